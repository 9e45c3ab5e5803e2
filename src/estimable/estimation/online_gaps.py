"""A run one sample at a time across gaps: it goes back to the state before a gap until something is known again."""

from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..annotations import Tree
from ..filters.belief import Belief
from ..filters.restarting import restarting
from ..frozen import replace
from ..models.sampled import Clock
from ..protocols import Algorithm
from ..results import Gap, Interval
from .following import channels_of
from .gap_numbers import Known
from .gapped import restarts_of
from .gaps import LONG, SHARE, Gaps, Given, read


def settings_of(given: Given, algorithm: Algorithm[Any], faults: checks.Faults) -> Gaps | None:
    """The settings of gaps; None where they are refused."""
    settings, model = read(given, len(algorithm.names.inputs), faults), algorithm.innermost.model
    if settings.how == "bridge" and settings.diffusion is None:
        faults.add('a bridge online needs the variance of the inputs per second: gaps = Gaps("bridge", diffusion=...).')
    if settings.how != "refuse" and (model.varying or channels_of(algorithm)):
        faults.add('`gaps` online needs a model that does not vary in time. Give gaps = "refuse".')
    faults.finish()
    return None if settings.how == "refuse" else settings


class Anchor(NamedTuple):
    """The state after the last sample of which something is known, the last known input, and the seconds since that sample.
    `since`: how long the input had not been known there."""

    state: Any
    u: np.ndarray
    seconds: float
    since: float = 0.0


class StepAcross(NamedTuple):
    """A step across (part of) a gap: the algorithm, from which state, over which interval, and what is done."""

    algorithm: Any
    state: Any
    interval: Interval
    anchor: Anchor
    gap: Gap


class OnlineGaps:
    """What a run does where its input is unknown."""

    def __init__(self, algorithm: Algorithm[Any], settings: Gaps, hold: str):
        self.known = Known(algorithm, hold, settings, False)
        self.settings, self.hold, self.algorithm = settings, hold, algorithm
        self.known.moves = np.zeros(len(self.known.inputs)) if settings.diffusion is None else settings.diffusion
        self.anchor: Anchor | None = None
        self.since, self.steps = 0.0, 0  # seconds and intervals in which the input was not known
        self.found: list[Gap] = []
        self.fresh = self._anew() if settings.how in ("auto", "break") else None

    def _anew(self) -> Belief | tuple[Belief, ...]:
        if self.settings.restart is None and not self.known.linear:
            checks.refuse("a nonlinear model has no stationary spread: give gaps=Gaps(..., restart=Prior(...)).")
        return restarts_of(self.known, self.settings)

    def with_room(self, algorithm: Algorithm[Any]) -> Any:
        """The algorithm whose state has room for the diffuse directions of a break."""
        return algorithm if self.fresh is None else restarting(algorithm, self.fresh)

    def pass_known(self, state: Tree, u: np.ndarray, dt: float) -> None:
        """Begin anew after an interval whose input was known: at its end too where it moves linearly."""
        self.anchor = Anchor(state, u, dt)
        self.since, self.steps = (0.0 if self.hold == "first_order" else dt), 0

    def covers(self, u: np.ndarray, u_end: np.ndarray, dt: float, regular: float | None) -> bool:
        """Whether a step is part of a gap: an input is NaN, or the step is too long for one."""
        return bool(np.isnan(u).any() or np.isnan(u_end).any() or (len(u) and self.long(dt, regular)))

    def long(self, dt: float, regular: float | None) -> bool:
        """Whether a step is longer than a regular one, and that says something."""
        return regular is not None and dt > LONG * regular and self.settings.diffusion is not None

    def step(
        self, state: Tree, held: np.ndarray, u: np.ndarray, u_end: np.ndarray, dt: float, at: tuple[int, float]
    ) -> StepAcross:
        """The step across a gap. `at`: the sample, and the seconds since the start of the run."""
        anchor, g, unknown = self.anchor, self.known.moves, np.isnan(u)
        if anchor is None or not unknown.any():
            anchor = Anchor(state, np.where(unknown, held, u), 0.0, self.since if unknown.any() else 0.0)
        seconds = anchor.seconds + dt
        self.since, self.steps = anchor.since + seconds, self.steps + 1
        why = self._why_break(self.since, g, at[1] + dt)
        gap = Gap(at[0], at[0] + 1, at[1], dt, "break" if why else "bridge", why)
        if why:
            interval = Interval(anchor.u, anchor.u, None, np.asarray(dt), restart=np.asarray(True))
            return StepAcross(self._sampled(dt), state, interval, anchor._replace(seconds=seconds), gap)
        ends = self.hold == "first_order" and not np.isnan(u_end).any()
        interval = Interval(anchor.u, u_end if ends else anchor.u, None, np.asarray(seconds))
        if anchor.since:  # outputs were seen meanwhile: an error that is constant over the interval, and lasts
            variance = self.steps * g * self.since * (unknown | np.isnan(u_end))
            interval = replace(interval, u_covariance=np.diag(variance))
        elif self.known.exact and (ends or self.hold == "zero_order"):
            interval = replace(interval, u_diffusion=g)
        else:
            interval = replace(interval, u_covariance=np.diag(g * seconds / (4 if ends else 1)))
        if ends:
            self.since, self.steps = 0.0, 0
        if self.fresh is not None:
            interval = replace(interval, restart=np.asarray(False))
        return StepAcross(self._sampled(seconds), anchor.state, interval, anchor._replace(seconds=seconds), gap)

    def _why_break(self, seconds: float, g: np.ndarray, elapsed: float) -> str:
        if self.settings.how != "auto":
            return "as asked" if self.settings.how == "break" else ""
        if self.settings.diffusion is None:
            return "the variance of the input per second is not given"
        return self.known.why_break(seconds, g, elapsed, SHARE)

    def _sampled(self, seconds: float) -> Any:
        """The algorithm over so many seconds."""
        dt = self.known.dt
        lengths, rows = (np.asarray(seconds), None) if not dt else (np.array([seconds]), np.zeros(1, int))
        if dt and abs(seconds - dt) <= 1e-6 * dt:
            lengths, rows = np.asarray(dt), None
        ready = self.algorithm.sampled(Clock(lengths, rows, self.hold, True))
        return self.with_room(ready.at(0))
