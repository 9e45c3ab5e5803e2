# pyright: reportUnknownArgumentType=false, reportUnknownLambdaType=false, reportUnknownMemberType=false
# pyright: reportUnnecessaryIsInstance=false
"""Records drawn from a model."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .. import checks, forks
from ..annotations import Array, Numbers
from ..data.record import Record
from ..estimation.binding import check_hold, check_prior
from ..frozen import replace
from ..kernels.small import apply, factor
from ..models.discretisation import HOLDS
from ..models.nonlinear_model import NonlinearModel
from ..models.output_error import OutputError
from ..models.plant import Functions
from ..models.prior import Prior
from ..models.sampled import SampledModel
from ..models.state_space import StateSpace
from ..protocols import Link
from ..results import Interval, Simulation, Stacked
from . import motion
from .transmit import Links, Sent, check_links, send_inputs, send_outputs

Model = StateSpace | NonlinearModel | OutputError


def simulate(
    model: Model,
    u: Numbers | None = None,
    *,
    seed: int,
    prior: Prior | None = None,
    steps: int | None = None,
    dt: float | None = None,
    t: Numbers | None = None,
    hold: str = "zero_order",
    input_link: Link | None = None,
    output_link: Link | None = None,
    lost: str = "zero",
    schedule: Mapping[str, Numbers] | None = None,
) -> Simulation:
    """Draw a record of a model under the input u (T, m), with random noises. The same seed gives the same record.

    - `model`: a `StateSpace`, a `NonlinearModel` or an `OutputError`.
    - `steps`: the number of rows, for a model without inputs.
    - `dt` or `t`: the step, or the times (T,), in seconds, for a continuous model.
    - `prior`: the initial state is drawn from it. None: the initial state is the operating point, or zero.
    - `input_link` and `output_link`: links that lose or delay packets of inputs and outputs. `lost`: what the actuator
      applies without a packet, "zero" or "hold" (its last input).
    - `schedule`: {channel: values (T,)}, the course of each channel that the matrices of a scheduled model follow. The record
      has it as an additional output, without noise. A channel that is an input is read from `u`.
    - `substeps`: the number of Runge-Kutta steps between samples for a continuous nonlinear model (default 8). Noise is added
      after each of them, which is exact in the limit of many.

    Returns a `Simulation`. Raises `InputError` with every fault of the call.

    >>> model = StateSpace([[0.9]], [[1.0]], Q=[[0.1]], R=[[0.2]], dt=1)
    >>> simulate(model, [[1.0], [0.0], [0.0]], seed=1).record.y.shape
    (3, 1)
    """
    bank = simulate_bank(model, u, seed=seed, runs=1, prior=prior, steps=steps, dt=dt, t=t, hold=hold,
                         input_link=input_link, output_link=output_link, lost=lost, schedule=schedule)  # fmt: skip
    return jax.tree_util.tree_map(lambda leaf: leaf[0], bank.items)


def simulate_bank(
    model: Model,
    u: Numbers | None = None,
    *,
    seed: int,
    runs: int,
    prior: Prior | None = None,
    steps: int | None = None,
    dt: float | None = None,
    t: Numbers | None = None,
    hold: str = "zero_order",
    input_link: Link | None = None,
    output_link: Link | None = None,
    lost: str = "zero",
    schedule: Mapping[str, Numbers] | None = None,
) -> Stacked:
    """Draw many records at once, for `estimate_bank`. Run 0 equals `simulate` with the same seed.

    Run i draws its noise with the random key `jax.random.fold_in(key(seed), i)`, so its values do not depend on the number of
    runs. The other arguments are as in `simulate`.
    Returns a `Stacked` of `Simulation`s.

    >>> model = StateSpace([[0.9]], Q=[[0.1]], R=[[0.2]], dt=1)
    >>> simulate_bank(model, seed=1, runs=5, steps=3).items.state.shape
    (5, 3, 1)
    """
    model = model.to_state_space() if isinstance(model, OutputError) else model
    links = Links(input_link, output_link)
    _check_call(model, prior, seed, runs, steps)
    model, followed = _along(model, u, schedule)
    record = _empty_record(model, u, steps, dt, t, hold, links, lost)
    sampled, lengths = _ready(model, record)
    forks.check()
    keys = jax.vmap(partial(jax.random.fold_in, jax.random.key(seed)))(jnp.arange(runs))
    drawn = jax.tree_util.tree_map(np.asarray, _draw_all(sampled, lengths, record.u, prior, links, lost, keys))
    t_rows = None if record.t is None else np.broadcast_to(record.t, (runs, *record.t.shape))
    return Stacked(_simulation(replace(_template(record, model, lost, followed), t=t_rows), drawn, followed), runs)


def drawn_from(
    model: Model,
    u: Numbers | None = None,
    *,
    prior: Prior | None = None,
    steps: int | None = None,
    dt: float | None = None,
    t: Numbers | None = None,
    hold: str = "zero_order",
    input_link: Link | None = None,
    output_link: Link | None = None,
    lost: str = "zero",
    schedule: Mapping[str, Numbers] | None = None,
) -> Callable[[Any], Simulation]:
    """Make a function that draws one `Simulation` with a random key, for `monte_carlo`. The arguments are as in `simulate`.

    With the key `fold_in(key(seed), i)` the function draws run i of `simulate_bank`.

    >>> draw = drawn_from(StateSpace([[0.9]], Q=[[0.1]], R=[[0.2]], dt=1), steps=3)
    >>> import jax
    >>> draw(jax.random.key(1)).state.shape
    (3, 1)
    """
    model = model.to_state_space() if isinstance(model, OutputError) else model
    links = Links(input_link, output_link)
    _check_call(model, prior, 0, 1, steps)
    model, followed = _along(model, u, schedule)
    record = _empty_record(model, u, steps, dt, t, hold, links, lost)
    (sampled, lengths), template = _ready(model, record), _template(record, model, lost, followed)

    def draw(key: Array) -> Simulation:
        return _simulation(template, _draw(sampled, lengths, record.u, prior, links, lost, key), followed)

    return draw


def _ready(model: StateSpace | NonlinearModel, record: Record) -> tuple[Any, np.ndarray]:
    """The model prepared for the record's steps, and their lengths (T,)."""
    clock = record.clock(model.dt or None)
    lengths = clock.lengths if clock.rows is None else clock.lengths[clock.rows]
    return motion.ready(model, clock), np.broadcast_to(lengths, len(record)).astype(float)


