"""Whether control lowers a quadratic cost from every state."""

from typing import Any

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..models.state_space import StateSpace
from ..results import Regulability
from .assessment import assess
from .estimability import moments_of, read_horizon, start_of
from .moments import Problem
from .tolerance import check_size


def regulability(
    model: StateSpace, L: Numbers, M: Numbers, *, horizon: float | None = None, terminal: Numbers | None = None
) -> Regulability:
    """Whether the optimal control has a strictly lower cost than no control, from every initial state.

    The cost is Σ x'L x + u'M u (in continuous time the integral) plus x'Ψ x at the end of a horizon. L (n, n) and M (m, m)
    are symmetric, and M is positive definite. Either may have a leading axis of time. The problem is the dual of
    `estimability`: the matrices of the model are transposed, L replaces Q, M replaces R, and time is reversed.

    `horizon`: the number of steps (seconds where dt = 0). None: no limit, which needs a stable model; a model that varies in
    time is judged over its rows. `terminal` (n, n): the weight Ψ at the end of a horizon. None: the stationary cost without
    control where it exists, otherwise L.

    Returns a `Regulability`. Raises `AssumptionError` for an unstable model without a horizon; `InputError` for weights of a
    wrong shape or sign, a model without inputs, and for more than 500 states.

    Cost: that of `estimability`.

    Reference: Y. Baram, T. Kailath, NASA TM-89427 (1987), Theorem 3.1, Corollaries 3.1-3.3. We correct the source, in its
    notation: the pair of Corollary 3.1 is (F', F'S) instead of (F', S), L is that at k+1 in (3.6), and (3.10) and (3.11) need
    an inverse.

    >>> idle = StateSpace([[0.0]], [[1.0]], dt=1)
    >>> regulability(idle, [[1.0]], [[1.0]]).regulable  # the state is gone before control can act on it
    False
    """
    faults = checks.Faults()
    weights = None
    if faults.instance("model", model, StateSpace):
        horizon = read_horizon(model, horizon, faults)
        check_size(model.n, faults, steps=0 if horizon is None or model.is_continuous else int(horizon))
        weights = _read_weights(model, L, M, terminal, faults)
        _check_rows(weights, horizon, model, faults)
    faults.finish()
    assert weights is not None
    state, control, end = weights
    steps = None if horizon is None or model.is_continuous else int(horizon)
    problem = dual(model, state, control, steps)
    if horizon is not None and end is None:
        end = start_of(problem, model.is_continuous, otherwise=problem.at(0).Q)
    moments = moments_of(problem, end, horizon, model.is_continuous)
    return Regulability(**assess(moments), states=model.states, inputs=model.inputs, horizon=horizon)


def dual(model: StateSpace, L: np.ndarray, M: np.ndarray, steps: int | None = None) -> Problem:
    """The dual estimation problem: matrices transposed, and time reversed from `steps` on."""

    def turned(X: np.ndarray):
        return np.swapaxes(X if X.ndim == 2 else X[:steps][::-1], -1, -2)

    return Problem(turned(model.A), turned(L), turned(model.B), turned(M), np.zeros((model.n, model.m)))


def _check_rows(weights: tuple | None, horizon: float | None, model: StateSpace, faults: checks.Faults) -> None:
    """Check that weights that vary in time have a row for each step of the horizon, as a model that varies has."""
    for name, weight in zip(("L", "M"), weights[:2] if weights else (), strict=False):
        too_long = horizon is None or model.is_continuous or horizon > len(weight)
        if weight.ndim == 3 and model.steps is None and too_long:
            faults.add(
                f"`{name}` varies over {len(weight)} rows: give a discrete model and a `horizon` of at most these steps."
            )


def _read_weights(model: StateSpace, L: Numbers, M: Numbers, terminal: Numbers | None, faults: checks.Faults) -> Any:
    """L, M and the terminal weight; None where one is invalid."""
    for axis in ("n", "m"):
        size = getattr(model, axis)
        faults.learn(axis, size, f"the model has {checks.counted(size, 'state' if axis == 'n' else 'input')}")
    if model.steps is not None:
        faults.learn("T", model.steps, f"the model has {model.steps} rows in time")
    if model.m == 0:
        faults.add("`model` has no input: give B, StateSpace(A, B, ...).")
        return None
    state, control = faults.covariance("L", L, "n n", leading="T"), faults.covariance("M", M, "m m", leading="T")
    end = None if terminal is None else faults.covariance("terminal", terminal, "n n")
    if control is not None:
        for each in control.reshape(-1, model.m, model.m):
            if not faults.positive_definite("M", each):
                break
    return None if state is None or control is None else (state, control, end)
