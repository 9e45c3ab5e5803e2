"""One step of a closed loop: measure, correct, act, move. It has the form of any algorithm's step, so every engine runs it."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..annotations import Array, Tree
from ..frozen import frozen, replace, static
from ..kernels.small import apply
from ..models.plant_steps import Steps
from ..models.prior import Prior
from ..protocols import Link
from ..results import Info, Interval, Sample
from .loop_gaps import UnknownInputs
from .plant_motion import acting, effective, move, phase_of, placed, row_of
from .transmit import Links


@frozen
class LoopInputs:
    """The inputs of the loop at one instant: unit normal noises, uniform draws of the links, the reference, and the phase of
    the plant (its entry 1, the others 0). `push` (n,): what disturbances add to the next state; `sensed`: what failures of
    sensors do, with the draw `sensor_noise` (p,); `position_noise` (2, m): of the positions measured
    now and at the next sample. `gap`: which inputs are unknown. `begin`, `place`: data of a window from the previous block
    (`window_loop`)."""

    noise: Any
    input_draw: Any
    output_draw: Any
    reference: Any
    phase: Any
    seen: Any
    push: Any = None
    sensed: Any = None
    sensor_noise: Any = None
    position_noise: Any = None
    gap: Any = None
    begin: Any = None
    place: Any = None


@frozen
class LoopState:
    """The states of the plant, the estimator, the controller and the links. x: the deviation of the state; `position` (m,): of
    the actuators; `commands` (L, m): the last ones, the newest first, where actuators delay them; `applied` (m,): the last
    command; `input`, `input_end`: the inputs over the next interval that the estimator knows; `output`: the last reading of
    each sensor, where one may freeze. `last`: the completed outputs of the last sample, and 1 for those seen, for a controller
    that acts before a sample (else None). `held` (m,): what is taken for inputs that are unknown; `gap`: of the last row."""

    x: Any
    position: Any
    commands: Any
    belief: Any
    control: Any
    links: Any
    applied: Any
    input: Any
    input_end: Any
    output: Any = None
    last: Any = None
    held: Any = None
    gap: Any = None


@frozen
class Decided:
    """The result of a sample before the plant moves: the states of estimator, controller and links, the readings, and the
    applied command."""

    belief: Any
    control: Any
    links: Any
    output: Any
    applied: Any
    info: Info
    report: Any


@frozen
class ControlLoop:
    """A plant, an estimator and a controller in a closed loop. `start`: the first state and the first positions. `origin`: the
    states at the operating point. `input_covariance` (m, m): of the measured positions, for estimators that use
    it. `columns`: the plant's outputs that the estimator uses. `commanded`: the estimator moves the
    actuators itself (`Actuated`). `freezes`: a sensor may repeat its last reading. `late`: outputs that arrive
    late are used (`Reordered`)."""

    plant: Steps
    estimator: Any
    controller: Any
    links: Links
    start: Any
    origin: Any
    dt: Any
    position_sigma: Any
    input_covariance: Any
    columns: tuple[int, ...] = static()
    lost: str = static(default="zero")
    commanded: bool = static(default=False)
    freezes: bool = static(default=False)
    late: bool = static(default=False)
    loses: bool = static(default=False)

    def at(self, k: int | Array) -> "ControlLoop":
        """The loop at row k."""
        return replace(self, plant=row_of(self.plant, k), estimator=self.estimator.at(k))

    def init(self, prior: Prior | None) -> LoopState:
        """The state before the first sample."""
        x, rest = (jnp.asarray(part) for part in self.start)
        links = tuple(None if link is None else _begin(link, size) for link, size in
                      ((self.links.input, rest.shape[0]), (self.links.output, self.plant.C.shape[-2])))  # fmt: skip
        p, L = len(self.columns), self.plant.history
        return LoopState(
            x,
            rest,
            jnp.broadcast_to(rest, (L, rest.shape[0])) if L > 1 else None,
            self.estimator.init(prior),
            self.controller.init(),
            links,
            rest,
            rest,
            rest,
            jnp.full(self.plant.C.shape[-2], jnp.nan) if self.freezes else None,
            (jnp.zeros(p), jnp.zeros(p)) if self.acts_first else None,
            *((rest, self._no_gap(rest.shape[0])) if self.loses else ()),
        )

    @property
    def acts_first(self) -> bool:
        """Whether the controller acts on a prediction, before the sample is measured."""
        return self.controller.acts_on == "predicted"

    def correct(self, state: LoopState, row: LoopInputs) -> tuple[LoopState, Info]:
        """Measure, correct, act, and move the plant; or act, measure, correct, where the controller acts first."""
        now = phase_of(self.plant, row.phase)
        if self.acts_first:
            return self._act_first(now, state, row)
        p, position = now.V.shape[0], placed(now, state.position)
        measured = now.rest + apply(now.C, state.x) + apply(now.V, row.noise[:p])
        if now.moves:
            measured = measured + apply(now.D, effective(now, position))
        standing = self._standing(state, acting(now, position), row)
        standing = standing if row.gap is None or not now.moves else _filled(state.held, standing, row.gap.unknown[0])
        decided = self.decide(state, measured, standing, row)
        commands = self._commands(state, decided.applied)
        moved = move(now, state.x, position, commands, row.noise[p:])
        x = moved.x if row.push is None else moved.x + row.push
        after = replace(state, x=x, position=moved.position, commands=commands if state.commands is not None else None)
        if self.commanded or not now.moves:
            known = decided.applied if row.gap is None else _filled(state.held, decided.applied, row.gap.unknown[0])
            return self.go_on(after, decided, state.x, moved.acting, known, known, row.gap)
        end = self._measured(acting(now, moved.position), row, 1)
        end = end if row.gap is None else _filled(standing, end, row.gap.unknown[1])
        return self.go_on(after, decided, state.x, moved.acting, standing, end, row.gap)

    def _no_gap(self, m: int) -> UnknownInputs:
        return UnknownInputs(jnp.zeros((2, m)), jnp.zeros(m), jnp.zeros(()))

    def _standing(self, state: LoopState, position: Array, row: LoopInputs) -> Any:
        """The known inputs at a sample: the measured positions, or the last command."""
        return state.applied if self.commanded or not self.plant.moves else self._measured(position, row, 0)

    def _measured(self, position: Array, row: LoopInputs, end: int) -> Any:
        """The measured positions at the sample (`end` = 0) or at the next one."""
        return position if row.position_noise is None else position + self.position_sigma * row.position_noise[end]

    def _commands(self, state: LoopState, applied: Array) -> Any:
        """The last commands, the newest first."""
        return applied[None] if state.commands is None else jnp.concatenate([applied[None], state.commands[:-1]])

    def delivered(self, state: LoopState, measured: Array, row: LoopInputs) -> Any:
        """The readings of the sensors that arrive at this sample, NaN for the others."""
        measured = self._read(state, measured, row)[0]
        delay = _measure(self.links.output, state.links[1], measured, row.output_draw)[0]
        return jnp.where(delay == 0, measured, jnp.nan)

    def decide(self, state: LoopState, measured: Array, standing: Array, row: LoopInputs) -> Decided:
        """Correct with the outputs that arrive, act, and send the command."""
        measured, output = self._read(state, measured, row)
        delay, sensors = _measure(self.links.output, state.links[1], measured, row.output_draw)
        seen = (jnp.isfinite(delay) if self.late else delay == 0) & (measured == measured)
        block = None if row.begin is None else (row.begin, row.place)
        block = entries(delay, list(self.columns)) if self.late else block
        u = standing if self.plant.moves else jnp.zeros(self.plant.B.shape[-1])
        belief, info = self._learn(state, measured, seen, u, extra=block)
        extra = info.extra or {}
        known = replace(info, extra={**extra, "input": extra["position"] if self.commanded else standing})
        control, u, reported = self.controller.act(state.control, known, row.reference)
        arrived, came, carrier = _command(self.links.input, state.links[0], u, row.input_draw)
        rest = state.applied if self.lost == "hold" else jnp.zeros(u.shape)
        applied = _within(self.plant, jnp.where(came, arrived, rest), state.applied)
        report = {"output": jnp.where(seen, measured, jnp.nan), "command": u, "arrived": came, "applied": applied,
                **{f"controller_{name}": value for name, value in reported.items()}}  # fmt: skip
        return Decided(belief, control, (carrier, sensors), output, applied, info, report)

    def go_on(
        self,
        state: LoopState,
        decided: Decided,
        x: Array,
        acting: Array,
        known: Array,
        known_end: Array,
        gap: UnknownInputs | None = None,
    ) -> tuple[LoopState, Info]:
        """The state of the loop after the plant has moved, and the report of the sample: the state x (n,), the positions that
        act, and the inputs that the estimator knows at both ends of the interval.
        """
        report = {
            **decided.report,
            "state": x + self.origin,
            "input": acting,
            "known_input": known if gap is None else jnp.where(gap.unknown[0] > 0, jnp.nan, known),
            "interval": Interval(known, known_end, None, self.dt, self.input_covariance),
        }
        after = replace(
            state, belief=decided.belief, control=decided.control, links=decided.links, applied=decided.applied,
            output=decided.output, input=known, input_end=known_end, **({} if gap is None else {"held": known_end, "gap": gap}),
        )  # fmt: skip
        return after, replace(decided.info, extra={"estimator": decided.info.extra or {}, "loop": report})

    def _act_first(self, now: Steps, state: LoopState, row: LoopInputs) -> tuple[LoopState, Info]:
        """Act, measure, correct, and move the plant, which has no actuators."""
        p, m = now.V.shape[0], now.B.shape[-1]
        believed, (completed, was_seen) = self.estimator.ahead(state.belief), state.last
        known = replace(believed, extra={**believed.extra, "completed": completed, "seen": was_seen})
        control, u, reported = self.controller.act(state.control, known, row.reference)
        arrived, came, carrier = _command(self.links.input, state.links[0], u, row.input_draw)
        rest = state.applied if self.lost == "hold" else jnp.zeros(m)
        applied = _within(now, jnp.where(came, arrived, rest), state.applied)
        commands = self._commands(state, applied)
        moved = move(now, state.x, placed(now, state.position), commands, row.noise[p:])
        through = apply(now.D, effective(now, moved.position))
        measured = now.rest + apply(now.C, state.x) + through + apply(now.V, row.noise[:p])
        measured, output = self._read(state, measured, row)
        delay, sensors = _measure(self.links.output, state.links[1], measured, row.output_draw)
        seen = (delay == 0) & (measured == measured)
        known = self.links.input is None or self.links.input.acknowledged
        input = applied if known else u
        belief, info = self._learn(state, measured, seen, input, arrived=None if known else jnp.full(m, jnp.nan))
        x = moved.x if row.push is None else moved.x + row.push
        last = info.extra["completed"], jnp.where(entries(seen, list(self.columns)), 1.0, 0.0)
        after = replace(
            state, x=x, position=moved.position, commands=commands if state.commands is not None else None, belief=belief,
            control=control, links=(carrier, sensors), applied=applied, input=input, input_end=input, output=output, last=last,
        )  # fmt: skip
        report = {"output": jnp.where(seen, measured, jnp.nan), "command": u, "arrived": came, "applied": applied,
                "state": state.x + self.origin, "input": moved.acting, "known_input": input,
                **{f"controller_{name}": value for name, value in reported.items()}}  # fmt: skip
        return after, replace(info, extra={"estimator": info.extra or {}, "loop": report})

    def _read(self, state: LoopState, measured: Array, row: LoopInputs) -> tuple[Any, Any]:
        """What the sensors read, NaN where nothing, and the readings to repeat where a sensor may freeze."""
        if row.sensed is None:
            return _rounded(measured, self.plant.resolution), None
        faults = row.sensed
        reading = faults.scale * measured + faults.shift
        reading = _rounded(reading + faults.sigma * row.sensor_noise, self.plant.resolution)
        reading = jnp.where(faults.forced == faults.forced, faults.forced, reading)
        if self.freezes:
            first = state.output != state.output  # before the first reading there is none to repeat
            reading = jnp.where((faults.frozen > 0) & ~first, state.output, reading)
        return jnp.where(faults.dropped > 0, jnp.nan, reading), reading if self.freezes else None

    def predict(self, state: LoopState, interval: Interval) -> LoopState:
        """The prediction of the estimator, from the inputs that it knows."""
        seen = Interval(state.input, state.input_end, None, interval.dt, self.input_covariance)
        if state.gap is not None:
            variance = state.gap.variance[:, None] * jnp.eye(state.gap.variance.shape[0])
            more = variance if self.input_covariance is None else self.input_covariance + variance
            uncertain = self.estimator.innermost.takes_uncertain_inputs
            seen = replace(seen, u_covariance=more if uncertain else None, restart=state.gap.restart > 0)
        return replace(state, belief=self.estimator.predict(state.belief, seen))

    def _learn(
        self,
        state: LoopState,
        measured: Array,
        seen: Array,
        u: Array,
        arrived: Array | None = None,
        extra: Tree = None,
    ):
        columns = list(self.columns)
        y = jnp.where(seen, measured, 0.0)
        sample = Sample(entries(y, columns), entries(seen, columns), u, arrived, extra)
        return self.estimator.correct(state.belief, sample)


def _filled(held: Array, value: Array, unknown: Array) -> Array:
    """The inputs, and what was last known about those that are unknown."""
    return jnp.where(unknown > 0, held, value)


def intervals_of(rows: LoopInputs, step: float) -> Interval:
    """The intervals of the rows of many runs. Their inputs are those of the loop."""
    runs, T = rows.seen.shape[:2]
    return Interval(np.zeros((runs, T, 0)), np.zeros((runs, T, 0)), None, np.full((runs, T), step))


def entries(vector: Array, columns: Sequence[int]):
    """Entries picked one by one, which a straight line of scalars supports."""
    return jnp.concatenate([vector[i : i + 1] for i in columns])


def _begin(link: Link, size: int) -> Any:
    """A link's state with the shapes for packets of `size` channels."""
    fresh = link.init()
    like, _ = jax.eval_shape(lambda: link.send(link.init(), jnp.zeros(size), jnp.zeros(max(link.draws, 1))))
    return jax.tree_util.tree_map(lambda leaf, shape: jnp.broadcast_to(leaf, shape.shape), fresh, like)


def _measure(link: Link, state: Tree, measured: Array, draw: Array):
    """The delays of the outputs, in steps; infinite where one is lost."""
    if link is None:
        return jnp.zeros(measured.shape), None
    state, delivery = link.send(state, measured, draw)
    return delivery.delay, state


def _command(link: Link, state: Tree, u: Array, draw: Array):
    """The commands that arrived at the actuators, and the mask of arrivals."""
    if link is None:
        return u, jnp.ones(u.shape, bool), None
    state, delivery = link.send(state, u, draw)
    came = jnp.isfinite(delivery.age)
    return jnp.where(came, delivery.value, 0.0), came, state


def _rounded(values: Array, step: Array | None):
    """Integer multiples of a step."""
    return values if step is None else jnp.round(values / step) * step


def _within(plant: Steps, command: Array, standing: Array):
    """The command within the limits of the actuators."""
    command = _rounded(command, plant.quantum)
    if plant.limits is not None:
        command = jnp.clip(command, plant.limits[0], plant.limits[1])
    return command if plant.reach is None else jnp.clip(command, standing - plant.reach, standing + plant.reach)
