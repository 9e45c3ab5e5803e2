"""Tests of the residuals of a fit: whiteness, and correlation with the inputs."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..data.record import Record
from ..diagnostics import cross_correlation, whiteness
from ..diagnostics.feedback import is_white
from ..diagnostics.innovations import FEWEST, LAGS, Correlations
from ..errors import InputError
from ..results import Check

ADVICE = {
    "whiteness": "The residuals are predictable: raise the orders, or use a method with another noise model.",
    "input-left": "The model lacks an effect of the input: raise nb, or check the delay.",
}


def residual_checks(
    e: Sequence[np.ndarray], records: Sequence[Record], coloured: str = "", *, direct: bool
) -> list[Check]:
    """Whiteness of each output's standardised one-step residuals (T, p), and their correlation with each input.

    `coloured`: what predictable residuals mean for a method, in place of the general advice. `direct`: whether the model lets an
    input act in its own row. Where it does not, and an input depends on its own past, as in a loop, the same row does not count:
    the input may have been computed from that output.
    """
    joined, inputs = side_by_side(e, records)
    if max(map(len, e)) <= LAGS + FEWEST:
        return []
    first, found = records[0], []
    lags = [first_lag(u, direct) for u in inputs.T]
    for i, name in enumerate(first.outputs):
        found += _tried(
            coloured or ADVICE["whiteness"], "whiteness", lambda i=i, name=name: whiteness(joined[:, i], name=name)
        )
        for j, given in enumerate(first.inputs):
            found += _tried(
                ADVICE["input-left"],
                "input-left",
                lambda i=i, j=j, name=name, given=given: cross_correlation(
                    joined[:, i], inputs[:, j], name=name, input_name=given, first=lags[j]
                ),
            )
    return found


def first_lag(u: np.ndarray, direct: bool) -> int:
    """The smallest lag at which an input (T,) must not be correlated with the residuals of a right model."""
    return 0 if direct or is_white(u) else 1


def side_by_side(e: Sequence[np.ndarray], records: Sequence[Record]) -> tuple[np.ndarray, np.ndarray]:
    """Residuals and inputs of all records, one after the other, separated by as many missing rows as there are lags."""
    gap = ((0, LAGS), (0, 0))
    joined = np.concatenate([np.pad(one, gap, constant_values=np.nan) for one in e])
    inputs = np.concatenate([np.pad(r.applied(), gap, constant_values=np.nan) for r in records])
    return joined, inputs


def _tried(advice: str, name: str, test: Callable[[], Any]) -> list[Check]:
    """A test as a check, with advice where it fails; no check where there are too few samples."""
    try:
        found: Correlations = test()
    except InputError:
        return []
    sentence = f"Residuals of one-step predictions: {found.sentence}."
    if not found.passed:
        verdict = found.sentence.split(": ")[0]
        sentence = f"Residuals of one-step predictions: {verdict}. {advice}"
    return [Check(name, bool(found.passed), found.statistic, found.limit, sentence)]
