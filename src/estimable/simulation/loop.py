"""One step of a closed loop: measure, correct, act, move. It has the form of any algorithm's step, so every engine runs it."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp

from ..annotations import Array, Tree
from ..frozen import frozen, replace, static
from ..kernels.small import apply
from ..models.controlled import Steps
from ..models.prior import Prior
from ..protocols import Link
from ..results import Info, Interval, Sample
from .transmit import Links


@frozen
class LoopInputs:
    """The inputs of the loop at one instant: unit normal noises, uniform draws of the links, the reference, and the phase of
    the plant (its entry 1, the others 0). `begin`, `place`: data of a window from the previous block (`window_loop`)."""

    noise: Any
    input_draw: Any
    output_draw: Any
    reference: Any
    phase: Any
    seen: Any
    begin: Any = None
    place: Any = None


@frozen
class LoopState:
    """The states of the plant, the estimator, the controller and the links; `applied` (m,): the last command of the
    actuators, `input`, `input_end`: their positions over the following interval. `last`: the completed outputs of the last
    sample, and 1 for those seen, for a controller that acts before a sample (else None)."""

    x: Any
    belief: Any
    control: Any
    links: Any
    applied: Any
    input: Any
    input_end: Any
    last: Any = None


@frozen
class Decided:
    """The result of a sample before the plant moves: the states of estimator, controller and links, and the applied input."""

    belief: Any
    control: Any
    links: Any
    applied: Any
    info: Info
    report: Any


@frozen
class ControlLoop:
    """A plant, an estimator and a controller in a closed loop. `columns`: the plant's outputs that the estimator uses."""

    plant: Steps
    estimator: Any
    controller: Any
    links: Links
    x0: Any
    dt: Any
    columns: tuple[int, ...] = static()
    lost: str = static(default="zero")

    def at(self, k: int | Array) -> "ControlLoop":
        """The loop at row k."""
        return replace(self, estimator=self.estimator.at(k))

    def init(self, prior: Prior | None) -> LoopState:
        """The state before the first sample."""
        m = self.plant.B.shape[-1]
        nothing = jnp.zeros(m)
        links = tuple(None if link is None else _begin(link, size) for link, size in
                      ((self.links.input, m), (self.links.output, self.plant.C.shape[-2])))  # fmt: skip
        p = len(self.columns)
        last = (jnp.zeros(p), jnp.zeros(p)) if self.acts_first else None
        return LoopState(
            jnp.asarray(self.x0),
            self.estimator.init(prior),
            self.controller.init(),
            links,
            nothing,
            nothing,
            nothing,
            last,
        )

    @property
    def acts_first(self) -> bool:
        """Whether the controller acts on a prediction, before the sample is measured."""
        return self.controller.acts_on == "predicted"

    def correct(self, state: LoopState, row: LoopInputs) -> tuple[LoopState, Info]:
        """Measure, correct, act, and move the plant; or act, measure, correct, where the controller acts first."""
        if self.acts_first:
            return self._act_first(state, row)
        now = _phase(self.plant, row.phase)
        p = now.V.shape[0]
        measured = apply(now.C, state.x) + apply(now.V, row.noise[:p])
        standing = state.applied if now.L is None else apply(jnp.asarray(now.L), state.x)
        decided = self.decide(state, measured, standing, row)
        x = apply(now.A, state.x) + apply(now.B, decided.applied) + apply(now.W, row.noise[p:])
        end = decided.applied if now.L is None else apply(jnp.asarray(now.L), x)
        return self.go_on(state, decided, x, decided.applied if now.L is None else standing, end)

    def decide(self, state: LoopState, measured: Array, standing: Array, row: LoopInputs) -> Decided:
        """Correct with the outputs that arrive, act, and send the command."""
        measured = _rounded(measured, self.plant.resolution)
        seen, sensors = _measure(self.links.output, state.links[1], measured, row.output_draw)
        block = None if row.begin is None else (row.begin, row.place)
        belief, info = self._learn(state, measured, seen, jnp.zeros(self.plant.B.shape[-1]), extra=block)
        known = replace(info, extra={**(info.extra or {}), "input": standing})
        control, u, reported = self.controller.act(state.control, known, row.reference)
        arrived, came, carrier = _command(self.links.input, state.links[0], u, row.input_draw)
        rest = state.applied if self.lost == "hold" else jnp.zeros(u.shape)
        applied = _within(self.plant, jnp.where(came, arrived, rest), standing)
        report = {"output": jnp.where(seen, measured, jnp.nan), "command": u, "arrived": came, "applied": applied,
                **{f"controller_{name}": value for name, value in reported.items()}}  # fmt: skip
        return Decided(belief, control, (carrier, sensors), applied, info, report)

    def go_on(
        self, state: LoopState, decided: Decided, x: Array, input: Array, input_end: Array
    ) -> tuple[LoopState, Info]:
        """The state of the loop after the plant has moved to x, and the report of the sample."""
        n = len(x) - (0 if self.plant.L is None else self.plant.B.shape[-1])
        report = {
            **decided.report,
            "state": state.x[:n],
            "input": input,
            "interval": Interval(input, input_end, None, self.dt),
        }
        after = LoopState(x, decided.belief, decided.control, decided.links, decided.applied, input, input_end)
        return after, replace(decided.info, extra={"estimator": decided.info.extra or {}, "loop": report})

    def _act_first(self, state: LoopState, row: LoopInputs) -> tuple[LoopState, Info]:
        """Act, measure, correct, and move the plant."""
        now = _phase(self.plant, row.phase)
        p, m = now.V.shape[0], now.B.shape[-1]
        believed, (completed, was_seen) = self.estimator.ahead(state.belief), state.last
        known = replace(believed, extra={**believed.extra, "completed": completed, "seen": was_seen})
        control, u, reported = self.controller.act(state.control, known, row.reference)
        arrived, came, carrier = _command(self.links.input, state.links[0], u, row.input_draw)
        rest = state.applied if self.lost == "hold" else jnp.zeros(m)
        applied = _within(now, jnp.where(came, arrived, rest), state.applied)
        measured = apply(now.C, state.x) + apply(now.D, applied) + apply(now.V, row.noise[:p])
        measured = _rounded(measured, self.plant.resolution)
        seen, sensors = _measure(self.links.output, state.links[1], measured, row.output_draw)
        known = self.links.input is None or self.links.input.acknowledged
        input = applied if known else u
        belief, info = self._learn(state, measured, seen, input, arrived=None if known else jnp.full(m, jnp.nan))
        x = apply(now.A, state.x) + apply(now.B, applied) + apply(now.W, row.noise[p:])
        last = info.extra["completed"], jnp.where(entries(seen, list(self.columns)), 1.0, 0.0)
        after = LoopState(x, belief, control, (carrier, sensors), applied, input, input, last)
        report = {"output": jnp.where(seen, measured, jnp.nan), "command": u, "arrived": came, "applied": applied,
                "state": state.x, "input": applied,
                **{f"controller_{name}": value for name, value in reported.items()}}  # fmt: skip
        return after, replace(info, extra={"estimator": info.extra or {}, "loop": report})

    def predict(self, state: LoopState, interval: Interval) -> LoopState:
        """The prediction of the estimator, from the applied inputs."""
        seen = Interval(state.input, state.input_end, None, interval.dt)
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


