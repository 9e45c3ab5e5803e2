"""A plant with its actuators over one step, phase by phase, as the loops of `simulation` use it."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..annotations import Array
from ..frozen import frozen, static
from ..kernels.small import factors
from .actuator import Actuator, ages, parts_of
from .discretisation import over, transition
from .events import PlantPhase
from .operating_point import OperatingPoint

LONGEST_SERIES = 128  # terms: enough for a lag whose time constant is a fiftieth of the step
ROUNDING = 4e-15  # of the largest value of a response: what its series may leave out
MOST = 2_000_000  # numbers of the matrices whose exponentials are computed together
FASTEST = 1e300  # a rate without a limit, as a number whose product with zero is zero


class PlantInSteps(Protocol):
    """What a step needs of a `ControlledPlant`."""

    @property
    def quantum(self) -> Any:
        """Commands are rounded to multiples of it."""
        ...

    @property
    def resolution(self) -> Any:
        """Outputs are rounded to multiples of it."""
        ...

    @property
    def mode(self) -> str:
        """How inputs move."""
        ...

    @property
    def point(self) -> OperatingPoint:
        """The operating point of the model."""
        ...

    @property
    def actuators(self) -> tuple[Actuator, ...]:
        """The actuator of each input."""
        ...


@frozen
class Piece:
    """A part of a step in which each command is constant, as in `kernels.actuator_motion`; each field is one by phase.

    `late` (L, m): 1 for the command that acts, of the last L. Without rate limits (`rate` is None) `lag` (n, m) and `decay`
    (m,) are those of the whole part, else they and `ramp_series` are Chebyshev series, one term by row. `lag`, `ramp`: None
    where the input of the plant is held over the step.
    """

    seconds: Any
    scale: Any  # 2 / seconds: from seconds to the argument of a series, less 1
    late: Any
    decay: Any
    step: Any = None
    lag: Any = None
    ramp: Any = None
    ramp_series: Any = None


@frozen
class Motion:
    """How the positions of the actuators move over a step; each field is one by phase, (P, m).

    `driven`: 1 where a fault moves the actuator towards `target`, 2 where it stays; `place`: the position of the onset, NaN:
    as it is. All three are None where no fault drives an actuator.
    """

    lower: Any
    upper: Any
    rate: Any
    reach: Any
    driven: Any
    target: Any
    place: Any
    pieces: tuple[Piece, ...]


@frozen
class Steps:
    """A step of a plant, by phase: x+ = A x + (effect of the positions p) + W e', y = `rest` + C x + D (K p + b) + V e.

    x: the deviation of the state. The effect is B (K p + b) where positions are held over the step ("direct": at their end;
    "held": at their beginning), and else the response to the moving positions ("moving"). K: `gain`, b: `bias`, (m,); None: 1
    and 0. `offset`: of the positions. `motion` None: positions are the commands. Commands are rounded to `quantum`, and are
    within `limits` and within `reach` of the last one; outputs are rounded to `resolution`. `rows` (T,): the phase of each row,
    where the plant varies from row to row; None: the loop chooses the phase.
    """

    A: Any
    B: Any
    C: Any
    D: Any
    W: Any
    V: Any
    rest: Any
    gain: Any
    bias: Any
    offset: Any
    motion: Motion | None
    limits: Any
    reach: Any
    quantum: Any
    resolution: Any
    mode: str = static(default="direct")
    history: int = static(default=0)
    rows: Any = None

    @property
    def moves(self) -> bool:
        """Whether the plant has actuators, whose positions are measured."""
        return self.mode != "direct"


def steps_of(phases: list[PlantPhase], plant: PlantInSteps, dt: float, rows: np.ndarray | None = None) -> Steps:
    """The step of a `ControlledPlant` over `dt` seconds."""
    A, B, W = map(_by_phase, _matrices(phases, dt))
    C, D = (_by_phase([getattr(phase.model, name) for phase in phases]) for name in "CD")
    noises = [phases[0].model.R if phase.model.R is None else phase.model.R for phase in phases]
    point = plant.point
    origin = np.array([actuator.operating_point for actuator in phases[0].actuators])
    gain, offset = (np.stack([getattr(phase, name) for phase in phases]) for name in ("gain", "offset"))
    bias = gain * (origin + offset) - origin - point.inputs
    faulty = any(phase.drives != phases[0].drives or phase.actuators is not phases[0].actuators for phase in phases)
    motion = _motion(phases, plant, dt) if plant.mode != "direct" or faulty else None
    return Steps(
        A, B, C, D, W, np.asarray(factors(_by_phase(noises))), point.outputs,
        _by_phase(gain) if np.any(gain != 1) else None, _by_phase(bias) if np.any(bias) else None,
        _by_phase(offset) if np.any(offset) else None, motion, _limits(plant), _reach(plant, dt), plant.quantum,
        plant.resolution, plant.mode, 0 if motion is None else motion.pieces[0].late.shape[1], rows,
    )  # fmt: skip


def _matrices(phases: list[PlantPhase], dt: float):
    """A, B and W of the plant over a step, by phase."""
    models = [phase.model for phase in phases]
    A, B = (np.stack([getattr(model, name) for model in models]) for name in "AB")
    if not models[0].is_continuous:
        return A, B, np.stack([model.G @ np.asarray(factors(model.Q)) for model in models])
    A, B, _, Q = over(A, B, np.stack([model.G @ model.Q @ model.G.T for model in models]), dt, hold="zero_order")
    return A, B, np.asarray(factors(Q))


def _by_phase(values: Sequence[Array] | np.ndarray) -> np.ndarray:
    """One entry for each phase; a single one where all are equal."""
    stacked = np.stack([np.asarray(value, float) for value in values])
    return (
        stacked[:1] if np.array_equal(stacked, np.broadcast_to(stacked[:1], stacked.shape), equal_nan=True) else stacked
    )


def _limits(plant: PlantInSteps) -> Any:
    """The smallest and the largest command, (2, m)."""
    stops = np.array([actuator.stops for actuator in plant.actuators]).T
    return stops if np.any(np.isfinite(stops)) else None


def _reach(plant: PlantInSteps, dt: float) -> Any:
    """How far a command may be from the last one, where it is the input at once."""
    fastest = np.array([actuator.fastest for actuator in plant.actuators])
    return fastest * dt if plant.mode == "direct" and np.any(np.isfinite(fastest)) else None


def _motion(phases: list[PlantPhase], plant: PlantInSteps, dt: float) -> Motion:
    moving = [[_mover(phase, i) for i in range(phase.model.m)] for phase in phases]
    lower, upper = np.moveaxis(np.array([[actuator.stops for actuator in phase.actuators] for phase in phases]), -1, 0)
    rate, reach = (np.array([[getattr(a, name) for a in row] for row in moving]) for name in ("fastest", "reach"))
    drives = [phase.drives for phase in phases]
    driven = np.array([[0 if d is None else 2 if d.to is None else 1 for d in row] for row in drives], float)
    target, place = (
        np.array(
            [[empty if d is None or getattr(d, name) is None else getattr(d, name) for d in row] for row in drives]
        )
        for name, empty in (("to", 0.0), ("place", np.nan))
    )
    limited, any_driven = bool(np.any(np.isfinite(rate))), bool(np.any(driven))
    driven, target, place = (_by_phase(value) if any_driven else None for value in (driven, target, place))
    return Motion(
        _by_phase(lower), _by_phase(upper), _by_phase(np.minimum(rate, FASTEST)) if limited else None, _by_phase(reach),
        driven, target, place, _pieces(phases, moving, plant.mode, dt, limited),
    )  # fmt: skip


def _mover(phase: PlantPhase, i: int) -> Actuator:
    """The actuator that moves input i: its own, or that of the fault."""
    drive = phase.drives[i]
    return phase.actuators[i] if drive is None else drive.actuator


def _pieces(
    phases: list[PlantPhase], moving: list[list[Actuator]], mode: str, dt: float, limited: bool
) -> tuple[Piece, ...]:
    """The parts of a step: two where a delay is not an integer number of steps."""
    delay = np.array([[actuator.delay for actuator in phase.actuators] for phase in phases])
    parts, pieces = parts_of(delay, dt, held=mode == "direct"), []
    for part, chosen in zip(parts, ages(parts), strict=True):
        responses = [
            _response(phases, i, [row[i] for row in moving], (part.seconds[:, i], part.after[:, i]), mode, limited)
            for i in range(phases[0].model.m)
        ]
        scale = np.divide(2.0, part.seconds, out=np.zeros_like(part.seconds), where=part.seconds > 0)
        pieces.append(Piece(*map(_by_phase, (part.seconds, scale, chosen)), *_gathered(responses)))
    return tuple(pieces)


class ActuatorResponse(NamedTuple):
    """The fields `decay`, `step`, `lag`, `ramp`, `ramp_series` of one actuator, by phase; the last axis of series is that of the
    terms."""

    decay: Any
    step: Any = None
    lag: Any = None
    ramp: Any = None
    ramp_series: Any = None


def _response(
    phases: list[PlantPhase],
    i: int,
    actuators: list[Actuator],
    part: tuple[np.ndarray, np.ndarray],
    mode: str,
    limited: bool,
) -> ActuatorResponse:
    """Responses to input i, moved by an actuator in each phase, over parts of a step: their lengths (P,) and the times from them
    to the end of the step."""
    seconds, after = part
    n = phases[0].model.n if mode == "moving" else 0
    A = np.stack([phase.model.A[:n, :n] for phase in phases])
    B = np.stack([phase.model.B[:n, i] for phase in phases])

    def at(τ: np.ndarray) -> np.ndarray:
        return _responses(A, B, actuators, τ, after)

    now = at(seconds[:, None])[:, 0]
    if not limited:
        return ActuatorResponse(now[:, -1], *((now[:, :n], now[:, 2 * n : -1]) if mode == "moving" else ()))
    terms = chebyshev(at, seconds)
    if mode != "moving":
        return ActuatorResponse(terms[:, -1])
    return ActuatorResponse(terms[:, -1], now[:, :n], terms[:, 2 * n : -1], now[:, n : 2 * n], terms[:, n : 2 * n])


def _responses(A: np.ndarray, B: np.ndarray, actuators: list[Actuator], τ: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Γ0, Γ1, Γl (n each) and E of each phase at its times τ (P, T), (P, T, 3n + 1); the plant then moves freely for `after`
    seconds, (P,).

    One exponential of x0' = A x0 + B, x1' = A x1 + B s, xl' = A xl + B q with s' = 1, q' = b (1 - q).
    """
    P, n = B.shape
    lagging = np.array([actuator.bandwidth < np.inf for actuator in actuators])
    b = np.where(lagging, [actuator.bandwidth for actuator in actuators], 0.0)
    arrives = ~lagging & [
        actuator.rate is not None for actuator in actuators
    ]  # a ramp ends there: nothing is left to jump
    M = np.zeros((P, 3 * n + 3, 3 * n + 3))
    one, s, q = 3 * n, 3 * n + 1, 3 * n + 2
    for j, driver in enumerate((one, s, q)):
        M[:, j * n : (j + 1) * n, j * n : (j + 1) * n] = A
        M[:, j * n : (j + 1) * n, driver] = B
    M[~lagging, 2 * n : one, one], M[~lagging, 2 * n : one, q] = B[~lagging], 0.0
    M[:, s, one], M[:, q, one], M[:, q, q] = 1.0, b, -b
    together = max(1, MOST // (τ.shape[1] * M[0].size))
    found = np.concatenate(
        [transition(M[k : k + together, None], τ[k : k + together])[..., one] for k in range(0, P, together)]
    )
    E = np.where(lagging[:, None], 1 - found[..., q], arrives[:, None].astype(float))
    found[arrives, :, 2 * n : one] = 0.0
    if n and np.any(after > 0):
        Φ = transition(A, after)
        found[..., :one] = np.einsum("pij,ptkj->ptki", Φ, found[..., :one].reshape(P, -1, 3, n)).reshape(P, -1, one)
    return np.concatenate([found[..., :one], E[..., None]], axis=2)


def chebyshev(function: Callable[[np.ndarray], np.ndarray], seconds: np.ndarray) -> np.ndarray:
    """Chebyshev coefficients (P, functions, terms) on [0, seconds] of functions of a time: (P, T) -> (P, T, functions)."""
    for count in (8, 16, 32, 64, LONGEST_SERIES):
        angles = np.pi * (np.arange(count) + 0.5) / count
        values = function(seconds[:, None] * (1 + np.cos(angles)) / 2)
        terms = 2 / count * np.cos(np.outer(np.arange(count), angles)) @ values
        terms[:, 0] /= 2
        small = np.abs(terms) <= ROUNDING * np.abs(values).max(axis=1, keepdims=True)
        if np.all(small[:, -2:]):
            break
    last = np.flatnonzero(~small.all(axis=(0, 2))).max(initial=0)
    return np.swapaxes(terms[:, : last + 1], 1, 2)


def _gathered(responses: list[ActuatorResponse]) -> list[Any]:
    """The fields of a `Piece`: by phase, with the actuators as the last axis and the terms of a series before the states."""
    fields = []
    for name in ActuatorResponse._fields:
        values = [getattr(one, name) for one in responses]
        if values[0] is None:
            fields.append(None)
            continue
        if values[0].ndim == 3 or (name == "decay" and values[0].ndim == 2):
            terms = max(value.shape[-1] for value in values)
            values = [np.moveaxis(_padded(value, terms), -1, 1) for value in values]
        fields.append(_by_phase(np.stack(values, axis=-1)))
    return fields


def _padded(value: np.ndarray, terms: int) -> np.ndarray:
    return np.concatenate([value, np.zeros((*value.shape[:-1], terms - value.shape[-1]))], axis=-1)
