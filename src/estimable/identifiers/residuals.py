"""Are the residuals of a fit white, and is something of the inputs left in them?"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..data.record import Record
from ..diagnostics import cross_correlation, whiteness
from ..diagnostics.innovations import FEWEST, LAGS, Correlations
from ..errors import InputError
from ..results import Check

ADVICE = {
    "whiteness": "Something predictable is left: raise the orders, or take a method with another model of the noise.",
    "input-left": "An effect of the input is not in the model: raise nb, or look at the delay.",
}


def residual_checks(e: Sequence[np.ndarray], records: Sequence[Record]) -> list[Check]:
    """Whiteness of each output's standardised residuals one step ahead (T, p), and what is left of each input in them."""
    joined, inputs = side_by_side(e, records)
    if max(map(len, e)) <= LAGS + FEWEST:
        return []
    first, found = records[0], []
    for i, name in enumerate(first.outputs):
        found += _tried("whiteness", lambda i=i, name=name: whiteness(joined[:, i], name=name))
        for j, given in enumerate(first.inputs):
            found += _tried(
                "input-left",
                lambda i=i, j=j, name=name, given=given: cross_correlation(
                    joined[:, i], inputs[:, j], name=name, input_name=given
                ),
            )
    return found


def side_by_side(e: Sequence[np.ndarray], records: Sequence[Record]) -> tuple[np.ndarray, np.ndarray]:
    """Residuals and inputs of all records, one after the other, with as many unknown rows between as there are lags."""
    gap = ((0, LAGS), (0, 0))
    joined = np.concatenate([np.pad(one, gap, constant_values=np.nan) for one in e])
    inputs = np.concatenate([np.pad(r.applied(), gap, constant_values=np.nan) for r in records])
    return joined, inputs


def _tried(name: str, test: Callable[[], Any]) -> list[Check]:
    """A test as a check; none where there are too few samples to judge by."""
    try:
        found: Correlations = test()
    except InputError:
        return []
    told = found.sentence.split(": ")[0]
    sentence = f"Residuals one step ahead: {found.sentence}."
    if not found.passed:
        size = f"{found.statistic:.1f}, limit {found.limit:.1f}, most of it at lag {found.lag}"
        sentence = f"Residuals one step ahead: {told}: {size}. {ADVICE[name]}"
    return [Check(name, bool(found.passed), found.statistic, found.limit, sentence)]
