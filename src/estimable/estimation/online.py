# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
"""Run an algorithm one sample at a time."""

from pathlib import Path
from typing import Any

import jax
import numpy as np

from .. import checks, forks
from ..annotations import Array, Numbers, Tree
from ..data.messy import WILD, name_wild
from ..data.record import LOST
from ..data.record_arguments import UNIFORM
from ..engines import choice
from ..engines.program.primitives import UnsupportedError
from ..errors import EstimableError, RunError
from ..frozen import frozen, replace, static
from ..models.discretisation import HOLDS
from ..models.prior import Prior
from ..models.sampled import Clock
from ..protocols import Algorithm
from ..results import Info, Interval, Outcome, Sample
from .binding import check_algorithm, check_hold, check_prior, check_prior_kind, model_of
from .online_steps import Quick
from .resuming import check_state
from .turns import wait


@forks.jit
def _init(algorithm: Algorithm[Any], prior: Prior | None):
    return algorithm.init(prior)


@forks.jit
def _correct(algorithm: Algorithm[Any], k: int | Array, state: Tree, sample: Sample):
    return algorithm.at(k).correct(state, sample)


@forks.jit
def _predict(algorithm: Algorithm[Any], k: int | Array, state: Tree, interval: Interval):
    return algorithm.at(k).predict(state, interval)


@frozen
class Progress:
    """The complete state of a run: the algorithm, its state, the held input, the last info, and the position."""

    algorithm: Any
    state: Any
    held: Any
    info: Info | None = None
    dt: float | None = static(default=None)
    sample: int = static(default=0)
    corrected: bool = static(default=False)
    hold: str = static(default="zero_order")
    lost: str = static(default="zero")

    def resumed(self) -> "Online":
        """The run that continues from here."""
        check_state(self)
        return Online(self)


