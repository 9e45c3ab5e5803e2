"""Directions in which a linear model may be wrong, as small numbers that are zero in the model itself.

Entries of A and of B by their relative error, a delay of each input, an offset of each state equation and of each sensor, an
offset of each driven state equation that begins in mid-record, and a limit of each input. Delay, offsets and limits enter as
further inputs, whose columns are the numbers: (u[k] - u[k-1]) / dt, 1, a step, and the part of u beyond half of its range.
"""

from typing import Any, NamedTuple

import numpy as np

from ..frozen import replace
from ..models.operating_point import OperatingPoint
from ..models.sampled import point_of
from ..models.state_space import StateSpace
from ..results import Interval, Sample
from ..results.trusts import Direction


class Directions(NamedTuple):
    """A model whose B and D hold the blocks [B0, B1, ..] side by side, and the directions of its errors."""

    model: StateSpace
    blocks: int  # of B: 1 and one for each gain
    found: tuple[Direction, ...]

    @staticmethod
    def of(plain: StateSpace, blocked: StateSpace, since: str | None = None) -> "Directions":
        """The directions of a model; `blocked` has its B in blocks. `since`: when late offsets begin, None: none do."""
        blocks = blocked.B.shape[-1] // plain.m if plain.m else 1
        return Directions(blocked, blocks, tuple(_directions(plain, _of_blocks(blocked.B, blocks, plain.m), since)))

    @property
    def inputs(self) -> int:
        """The number of inputs of the plain model."""
        return self.model.B.shape[-1] // self.blocks

    def moved(self, θ: np.ndarray) -> StateSpace:
        """The model with θ (d,), which may be complex, and its further inputs."""
        model, m = self.model, self.inputs
        A, B, D = model.A, _of_blocks(model.B, self.blocks, m), _of_blocks(model.D, self.blocks, m)
        end = None if model.B_end is None else _of_blocks(model.B_end, self.blocks, m)
        late, constant = np.zeros((*B.shape[:-1], m), θ.dtype), np.zeros((*B.shape[:-1], 2), θ.dtype)
        level = np.zeros((*D.shape[:-1], m + 2), θ.dtype)
        beyond, beyond_end, beyond_now = 0 * late, 0 * late, np.zeros((*D.shape[:-1], m), θ.dtype)
        for by, one in zip(θ, self.found, strict=True):
            if one.kind == "A":
                A = A * _scaled(A.shape[-2:], one.at, by)
            elif one.kind == "B":
                factor = _scaled(B.shape[-2:], one.at, by)
                B, end = B * factor, None if end is None else end * factor
            elif one.kind == "delay":
                j = one.at[0]
                late[..., j] = late[..., j] - by * (B[..., j] if end is None else B[..., j] + end[..., j])
                level[..., j] = level[..., j] - by * D[..., j]
            elif one.kind == "limit":
                j = one.at[0]
                beyond[..., j], beyond_now[..., j] = -by * B[..., j], -by * D[..., j]
                beyond_end[..., j] = 0 if end is None else -by * end[..., j]
            elif one.kind == "state offset":
                constant[..., 0, one.at[0], 0] += by
            elif one.kind == "late offset":
                constant[..., 0, one.at[0], 1] += by
            else:
                level[..., 0, one.at[0], m] += by
        point = point_of(model)
        inputs = np.concatenate([point.inputs[..., :m], np.zeros((*point.inputs.shape[:-1], 2 * m + 2))], axis=-1)
        return replace(
            model, A=A, B=_side_by_side([B, late, constant, beyond]), D=_side_by_side([D, level, beyond_now]),
            B_end=None if end is None else _side_by_side([end, 0 * late, 0 * constant, beyond_end]),
            operating_point=OperatingPoint(point.states, inputs, point.outputs),
        )  # fmt: skip


