"""Covariances as unconstrained numbers: the free and the fixed ones of `fit_noise`."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array
from ..filters.unknown_gain import UnknownGain
from ..frozen import replace
from ..models.discretisation import over
from ..models.sampled import Clock, sample
from ..models.state_space import StateSpace
from ..protocols import Algorithm

Free: TypeAlias = str | Sequence[str] | Mapping[str, str | Sequence[bool] | None]  # covariances, and how each moves
WORDS = ("diagonal", "scale", "full")


class Part(NamedTuple):
    """One covariance: its field, its initial value, the free variances, and how they move.

    "diagonal": each free variance by itself, with fixed correlations; "scale": all by one factor; "full": every entry.
    """

    field: str
    start: np.ndarray
    channels: tuple[str, ...]
    kind: str
    free: tuple[int, ...]

    @property
    def size(self) -> int:
        """The number of its parameters."""
        k = len(self.free)
        return {"diagonal": k, "scale": 1, "full": k * (k + 1) // 2}[self.kind]

    @property
    def names(self) -> tuple[str, ...]:
        """The name of each parameter."""
        if self.kind == "scale":
            return (f"{self.field} scale",)
        if self.kind == "diagonal":
            return tuple(f"{self.field}[{self.channels[i]}]" for i in self.free)
        return tuple(
            f"{self.field}[{self.channels[i]}]" if i == j else f"{self.field}[{self.channels[i]}, {self.channels[j]}]"
            for i, j in self._pairs
        )

    @property
    def _pairs(self) -> list[tuple[int, int]]:
        return [(i, j) for i in range(len(self.channels)) for j in range(i + 1)]

    def begin(self) -> np.ndarray:
        """The initial parameters."""
        if self.kind != "full":
            return np.zeros(self.size)
        L = np.linalg.cholesky(self.start)
        return np.array([np.log(L[i, i]) if i == j else L[i, j] / np.sqrt(self.start[i, i]) for i, j in self._pairs])

    def matrix(self, θ: Array):
        """The covariance at θ: positive semidefinite for every θ."""
        if self.kind == "scale":
            return jnp.exp(2 * θ[0]) * self.start
        if self.kind == "diagonal":
            d = jnp.ones(len(self.start)).at[jnp.array(self.free)].set(jnp.exp(θ))
            return d[:, None] * self.start * d[None, :]
        L = jnp.zeros(self.start.shape)
        for at, (i, j) in enumerate(self._pairs):
            L = L.at[i, j].set(jnp.exp(θ[at]) if i == j else θ[at] * np.sqrt(self.start[i, i]))
        return L @ L.T

    def entries(self, θ: Array):
        """The entries of the covariance (or its scale) at θ, in the order of `names`."""
        if self.kind == "scale":
            return jnp.exp(2 * θ[:1])
        M = self.matrix(θ)
        pairs = [(i, i) for i in self.free] if self.kind == "diagonal" else self._pairs
        return jnp.stack([M[i, j] for i, j in pairs])


def parts(algorithm: Algorithm[Any], free: Free, faults: checks.Faults) -> list[Part]:
    """The free covariances, checked."""
    model: StateSpace = algorithm.model
    noises = (
        model.states
        if np.array_equal(model.G, np.eye(model.n))
        else tuple(f"w{i + 1}" for i in range(model.Q.shape[-1]))
    )
    there = {"Q": (model.Q, noises), "R": (model.R, model.outputs)}
    if isinstance(algorithm, UnknownGain):
        there["walk"] = (algorithm.walk, algorithm.names.gains)
    if not isinstance(free, dict | str) and not (
        isinstance(free, list | tuple | set | frozenset) and all(isinstance(one, str) for one in free)
    ):
        faults.add(f"`free` must name covariances: {checks.listed(there)}. Got {checks.short(free)}.")
        return []
    words = free if isinstance(free, dict) else dict.fromkeys([free] if isinstance(free, str) else free)
    found = []
    for field, how in words.items():
        if field not in there:
            faults.add(
                f"`free` must name covariances: {checks.listed(there)}. Got {field!r}.{checks.suggestion(field, there)}"
            )
            continue
        start, channels = there[field]
        part = _part(field, start, channels, how, faults)
        if part is not None:
            found.append(part)
    if not words:
        faults.add("`free` is empty: name at least one covariance to fit.")
    return found


def _part(
    field: str,
    start: np.ndarray | None,
    channels: tuple[str, ...],
    how: str | Sequence[bool] | None,
    faults: checks.Faults,
) -> Part | None:
    if start is None or np.ndim(start) != 2:
        faults.add(
            f"`{field}` must be a single matrix to be fitted: it {'is not given' if start is None else 'varies in time'}."
        )
        return None
    start = np.asarray(start, float)
    k, free = len(start), range(len(start))
    if how is None:
        how = "diagonal" if np.array_equal(start, np.diag(np.diag(start))) else "full"
    if not isinstance(how, str):
        mask = np.asarray(how)
        if mask.shape != (k,) or mask.dtype != bool or not mask.any():
            faults.add(
                f"`free[{field!r}]` must be one of {checks.listed(WORDS)}, or {k} bools, one per variance. "
                f"Got {checks.short(how)}."
            )
            return None
        how, free = "diagonal", np.flatnonzero(mask)
    elif how not in WORDS:
        faults.choice(f"free[{field!r}]", how, WORDS)
        return None
    zero = [channels[i] for i in free if start[i, i] == 0]
    if (how == "diagonal" and zero) or not start.any():
        faults.add(
            f"`{field}` starts from a variance of zero for {checks.listed(zero)}, which cannot be scaled: start from a "
            f"small one, or leave it out with free={{{field!r}: [True, False, ..]}}."
        )
        return None
    if how == "full" and np.linalg.eigvalsh(start)[0] <= 1e-12 * np.abs(start).max():
        faults.add(
            f"`{field}` must be positive definite to be fitted in full: start from a covariance without zero eigenvalues."
        )
        return None
    return Part(field, start, channels, how, tuple(int(i) for i in free))


def noise_of(model: StateSpace, clock: Clock):
    """A function of (Q, R) that returns V, Ω, W of the sampled model, differentiable by JAX."""
    if not model.is_continuous:

        def discrete(Q: Array, R: Array):
            sampled = sample(replace(model, Q=model.Q if Q is None else Q, R=model.R if R is None else R), clock)
            return sampled.V, sampled.Ω, sampled.W

        return discrete
    from ..kernels.small import factors

    q = model.Q.shape[-1]
    lengths = np.atleast_1d(clock.lengths)
    units = np.eye(q * q).reshape(q, q, q, q)
    basis = np.stack(
        [np.stack([over(model.A, model.B, _symmetric(model.G @ units[i, j] @ model.G.T), lengths, hold="zero_order")[3]
                   for j in range(q)]) for i in range(q)]
    )  # fmt: skip
    one = len(lengths) == 1

    def continuous(Q: Array, R: Array):
        Q, R = (jnp.asarray(given if M is None else M) for M, given in ((Q, model.Q), (R, model.R)))
        W = factors(jnp.einsum("ij,ijkab->kab", Q, basis))
        return factors(R), None, W[0] if one else W

    return continuous


def _symmetric(M: np.ndarray) -> np.ndarray:
    return (M + M.T) / 2