def _along(
    model: StateSpace | NonlinearModel, u: Numbers | None, schedule: Mapping[str, Numbers] | None
) -> tuple[StateSpace | NonlinearModel, dict[str, np.ndarray]]:
    """The model along the given course of its channels, and those that the record has as additional outputs."""
    if schedule is None and not model.scheduled_by:
        return model, {}
    if schedule is not None and not isinstance(schedule, Mapping):
        checks.refuse(f"`schedule` must be a mapping of channels to values. Got {checks.short(schedule)}.")
    given = dict(schedule or {})
    measured = [channel for channel in model.scheduled_by if channel in model.outputs]
    if measured:
        checks.refuse(
            f"the matrices of the model follow its own output {measured[0]!r}: simulate such a plant as a NonlinearModel."
        )
    columns: Any = np.asarray([] if u is None else u)
    from_u = {name: columns[:, model.inputs.index(name)] for name in model.scheduled_by
              if name in model.inputs and columns.ndim == 2 and columns.shape[1] == model.m}  # fmt: skip
    if not isinstance(model, StateSpace):
        checks.refuse("`schedule` is for a StateSpace with a schedule.")
    return model.along(given | from_u), {name: np.asarray(values, float) for name, values in given.items()}


def _template(
    record: Record, model: StateSpace | NonlinearModel, lost: str, followed: Mapping[str, np.ndarray]
) -> Record:
    """The record of a run without the drawn data."""
    y = np.zeros((len(record), model.p + len(followed)))
    return Record(
        y, record.u, dt=record.dt, t=record.t, hold=record.hold, lost=lost,
        inputs=model.inputs, outputs=(*model.outputs, *followed),
    )  # fmt: skip


def _simulation(template: Record, drawn: "SimulatedRun", followed: Mapping[str, np.ndarray]) -> Simulation:
    y = drawn.y
    if followed:
        xp: Any = jnp if checks.is_traced(y) else np
        columns = xp.stack([xp.asarray(values) for values in followed.values()], axis=-1)
        y = xp.concatenate([y, xp.broadcast_to(columns, (*y.shape[:-1], len(followed)))], axis=-1)
    record = replace(template, y=y, u=drawn.sent.logged, arrived=drawn.sent.arrived)
    return Simulation(record, drawn.x, drawn.sent.applied, drawn.measured, drawn.sent.delay, drawn.delay)


def _check_call(
    model: StateSpace | NonlinearModel, prior: Prior | None, seed: int, runs: int, steps: int | None
) -> None:
    faults = checks.Faults()
    faults.whole("seed", seed, 0)
    faults.whole("runs", runs, 1, checks.MOST_ROWS)
    if steps is not None:
        faults.whole("steps", steps, 1, checks.MOST_ROWS)
    is_model = isinstance(model, StateSpace | NonlinearModel)
    if not is_model:
        faults.add(f"`model` must be a StateSpace, a NonlinearModel or an OutputError. Got {checks.short(model)}.")
    if prior is not None and faults.instance("prior", prior, Prior) and is_model:
        check_prior(prior, model, faults)
        if prior.diffuse is not None:
            faults.add("`prior` must not have diffuse directions: a state cannot be drawn from an infinite variance.")
    faults.finish()