def _directions(model: StateSpace, blocks: np.ndarray, since: str | None) -> Any:
    x, u, y = model.states, model.inputs, model.outputs
    shaped = _shapes_noise(model)
    for i, j in np.ndindex(model.n, model.n):
        exact = model.is_continuous and np.all(np.abs(model.A[..., i, j]) == 1)
        if np.any(model.A[..., i, j]) and not exact and not (shaped[i] or shaped[j]):
            yield Direction(f"A[{x[i]}, {x[j]}]", "A", (i, j))
    for i, j in np.ndindex(model.n, model.m):
        if np.any(blocks[..., i, j]):
            yield Direction(f"B[{x[i]}, {u[j]}]", "B", (i, j))
    yield from (Direction(f"delay of {u[j]}", "delay", (j,)) for j in range(model.m))
    yield from (Direction(f"limit of {u[j]}", "limit", (j,)) for j in range(model.m))
    yield from (Direction(f"offset of d{x[i]}/dt", "state offset", (i,)) for i in range(model.n) if not shaped[i])
    yield from (Direction(f"offset of {y[i]}", "sensor offset", (i,)) for i in range(model.p))
    if since is not None:
        driven = _ever((blocks != 0).any(axis=(-3, -1)))
        yield from (
            Direction(f"offset of d{x[i]}/dt from {since} on", "late offset", (int(i),)) for i in np.flatnonzero(driven)
        )


def _shapes_noise(model: StateSpace) -> np.ndarray:
    """The states that only colour a noise: nothing drives them but noise, and no sensor sees them."""
    own = np.eye(model.n, dtype=bool)
    driven = (np.where(own, 0, model.A) != 0).any(axis=-1) | (model.B != 0).any(axis=-1)
    seen = (model.C != 0).any(axis=-2)
    return ~(_ever(driven) | _ever(seen))


def _ever(flags: np.ndarray) -> np.ndarray:
    return np.asarray(flags.any(axis=tuple(range(flags.ndim - 1))))


def _of_blocks(M: np.ndarray, blocks: int, m: int) -> np.ndarray:
    """(.., rows, blocks m) as (.., blocks, rows, m)."""
    return np.moveaxis(M.reshape(*M.shape[:-1], blocks, m), -2, -3)


def _side_by_side(parts: list[np.ndarray]) -> np.ndarray:
    """The columns of each block, and the blocks side by side."""
    M = np.moveaxis(np.concatenate(parts, axis=-1), -3, -2)
    return M.reshape(*M.shape[:-2], -1)


def _scaled(shape: tuple[int, ...], at: tuple[int, ...], by: complex) -> np.ndarray:
    """Ones, and 1 + `by` at one entry."""
    factor = np.ones(shape, np.result_type(by))
    factor[at] += by
    return factor


def with_further_inputs(samples: Sample, intervals: Interval, hold: str, begin: int | None) -> tuple[Sample, Interval]:
    """The rows with further inputs: the rate of each input, a constant, a step at row `begin` (None: 0 in every row), and the
    part of each input beyond half of its range."""
    u, dt = intervals.u, np.asarray(intervals.dt)[:, None]
    moved = intervals.u_end - u if hold == "first_order" else np.diff(u, axis=0, prepend=u[:1])
    rate = np.divide(moved, dt, out=np.zeros_like(moved), where=dt > 0)
    step = np.zeros(len(u)) if begin is None else np.arange(len(u)) >= begin
    constant = np.stack([np.ones(len(u)), step], axis=1)
    low, high = np.nanmin(u, axis=0), np.nanmax(u, axis=0)
    middle, half = (low + high) / 2, (high - low) / 4

    def wider(values: np.ndarray) -> np.ndarray:
        """Inputs (T, m) with the further ones: `beyond` is what a limit at half of the range takes away."""
        beyond = values - np.clip(values, middle - half, middle + half)
        return np.concatenate([values, rate, constant, beyond], axis=1)

    more = (0, wider(u).shape[1] - u.shape[1])  # further inputs have no error
    diffusion, covariance = intervals.u_diffusion, intervals.u_covariance
    return replace(samples, u=wider(samples.u)), replace(
        intervals,
        u=wider(u),
        u_end=wider(intervals.u_end),
        u_diffusion=None if diffusion is None else np.pad(diffusion, [(0, 0), more]),
        u_covariance=None if covariance is None else np.pad(covariance, [(0, 0), more, more]),
    )
