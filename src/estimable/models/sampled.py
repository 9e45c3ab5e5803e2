"""A model as the steps of an algorithm use it: discrete, with noises scaled from unit white ones, at one instant."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array
from ..frozen import frozen, replace, static
from ..kernels.small import factors
from . import angles
from .discretisation import over, wandering
from .operating_point import OperatingPoint
from .several_steps import several_steps
from .state_space import StateSpace, refuse_schedule


class Clock(NamedTuple):
    """The steps of a record: their distinct lengths (K,) in seconds, the index of the length of each row, and the hold of u.

    `wanders`: whether intervals have `u_diffusion`, for which a continuous model needs `wandering` as well as B.
    """

    lengths: np.ndarray
    rows: np.ndarray | None = None
    hold: str = "zero_order"
    wanders: bool = False

    @staticmethod
    def every(dt: float | None, hold: str = "zero_order", *, wanders: bool = False) -> "Clock":
        """Steps of `dt` seconds."""
        return Clock(np.asarray(dt, float), None, hold, wanders)


@frozen
class SampledModel:
    """x+ = A x + B u + B_end u_end + ω, y = C x + D u + v about `point`; v = V e, ω = Ω e + W e' with e, e' unit white.

    Matrices named in `varying` have a time axis, read at row k, or at `rows[k]` if several rows share one entry.
    `added` (d,): the variances of the last states, disturbances, before the first sample; None where there are none.
    `tangents`: the derivatives of its matrices with respect to their uncertain entries, if there are any.
    `independent`: V is diagonal and there is no Ω, so that each output has its own independent noise. `wandering` (n, n, m), of
    a clock that `wanders`: an input that wanders by unit diffusion adds Σ_k wandering[k] ε_k to the next state. `period`: that of
    each output which is an angle, 0 for the others.
    """

    A: Any
    B: Any
    B_end: Any
    C: Any
    D: Any
    V: Any
    Ω: Any
    W: Any
    point: OperatingPoint
    rows: Any = None
    varying: tuple[str, ...] = static(default=())
    independent: bool = static(default=False)
    wandering: Any = None
    added: Any = None
    tangents: Any = None
    period: tuple[float, ...] | None = static(default=None)

    @property
    def turn(self) -> Any:
        """`period` as an array."""
        return None if self.period is None else np.array(self.period)

    def at(self, k: int | Array) -> "SampledModel":
        """The model at row k."""
        if self.tangents is not None and self.tangents.varying:
            return replace(self, tangents=self.tangents.at(k)).at(k)
        if not self.varying:
            return self
        row = k if self.rows is None else self.rows[k]
        instant = {
            name: jax.lax.dynamic_index_in_dim(getattr(self, name), row, keepdims=False) for name in self.varying
        }
        return replace(self, rows=None, varying=(), **instant)


def sample(model: StateSpace, clock: Clock) -> SampledModel:
    """`model` sampled at the steps of `clock`; a discrete model takes several of its own steps
    where the clock is longer.

    Leading axes of a stacked model stay in front. Traceable for a discrete model. Raises `InputError` without R.
    """
    refuse_schedule(model)
    if model.R is None:
        checks.refuse(
            "`R`, the covariance of the measurement noise, is needed here. For noise-free outputs give zeros."
        )
    rows = Ψ = None
    if model.is_continuous:
        if clock.wanders:
            Ψ = _wandering(model, clock)
        model, rows = _discrete(model, clock)
    elif clock.rows is not None:
        batch, (model, wandering) = _batch(model), several_steps(model, clock.lengths, clock.hold)
        rows = np.broadcast_to(clock.rows, (*batch, len(clock.rows)))
        Ψ = wandering if clock.wanders else None
    V, Ω, W = _white(model)
    deterministic = {"A", "B", "B_end", "C", "D"} & set(model.varying)
    if Ψ is not None and np.ndim(Ψ) > 3 + len(_batch(model)):
        deterministic |= {"wandering"}
    return SampledModel(
        model.A, model.B, model.B_end, model.C, model.D, V, Ω, W, point_of(model), rows,
        tuple(sorted(deterministic | _varying_noise(model))), model.S is None and is_diagonal(model.R), Ψ,
        None if model.disturbance is None else model.disturbance.variance,
        period=angles.periods(model.angles, model.outputs),
    )  # fmt: skip


def _wandering(model: StateSpace, clock: Clock) -> np.ndarray:
    """`wandering` for each distinct step, or for each row of a model that varies; without that axis if its length is one."""
    lengths = np.atleast_1d(clock.lengths)
    if model.varying and clock.rows is not None:
        lengths = lengths[clock.rows]
    A, B = (_timed(model, name) for name in "AB")
    Ψ = wandering(A, lengths, hold=clock.hold) @ B[..., None, :, :]
    return Ψ[..., 0, :, :, :] if Ψ.shape[-4] == 1 else Ψ


def _timed(model: StateSpace, name: str) -> np.ndarray:
    """A matrix with a time axis, of length one if it does not vary."""
    M = getattr(model, name)
    return M if name in model.varying else M[..., None, :, :]


def is_diagonal(R: Array) -> bool:
    """Whether R (.., p, p) is known to be diagonal, in every row of time and batch."""
    return not checks.is_traced(R) and not np.any(np.asarray(R) * (1 - np.eye(np.shape(R)[-1])))


def _varying_noise(model: StateSpace) -> set[str]:
    """The names among V, Ω, W that vary in time."""
    varying = set(model.varying)
    if model.S is not None:
        return {"V", "Ω", "W"} if varying & {"Q", "R", "S", "G"} else set()
    return ({"W"} if varying & {"Q", "G"} else set()) | ({"V"} if "R" in varying else set())


def point_of(model: StateSpace) -> OperatingPoint:
    """The operating point of the model; zero if it has none."""
    if model.operating_point is not None:
        return model.operating_point
    return OperatingPoint(*(np.zeros((*_batch(model), size)) for size in (model.n, model.m, model.p)))


def _batch(model: StateSpace) -> tuple[int, ...]:
    """The leading axes of a stacked model: (B,), or none."""
    return model.A.shape[: model.A.ndim - 2 - ("A" in model.varying)]


def _discrete(model: StateSpace, clock: Clock) -> tuple[StateSpace, np.ndarray | None]:
    """The discrete model, with one entry for each distinct step, or one for each row if the model varies."""
    lengths, rows = np.atleast_1d(clock.lengths), clock.rows
    if model.varying and rows is not None:
        lengths, rows = lengths[rows], None
    rows = None if rows is None else np.broadcast_to(rows, (*_batch(model), len(rows)))
    A, B, G, Q = (_timed(model, name) for name in "ABGQ")
    Φ, B, B_end, Q = over(A, B, G @ Q @ np.swapaxes(G, -1, -2), lengths, hold=clock.hold)
    changed = {"A": Φ, "B": B, "B_end": B_end, "Q": Q}
    fixed = {name for name, M in changed.items() if M is not None and M.shape[-3] == 1}
    changed = {name: M[..., 0, :, :] if name in fixed else M for name, M in changed.items()}
    varying = {name for name, M in changed.items() if M is not None} - fixed
    unchanged = {name for name in model.varying if name in ("C", "D", "R")}
    return replace(
        model,
        **changed,
        G=np.broadcast_to(np.eye(model.n), Φ[..., 0, :, :].shape),
        dt=float(np.mean(lengths)),
        varying=tuple(sorted(varying | unchanged)),
    ), rows


def _white(model: StateSpace):
    """V, Ω, W: the factor of the joint covariance of (v, G w)."""
    if model.S is None:
        Q, G = _together(model, ("Q", "G"))
        return factors(model.R), None, G @ factors(Q)
    Q, R, S, G = _together(model, ("Q", "R", "S", "G"))
    p = model.p
    xp = _library(Q, R, S)
    joint = xp.concatenate([xp.concatenate([R, xp.swapaxes(S, -1, -2)], -1), xp.concatenate([S, Q], -1)], axis=-2)
    L = factors(joint)
    return L[..., :p, :p], G @ L[..., p:, :p], G @ L[..., p:, p:]


def _together(model: StateSpace, names: Sequence[str]):
    """The named matrices, each with a time axis of full length if any of them varies."""
    T = next((getattr(model, name).shape[-3] for name in names if name in model.varying), None)
    matrices = (getattr(model, name) for name in names)
    if T is None:
        return tuple(matrices)
    return tuple(
        M if name in model.varying else _library(M).repeat(M[..., None, :, :], T, axis=-3)
        for name, M in zip(names, matrices, strict=True)
    )


def _library(*matrices: Array) -> Any:
    """NumPy for known numbers, which it has in complex form too (`complex_step`); JAX for traced ones."""
    return jnp if checks.is_traced(*matrices) else np
