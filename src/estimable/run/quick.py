"""A run at one sample a call in machine code: `online` checks, this steps."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..engines.single import Step
from ..engines.straight_line import UnsupportedError
from ..engines.written import refuse_varying
from ..models.sampled import Clock
from ..results import Info, Interval, Sample
from .binding import model_of

FLOAT = np.dtype(float)


def _correct(algorithm, state, y, u):
    """`correct` of y, NaN where not seen, and whether y holds what no sample can."""
    seen = y == y
    state, info = algorithm.correct(state, Sample(jnp.where(seen, y, 0.0), seen, u))
    return state, (info, jnp.any(jnp.abs(y) == jnp.inf))


def _predict(algorithm, state, u, u_end, dt):
    """`predict`, and whether u is no number."""
    return algorithm.predict(state, Interval(u, u_end, None, dt)), ~jnp.all(jnp.isfinite(u))


class Told(Info):
    """An `Info` in a flat array, read when it is asked for."""

    def __init__(self, read: Any, flat: np.ndarray):
        self.__dict__.update(read=read, flat=flat, made=None)

    def whole(self) -> Info:
        """The info itself."""
        if self.__dict__["made"] is None:
            self.__dict__["made"] = self.__dict__["read"](self.__dict__["flat"])[0]
        return self.__dict__["made"]

    def __repr__(self) -> str:
        return repr(self.whole())


for _name in Info.__dataclass_fields__:
    setattr(Told, _name, property(lambda told, name=_name: getattr(told.whole(), name)))
jax.tree_util.register_pytree_node(
    Told, lambda told: jax.tree_util.tree_flatten(told.whole()), jax.tree_util.tree_unflatten
)


class Quick:
    """The steps of one run, and where it stands. Raises `UnsupportedError` where they cannot be machine code."""

    def __init__(self, progress: Any):
        model = model_of(progress.algorithm)
        if model.is_continuous:
            raise UnsupportedError("a continuous model, whose steps may differ in length")
        self.algorithm = progress.algorithm.sampled(Clock.every(model.dt, progress.hold))
        refuse_varying(self.algorithm)
        self.dt, self.sample, self.corrected = np.array(model.dt), progress.sample, progress.corrected
        self.held, self.info, self.start = progress.held, progress.info, progress.state
        inputs = [model.inputs.index(name) for name in progress.algorithm.names.inputs]
        self.takes_u, self.takes_end = (
            bool(model.feeds_through(inputs)),
            progress.hold == "first_order" and bool(inputs),
        )
        self.once, self.outputs, self.input = model.S is not None, (model.p,), (len(inputs),)
        point = model.operating_point
        self.rest = np.zeros(len(inputs)) if point is None else point.inputs[inputs]
        self.here: Step | None = None
        self.steps: dict = {}
        example = self._step("correct")
        self.code_at = int(example.tell(np.arange(float(len(example.told))))[0].outcome)

    def accepts(self, y: Any) -> bool:
        """Whether y needs no more than a look: an array as a sample is, to a model that takes nothing else now."""
        plain = type(y) is np.ndarray and y.dtype is FLOAT and y.shape == self.outputs
        return plain and not self.takes_u and not (self.once and self.corrected)

    def accepts_input(self, u: Any) -> bool:
        """The same of an input to `predict`."""
        return type(u) is np.ndarray and u.dtype is FLOAT and u.shape == self.input and not self.takes_end

    def correct(self, y: Any, u: Any) -> tuple[int, bool]:
        """The outcome code, and whether y was refused; the run moves on where both are 0."""
        step = self._at("correct")
        step.inputs[0][:], step.inputs[1][:] = y, u
        step.run()
        code, refused = int(step.told[self.code_at]), bool(step.told[-1])
        if code == 0 and not refused:
            self.here, self.corrected, self.info = step, True, Told(step.tell, step.told.copy())
        return code, refused

    def predict(self, u: Any, u_end: Any) -> bool:
        """Whether u was refused; else the run is at the next sample."""
        step = self._at("predict")
        step.inputs[0][:], step.inputs[1][:] = u, u_end
        step.run()
        if step.told[0]:
            return True
        self.here, self.held, self.corrected, self.sample = step, step.inputs[0], False, self.sample + 1
        return False

    def state(self) -> Any:
        """What is believed now."""
        return self.start if self.here is None else self.here.next_state()

    def _at(self, kind: str) -> Step:
        """The step of this kind, with the state of now."""
        if self.here is None:
            return self._step(kind)
        step = self.here.after.get(kind)
        if step is None:
            step = self.here.after[kind] = self._step(kind)
        step.state[:] = self.here.next
        return step

    def _step(self, kind: str) -> Step:
        """The one step of this kind for states of this form."""
        state = self.state()
        leaves, structure = jax.tree_util.tree_flatten(state)
        key = (kind, structure, tuple(np.shape(leaf) for leaf in leaves))
        if key not in self.steps:
            y, u = np.zeros(self.outputs), np.zeros(self.input)
            inputs = (_correct, y, u) if kind == "correct" else (_predict, u, u, self.dt)
            self.steps[key] = Step(inputs[0], self.algorithm, state, *inputs[1:])
        return self.steps[key]