def _empty_record(
    model: StateSpace | NonlinearModel,
    u: Numbers | None,
    steps: int | None,
    dt: float | None,
    t: Numbers | None,
    hold: str,
    links: Links,
    lost: str,
) -> Record:
    """The times and inputs of the run, checked."""
    faults = checks.Faults()
    if dt is not None:
        dt = faults.number("dt", dt, lower=0.0, unit="seconds")
    if t is not None:
        faults.array("t", t, "T")
    faults.choice("hold", hold, HOLDS)
    faults.finish()
    _check_rows(model, u, steps, t, faults)
    if model.is_continuous and dt is None and t is None:
        faults.add("`dt` or `t` must be given, in seconds: the model is continuous.")
    if not model.is_continuous and (t is not None or dt not in (None, model.dt)):
        faults.add(f"the model is discrete with a fixed dt = {model.dt:g} s: leave out `dt` and `t`.")
    check_hold(model, hold, faults)
    check_links(links, lost, model.m, model.p, hold, faults)
    faults.finish()
    rows = next(
        given if isinstance(given, int) else len(np.asarray(given)) for given in (u, steps, t) if given is not None
    )
    record = Record(
        np.zeros((rows, model.p)), np.zeros((rows, 0)) if u is None else u, dt=model.dt or dt, t=t, hold=hold
    )
    if record.u.shape[1] != model.m:
        faults.add(f"`u` must be (T, m) = (T, {model.m}): {_inputs(model)}. Got {record.u.shape}.")
    if np.isnan(record.u).any():
        faults.add("`u` must not hold NaN: a simulation needs every input.")
    if model.steps is not None and model.steps != rows:
        faults.add(f"the model varies over {model.steps} rows of time, but the input has {rows}.")
    faults.finish()
    return record


def _inputs(model: StateSpace | NonlinearModel) -> str:
    return f"the model has {checks.counted(model.m, 'input')}"


def _check_rows(
    model: StateSpace | NonlinearModel, u: Numbers | None, steps: int | None, t: Numbers | None, faults: checks.Faults
) -> None:
    """Check that the number of rows is given exactly once."""
    if u is None and model.m:
        faults.add(f"`u` must be (T, m) = (T, {model.m}): {_inputs(model)}.")
    if np.isscalar(u) or (isinstance(u, np.ndarray) and u.ndim == 0):
        faults.add(f"`u` must be (T, m) = (T, {model.m}): one row per sample. Got {checks.short(u)}.")
    elif u is not None and (rows := faults.rows("u", u)) is not None and steps not in (None, rows):
        faults.add(f"`steps` = {steps}, but `u` has {rows} rows: leave `steps` out.")
    if t is not None:
        faults.rows("t", t)
    if u is None and steps is None and t is None:
        faults.add("`steps` must be the number of rows to draw, as there is no `u`.")


class SimulatedRun(NamedTuple):
    """One run: arrived outputs y (T, p), states x (T, n), sent and applied inputs, measured outputs, their delays."""

    y: Any
    x: Any
    sent: Sent
    measured: Any
    delay: Any


def _draw(
    model: SampledModel | Functions,
    lengths: Array,
    u: Array,
    prior: Prior | None,
    links: Links,
    lost: str,
    key: Array,
) -> SimulatedRun:
    """One run, in absolute units."""
    start = motion.origin(model)
    T, n = u.shape[0], start.shape[0]
    x_mean, x_factor = start, jnp.zeros((n, n))
    if prior is not None:
        x_mean, x_factor = jnp.asarray(prior.mean), factor(prior.covariance)
    first, rows = jax.random.split(key)
    x0 = x_mean - start + apply(x_factor, jax.random.normal(first, (n,)))
    noise = jax.random.normal(rows, (T, motion.noises(model)))
    sent = send_inputs(links.input, u, key, lost)
    u_end = jnp.concatenate([sent.applied[1:], sent.applied[-1:]])

    def step(x: Array, row: tuple[Array, Interval, Array]) -> tuple[Array, tuple[Array, Array]]:
        k, interval, e = row
        x_next, y = motion.move(model, x, k, interval, e)
        return x_next, (y, start + x)

    steps = (jnp.arange(T), Interval(sent.applied, u_end, None, lengths), noise)
    measured, x = jax.lax.scan(step, x0, steps)[1]
    y, delay = send_outputs(links.output, measured, key)
    return SimulatedRun(y, x, sent, measured, delay)


@forks.jit(static_argnames=("lost",))
def _draw_all(
    model: SampledModel | Functions,
    lengths: Array,
    u: Array,
    prior: Prior | None,
    links: Links,
    lost: str,
    keys: Array,
) -> SimulatedRun:
    """One run per key."""
    return jax.vmap(lambda key: _draw(model, lengths, u, prior, links, lost, key))(keys)
