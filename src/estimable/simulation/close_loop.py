# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownLambdaType=false
# pyright: reportUnnecessaryIsInstance=false
"""Simulation of a plant under a controller that acts on an estimate."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from .. import forks
from ..annotations import Array, Numbers
from ..errors import RunError
from ..estimation.gaps import Gaps, Given
from ..filters.actuated import Actuated
from ..filters.restarting import restarting
from ..frozen import replace
from ..models.controlled import ControlledPlant
from ..models.disturbances import SensorFault
from ..models.event_rows import pushes, sensed
from ..models.output_error import OutputError
from ..models.prior import Prior
from ..models.sampled import Clock
from ..models.state_space import StateSpace
from ..protocols import Algorithm, Controller, Link, RecursiveIdentifier
from ..protocols import Plant as Simulator
from ..results import ClosedLoop, ClosedLoopBank, Info, Names, Outcome
from . import plants_apart, python_loop, scheduled, window_loop
from .late_outputs import Reordered, longest_delay
from .loop import ControlLoop, LoopInputs, intervals_of
from .loop_checks import check_call, check_run, check_simulators, known_hold
from .loop_gaps import check_gaps, planned
from .transmit import Links

Plant = ControlledPlant | StateSpace | OutputError | Simulator
NOISE, INPUT, OUTPUT, SENSOR, POSITION = range(5)  # streams of a run's random numbers


def close_loop(
    plant: Plant,
    controller: Controller[Any],
    estimator: Algorithm[Any],
    *,
    reference: Numbers,
    seed: int,
    prior: Prior | None,
    dt: float | None = None,
    start: Numbers | None = None,
    input_link: Link | None = None,
    output_link: Link | None = None,
    lost: str = "zero",
    on_failure: str = "raise",
    engine: str = "auto",
    schedule: Mapping[str, Numbers] | None = None,
    gaps: Given = "auto",
) -> ClosedLoop:
    """Simulate a closed loop of plant, sensor link, estimator, controller and actuator link along a reference (T, r), or
    (T,).

    At each sample, in this order: the outputs are measured and sent; the estimator corrects; the controller computes its
    command from the estimate; the command is sent; the plant moves; the estimator predicts with the applied inputs. A
    controller that acts on a prediction (`Tracking`) acts before the outputs are measured, so that its input may enter y at
    once.

    - `plant`: a `ControlledPlant`; or a model, whose inputs then act without an actuator; or a simulator (a `Plant`, such as
      `plants.JsbsimF16`), whose loop runs in Python.
    - `controller`: the control law, such as `StateFeedback`.
    - `estimator` and `prior`: as in `estimate`. The model of the estimator may differ from the plant; outputs are matched by
      name. The estimator uses the measured position of the actuator where there is one (`ControlledPlant(actuator=...)`).
      Otherwise, and inside `Actuated`, it uses the command that arrived, which the link must then acknowledge, unless the
      estimator supports unknown arrivals.
    - `input_link`, `output_link`, `lost`: as in `simulate`. Outputs that arrive late are used if the link says late="use": the
      estimator goes back to the sample at which they were measured (1 + the longest delay times the cost).
    - `dt`: the step in seconds, for a continuous plant. `start` (n,): its initial state (default zero).
    - `schedule`: {channel: values (T,), or one number}, the course of each channel that the matrices of the plant or of the
      estimator follow. With a simulator as the plant, the estimator reads a channel without a course from the outputs.
    - `gaps`: what the estimator does while a position is not measured (`SensorFault` of an input), as in `online`: a bridge needs
      the variance of the input per second.
    - `seed`: of the noises and links.
    - `engine`: "auto", "native" or "xla". `on_failure`: "raise" or "keep". Both are as in `estimate`.

    Returns a `ClosedLoop`. Raises `InputError` with every fault of the call; `RunError` where the numbers of the estimator
    fail.

    >>> model = StateSpace([[1.0]], [[1.0]], Q=[[0.0]], R=[[0.0]], dt=1)
    >>> law = StateFeedback([[0.5]], reference_gain=[[0.5]])
    >>> flown = close_loop(model, law, Kalman(model), reference=np.ones(5), seed=0, prior=Prior([0.0], [[0.0]]))
    >>> flown.state.ravel().tolist()
    [0.0, 0.5, 0.75, 0.875, 0.9375]
    """
    bank = close_loop_bank(
        plant, controller, estimator, reference=reference, seed=seed, runs=1, prior=prior, dt=dt, start=start,
        input_link=input_link, output_link=output_link, lost=lost, on_failure=on_failure, engine=engine, schedule=schedule,
        gaps=gaps,
    )  # fmt: skip
    return bank[0]


def close_loop_bank(
    plant: Plant | Sequence[Plant],
    controller: Controller[Any],
    estimator: Algorithm[Any],
    *,
    reference: Numbers,
    seed: int,
    runs: int | None = None,
    prior: Prior | None,
    dt: float | None = None,
    start: Numbers | None = None,
    input_link: Link | None = None,
    output_link: Link | None = None,
    lost: str = "zero",
    first: int = 0,
    on_failure: str = "raise",
    engine: str = "auto",
    schedule: Mapping[str, Numbers] | None = None,
    gaps: Given = "auto",
) -> ClosedLoopBank:
    """Simulate the same loop many times, with new noises and losses each time. Run 0 equals `close_loop` with the same seed.

    `plant` may be a list of plants, such as one plant with different `events`, one for each run (leave `runs` out).
    The arguments, the order within a sample and the errors are those of `close_loop`. `first`: the number of the first run.
    Run i draws its noise with the random key `jax.random.fold_in(key(seed), i)`, so its values do not depend on the number
    of runs. Returns a `ClosedLoopBank`. Use `monte_carlo_loops` for more runs than the memory holds.
    """
    several = isinstance(plant, list | tuple)
    plants = [_plant(one) for one in (plant if isinstance(plant, list | tuple) else [plant])]
    runs = len(plants) if runs is None and several else runs
    along = scheduled.along(plants, estimator, schedule, reference)
    plants, call = along.plants, _Call(controller, along.estimator, Links(input_link, output_link), start, lost, seed)
    followed, step = None, None
    for flown, _ in plants:
        known = call.knowing(flown)
        followed, step = check_call(flown, controller, known, call.links, reference, prior, dt, start, lost)
    assert followed is not None
    assert step is not None
    check_run(seed, runs, first, on_failure, engine, len(plants) if several else None)
    call = call._replace(gaps=check_gaps(plants, along.estimator, gaps, longest_delay(call.links.output) > 0))
    check_simulators([one for _, one in plants if one is not None], several, call.links, along.measured)
    which, simulator = first + np.arange(runs or 0), plants[0][1]
    if several:
        apart = [call.prepared(flown, followed, step, which[i : i + 1]) for i, (flown, _) in enumerate(plants)]
        used, run = plants_apart.scan_bank(engine, apart, prior, step, select=_everything)
    else:
        loop, rows = call.prepared(plants[0][0], followed, step, which)
        given = loop, prior, rows, intervals_of(rows, step)
        if simulator is None:
            used, run = window_loop.scan_bank(engine, *given, select=_everything)
        else:
            follow = None if not along.measured else lambda k, y: call.ready(plants[0][0], step, along.at(k, y))
            used, run = python_loop.scan_bank(simulator, *given, select=_everything, follow=follow)
    info, codes, failed_at = jax.tree_util.tree_map(np.asarray, (run.info, run.code, run.failed_at))
    t = np.arange(len(followed)) * step
    outcomes = tuple(Outcome.of(int(c), int(k), t) for c, k in zip(codes, failed_at, strict=True))
    if on_failure == "raise":
        _raise_failures(outcomes, first)
    closed = replace(_closed(info, t, followed, used, call.knowing(plants[0][0]).names), schedule=along.course or None)
    if several:
        return ClosedLoopBank(closed, outcomes, tuple(flown.events for flown, _ in plants))
    return ClosedLoopBank(replace(closed, events=plants[0][0].events), outcomes)


def _raise_failures(outcomes: tuple[Outcome, ...], first: int) -> None:
    for i, outcome in enumerate(outcomes):
        if outcome.code:
            which = f"Run {first + i}: " if len(outcomes) > 1 else ""
            raise RunError(outcome._replace(sentence=which + outcome.sentence))


class _Call(NamedTuple):
    """The arguments of `close_loop` that are common to all plants of a bank."""

    controller: Controller[Any]
    estimator: Algorithm[Any]
    links: Links
    start: Numbers | None
    lost: str
    seed: int
    gaps: Gaps | None = None

    def knowing(self, plant: ControlledPlant) -> Any:
        """The estimator; an identifier has the names of the plant's channels, where it does not define its own."""
        if isinstance(plant, ControlledPlant) and isinstance(self.estimator, RecursiveIdentifier):
            return self.estimator.for_channels(plant.model.inputs, plant.model.outputs)
        return self.estimator

    def ready(self, plant: ControlledPlant, step: float, estimator: Algorithm[Any]) -> Any:
        """An estimator prepared for steps of `step` seconds."""
        if isinstance(estimator, Actuated):
            estimator = estimator.from_rest(plant.point.inputs)
        ready, longest = (
            estimator.sampled(Clock.every(step, known_hold(plant, estimator))),
            longest_delay(self.links.output),
        )
        return Reordered(ready, longest, plant.model.m, len(estimator.names.outputs)) if longest else ready

    def prepared(
        self, plant: ControlledPlant, followed: np.ndarray, step: float, which: np.ndarray
    ) -> tuple[ControlLoop, LoopInputs]:
        """The loop of a plant for steps of `step` seconds, and the rows of its runs `which`."""
        estimator = self.knowing(plant)
        commanded, sigma = isinstance(estimator, Actuated), plant.position_sigma
        counts = not commanded and estimator.innermost.takes_uncertain_inputs
        columns = tuple(plant.model.outputs.index(name) for name in estimator.names.outputs)
        t = np.arange(len(followed)) * step
        lost = self.gaps and planned(plant, estimator, self.gaps, t, step, known_hold(plant, estimator))
        ready = self.ready(plant, step, estimator)
        ready = ready if lost is None or lost.fresh is None else restarting(ready, lost.fresh)
        loop = ControlLoop(
            plant.steps(step, t), ready, self.controller, self.links, _start(plant, self.start),
            plant.point.states, np.asarray(step), sigma, np.diag(sigma**2) if counts and sigma is not None else None,
            columns=columns, lost=self.lost, commanded=commanded, late=longest_delay(self.links.output) > 0,
            freezes=_freezes(plant), loses=lost is not None,
        )  # fmt: skip
        rows = _rows(loop, plant, t, followed, self.seed, which)
        if lost is None:
            return loop, rows
        gap = jax.tree_util.tree_map(lambda leaf: np.broadcast_to(leaf, (len(which), *leaf.shape)), lost.rows)
        return loop, replace(rows, gap=gap)


