"""How any linear model stands to a record: simulated, and predicted one step ahead; are the residuals white, is input left?"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..data.record import Record
from ..diagnostics import cross_correlation, standardised, whiteness
from ..diagnostics.innovations import FEWEST, LAGS, Correlations
from ..errors import InputError
from ..kernels.innovations_form import System, initial_state, predictions, response
from ..models.state_space import StateSpace
from ..results import Check, Validation
from .validation import fit_percent

ADVICE = {
    "whiteness": "Something predictable is left: raise the orders, or take a method with another model of the noise.",
    "input-left": "An effect of the input is not in the model: raise nb, or look at the delay.",
}


class Standing(NamedTuple):
    """Outputs minus the model's, (T, p), NaN where not seen: simulated from the inputs alone, predicted from the sample before.

    `standardised`: the second over their standard deviations, (T, p).
    """

    simulated: np.ndarray
    one_step: np.ndarray
    standardised: np.ndarray


def state_space_of(model: Any) -> StateSpace:
    """A model of any kind as a state-space model."""
    return model if isinstance(model, StateSpace) else model.to_state_space()


def standing(model: StateSpace, record: Record, rows: int | None = None) -> Standing:
    """How a discrete model stands to a record.

    The state at row 0 is that from which the simulation is nearest to the first `rows` rows (None: all): what comes after
    them is not looked at by the simulation. Inputs that are not known count as the value before.
    """
    system = system_of(model)
    u, y = held(record.applied()), record.y
    if model.operating_point is not None:
        u, y = u - model.operating_point.inputs, y - model.operating_point.outputs
    x = initial_state(system, u[:rows], y[:rows])
    simulated, _ = response(system, u, x)
    predicted, V, _ = predictions(system, u, y, x, np.zeros((len(x), len(x))))
    return Standing(y - simulated, y - predicted, standardised(y - predicted, V))


def system_of(model: StateSpace) -> System:
    """The matrices of a model that does not vary, the noise as it enters the state."""
    G, S = np.asarray(model.G), model.S
    cross = np.zeros((model.n, model.p)) if S is None else G @ S
    Q = np.zeros((model.n, model.n)) if model.Q is None else G @ model.Q @ G.T
    return System(model.A, model.B, model.C, model.D, Q, model.R, cross)


def held(u: np.ndarray) -> np.ndarray:
    """The inputs, and where they are not known the value before (0 at the start)."""
    rows = np.maximum.accumulate(np.where(np.isnan(u), 0, np.arange(len(u))[:, None]), axis=0)
    return np.nan_to_num(np.take_along_axis(u, rows, axis=0))


def validation_of(model: Any, records: Sequence[Record], extra: Sequence[Check] = ()) -> Validation:
    """How a model stands to the records it was fitted to: residuals are those of the simulation."""
    found = [standing(state_space_of(model), record) for record in records]
    residuals, one_step = tuple(one.simulated for one in found), tuple(one.one_step for one in found)
    white = residual_checks([one.standardised for one in found], records)
    return Validation(
        residuals, fit_percent(residuals, records), (*extra, *white), fit_percent(one_step, records), one_step
    )


def residual_checks(e: Sequence[np.ndarray], records: Sequence[Record]) -> list[Check]:
    """Whiteness of each output's standardised residuals one step ahead, and what is left of each input in them."""
    first, gap = records[0], LAGS
    if max(map(len, e)) <= LAGS + FEWEST:
        return []
    joined = np.concatenate([np.pad(one, ((0, gap), (0, 0)), constant_values=np.nan) for one in e])
    inputs = np.concatenate([np.pad(r.applied(), ((0, gap), (0, 0)), constant_values=np.nan) for r in records])
    found = []
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


def _tried(name: str, test: Any) -> list[Check]:
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
