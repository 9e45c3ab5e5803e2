"""Covariances as unconstrained numbers: the free and the fixed ones of `fit_noise`."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from .. import checks
from ..models.markov_disturbance import Disturbance
from ..models.state_space import StateSpace
from ..protocols import Algorithm, GainAlgorithm

Free: TypeAlias = str | Sequence[str] | Mapping[str, str | Sequence[bool] | None]  # covariances, and how each moves
WORDS = ("diagonal", "scale", "full")


class Part(NamedTuple):
    """One covariance: its field, its initial value, the free variances, and how they move.

    "diagonal": each free variance by itself, with fixed correlations; "scale": all by one factor; "full": every entry, or
    those of `blocks`. A covariance (T, k, k) that varies in time has factors instead of entries.
    """

    field: str
    start: np.ndarray
    channels: tuple[str, ...]
    kind: str
    free: tuple[int, ...]
    noises: int | None = None  # of "Q, S, R" as one covariance: the size of Q
    blocks: np.ndarray | None = None  # (k, k): the free entries of "full"; None: all

    @property
    def varies(self) -> bool:
        """Whether it varies in time."""
        return self.start.ndim == 3

    @property
    def size(self) -> int:
        """The number of its parameters."""
        return {"diagonal": len(self.free), "scale": 1, "full": len(self._pairs)}[self.kind]

    @property
    def names(self) -> tuple[str, ...]:
        """The name of each parameter."""
        if self.kind == "scale":
            return (f"{self.field} scale",)
        if self.kind == "diagonal":
            scale = " scale" if self.varies else ""
            return tuple(f"{self.field}{scale}[{self.channels[i]}]" for i in self.free)
        return tuple(self._name(i, j) for i, j in self._pairs)

    def _name(self, i: int, j: int) -> str:
        a, b, q = self.channels[i], self.channels[j], self.noises
        if q is not None and i >= q > j:
            return f"S[{b}, {a}]"
        field = self.field if q is None else "Q" if i < q else "R"
        return f"{field}[{a}]" if i == j else f"{field}[{a}, {b}]"

    @property
    def _pairs(self) -> list[tuple[int, int]]:
        return [(i, j) for i in self.free for j in self.free if j <= i and (self.blocks is None or self.blocks[i, j])]

    @property
    def logarithms(self) -> np.ndarray:
        """Whether each parameter is the logarithm of a standard deviation: (size,)."""
        return np.array([i == j for i, j in self._pairs]) if self.kind == "full" else np.ones(self.size, bool)

    @property
    def may_vanish(self) -> np.ndarray:
        """Whether each parameter is that of a variance that may be zero: (size,)."""
        return np.full(self.size, self.kind != "full")

    def undetermined(self, zero: np.ndarray) -> np.ndarray:
        """The parameters that have no effect where those of `zero` are zero: (size,)."""
        return zero

    def begin(self) -> np.ndarray:
        """The initial parameters."""
        if self.kind != "full":
            return np.zeros(self.size)
        L, among = np.zeros(self.start.shape), np.ix_(self.free, self.free)
        L[among] = np.linalg.cholesky(self.start[among])
        return np.array([np.log(L[i, i]) if i == j else L[i, j] / np.sqrt(self.start[i, i]) for i, j in self._pairs])

    def matrix(self, θ: np.ndarray) -> np.ndarray:
        """The covariance at θ, which may be complex: positive semidefinite for every real θ."""
        if self.kind == "scale":
            return np.exp(2 * θ[0]) * self.start
        if self.kind == "diagonal":
            d = np.ones(self.start.shape[-1], θ.dtype)
            d[list(self.free)] = np.exp(θ)
            return d[:, None] * self.start * d[None, :]
        L = np.zeros(self.start.shape, θ.dtype)
        for at, (i, j) in enumerate(self._pairs):
            L[i, j] = np.exp(θ[at]) if i == j else θ[at] * np.sqrt(self.start[i, i])
        fixed = self.start * ~np.isin(np.arange(len(L)), self.free)[:, None]
        return fixed + L @ L.T

    def covariances(self, θ: np.ndarray) -> dict[str, np.ndarray]:
        """The covariances of the model at θ, by field."""
        M, q = self.matrix(θ), self.noises
        return {self.field: M} if q is None else {"Q": M[:q, :q], "S": M[:q, q:], "R": M[q:, q:]}

    def entries(self, θ: np.ndarray) -> np.ndarray:
        """The entries of the covariance (or its scale) at θ, in the order of `names`."""
        if self.kind == "scale" or self.varies:
            return np.exp(2 * θ)
        M = self.matrix(θ)
        pairs = [(i, i) for i in self.free] if self.kind == "diagonal" else self._pairs
        return np.stack([M[i, j] for i, j in pairs])


class DisturbancePart(NamedTuple):
    """The densities and the time constants of the disturbances of a model (`markov_disturbance`), each by its own factor.

    The parameters are half the logarithm of each density, or the logarithm of the standard deviation of an offset, and then the
    logarithm of each time constant.
    """

    start: Disturbance
    channels: tuple[str, ...]

    @property
    def _moving(self) -> np.ndarray:
        """Those with a time constant."""
        return np.flatnonzero(~self.start.is_offset)

    @property
    def size(self) -> int:
        """The number of its parameters."""
        return len(self.channels) + len(self._moving)

    @property
    def names(self) -> tuple[str, ...]:
        """The name of each parameter."""
        densities = (f"density[{name}]" for name in self.channels)
        return (*densities, *(f"time_constant[{self.channels[i]}]" for i in self._moving))

    @property
    def logarithms(self) -> np.ndarray:
        """All are logarithms."""
        return np.ones(self.size, bool)

    @property
    def may_vanish(self) -> np.ndarray:
        """The densities may be zero."""
        return np.arange(self.size) < len(self.channels)

    def undetermined(self, zero: np.ndarray) -> np.ndarray:
        """Without a density, its time constant has no effect."""
        count = len(self.channels)
        return np.concatenate([zero[:count], zero[:count][self._moving]])

    def begin(self) -> np.ndarray:
        """The initial parameters."""
        return np.zeros(self.size)

    def covariances(self, θ: np.ndarray) -> dict[str, Any]:
        """The time constants and densities at θ, which may be complex."""
        power = np.where(self.start.is_offset, 1, 2)
        time_constant = np.asarray(self.start.time_constant).astype(θ.dtype)
        time_constant[self._moving] *= np.exp(θ[len(self.channels) :])
        return {"disturbance": (time_constant, self.start.density * np.exp(θ[: len(self.channels)]) ** power)}

    def entries(self, θ: np.ndarray) -> np.ndarray:
        """The densities, and then the time constants."""
        time_constant, density = self.covariances(θ)["disturbance"]
        return np.concatenate([density, time_constant[self._moving]])


def _there(algorithm: Algorithm[Any]) -> dict[str, tuple[Any, tuple[str, ...]]]:
    """The covariances that can be fitted, with the names of their channels."""
    inner, model = algorithm.innermost, algorithm.innermost.model
    noises = (
        model.states
        if model.G is not None and np.array_equal(model.G, np.eye(model.n))
        else tuple(f"w{i + 1}" for i in range(model.Q.shape[-1]))
    )
    disturbance = model.disturbance if isinstance(model, StateSpace) else None
    own = len(noises) - (
        0 if disturbance is None else len(disturbance.at)
    )  # the noises of disturbances are not among Q
    there: dict[str, Any] = {"Q": (model.Q[..., :own, :own], noises[:own]), "R": (model.R, model.outputs)}
    if isinstance(model, StateSpace) and not model.is_continuous:
        there["S"] = (model.S, noises[:own])
    if disturbance is not None and not disturbance.discretised:
        there["disturbance"] = (disturbance, model.states[-len(disturbance.at) :])
    if isinstance(inner, GainAlgorithm) and inner.gain is not None:
        there["walk"] = (getattr(inner, "walk", None), inner.names.gains)
    return there


def parts(algorithm: Algorithm[Any], free: Free, faults: checks.Faults) -> list[Part | DisturbancePart]:
    """The free covariances, checked."""
    there, model = _there(algorithm), algorithm.innermost.model
    if not isinstance(free, dict | str) and not (
        isinstance(free, list | tuple | set | frozenset) and all(isinstance(one, str) for one in free)
    ):
        faults.add(f"`free` must name covariances: {checks.listed(there)}. Got {checks.short(free)}.")
        return []
    words = free if isinstance(free, dict) else dict.fromkeys([free] if isinstance(free, str) else free)
    found: list[Part | DisturbancePart | None] = []
    if "S" in words and "S" in there:
        found.append(_joint(model, there["Q"][1], words, faults))
        words = {field: how for field, how in words.items() if field not in "QRS"}
    for field, how in words.items():
        if field not in there:
            faults.add(
                f"`free` must name covariances: {checks.listed(there)}. Got {field!r}.{checks.suggestion(field, there)}"
            )
            continue
        start, channels = there[field]
        if field == "disturbance":
            found.append(DisturbancePart(start, channels))
            continue
        part = _part(field, start, channels, how, faults)
        if part is not None:
            found.append(part)
    if not words and not found:
        faults.add("`free` is empty: name at least one covariance to fit.")
    return [part for part in found if part is not None]


def _joint(model: StateSpace, noises: tuple[str, ...], words: Mapping[str, Any], faults: checks.Faults) -> Part | None:
    """Q, S and R as one covariance: with less, some trial would not be positive semidefinite."""
    if not {"Q", "R"} <= set(words):
        faults.add('`free`: the cross noise S is fitted together with Q and R: free=("Q", "R", "S").')
        return None
    if model.varying and {"Q", "R", "S"} & set(model.varying):
        faults.add("`Q`, `R` and `S` must be constant to be fitted together. In this model one of them varies in time.")
        return None
    own = len(noises)
    S = np.zeros((own, model.p)) if model.S is None else np.asarray(model.S)[:own]
    start = np.block([[np.asarray(model.Q)[:own, :own], S], [S.T, np.asarray(model.R)]])
    if np.linalg.eigvalsh(start)[0] <= 1e-12 * np.abs(start).max():
        faults.add(
            "The joint covariance of `Q`, `S` and `R` must be positive definite to be fitted. "
            "Start from larger variances in Q and R."
        )
        return None
    channels = (*noises, *model.outputs)
    return Part("Q, S, R", start, channels, "full", tuple(range(len(channels))), len(noises))


def _part(
    field: str,
    start: np.ndarray | None,
    channels: tuple[str, ...],
    how: str | Sequence[Any] | None,
    faults: checks.Faults,
) -> Part | None:
    """One covariance as parameters; None with a fault."""
    if start is None:
        faults.add(f"`{field}` must be given to be fitted: its value is the start of the search.")
        return None
    start = np.asarray(start, float)
    how = how if how is not None else "diagonal" if start.ndim == 3 or _is_diagonal(start) else "full"
    if isinstance(how, str) and how not in WORDS:
        faults.choice(f"free[{field!r}]", how, WORDS)
        return None
    k = start.shape[-1]
    blocks = np.ones((k, k), bool) if isinstance(how, str) else _blocks(field, start, how, faults)
    if blocks is None:
        return None
    kind = how if isinstance(how, str) else "diagonal" if _is_diagonal(blocks) else "full"
    part = Part(field, start, channels, kind, tuple(int(i) for i in np.flatnonzero(np.diag(blocks))), None, blocks)
    return part if _has_start(part, faults) else None


def _is_diagonal(M: np.ndarray) -> bool:
    return np.array_equal(M, np.diag(np.diag(M)))


def _blocks(field: str, start: np.ndarray, how: Sequence[Any], faults: checks.Faults) -> np.ndarray | None:
    """The free entries (k, k), from k bools, one per variance, or from (k, k) bools, one per entry."""
    k, mask = start.shape[-1], np.asarray(how)
    if mask.dtype != bool or mask.shape not in {(k,), (k, k)} or not mask.any():
        faults.add(
            f"`free[{field!r}]` must be one of {checks.listed(WORDS)}, {k} bools, one per variance, or a symmetric ({k}, {k}) "
            f"array of bools, one per entry. Got {checks.short(how)}."
        )
        return None
    if mask.ndim == 1:
        return np.diag(mask)
    linked = mask.astype(int) @ mask > 0
    if not np.array_equal(mask, mask.T) or not np.array_equal(linked, mask):
        faults.add(
            f"`free[{field!r}]` must be blocks: where the covariance of two noises is free, so are their variances, and their "
            f"covariances with every noise that has a free covariance with either. Got {checks.short(how)}."
        )
        return None
    if not _is_diagonal(mask) and (start * (~mask & (np.diag(mask)[:, None] | np.diag(mask)))).any():
        faults.add(
            f"`{field}` has covariances other than 0 outside the free blocks of `free[{field!r}]`: free them too, or start from "
            "0."
        )
        return None
    return mask


def _has_start(part: Part, faults: checks.Faults) -> bool:
    """Whether the search can start from the covariance that is given."""
    start, field = part.start, part.field
    sizes = np.abs(start).max(axis=0) if part.varies else np.abs(start)
    zero = [part.channels[i] for i in part.free if sizes[i, i] == 0]
    if (part.kind != "scale" and zero) or not start.any():
        faults.add(
            f"`{field}` starts from a variance of zero for {checks.listed(zero)}, which cannot be scaled: start from a "
            f"small one, or leave it out with free={{{field!r}: [True, False, ..]}}."
        )
        return False
    if part.kind == "full" and part.varies:
        faults.add(f'`{field}` varies in time: free["{field}"] must be "scale", "diagonal" or bools, one per variance.')
        return False
    among = start if part.varies else start[np.ix_(part.free, part.free)]
    if part.kind == "full" and np.linalg.eigvalsh(among)[0] <= 1e-12 * np.abs(start).max():
        faults.add(
            f"`{field}` must be positive definite to be fitted in full: start from a covariance without zero eigenvalues."
        )
        return False
    return True
