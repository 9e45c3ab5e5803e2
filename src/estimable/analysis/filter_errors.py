"""The true error of a given filter, whose model has fewer states or wrong noises, next to the sigma that it claims.

Letters: x+ = A x + g w, y = C x + V v the true model; A_f, C_f, .. that of the filter, with gain K from its own recursion, and M
the selection of its states. With the error e = M x - x^, without a difference of growing numbers (A. Gelb (ed.), Applied Optimal
Estimation, 1974, §7.2, in the coordinates (x, e)):

    e+ = (I - K C_f) A_f e + [(M A - A_f M) - K (C A - C_f A_f M)] x + (M - K C) g w - K V v
"""

from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..frozen import replace
from ..kernels.square_root_elements import lengths, lower
from ..models.state_space import StateSpace
from ..protocols import Algorithm, JumpingGains
from ..results import CovarianceQuestion
from .covariance_models import ArrayQuestion, ask
from .covariance_problem import Question, Stage

Real = np.ndarray
SETTLED = 1e-13  # relative change of every sigma in a step that ends a run without a horizon


class FilterCourse(NamedTuple):
    """After each sample: the true sigma (T, q) of the quantities by the filter, and the sigma that the filter claims."""

    sigma: Real
    claimed: Real


def of_filter(given: CovarianceQuestion, asked: ArrayQuestion) -> tuple[ArrayQuestion, Real]:
    """The question of the filter about its own model, and the selection of its states, both in scaled states."""
    faults = checks.Faults()
    algorithm: Any = given.filter
    model = algorithm.model if isinstance(algorithm, Algorithm) else algorithm
    plain = not isinstance(algorithm, JumpingGains) and isinstance(model, StateSpace)
    if not plain or not isinstance(given.model, StateSpace) or given.prior.diffuse is not None:
        faults.add(
            "`filter` must be a `Kalman` filter, or its `StateSpace`, and is compared with a linear model from a prior without "
            f"diffuse directions. Got {checks.short(given.filter)}."
        )
        faults.finish()
    if missing := [name for name in model.states if name not in asked.states]:
        faults.add(f"`filter` has states that the model does not have: {checks.listed(missing)}.")
    if model.outputs != asked.outputs:
        faults.add(f"`filter` must have the outputs of the model, {checks.listed(asked.outputs)}.")
    if asked.question.continuous:
        faults.add("`filter` works on samples: give `dt`, the step of this continuous model.")
    faults.finish()
    rows = [asked.states.index(name) for name in model.states]
    M = np.eye(len(asked.states))[rows]
    prior = given.prior.in_basis(M)
    changes = {"model": model, "prior": prior, "wanted": None, "requirement": None, "filter": None}
    dt = None if not model.is_continuous else given.dt or asked.question.dt
    own = ask(replace(given, **changes, dt=dt))
    return own, M * asked.question.size / own.question.size[:, None]


def filter_course(true: Question, filter: Question, M: Real, rows: int, *, settle: bool) -> FilterCourse:
    """Over `rows` samples, or until nothing changes. M (n_f, n) is in scaled states, as both questions are."""
    n, H = len(true.size), true.H
    H_f = H @ M.T  # of the filter's states, which M selects
    rest = H - H_f @ M
    x, e, S = true.L, M @ true.L, filter.L
    sigma, claimed = [], []
    for k in range(rows):
        one = true.stages(k - 1) if k else true.first
        two = filter.stages(k - 1) if k else filter.first
        if k:
            S = lower(np.hstack([two.A @ S, two.noise]))
        K, S = _gain(S, two)
        x, e = _moved(x, e, one, two, K, M, first=k == 0)
        sigma.append(lengths(rest @ x + H_f @ e))
        claimed.append(lengths(H_f @ S))
        if settle and k > n and np.all(np.abs(sigma[-1] - sigma[-2]) <= SETTLED * sigma[-1]):
            break
    return FilterCourse(np.array(sigma), np.array(claimed))


def _gain(S: Real, stage: Stage) -> tuple[Real, Real]:
    """K, and the factor after the sample."""
    p, n, V = len(stage.C), len(S), stage.sensors
    if p == 0:
        return np.zeros((n, 0)), S
    both = lower(np.vstack([np.hstack([V, stage.C @ S]), np.hstack([np.zeros((n, V.shape[1])), S])]))
    return np.linalg.solve(both[:p, :p].T, both[p:, :p].T).T, both[p:, p:]  # (K s) s^-1


def _moved(x: Real, e: Real, one: Stage, two: Stage, K: Real, M: Real, *, first: bool) -> tuple[Real, Real]:
    """Factors of (x, e) with common columns, after a step and the sample after it."""
    n, m = len(x), len(e)
    closed, V = np.eye(m) - K @ two.C, one.sensors
    if first:
        x_next, e_next = x, closed @ e - K @ (one.C - two.C @ M) @ x
        columns = np.vstack([np.zeros((n, V.shape[1])), -K @ V])
    else:
        through = (M @ one.A - two.A @ M) - K @ (one.C @ one.A - two.C @ two.A @ M)
        x_next, e_next = one.A @ x, closed @ (two.A @ e) + through @ x
        g = one.noise
        columns = np.hstack([np.vstack([g, (M - K @ one.C) @ g]), np.vstack([np.zeros((n, V.shape[1])), -K @ V])])
    both = lower(np.hstack([np.vstack([x_next, e_next]), columns]))
    return both[:n], both[n:]