def _plant(given: Plant | Sequence[Plant]) -> tuple[Any, Any]:
    """The plant with its actuators, and the simulator that replaces it, or None."""
    if isinstance(given, StateSpace | OutputError):
        return ControlledPlant(given), None
    return (given.linear, given) if isinstance(given, Simulator) else (given, None)


def _freezes(plant: ControlledPlant) -> bool:
    """Whether a sensor may repeat its last reading."""
    return any(isinstance(event, SensorFault) and event.kind == "frozen" for event in plant.events)


def _everything(info: Info, keep: str) -> Info:
    loop = {name: value for name, value in info.extra["loop"].items() if name != "interval"}
    return replace(info, extra={**info.extra, "loop": loop})


def _closed(info: Info, t: np.ndarray, reference: np.ndarray, engine: str, names: Names) -> ClosedLoop:
    """The records of all runs, from the reports of the steps."""
    reported = dict(info.extra["loop"])
    control = {
        name.removeprefix("controller_"): reported.pop(name)
        for name in list(reported)
        if name.startswith("controller_")
    }
    info = replace(info, extra=info.extra["estimator"])
    return ClosedLoop(t=t, reference=reference, info=info, control=control, outcome=Outcome.of(0, 0, None), engine=engine,
                      names=names, **reported)  # fmt: skip