def entries(vector: Array, columns: Sequence[int]):
    """Entries picked one by one, which a straight line of scalars supports."""
    return jnp.concatenate([vector[i : i + 1] for i in columns])


def _phase(plant: Steps, weight: Array) -> Steps:
    """The matrices of the phase whose weight is 1."""

    def chosen(stack: Array):
        M = jnp.asarray(stack[0])
        for i in range(1, len(stack)):
            M = jnp.where(weight[i] > 0, jnp.asarray(stack[i]), M)
        return M

    return replace(plant, **{name: chosen(getattr(plant, name)) for name in "ABCDW"}, V=jnp.asarray(plant.V))


def _begin(link: Link, size: int) -> Any:
    """A link's state with the shapes for packets of `size` channels."""
    fresh = link.init()
    like, _ = jax.eval_shape(lambda: link.send(link.init(), jnp.zeros(size), jnp.zeros(max(link.draws, 1))))
    return jax.tree_util.tree_map(lambda leaf, shape: jnp.broadcast_to(leaf, shape.shape), fresh, like)


def _measure(link: Link, state: Tree, measured: Array, draw: Array):
    """The outputs that arrived in time."""
    if link is None:
        return jnp.ones(measured.shape, bool), None
    state, delivery = link.send(state, measured, draw)
    return delivery.arrived, state


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
