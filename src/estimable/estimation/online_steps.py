"""A run with one sample per call in machine code: plain arguments go directly to it; others `online` checks first."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..annotations import Array, Numbers, Tree
from ..data.messy import WILD
from ..engines.batches import words
from ..engines.one_step import Place, Step, code_of, flat, form_of
from ..engines.program.primitives import UnsupportedError
from ..engines.time_varying import ByRow, looked_up
from ..models.sampled import Clock
from ..protocols import Algorithm
from ..results import Info, Interval, Sample
from .binding import model_of
from .declared_angles import angles_of, reported

FLOAT = np.dtype(float)
REFUSED = -1  # the code of a step whose datum is wild, or whose input is not a number
LENGTHS = 64  # of steps for which the sampled model is cached


def sampled(algorithm: Algorithm[Any], clock: Clock) -> Any:
    """The algorithm prepared for the steps of a run, with angles reported in their range."""
    names = algorithm.names._replace(angles=angles_of(model_of(algorithm)))
    return reported(algorithm.sampled(clock), names)


def _now(algorithm: Algorithm[Any] | ByRow, row: Sequence[Array]) -> Any:
    return algorithm.now(row) if isinstance(algorithm, ByRow) else algorithm


def _correct(
    fixed: tuple[Algorithm[Any] | ByRow, Array], state: tuple[Tree, Array], y: Array, u: Array, row: Sequence[Array]
):
    """`correct` of y, NaN where not seen, and its report. A state is that of the algorithm and the held input."""
    (algorithm, _), (belief, held), seen = fixed, state, y == y
    belief, info = _now(algorithm, row).correct(belief, Sample(jnp.where(seen, y, 0.0), seen, u))
    return (belief, held), info, jnp.where(jnp.any(jnp.abs(y) > WILD), REFUSED, info.outcome)


def _predict(
    fixed: tuple[Algorithm[Any] | ByRow, Array], state: tuple[Tree, Array], u: Array, u_end: Array, row: Sequence[Array]
):
    """`predict` under u, which is constant where there is no u_end."""
    (algorithm, dt), (belief, _) = fixed, state
    interval = Interval(u, u_end if u_end.size else u, None, dt)
    finite = jnp.all(jnp.isfinite(u)) & jnp.all(jnp.isfinite(u_end))
    return (_now(algorithm, row).predict(belief, interval), u), Info(), jnp.where(finite, 0, REFUSED)


FUNCTIONS = {"correct": _correct, "predict": _predict}


class InfoInMemory(Info):
    """An `Info` in its own memory; a field is read when it is used."""

    __slots__ = ("_fields", "_memory")
    __setattr__, __delattr__ = object.__setattr__, object.__delattr__  # its fields are properties

    def __init__(self, fields: Mapping[str, Callable[[bytes], Any]], memory: bytes):
        self._fields = fields
        self._memory = memory

    def whole(self) -> Info:
        """The info itself."""
        return Info(**{name: read(self._memory) for name, read in self._fields.items()})

    def __repr__(self) -> str:
        return repr(self.whole())

    def __reduce__(self):
        return Info, tuple(getattr(self, name) for name in self._fields)


for _name in Info.__dataclass_fields__:
    setattr(InfoInMemory, _name, property(lambda info, name=_name: info._fields[name](info._memory)))
jax.tree_util.register_pytree_node(
    InfoInMemory, lambda info: jax.tree_util.tree_flatten(info.whole()), jax.tree_util.tree_unflatten
)


class Quick:
    """The steps of one run, and its position. Raises `UnsupportedError` where they cannot be machine code."""

    def __init__(self, progress: Any):
        self.algorithm, self.model, self.hold = progress.algorithm, model_of(progress.algorithm), progress.hold
        self.sample, self.corrected, self.info = progress.sample, progress.corrected, progress.info
        self.continuous = self.model.is_continuous
        self.dt = progress.dt if self.continuous else self.model.dt
        self.end = self.model.steps or math.inf
        inputs = [self.model.inputs.index(name) for name in self.algorithm.names.inputs]
        self.outputs, self.inputs = (self.model.p,), (len(inputs),)
        self.direct = bool(self.model.feeds_through(inputs))
        self.moving_input = self.hold == "first_order" and bool(inputs)
        self.once = self.model.S is not None
        point = self.model.operating_point
        self.rest = np.zeros(len(inputs)) if point is None else point.inputs[inputs]
        self.lengths: dict[float, tuple[np.ndarray, np.ndarray | None]] = {}
        self.places: dict[Any, list[Place]] = {}
        self.at: Any = self.algorithm
        self._begin((progress.state, progress.held))

    def correct(self, y: Numbers, u: Numbers | None) -> int | None:
        """The outcome code; the run advances where it is 0. None where an argument must be checked first."""
        if not _plain(y, self.outputs) or not (_plain(u, self.inputs) if u is not None else not self.direct):
            return None
        step = self.here.after.get("correct")
        if step is None or self.sample >= self.end or (self.once and self.corrected):
            return None
        sample, direct, row = step.inputs
        sample[...] = y
        if self.rows is not None:
            row[...] = self.rows[self.sample]
        if u is None:
            code = step.run()
        else:
            direct[...] = u
            code = step.run()
            direct[...] = self.rest
        if code == 0:
            self.here = step.there
            self.corrected = True
            self.info = InfoInMemory(step.fields, step.report.tobytes())
        return code

    def predict(self, u: Numbers | None, u_end: Numbers | None, dt: float | None) -> int | None:
        """0 where the run is at the next sample; None where an argument must be checked first."""
        step = self.here.after.get("predict")
        if step is None or self.sample >= self.end or not self._plain_inputs(u, u_end) or not self._lasts(dt):
            return None
        start, end, row = step.inputs
        if u is not None:
            start[...] = u
        if u_end is not None:
            end[...] = u_end
        if self.rows is not None:
            row[...] = self.rows[self.sample]
        code = step.run()
        if code == 0:
            self.here = step.there
            self.corrected = False
            self.sample += 1
            self.dt = self.clock
        return code

    def follow(self, algorithm: Algorithm[Any]) -> None:
        """Continue with an algorithm that differs in its numbers: those of a scheduled model at another value."""
        self.at = algorithm
        self.lengths = {}
        numbers = self._numbers(self.clock or 0.0)
        self.fixed[:], self.rows = numbers

    def prepare(self, kind: str, dt: float = 0.0) -> None:
        """Prepare the step of this kind from here, of `dt` seconds for a continuous model. Raises `UnsupportedError`."""
        if kind == "predict" and self.continuous:
            self._set(dt, self._numbers(dt))
            self.dt = dt
        self._step(kind, self.here)

    @property
    def state(self) -> Any:
        """The current state of the algorithm, and the held input."""
        return self.here.state

    def _plain_inputs(self, u: Numbers | None, u_end: Numbers | None) -> bool:
        plain = _plain(u, self.inputs) if u is not None else not self.inputs[0]
        return plain and (_plain(u_end, self.inputs) if self.moving_input else u_end is None)

    def _lasts(self, dt: float | None) -> bool:
        """Whether the numbers of a step of `dt` seconds are loaded, or can be."""
        if dt is None:
            if not self.continuous:
                return True
            dt = self.dt
        if not isinstance(dt, float):
            return False
        if dt == self.clock:
            return True
        known = self.continuous and dt in self.lengths
        if known:
            self._set(dt, self.lengths[dt])
        return known

    def _set(self, dt: float, numbers: tuple[np.ndarray, np.ndarray | None]) -> None:
        self.clock = dt
        self.fixed[:], self.rows = numbers

    def _numbers(self, dt: float) -> tuple[np.ndarray, np.ndarray | None]:
        """The numbers of the algorithm sampled at a step length, and those that it looks up by row, if any."""
        if dt not in self.lengths:
            algorithm, moving = self._sampled(dt)
            if _form(algorithm) != self.form:
                raise UnsupportedError(f"a step of {dt:g} s has other equations than the earlier ones")
            if len(self.lengths) == LENGTHS:
                self.lengths.clear()
            self.lengths[dt] = flat((algorithm, dt)), _by_row(moving)
        return self.lengths[dt]

    def _sampled(self, dt: float) -> tuple[Any, list[np.ndarray]]:
        return looked_up(sampled(self.at, Clock.every(dt, self.hold)), self.model.steps or 1)

    def _begin(self, state: tuple[Tree, Array]) -> None:
        """The start of the run, and the steps of a cycle; `correct` may come before the first length is known."""
        self.clock, dt = self.dt, float(self.dt or self.model.dt or 0.0)
        algorithm, moving = self._sampled(dt)
        self.form = _form(algorithm)
        self.fixed, self.rows = flat((algorithm, dt)), _by_row(moving)
        self.example = (algorithm, dt), [array[0] for array in moving]
        self.here = self._place(state)
        self.here.flat[:] = flat(state)
        place = self.here
        for kind in ("correct", "predict", "correct", "predict")[self.corrected :]:
            place = self._step(kind, place).there

    def _step(self, kind: str, here: Place) -> Step:
        """The step of this kind from a place."""
        if kind not in here.after:
            fixed, row = self.example
            u, end = np.zeros(self.inputs), np.zeros(self.inputs if self.moving_input else 0)
            inputs = (np.zeros(self.outputs), u, row) if kind == "correct" else (u, end, row)
            code = code_of(FUNCTIONS[kind], fixed, here.form, *inputs)
            here.after[kind] = step = Step(code, self.fixed, here, self._place(code.next, here))
            step.inputs[1 if kind == "correct" else 0][:] = self.rest
        return here.after[kind]

    def _place(self, state: Tree, other: Place | None = None) -> Place:
        """A place for states of this form, different from the other one: at most two of each form."""
        places = self.places.setdefault(_form(state), [])
        free = [place for place in places if place is not other]
        if not free:
            free = [Place(state)]
            places += free
        return free[0]


def _plain(numbers: Numbers | None, shape: tuple[int]) -> bool:
    """Whether these numbers are plain: an array of floats, or a list of them, of the right shape."""
    if type(numbers) is np.ndarray:
        return numbers.dtype is FLOAT and numbers.shape == shape
    return type(numbers) is list and len(numbers) == shape[0] and {*map(type, numbers)} == {float}


def _form(tree: Tree) -> Any:
    """A tree without its numbers."""
    leaves, structure = jax.tree_util.tree_flatten(form_of(tree))
    return structure, tuple(leaves)


def _by_row(arrays: list[np.ndarray]) -> np.ndarray | None:
    """Arrays with a leading axis of rows, as words side by side."""
    sides = [np.reshape(array, (len(array), -1)) for array, _ in words([(array, None) for array in arrays])]
    return np.concatenate(sides, axis=1, dtype=float) if sides else None