@forks.jit(static_argnames=("T", "sizes"))
def _draw(seed: int, which: np.ndarray, T: int, sizes: tuple[int, ...]):
    """The random numbers of each run, (runs, T, size): normal and uniform ones, by stream."""

    def one(i: Array):
        key = jax.random.fold_in(jax.random.key(seed), i)

        def drawn(stream: int, size: int) -> Any:
            key_ = jax.random.fold_in(key, stream)
            return (
                jax.random.uniform(key_, (T, size), float)
                if stream in (INPUT, OUTPUT)
                else jax.random.normal(key_, (T + 1 if stream == POSITION else T, size))
            )

        return [drawn(stream, size) for stream, size in enumerate(sizes)]

    return jax.vmap(one)(which)


def _rows(
    loop: ControlLoop, plant: ControlledPlant, t: np.ndarray, reference: np.ndarray, seed: int, which: np.ndarray
) -> LoopInputs:
    """The rows of the runs with these indices."""
    T, runs = len(reference), len(which)
    stages, phases = plant.plants_at(t)
    models = [stage.model for stage in stages]
    faults = sensed(plant.events, models, phases, t)
    noises = loop.plant.V.shape[-1] + loop.plant.W.shape[-1]
    unused = plant.model.m if plant.mode == "moving" else 0  # one for each actuator, which has no noise
    sizes = (noises + unused, *(0 if link is None else max(link.draws, 1) for link in loop.links),
             0 if faults is None else plant.model.p, 0 if plant.position_sigma is None else plant.model.m)  # fmt: skip
    noise, input_draw, output_draw, sensor, position = (np.asarray(drawn) for drawn in _draw(seed, which, T, sizes))
    push = pushes(plant.events, models, phases, t, float(loop.dt))
    weight = np.ones((T, 1)) if plant.varies else np.eye(len(stages))[phases]
    shared = (reference, weight, push, faults)
    reference, phase, push, faults = jax.tree_util.tree_map(
        lambda rows: np.broadcast_to(rows, (runs, *rows.shape)), shared
    )
    return LoopInputs(
        noise[..., :noises], input_draw, output_draw, reference, phase, np.ones((runs, T), bool), push, faults,
        None if faults is None else sensor,
        None if plant.position_sigma is None else np.stack([position[:, :-1], position[:, 1:]], axis=2),
    )  # fmt: skip


def _start(plant: ControlledPlant, start: Numbers | None) -> tuple[np.ndarray, np.ndarray]:
    """The deviation of the initial state, and the actuators at rest."""
    x = np.zeros(plant.model.n) if start is None else np.asarray(start, float) - plant.point.states
    return x, np.asarray(plant.point.inputs, float)
