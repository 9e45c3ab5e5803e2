"""A question of covariance analysis in the units of its own quantities: steps as arrays, noises by source, the prior by factors.

States are scaled by powers of two near their prior sigma (where that is 0 or infinite: the requirement, else what the noise
makes of them, else what the outputs can show of them). Ranks and directions are decided in these units, so that the user's
do not matter.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..kernels.step_factors import noise_factors, semidefinite_factor
from ..models.prior import Prior

Real = np.ndarray


class Stage(NamedTuple):
    """x+ = A x + Σ g_i w_i, and the sample after it, y = C x+ + Σ V_i v_i: the noises by source."""

    A: Real
    g: list[Real]
    C: Real
    V: list[Real]

    @property
    def noise(self) -> Real:
        """All g side by side."""
        return np.hstack([np.zeros((len(self.A), 0)), *self.g])

    @property
    def sensors(self) -> Real:
        """All V side by side."""
        return np.hstack([np.zeros((len(self.C), 0)), *self.V])


class Question(NamedTuple):
    """`stage` for a constant model, `stages` (row k leads from y[k] to y[k+1]) for another; the first sample has C and V of
    `first`. For a continuous model whose R is a density, V are factors of densities, and `continuous` is True.

    The prior has covariance L L' and diffuse directions D. H x are the quantities in the user's units, `size` the unit of each
    state, `dt` the time of a step, `noise_names` and `sensor_names` those of the sources.
    """

    first: Stage
    stages: Callable[[int], Stage]
    constant: bool
    continuous: bool
    L: Real
    D: Real
    H: Real
    size: Real
    dt: float
    noise_names: tuple[str, ...]
    sensor_names: tuple[str, ...]

    @property
    def sources(self) -> tuple[str, ...]:
        """The names of the sources, the prior last."""
        return (*self.noise_names, *self.sensor_names, "prior")


def blocks(covariance: Real) -> list[list[int]]:
    """Indices of channels whose noises are correlated; the last two axes are those of the channels."""
    joined = np.any(np.abs(covariance.reshape(-1, *covariance.shape[-2:])) > 0, axis=0)
    left, found = list(range(len(joined))), []
    while left:
        group, new = [], [left[0]]
        while new:
            i = new.pop()
            if i in left:
                left.remove(i)
                group.append(i)
                new += [j for j in left if joined[i, j]]
        found.append(sorted(group))
    return found


def factors(covariance: Real, groups: list[list[int]]) -> list[Real]:
    """A factor of each block, in the rows of all channels."""
    found = []
    for group in groups:
        half = semidefinite_factor(covariance[np.ix_(group, group)])
        whole = np.zeros((len(covariance), half.shape[1]))
        whole[group] = half
        found.append(whole)
    return found


def noise_name(G: Real, group: list[int], states: tuple[str, ...]) -> str:
    """ "process noise of v" where a source enters one state, else by its number."""
    moved = np.flatnonzero(np.abs(G[:, group]).max(axis=1, initial=0.0))
    if len(moved) == 1:
        return f"process noise of {states[moved[0]]}"
    return f"process noise {', '.join(str(i + 1) for i in group)}"


def units(prior: Prior, wanted: Real, floor: Callable[[], tuple[Real, Real]]) -> Real:
    """The unit of each state: a power of two near its prior sigma, else `wanted`, else by `floor`: noise, information."""
    σ = np.sqrt(np.diagonal(prior.covariance))
    if prior.diffuse is not None:
        σ = np.where(np.abs(prior.diffuse).max(axis=1) > 0, 0.0, σ)
    size = np.where(σ > 0, σ, wanted)
    if np.any(size <= 0):
        by_noise, by_information = floor()
        size = np.where(size > 0, size, np.where(by_noise > 0, by_noise, by_information))
    return 2.0 ** np.round(np.log2(np.where((size > 0) & np.isfinite(size), size, 1.0)))


def floors(A: Real, g: Real, C: Real, V: Real, prior: Prior, *, continuous: bool = False) -> tuple[Real, Real]:
    """What noise and prior make of each state within n steps, and the sigma to which the outputs of n steps could show it alone.

    A continuous model takes steps of its fastest time constant.
    """
    n = len(A)
    if continuous:
        τ = 1 / (np.abs(np.linalg.eigvals(A)).max(initial=0.0) or 1.0)
        A, (g,) = noise_factors(A, [g], τ)
        V = V / np.sqrt(τ)
    start = semidefinite_factor(prior.covariance)
    if prior.diffuse is not None:
        start = start[:, :0]
    moved, shown, L, Φ = np.zeros(n), np.zeros(n), np.hstack([g, start]), np.eye(n)
    noise = np.sqrt(np.sum(V**2, axis=1))
    for _ in range(n):
        moved = moved + np.sum(L**2, axis=1)
        E = C @ Φ / np.where(noise > 0, noise, 1.0)[:, None]
        shown = shown + np.sum(E**2, axis=0)
        L, Φ = A @ L, A @ Φ
    with np.errstate(divide="ignore"):
        return np.sqrt(moved), np.where(shown > 0, 1 / np.sqrt(np.where(shown > 0, shown, 1.0)), 0.0)


def prior_factors(prior: Prior, size: Real) -> tuple[Real, Real]:
    """L and D in scaled units; L without its part along D, where the variance is infinite anyway."""
    L = semidefinite_factor(prior.covariance / size[:, None] / size)
    if prior.diffuse is None:
        return L, np.zeros((len(size), 0))
    D = np.linalg.qr(prior.diffuse / size[:, None])[0]
    L = L - D @ (D.T @ L)
    kept = np.linalg.norm(L, axis=0) > 1e-14
    return L[:, kept], D


def scaled(stage: Stage, size: Real) -> Stage:
    """The stage in scaled states."""
    return Stage(stage.A * (size / size[:, None]), [g / size[:, None] for g in stage.g], stage.C * size, stage.V)
