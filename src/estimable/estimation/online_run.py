# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
"""The run of an algorithm one sample at a time."""

from pathlib import Path
from typing import Any

import jax
import numpy as np

from .. import checks, forks
from ..annotations import Array, Numbers, Tree
from ..data.messy import WILD, name_wild
from ..engines import choice
from ..engines.program.primitives import UnsupportedError
from ..errors import EstimableError, RunError
from ..frozen import frozen, replace, static
from ..models.prior import Prior
from ..models.sampled import Clock
from ..protocols import Algorithm
from ..results import Gap, Info, Interval, Outcome, Sample
from .binding import model_of
from .following import Following, Given, Values, channels_of, nominal
from .online_arguments import KnownInputs, step_length
from .online_gaps import OnlineGaps
from .online_steps import Quick, sampled
from .resuming import check_state
from .turns import wait


@forks.jit
def init(algorithm: Algorithm[Any], prior: Prior | None):
    """The state before the first sample."""
    return algorithm.init(prior)


@forks.jit
def _correct(algorithm: Algorithm[Any], k: int | Array, state: Tree, sample: Sample):
    return algorithm.at(k).correct(state, sample)


@forks.jit
def _predict(algorithm: Algorithm[Any], k: int | Array, state: Tree, interval: Interval):
    return algorithm.at(k).predict(state, interval)


