"""The numbers that decide about a gap: how fast an input moves, and how far the state spreads."""

from functools import cached_property
from typing import Any, NamedTuple, Protocol

import jax
import numpy as np

from ..data.record import Record
from ..filters.linearised import Linearised
from ..filters.unknown_gain import UnknownGain
from ..frozen import replace
from ..models import several_steps
from ..models.discretisation import over, wandering
from ..models.sampled import point_of
from ..models.state_space import StateSpace
from ..models.stationary_spread import StateSpread, growth_time, spread
from ..protocols import Algorithm


class GapSettings(Protocol):
    """The settings that these numbers depend on."""

    @property
    def diffusion(self) -> Any:
        """The variance of each input per second, or None."""

    @property
    def spread(self) -> Any:
        """The variance of each input, or None."""


class Bridge:
    """The logged inputs u (.., T, m) at times t (T,)."""

    def __init__(self, t: np.ndarray, u: np.ndarray):
        self.t, self.u = t, u

    def diffusion(self, seconds: float) -> np.ndarray:
        """The mean square step over so many seconds, per second, (.., m); from what two samples apart say where none is."""
        near = 0.4 * float(np.median(np.diff(self.t))) if len(self.t) > 1 else 0.0
        later = np.searchsorted(self.t, self.t + seconds - near)
        inside = np.flatnonzero(later < len(self.t))
        inside = inside[self.t[later[inside]] - self.t[inside] <= seconds + near]
        step = self.u[..., later[inside], :] - self.u[..., inside, :]
        known = ~np.isnan(step)
        count = known.sum(axis=-2)
        mean = np.sum(np.where(known, step, 0.0) ** 2, axis=-2) / np.maximum(count, 1)
        spread = 2 * np.nanvar(np.where(np.isnan(self.u).all(axis=-2, keepdims=True), 0.0, self.u), axis=-2)
        return np.where(count > 0, mean, spread) / seconds


