"""An algorithm whose record holds the commands of actuators."""

from dataclasses import KW_ONLY, field
from typing import Any, Self

import numpy as np

from .. import checks
from ..frozen import frozen, replace, set_field
from ..models.actuator import by_input
from ..models.chain import Chain, ChainState, chain
from ..models.prior import Prior
from ..models.sampled import Clock
from ..protocols import Wrapper
from ..results import Info, Interval, Sample
from .wrapped import check_algorithm


@frozen
class Commanded:
    """The state of the wrapped algorithm, and that of the actuators."""

    state: Any
    actuators: ChainState


@frozen
class Actuated(Wrapper[Commanded]):
    """A wrapper around another algorithm, for records that hold the commands of actuators instead of their positions.

    Model: the inputs of the algorithm's model are positions. Each follows its command as its healthy `Actuator` does, with its
    delay, limits and rate; known limits are thus no evidence of a failure. Over an interval the input is the mean of the
    position, exactly; at a sample, where the input enters y directly, it is the position.

    Assumes that the actuators are healthy and their numbers right, and that commands are held from sample to sample. A
    difference between position and command looks like a change of gain or a disturbance. Measured positions are better: with
    them leave this wrapper out.

    Settings: `algorithm`; `actuators`: an `Actuator` for all inputs, or {input: Actuator} (the others are positions); `start`
    (m,): the inputs before the first command (default None: where the first command holds the actuators). Put it around all
    other wrappers: a window would start the actuators again.

    Reports `extra["position"]` (m,), the inputs at the sample. For a whole record `through_actuators` does the same, also for
    `smooth` and `identify`.

    Cost: one exponential and about 30 operations for each input.

    Reference: ours.

    >>> model = StateSpace([[1.0]], [[0.1]], Q=[[0.0]], R=[[0.01]], dt=0.1, inputs=["valve"])
    >>> slow = Actuated(Kalman(model), {"valve": Actuator(5.0, limits=(0.0, 0.8))}, start=[0.0])
    >>> record = Record([0.0, 0.0], [1.0, 1.0], dt=0.1, inputs=["valve"])
    >>> estimate(slow, record, prior=Prior([0.0], [[0.0]])).extra["position"].round(4).tolist()
    [[0.0], [0.3148]]
    """

    algorithm: Any
    actuators: Any
    _: KW_ONLY
    start: Any = None
    ready: Chain | None = field(default=None, init=False)

    def __post_init__(self):
        faults = checks.Faults()
        check_algorithm(self.algorithm, faults)
        faults.finish()
        inputs = self.algorithm.names.inputs
        actuators = by_input(self.actuators, inputs, "actuators", faults)
        faults.learn("m", len(inputs), f"the model has {checks.counted(len(inputs), 'input')}")
        start = None if self.start is None else faults.array("start", self.start, "m")
        faults.finish()
        set_field(self, actuators=actuators, start=start)

    def sampled(self, clock: Clock) -> Self:
        """The same wrapper with actuators for the steps of `clock`, around the sampled algorithm."""
        if clock.hold != "zero_order":
            checks.refuse('the record\'s hold must be "zero_order": commands are constant from sample to sample.')
        ready = chain(self.actuators, self.algorithm.names.inputs, self.start, clock)
        return replace(self, algorithm=self.algorithm.sampled(clock), ready=ready, actuators=None, start=None)

    def from_rest(self, inputs: np.ndarray) -> Self:
        """The same wrapper, with actuators that start at these inputs."""
        return self if self.start is not None else replace(self, start=inputs)

    @property
    def _chain(self) -> Chain:
        if self.ready is None:
            checks.refuse("an Actuated algorithm needs the length of its steps: use estimate, online or close_loop.")
        return self.ready

    def init(self, prior: Prior) -> Commanded:
        """The belief of the wrapped algorithm before y[0], and the actuators at their start."""
        return Commanded(self.algorithm.init(prior), self._chain.init())

    def correct(self, state: Commanded, sample: Sample) -> tuple[Commanded, Info]:
        """Update with one sample; the input is the position."""
        position = self._chain.position(state.actuators, sample.u)
        inner, info = self.algorithm.correct(state.state, replace(sample, u=position))
        return replace(state, state=inner), replace(info, extra={**(info.extra or {}), "position": position})

    def predict(self, state: Commanded, interval: Interval) -> Commanded:
        """Move to the next sample with the mean position over the interval."""
        actuators, mean = self._chain.step(state.actuators, interval.u, interval.dt)
        return Commanded(self.algorithm.predict(state.state, replace(interval, u=mean, u_end=mean)), actuators)
