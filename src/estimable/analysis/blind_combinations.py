"""Shifts of the state that look the same to the outputs, and certificates of the structure."""

import numpy as np

from ..errors import EstimableError
from ..kernels import canonical_correlations as correlations
from ..kernels import square_root_elements as el
from ..kernels.canonical_correlations import StateFactors
from ..kernels.echelon import echelon
from ..kernels.growth_frame import growth_frame
from . import covariance_courses as courses
from .covariance_models import ArrayQuestion
from .observability import observability

Real = np.ndarray
MOST_STEPS = 1000  # followed one by one for the correlations; beyond, they come from the factors at the end
SMALL = 0.1  # of the sigma of a state: smaller shifts are not worth a sentence
GROWTH = 1e7  # condition of Π in units of its own diagonal, up to which the factors at the end are accurate


def blind(asked: ArrayQuestion, found: courses.Spreads) -> tuple[Real, Real, Real]:
    """Shifts (r, n) in the user's units, the share of sigma left along each, and all squared correlations."""
    question, learnt = asked.question, 0.01
    size = question.size
    F, N, _ = el.state_error(found.belief)
    if question.D.shape[1]:
        shifts = echelon(size[:, None] * N).T
        return shifts, np.ones(len(shifts)), np.zeros(0)
    pairs = _pairs(asked, found, F)
    if pairs is None:
        return np.zeros((0, len(size))), np.zeros(0), np.zeros(0)
    σ = el.lengths(el.lower(found.alone.Φ) if not found.alone.S.size else np.hstack([found.alone.S, found.alone.Φ]))
    σ = np.where(σ > 0, σ, 1.0)
    left = np.sqrt(pairs.left)
    hidden = left >= 1 - learnt
    V = pairs.v[:, hidden] / σ[:, None]
    shifts = echelon(V)
    shifts = shifts / np.linalg.norm(np.linalg.lstsq(V, shifts)[0], axis=0)  # one sigma along each, as along V
    large = np.abs(shifts).max(axis=0, initial=0.0) >= SMALL
    return (shifts[:, large] * (size * σ)[:, None]).T, left[hidden][large], pairs.squared


def _pairs(asked: ArrayQuestion, found: courses.Spreads, F: Real) -> correlations.Pairs | None:
    """The canonical pairs at the end, in scaled states; None where growth has hidden them in rounding."""
    question, steps = asked.question, found.steps[-1]
    if not question.continuous and not asked.noise_free and steps <= MOST_STEPS:
        return _followed(asked, steps)
    alone = np.hstack([found.alone.S, found.alone.Φ])
    if not np.all(np.isfinite(alone)):
        return None
    L = el.lower(alone)
    unit = el.lengths(L)
    if not unit.any():
        return None
    if np.linalg.cond(L[unit > 0] / unit[unit > 0, None]) > GROWTH:
        return None
    pairs = correlations.pairs(StateFactors(L, F, np.zeros((len(L), 0))))
    return pairs._replace(squared=1 - pairs.left)


def _followed(asked: ArrayQuestion, steps: int) -> correlations.Pairs:
    """Sample by sample, in a frame in which slow growth is not hidden by fast growth: A_k Q_k = Q_{k+1} R_k."""
    question = asked.question
    n = len(question.first.A)
    Q, T = growth_frame(question.first.A) if question.constant else (np.eye(n), np.eye(n))
    L = el.lower(Q.T @ question.L)
    factors = StateFactors(L, L, np.zeros((n, 0)))
    for k in range(steps + 1):
        stage = question.first
        if k:
            stage = question.stages(k - 1)
            if not question.constant:
                Q, T = np.linalg.qr(stage.A @ Q)
            factors = correlations.moved(factors, T, Q.T @ stage.noise)
        factors = correlations.corrected(factors, stage.C @ Q, stage.sensors)
    pairs = correlations.pairs(factors)
    return pairs._replace(g=Q @ pairs.g, v=Q @ pairs.v, known=Q @ pairs.known)


def certificates(asked: ArrayQuestion) -> tuple[int | None, float | None]:
    """The rank of what noise-free outputs show, and the distance to a model that hides a direction."""
    if not asked.question.constant or len(asked.states) > asked.model.n:
        return None, None
    try:
        seen = observability(asked.model)
    except EstimableError:  # too many states
        return None, None
    return asked.model.n - len(seen.directions), float(seen.distance)
