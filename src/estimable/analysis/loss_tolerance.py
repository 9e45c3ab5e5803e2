"""How many lost samples an estimator tolerates, before any data."""

from typing import Any

import numpy as np

from .. import checks
from ..errors import AssumptionError
from ..kernels.losses import stabilising_gain
from ..models.state_space import StateSpace
from ..results import LossTolerance
from .observability import observability

BISECTIONS = 20
EDGE = 1e-9  # how far inside the unit circle an eigenvalue must lie to count as stable
LARGEST = 30  # states: equations of n² unknowns are solved


def loss_tolerance(model: StateSpace) -> LossTolerance:
    """The arrival rate of samples below which the expected covariance of the estimate grows without bound.

    Model: x[k+1] = A x[k] + G w[k], y[k] = C x[k] + v[k]. The outputs of a sample arrive together or not at all. They arrive
    with probability λ, independently of other samples.

    The critical λ is known only as an interval. It is at least 1 - 1/ρ(A)², with ρ(A) the spectral radius. It is at most the
    smallest λ for which the modified Riccati equation X = A X A' + Q - λ (A X C' + N)(C X C' + R)^-1 (A X C' + N)' has a
    solution. Here Q is the covariance of G w and N its covariance with v. Both ends agree where a single sample determines
    the unstable part of the state. A stable A has no critical rate: the covariance stays bounded even if every sample is
    lost.

    Returns a `LossTolerance`. Its method `at(rate)` bounds the expected covariance at a given rate. Losses in bursts
    (a Gilbert-Elliott link) do more harm than independent losses of the same rate: simulate them.

    Cost: solutions of n² linear equations. Where no closed form applies, 20 bisections for the unstable part; the upper end
    is then rounded up, and a stabilising gain proves it.

    Raises `InputError` for a continuous or time-varying model, more than 30 states, or an R that is not positive definite;
    `AssumptionError` where no output shows an unstable direction, so that no rate is enough.

    Reference: B. Sinopoli and others, IEEE TAC 49 (2004) 1453-1464, Theorems 2-5; single output: N. Elia, Systems & Control
    Letters 54 (2005) 237-249.

    >>> found = loss_tolerance(StateSpace([[1.25]], Q=[[1.0]], R=[[1.0]], dt=1))
    >>> round(found.lower, 12), round(found.upper, 12), round(float(found.at(0.8).upper[0, 0]), 9)
    (0.36, 0.36, 2.793429649)
    """
    faults = checks.Faults()
    if not faults.instance("model", model, StateSpace):
        faults.finish()
    _check(model, faults)
    faults.finish()
    A, C = np.asarray(model.A), np.asarray(model.C)
    ρ = float(np.abs(np.linalg.eigvals(A)).max())
    if ρ < 1 - EDGE:
        return LossTolerance(0.0, 0.0, ρ, True, "A is stable: the estimate stays bounded at any loss rate.", model)
    seen = observability(model)
    if not seen.detectable:
        raise AssumptionError(f"no arrival rate is enough: {' '.join(seen.sentences)}")
    lower = max(1 - 1 / ρ**2, 0.0)
    upper = max(_upper(*_unstable(A, C), lower), lower)
    exact = upper - lower <= 1e-12
    sentence = f"The estimate stays bounded where more than {100 * upper:.4g} % of the samples arrive"
    below = "" if exact else f"; between {100 * lower:.4g} % and {100 * upper:.4g} % it is undecided"
    low = f"; it grows without bound where fewer than {100 * lower:.4g} % do" if lower else ""
    return LossTolerance(lower, upper, ρ, exact, f"{sentence}{low}{below}.", model)


def _check(model: StateSpace, faults: checks.Faults) -> None:
    if model.is_continuous:
        faults.add("`model` is continuous (dt = 0): but losses concern samples. Discretise it: model.discretise(dt).")
    if model.varying:
        faults.add("`model` varies in time: only a constant model has a critical arrival rate.")
    if model.n > LARGEST:
        faults.add(f"`model` must have at most {LARGEST} states. Got {model.n}.")
    if model.R is None:
        faults.add("`model` has no R: give the covariance of the measurement noise, StateSpace(..., R=...).")
    elif "R" not in model.varying:
        faults.positive_definite("R", np.asarray(model.R))


def _unstable(A: np.ndarray, C: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A and C on the part of the state that does not decay."""
    from scipy.linalg import schur

    parts: Any = schur(A, output="real", sort=lambda re, im=0.0: np.hypot(re, im) >= 1 - EDGE)
    T, Z, k = parts
    return T[:k, :k], C @ Z[:, :k]


def _upper(A: np.ndarray, C: np.ndarray, lower: float) -> float:
    """The least rate for which some gain bounds the expected covariance of the unstable part."""
    rank = np.linalg.matrix_rank(C, tol=1e-10 * np.abs(C).max())
    if rank == len(A):
        return lower
    most = 1 - 1 / np.abs(np.linalg.det(A)) ** 2
    if rank == 1:
        return float(most)
    n, p = len(A), len(C)
    enough, short = 1.0, lower
    for _ in range(BISECTIONS):
        middle = (enough + short) / 2
        found = stabilising_gain(A, C, np.eye(n), np.eye(p), np.zeros((n, p)), middle)
        enough, short = (middle, short) if found is not None else (enough, middle)
    return enough