@frozen
class Progress:
    """The complete state of a run: the algorithm, its state, the held input, the last info, and the position.

    `schedule`: the current values of the channels that the matrices of the model follow.
    """

    algorithm: Any
    state: Any
    held: Any
    info: Info | None = None
    schedule: Any = None
    dt: float | None = static(default=None)
    sample: int = static(default=0)
    corrected: bool = static(default=False)
    hold: str = static(default="zero_order")
    lost: str = static(default="zero")
    gaps: Any = None

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
        self._known = KnownInputs(progress.algorithm)
        self._follows = Following(progress.algorithm, progress.schedule) if channels_of(progress.algorithm) else None
        self._across = None if progress.gaps is None else OnlineGaps(progress.algorithm, progress.gaps, progress.hold)
        self._elapsed = 0.0
        self._quick = self._machine_code(progress)

    @property
    def progress(self) -> Progress:
        """The current state of the run."""
        turn = self._turn
        wait(turn)
        try:
            now = self._progress_now()
            return now if self._follows is None else replace(now, schedule=self._follows.values)
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

    def correct(
        self,
        y: Numbers,
        u: Numbers | None = None,
        *,
        arrived: Numbers | None = None,
        schedule: Values | None = None,
        sigma: Numbers | None = None,
    ) -> Info:
        """Update the estimate with the outputs y (p,) of this sample, NaN where missing, and return the report (an `Info`).

        `u` (m,) is needed only where the input enters y directly (D is not zero). Sensors that report one after the other at
        the same instant may be passed in several calls, with NaN for the others.

        `schedule`: the present values of the channels that the matrices of a scheduled model follow. A channel that is an
        output or an input of the model is read from y or u. Otherwise a value holds until the next is given.

        `sigma` (p,): the standard deviations of the noise of this sample, NaN for that of the model; XLA then runs the steps.
        """
        turn = self._turn
        try:
            turn.pop()
        except IndexError:
            wait(turn)
        try:
            if self._follows is not None or schedule is not None:
                self._follow(y=y, u=u, schedule=schedule)
            quick = self._quick
            plain = self._across is None and arrived is None and sigma is None
            if plain and quick is not None and quick.correct(y, u) == 0:
                self._progress = None
                return quick.info
            return self._checked_correct(y, u, arrived, sigma)
        finally:
            turn.append(True)

    def _checked_correct(self, y: Numbers, u: Numbers | None, arrived: Numbers | None, sigma: Numbers | None) -> Info:
        """`correct`, with all checks of its arguments."""
        quick = self._quick
        model, faults = model_of(self.algorithm), checks.Faults()
        faults.learn("p", model.p, f"the model has {checks.counted(model.p, 'output')}")
        seen = faults.array("y", y, "p", nan=True)
        noise = None if sigma is None else faults.array("sigma", sigma, "p", nan=True)
        if noise is not None and np.any(noise < 0):
            faults.add(f"`sigma` must be standard deviations, at least 0. Got {checks.short(sigma)}.")
        self._check_room(faults)
        if self._now.corrected and model.S is not None:
            faults.add(
                "`correct` was called twice without `predict`: the cross noise `S` of a sample can be used only once."
            )
        if u is None and self._known.direct:
            faults.add("`u` must be given to correct: the input enters y directly (`D` is not zero).")
        applied = self._applied(u, arrived, faults)
        faults.finish()
        seen = self._without_wild(seen)
        if self._across is not None and not np.isnan(seen).all():
            self._across.anchor = None
        if noise is None and quick is not None and self._is_prepared(quick, "correct"):
            code = quick.correct(seen, applied)
            assert code is not None  # the arguments are plain by now
            self._settle(code)
            self._progress = None
            return quick.info
        fate = None
        if self.algorithm.takes_unknown_arrivals:
            fate = np.full(len(self._known.columns), np.nan) if arrived is None else np.asarray(arrived, float)
        values, now = np.nan_to_num(seen, nan=0.0), self._progress_now()
        sample = Sample(values, ~np.isnan(seen), applied, fate, sigma=noise)
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
        schedule: Values | None = None,
    ) -> None:
        """Move to the next sample, `dt` seconds later, under the input u (m,). `schedule`: as in `correct`.

        `u_end` (m,): the input at the next sample, for an input that moves linearly between samples (hold "first_order").
        `dt`: by default the step of a discrete model; for a continuous one the step of the last call.
        """
        turn = self._turn
        try:
            turn.pop()
        except IndexError:
            wait(turn)
        try:
            if self._follows is not None or schedule is not None:
                self._follow(u=u, schedule=schedule)
            quick = self._quick
            if self._across is None and quick is not None and arrived is None and quick.predict(u, u_end, dt) == 0:
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
        step = step_length(model_of(self.algorithm), dt, self._now.dt, faults, several=self._across is not None)
        self._check_room(faults)
        if u is None and self._known.columns:
            faults.add(f"`u` must be given to predict: the model has {self._known.counted}.")
        applied = self._applied(u, arrived, faults)
        end = applied
        if self._now.hold == "first_order" and self._known.columns:
            if u_end is None:
                faults.add('`u_end` must be given to predict: the input moves between samples (hold = "first_order").')
            else:
                end = self._applied(u_end, None, faults)
        elif u_end is not None:
            faults.add('`u_end` needs online(..., hold="first_order"): this input is constant between samples.')
        faults.finish()
        if self._across is not None and self._moved_across(applied, end, step):
            return
        if quick is not None and self._is_prepared(quick, "predict", step):
            quick.predict(applied, end if quick.moving_input else None, None)
            self._progress = None
            return
        interval = Interval(applied, end, None, np.asarray(step, float))
        now = self._progress_now()
        state = _predict(self._at_step(step), now.sample, now.state, interval)
        self.progress = replace(now, state=state, held=applied, dt=step, sample=now.sample + 1, corrected=False)

    def _moved_across(self, u: np.ndarray, u_end: np.ndarray, dt: float) -> bool:
        """Whether this step was part of a gap, and has been made."""
        across, now = self._across, self._progress_now()
        assert across is not None
        at = now.sample, self._elapsed
        self._elapsed += dt
        regular = model_of(self.algorithm).dt or now.dt
        if not across.covers(u, u_end, dt, regular):
            across.pass_known(now.state, u, dt)
            return False
        step = across.step(now.state, now.held, u, u_end, dt, at)
        state = _predict(step.algorithm, 0, step.state, step.interval)
        across.anchor = step.anchor
        across.found.append(step.gap)
        usual = dt if regular is None or not across.long(dt, regular) else now.dt
        after = replace(now, state=state, held=step.anchor.u, dt=usual, sample=now.sample + 1, corrected=False)
        self.progress = after
        self._quick = self._machine_code(after)
        return True

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """What was done in each step in which an input was unknown."""
        return () if self._across is None else tuple(self._across.found)

    def _machine_code(self, progress: Progress) -> Quick | None:
        """The run as machine code, or None where XLA runs it."""
        if self._asked == "xla" or (self._asked == "auto" and jax.default_backend() != "cpu"):
            return None
        try:
            if progress.algorithm.takes_unknown_arrivals:
                raise UnsupportedError("inputs of unknown arrival are not supported")
            return Quick(replace(progress, algorithm=nominal(progress.algorithm)))
        except EstimableError:
            raise
        except Exception as reason:
            why = reason
        self._pass_over(why)
        return None

    def _follow(self, **given: Given) -> None:
        """Set the matrices of a scheduled model for the values of a call."""
        follows, faults = self._follows, checks.Faults()
        if follows is None:
            checks.refuse("`schedule` is for a model with a schedule: the matrices of this one follow no channel.")
        values = follows.read(faults, **given)
        faults.finish()
        if not np.array_equal(values, follows.values):
            follows.values, self._sampled = values, {}
        if self._quick is not None and self._quick.at is not (algorithm := follows.now):
            self._quick.follow(algorithm)

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
        """Write the algorithm and its state to a file. `load` reads the file, and the run resumes. Not inside a gap."""
        if self._across is not None and self._across.steps:
            checks.refuse("the run is inside a gap of its input: save it after a step whose input is known.")
        from ..store.save import save

        save(path, self)

    def _applied(self, u: Numbers | None, arrived: Numbers | None, faults: checks.Faults) -> Any:
        """The input that the actuator applies; at rest where none is given."""
        if u is None:
            return self._known.rest
        lost = self._progress_now().held if arrived is not None and self._base.lost == "hold" else 0.0
        return self._known.applied(u, arrived, lost, faults, nan=self._across is not None)

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
            now = self.algorithm if self._follows is None else self._follows.now
            self._sampled[dt] = sampled(now, Clock.every(dt, self._base.hold))
        return self._sampled[dt]