class Online:
    """An algorithm that runs sample by sample, made by `online`. It is the only mutable object of estimable.

    For each sample call `correct` with the outputs, then `predict` with the input.

    Calls from several threads run one after another. `copy.copy`, `copy.deepcopy` and `pickle` make an independent run.

    >>> model = StateSpace([[1.0]], [[1.0]], Q=[[0.0]], R=[[1.0]], dt=1)
    >>> running = online(Kalman(model), prior=Prior([0.0], [[1.0]]))
    >>> running.correct([2.0]).mean.tolist()
    [1.0]
    >>> running.predict([0.5])
    >>> running.correct([float("nan")]).mean.tolist()
    [1.5]
    """

    def __init__(self, progress: Progress, engine: str = "auto"):
        self._progress: Progress | None = progress
        self._base = progress
        self._sampled: dict[float | None, Any] = {}
        self._asked = engine
        self._turn = [True]  # without its item while a call runs
        self._wild_is_named = False
        self._quick = self._machine_code(progress)

    @property
    def progress(self) -> Progress:
        """The current state of the run."""
        turn = self._turn
        wait(turn)
        try:
            return self._progress_now()
        finally:
            turn.append(True)

    def __reduce__(self):
        return Online, (self.progress, self._asked)

    def _progress_now(self) -> Progress:
        """`progress`, for a call that has its turn."""
        if self._progress is None:
            quick: Any = self._quick
            (state, held), info = quick.state, jax.tree_util.tree_map(np.asarray, quick.info)
            self._progress = replace(
                self._base, state=state, info=info, held=held, sample=quick.sample, corrected=quick.corrected,
                dt=quick.dt if quick.sample else self._base.dt,
            )  # fmt: skip
        return self._progress

    @progress.setter
    def progress(self, progress: Progress) -> None:
        self._progress, self._base, self._quick = progress, progress, None

    def __repr__(self) -> str:
        return f"Online({type(self.algorithm).__name__} at sample {self._now.sample})"

    @property
    def _now(self) -> Any:
        """The position of the run: `sample`, `corrected`, `dt` and `hold`."""
        return self._quick or self._base

    @property
    def algorithm(self) -> Any:
        """The running algorithm."""
        return self._base.algorithm

    @property
    def engine(self) -> str:
        """The engine that runs the steps: "native" or "xla"."""
        return "xla" if self._quick is None else "native"

    @property
    def info(self) -> Info | None:
        """The report of the last `correct`; None before the first."""
        return self._now.info

    def correct(self, y: Numbers, u: Numbers | None = None, *, arrived: Numbers | None = None) -> Info:
        """Update the estimate with the outputs y (p,) of this sample, NaN where missing, and return the report (an `Info`).

        `u` (m,) is needed only where the input enters y directly (D is not zero). Sensors that report one after the other at
        the same instant may be passed in several calls, with NaN for the others.
        """
        turn = self._turn
        try:
            turn.pop()
        except IndexError:
            wait(turn)
        try:
            quick = self._quick
            if quick is not None and arrived is None and quick.correct(y, u) == 0:
                self._progress = None
                return quick.info
            return self._checked_correct(y, u, arrived)
        finally:
            turn.append(True)

    def _checked_correct(self, y: Numbers, u: Numbers | None, arrived: Numbers | None) -> Info:
        """`correct`, with all checks of its arguments."""
        quick = self._quick
        model, faults = model_of(self.algorithm), checks.Faults()
        faults.learn("p", model.p, f"the model has {checks.counted(model.p, 'output')}")
        seen = faults.array("y", y, "p", nan=True)
        self._check_room(faults)
        if self._now.corrected and model.S is not None:
            faults.add(
                "`correct` was called twice without `predict`: the cross noise `S` of a sample can be used only once."
            )
        if u is None and model.feeds_through(self._inputs):
            faults.add("`u` must be given to correct: the input enters y directly (`D` is not zero).")
        applied = self._applied(u, arrived, faults) if u is not None else self._rest()
        faults.finish()
        seen = self._without_wild(seen)
        if quick is not None and self._is_prepared(quick, "correct"):
            code = quick.correct(seen, applied)
            assert code is not None  # the arguments are plain by now
            self._settle(code)
            self._progress = None
            return quick.info
        fate = None
        if self.algorithm.takes_unknown_arrivals:
            fate = np.full(len(self._inputs), np.nan) if arrived is None else np.asarray(arrived, float)
        sample, now = Sample(np.nan_to_num(seen, nan=0.0), ~np.isnan(seen), applied, fate), self._progress_now()
        state, info = _correct(self._at_step(now.dt), now.sample, now.state, sample)
        info = jax.tree_util.tree_map(np.asarray, info)
        self._settle(int(info.outcome))
        self.progress = replace(now, state=state, info=info, corrected=True)
        return info

    def _without_wild(self, y: np.ndarray) -> np.ndarray:
        """A sample with NaN for values that overflow when they are squared; the first one of the run is logged."""
        wild = np.abs(y) > WILD
        if wild.any() and not self._wild_is_named:
            self._wild_is_named = True
            name_wild(y[None], wild[None], self.algorithm.names.outputs, self._now.sample)
        return np.where(wild, np.nan, y)

    def predict(
        self,
        u: Numbers | None = None,
        *,
        u_end: Numbers | None = None,
        arrived: Numbers | None = None,
        dt: float | None = None,
    ) -> None:
        """Move to the next sample, `dt` seconds later, under the input u (m,).

        `u_end` (m,): the input at the next sample, for an input that moves linearly between samples (hold "first_order").
        `dt`: by default the step of a discrete model; for a continuous one the step of the last call.
        """
        turn = self._turn
        try:
            turn.pop()
        except IndexError:
            wait(turn)
        try:
            quick = self._quick
            if quick is not None and arrived is None and quick.predict(u, u_end, dt) == 0:
                self._progress = None
            else:
                self._checked_predict(u, u_end, arrived, dt)
        finally:
            turn.append(True)

    def _checked_predict(
        self, u: Numbers | None, u_end: Numbers | None, arrived: Numbers | None, dt: float | None
    ) -> None:
        """`predict`, with all checks of its arguments."""
        quick, faults = self._quick, checks.Faults()
        step = self._step(dt, faults)
        self._check_room(faults)
        if u is None and self._inputs:
            faults.add(f"`u` must be given to predict: the model has {self._counted_inputs()}.")
        applied = self._applied(u, arrived, faults) if u is not None else self._rest()
        end = applied
        if self._now.hold == "first_order" and self._inputs:
            if u_end is None:
                faults.add('`u_end` must be given to predict: the input moves between samples (hold = "first_order").')
            else:
                end = self._applied(u_end, None, faults)
        elif u_end is not None:
            faults.add('`u_end` needs online(..., hold="first_order"): this input is constant between samples.')
        faults.finish()
        if quick is not None and self._is_prepared(quick, "predict", step):
            quick.predict(applied, end if quick.moving_input else None, None)
            self._progress = None
            return
        interval = Interval(applied, end, None, np.asarray(step, float))
        now = self._progress_now()
        state = _predict(self._at_step(step), now.sample, now.state, interval)
        self.progress = replace(now, state=state, held=applied, dt=step, sample=now.sample + 1, corrected=False)

    def _machine_code(self, progress: Progress) -> Quick | None:
        """The run as machine code, or None where XLA runs it."""
        if self._asked == "xla" or (self._asked == "auto" and jax.default_backend() != "cpu"):
            return None
        try:
            if progress.algorithm.takes_unknown_arrivals:
                raise UnsupportedError("inputs of unknown arrival are not supported")
            return Quick(progress)
        except EstimableError:
            raise
        except Exception as reason:
            why = reason
        self._pass_over(why)
        return None

    def _is_prepared(self, quick: Quick, kind: str, dt: float = 0.0) -> bool:
        """Whether machine code is ready for a step; otherwise XLA continues."""
        try:
            quick.prepare(kind, dt)
            return True
        except EstimableError:
            raise
        except Exception as reason:
            why = reason
        self._pass_over(why)
        self.progress = self._progress_now()
        return False

    def _pass_over(self, why: Exception) -> None:
        name = type(self.algorithm).__name__
        if self._asked == "native":
            checks.refuse(f'engine = "native" cannot run {name} online: {choice.reason_of(why)}. Use "auto" or "xla".')
        choice.pass_over("native", name, why)

    def _settle(self, code: int) -> None:
        outcome = Outcome.of(code, self._now.sample, None)
        if outcome.code:
            raise RunError(outcome)

    def save(self, path: str | Path) -> None:
        """Write the algorithm and its state to a file. `load` reads the file, and the run resumes."""
        from ..store.save import save

        save(path, self)

    def _step(self, dt: float | None, faults: checks.Faults) -> Any:
        model = model_of(self.algorithm)
        if dt is None:
            if model.is_continuous and self._now.dt is None:
                faults.add("`dt` must be given to the first predict: the model is continuous.")
            return self._now.dt if model.is_continuous else model.dt
        dt = faults.number("dt", dt, above=0.0, unit="seconds")
        if (
            dt is not None
            and model.dt is not None
            and not model.is_continuous
            and abs(dt - model.dt) > UNIFORM * model.dt
        ):
            faults.add(
                f"`dt` = {dt:g} s, but the model is discrete with dt = {model.dt:g} s: a continuous one is needed."
            )
        return dt

    def _applied(self, u: Numbers, arrived: Numbers | None, faults: checks.Faults) -> Any:
        """The input that the actuator applies: u where it arrived, else zero or the held input."""
        faults.learn("m", len(self._inputs), f"the model has {self._counted_inputs()}")
        sent = faults.array("u", u, "m")
        if arrived is None or sent is None:
            return sent
        fate = faults.array("arrived", arrived, "m", nan=True)
        if self.algorithm.takes_unknown_arrivals:
            return sent
        if fate is not None and not np.all((fate == 0) | (fate == 1)):
            faults.add("`arrived` must be 1 (applied) or 0 (lost): this algorithm needs every input.")
        return np.where(fate == 1, sent, self._progress_now().held if self._base.lost == "hold" else 0.0)

    def _rest(self) -> np.ndarray:
        point = model_of(self.algorithm).operating_point
        return np.zeros(len(self._inputs)) if point is None else point.inputs[self._inputs]

    @property
    def _inputs(self) -> list[int]:
        """The model's known inputs: all but those of an `UnknownInput`."""
        inputs = model_of(self.algorithm).inputs
        return [inputs.index(name) for name in self.algorithm.names.inputs]

    def _counted_inputs(self) -> str:
        known = "" if len(self._inputs) == model_of(self.algorithm).m else "known "
        return checks.counted(len(self._inputs), f"{known}input")

    def _check_room(self, faults: checks.Faults) -> None:
        steps = model_of(self.algorithm).steps
        if steps is not None and self._now.sample >= steps:
            faults.add(f"the model varies over {steps} rows of time, and all of them have been used.")

    def _at_step(self, dt: float | None) -> Any:
        """The algorithm sampled at a step length; `correct` does not depend on it."""
        if dt is None:
            dt = next(iter(self._sampled), model_of(self.algorithm).dt)
        if dt not in self._sampled:
            if len(self._sampled) >= 64:
                self._sampled.clear()
            self._sampled[dt] = self.algorithm.sampled(Clock.every(dt, self._base.hold))
        return self._sampled[dt]