class Known:
    """What is known about an algorithm and of the inputs of its record, for the decision and for a restart."""

    def __init__(self, algorithm: Algorithm[Any], hold: str, settings: "GapSettings", stacked: bool):
        self.algorithm, self.hold, self.settings, self.stacked = algorithm, hold, settings, stacked
        self.model = algorithm.innermost.model
        self.inputs = [self.model.inputs.index(name) for name in algorithm.names.inputs]
        self.linear = isinstance(self.model, StateSpace)
        self.exact = self.linear and not isinstance(algorithm.innermost, Linearised)
        self.logged: np.ndarray | None = settings.spread
        self.steps_may_vary = (
            not self.model.varying
            and not (stacked and not self.model.is_continuous)
            and (self.linear or self.model.is_continuous)
        )

    def of(self, algorithm: Algorithm[Any]) -> "Known":
        """The same about another algorithm with the same inputs."""
        other = Known(algorithm, self.hold, self.settings, self.stacked)
        other.logged, other.moves = self.logged, self.moves
        return other

    def see(self, u: np.ndarray, record: Record) -> None:
        """Look at the logged inputs (.., T, m): their variance, and how they move from sample to sample."""
        settings, t = self.settings, record.t
        t = np.arange(len(record)) * (record.dt or self.dt or 1.0) if t is None else t
        step = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
        self.logged = self.variance(u) if settings.spread is None else settings.spread
        self.moves = Bridge(t, u).diffusion(step) if settings.diffusion is None else settings.diffusion

    @cached_property
    def states(self) -> np.ndarray:
        """The states at the operating point, (n,)."""
        return np.asarray(point_of(self._one).states)

    @property
    def output(self) -> tuple[np.ndarray, np.ndarray]:
        """C and R."""
        return np.asarray(self._one.C), np.asarray(self._one.R)

    def step(
        self, h: float, z: np.ndarray, P: np.ndarray, u: np.ndarray, u_end: np.ndarray, g: np.ndarray, S: float
    ) -> "MovedInGap":
        """The first h seconds of a gap of S seconds: z+ = F z + c + n of (x, θ), cov n = N."""
        model, inner = self._one, self.algorithm.innermost
        n, p = len(model.A), len(z) - len(model.A)
        blocks = self._blocks if p else np.asarray(model.B)[:, self.inputs]
        A, B, B_end, Q, ramp, start, Ψ = self._over(blocks, h, S)
        moments = _moments(z[n:], P[n:, n:])
        m = len(u)

        def parts(M: np.ndarray) -> np.ndarray:
            return M.reshape(len(M), p + 1, m)

        move = parts(B) @ (u - self.point) + (0.0 if B_end is None else parts(B_end) @ (u_end - self.point))
        F = np.block([[A, move[:, 1:]], [np.zeros((p, n)), np.eye(p)]])
        c = np.concatenate([move[:, 0], np.zeros(p)])
        L = _root(moments)

        def weighted(M: np.ndarray) -> np.ndarray:
            return np.einsum("nbm,bl->nml", parts(M), L)

        ramps, starts = weighted(ramp), weighted(start)
        N = Q + sum(np.einsum("iml,m,jml->ij", W, g, W) for W in (weighted(one) for one in Ψ))
        if self.hold == "first_order" and h < S:
            N = N + np.einsum("iml,m,jml->ij", ramps, g * h * (1 - h / S), ramps)
        walk = np.asarray(getattr(inner, "walk", 0.0)) if p else np.zeros((0, 0))
        N = np.block([[N, np.zeros((n, p))], [np.zeros((p, n)), np.reshape(walk, (p, p)) * h]])
        return MovedInGap(F, c, N, ramps, starts)

    def across(self, part: "MovedInGap", rest: "MovedInGap", g: np.ndarray, h: float, S: float) -> np.ndarray:
        """The covariance of n after h seconds and after S seconds: process noise moves on, and the input error at h is common."""
        n = len(self._one.A)
        common = g * h * ((1 - h / S) if self.hold == "first_order" else 1.0)
        N = part.N @ rest.F.T
        N[:n, :n] += np.einsum("iml,m,jml->ij", part.ramps, common, rest.starts)
        return N

    def _over(self, blocks: np.ndarray, h: float, S: float) -> tuple[Any, ...]:
        """Φ, B, B_end, Qd, the effects of an error that grows from zero, and that is there at the start, and the wandering."""
        model = self._one
        if model.is_continuous:
            A, B, B_end, Q = over(model.A, blocks, self._noise, h, hold=self.hold)
            _, falling, ramp, _ = over(model.A, blocks, self._noise, h, hold="first_order")
            Ψ = wandering(np.asarray(model.A), np.asarray(h), hold=self.hold) @ blocks
            return A, B, B_end, Q, ramp, falling if self.hold == "first_order" else B, Ψ
        ends = (
            None if model.B_end is None else self._gain_model.B_end if self._has_gains else model.B_end[:, self.inputs]
        )
        longer = replace(model, B=blocks, B_end=ends)
        return several_steps.part(longer, round(h / model.dt), self.hold)

    @property
    def dt(self) -> float | None:
        """The step of a discrete model, 0 for a continuous one."""
        return self.model.dt

    @cached_property
    def point(self) -> np.ndarray:
        """The inputs at the operating point, (m,)."""
        return np.asarray(point_of(self._one).inputs)[self.inputs] if self.linear else np.zeros(len(self.inputs))

    def variance(self, u: np.ndarray) -> np.ndarray:
        """The mean square of the logged inputs about the operating point, (.., m)."""
        known = ~np.isnan(u)
        square = np.where(known, u - self.point, 0.0) ** 2
        return square.sum(axis=-2) / np.maximum(known.sum(axis=-2), 1)

    def why_break(self, seconds: float, diffusion: np.ndarray, duration: float, share: float) -> str:
        """Why the state would not be known across a gap; empty where it would be."""
        if not self.linear:
            return ""
        growth = growth_time(np.asarray(self._one.A), float(self.dt or 0.0))
        if growth is not None:
            limit = share * (duration if np.isinf(growth) else growth)
            what = "the record" if np.isinf(growth) else "the time constant of the fastest unstable mode"
            return f"longer than {share:g} of {what}, {limit:.3g} s" if seconds > limit else ""
        if self.logged is None:
            return ""  # a restart would know nothing
        known = self.spread_of(diffusion)
        if known.leaves_more_unknown_than(self._growth(seconds, diffusion)):
            return ""
        return "the state would spread as far as after a restart"

    def spread_of(self, diffusion: np.ndarray) -> StateSpread:
        """The spread of the state under the logged inputs."""
        g, v = (x.reshape(-1, x.shape[-1]).max(axis=0) for x in (np.asarray(diffusion), np.asarray(self.logged)))
        model, B = self._one, self._effects
        copies = B.shape[1] // max(len(v), 1)
        return spread(
            np.asarray(model.A), self._noise, B, np.tile(v, copies), np.tile(g, copies), float(self.dt or 0.0)
        )

    def _growth(self, seconds: float, diffusion: np.ndarray) -> np.ndarray:
        """The covariance that process noise and an unknown input give a known state in so many seconds."""
        g = np.asarray(diffusion).reshape(-1, np.shape(diffusion)[-1]).max(axis=0)
        model, B = self._one, self._effects
        g = np.tile(g, B.shape[1] // max(len(g), 1))
        if model.is_continuous:
            Q = over(model.A, B, self._noise, seconds, hold=self.hold)[3]
            Ψ = wandering(np.asarray(model.A), np.asarray(seconds), hold=self.hold) @ B
        else:
            longer, Ψs = several_steps.several_steps(model, np.array([seconds]), self.hold)
            Q, Ψ = longer.Q[0], Ψs[0]
            g = g[: Ψ.shape[-1]]
        return Q + np.einsum("kij,j,klj->il", Ψ, g, Ψ)

    @cached_property
    def _one(self) -> Any:
        """The model, of a stack the first, of one that varies its first row."""
        return _constant(self.model) if self.linear else self.model

    @property
    def _noise(self) -> np.ndarray:
        return self._one.G @ self._one.Q @ self._one.G.T

    @property
    def _has_gains(self) -> bool:
        return isinstance(self.algorithm.innermost, UnknownGain)

    @cached_property
    def _gain_model(self) -> StateSpace:
        """The model with the directions of the gains side by side in B."""
        inner: Any = self.algorithm.innermost
        return _constant(inner.in_blocks())

    @property
    def _blocks(self) -> np.ndarray:
        return np.asarray(self._gain_model.B)

    @cached_property
    def _effects(self) -> np.ndarray:
        """The columns of B of the known inputs, weighted by a factor of E[θ θ'] where gains act on them."""
        if not self._has_gains:
            return np.asarray(self._one.B)[:, self.inputs]
        inner: Any = self.algorithm.innermost
        gain = inner.gain
        L = _root(_moments(np.atleast_2d(gain.mean)[0], gain.covariance.reshape(-1, gain.size, gain.size)[0]))
        parts = self._blocks.reshape(len(self._blocks), len(L), -1)
        return np.concatenate([np.einsum("nbm,b->nm", parts, column) for column in L.T], axis=1)


class MovedInGap(NamedTuple):
    """The state after a part of a gap: z+ = F z + c + n, cov n = N, and the weighted effects of input errors."""

    F: np.ndarray
    c: np.ndarray
    N: np.ndarray
    ramps: np.ndarray
    starts: np.ndarray


def _constant(model: StateSpace) -> StateSpace:
    """The model, of a stack the first, of one that varies its first row."""
    while np.ndim(model.A) - ("A" in model.varying) > 2:
        model = jax.tree_util.tree_map(lambda leaf: leaf[0], model)
    rows = {name: getattr(model, name)[0] for name in model.varying}
    return replace(model, **rows, varying=())


def _moments(θ: np.ndarray, P: np.ndarray) -> np.ndarray:
    """E[θ~ θ~'] of θ~ = (1, θ)."""
    known = np.concatenate([[1.0], θ])
    moments = np.outer(known, known)
    moments[1:, 1:] += P
    return moments


def _root(M: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh(M)
    return vectors * np.sqrt(np.maximum(values, 0.0))