def online(
    algorithm: Algorithm[Any],
    *,
    prior: Prior | None,
    engine: str = "auto",
    hold: str = "zero_order",
    lost: str = "zero",
) -> Online:
    """Start an algorithm that runs one sample at a time. Its results equal those of `estimate` to rounding.

    Then, for each sample, call `.correct(y)` and `.predict(u)`. `.info` is the last report and `.engine` the engine that
    runs. `.save(path)` stores the run, and `load(path)` resumes it.

    - `prior`: the `Prior` of the state at the first sample.
    - `engine`: "native", machine code for small models on a CPU: about two microseconds per sample where y and u are float64
      arrays, or lists of floats; "xla": some hundreds of microseconds; "auto": the first of these that can run the algorithm.
    - `hold`: how the input moves between samples, "zero_order" or "first_order".
    - `lost`: what the actuator does when a packet is lost, "zero" or "hold".

    Returns an `Online`. Raises `InputError` for a wrong call, `RunError` where the numbers fail.
    """
    faults = checks.Faults()
    choice.check(engine, faults)
    faults.choice("hold", hold, HOLDS)
    faults.choice("lost", lost, LOST)
    check_algorithm(algorithm, faults)
    check_prior_kind(algorithm, prior, faults)
    faults.finish()
    model = model_of(algorithm)
    if algorithm.has_state_prior:
        check_prior(prior, model, faults)
    check_hold(model, hold, faults)
    faults.finish()
    state = _init(algorithm.sampled(Clock.every(model.dt, hold)), prior)
    return Online(Progress(algorithm, state, np.zeros(len(algorithm.names.inputs)), hold=hold, lost=lost), engine)
