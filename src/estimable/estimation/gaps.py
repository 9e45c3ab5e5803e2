"""Where the input of a record is unknown, and what a driver does there."""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from .. import checks
from ..data.record import Record
from ..frozen import frozen, set_field, static
from ..models.prior import Prior
from ..results import Gap
from .gap_numbers import Bridge, Known

HOW = ("auto", "bridge", "break", "refuse")
LONG = 1.5  # times the median step: an interval in which samples are missing
REGULAR = 0.2  # of the median step: how far most steps of a sampled record are from it
ON_GRID = 0.75  # of the steps are about multiples of the median: else the record has no sampling rate
SHARE = 0.25  # of a time constant, or of the record: the longest bridge of a model that is not stable


@frozen
class Gaps:
    """What to do where the input was not recorded: `gaps=` of `estimate` and other functions.

    An input was not recorded in a row where it is NaN, and over an interval longer than 1.5 times the median step of a regular
    record. Missing outputs alone are no gap.

    Settings:

    - `how`: "bridge": the input moves linearly across the gap, with the variance of a Brownian motion, a bridge where its end is
      known; "break": the state restarts after the gap, and gains, parameters and unknown inputs are carried over; "auto": a
      bridge while it leaves the state known better than a break would; "refuse": an error that names the gap.
    - `diffusion` (m,): the variance of each input per second. None: from the steps of the logged input as long as the gap.
    - `spread` (m,): the variance of each input about the operating point. None: that of the logged input.
    - `restart`: a `Prior` of the state after a break. None: the spread that the noise and the input give a stable model, and no
      knowledge of directions that are not stable. Nonlinear models need it.

    >>> Gaps("bridge", diffusion=[0.5]).how
    'bridge'
    """

    how: str = static(default="auto")
    diffusion: Any = None
    spread: Any = None
    restart: Prior | None = None

    def __post_init__(self):
        faults = checks.Faults()
        faults.choice("gaps", self.how, HOW)
        for name in ("diffusion", "spread"):
            given = getattr(self, name)
            if given is None:
                continue
            read = faults.array(name, np.atleast_1d(given) if np.ndim(given) == 0 else given, "m")
            if read is not None and np.any(read < 0):
                faults.add(f"`{name}` must be variances, at least 0. Got {checks.short(given)}.")
            set_field(self, **{name: read})
        if self.restart is not None:
            faults.instance("restart", self.restart, Prior)
        faults.finish()


Given: TypeAlias = str | Gaps


def read(given: Given, inputs: int, faults: checks.Faults) -> Gaps:
    """The settings, for a model with so many inputs."""
    if isinstance(given, Gaps):
        for name in ("diffusion", "spread"):
            if (value := getattr(given, name)) is not None and len(value) != inputs:
                faults.add(f"`{name}` of the gaps must have {checks.counted(inputs, 'entry')}, one for each input.")
        return given
    if not faults.choice("gaps", given, HOW):
        return Gaps()
    return Gaps(given)


class GapPlan(NamedTuple):
    """The rows that the engine runs, and the numbers of the intervals after them.

    `rows` (T',): their rows in the record. `u`, `u_covariance`, `u_diffusion`: with a leading axis in a bank. `lengths`: for the
    clock; `seconds`: true ones. `restart`: where the state restarts; None: nowhere. `found`: what was done where.
    """

    rows: np.ndarray
    u: np.ndarray
    seconds: np.ndarray
    lengths: np.ndarray
    u_covariance: np.ndarray | None
    u_diffusion: np.ndarray | None
    restart: np.ndarray | None
    found: tuple[Gap, ...]


def present(record: Record, u: np.ndarray) -> bool:
    """Whether the record, or the inputs u (.., T, m) of a bank, have a gap."""
    return bool(np.isnan(u).any() or record.breaks or _has_long(record, u.shape[-1]))


def plan(
    record: Record, rows: Record, u: np.ndarray, settings: Gaps, known: Known, faults: checks.Faults
) -> GapPlan | None:
    """What to do with the gaps of a record. `rows`: those of a bank, or the record. None with a fault."""
    unknown = np.isnan(u)
    if u.ndim == 3:
        if np.any(unknown != unknown[:1]):
            faults.add("the records of a bank must have inputs that are NaN in the same rows. Run them one by one.")
            return None
        unknown = unknown[0]
    t = np.arange(len(record)) * (record.dt or known.dt or 1.0) if record.t is None else record.t
    missing = np.isnan(rows.y).all(axis=-1)
    missing = missing if missing.ndim == 1 else missing.all(axis=0)
    return _Planner(t, u, unknown, missing, record, settings, known, faults).plan()


def _has_long(record: Record, inputs: int) -> bool:
    return bool(inputs and record.dt is None and record.t is not None and _long(np.diff(record.t)).any())


def _long(steps: np.ndarray) -> np.ndarray:
    """Which intervals of a record with a sampling rate are longer than it."""
    if len(steps) == 0:
        return np.zeros(0, bool)
    median = np.median(steps)
    ratio = steps / median
    on_grid = (np.abs(ratio - np.round(ratio)) <= REGULAR) & (ratio > 0.5)
    regular = np.mean(np.abs(ratio - 1) <= REGULAR) >= 0.5 and np.mean(on_grid) >= ON_GRID
    return (steps > LONG * median) & regular


class _Planner:
    """The making of a plan."""

    def __init__(
        self,
        t: np.ndarray,
        u: np.ndarray,
        unknown: np.ndarray,
        missing: np.ndarray,
        record: Record,
        settings: Gaps,
        known: Known,
        faults: checks.Faults,
    ):
        drop = missing & unknown.all(axis=1) & (u.shape[-1] > 0) & known.steps_may_vary
        drop[[0, -1]] = False
        self.rows = np.flatnonzero(~drop)
        self.t, self.all_t, self.all_u = t[self.rows], t, u
        self.u, self.unknown = np.array(u[..., self.rows, :]), unknown[self.rows]
        self.settings, self.known, self.faults = settings, known, faults
        self.first_order = record.hold == "first_order"
        self.median = float(np.median(np.diff(t))) if len(t) > 1 else float(known.dt or 0.0)
        self.seconds = np.append(np.diff(self.t), self.median)
        long = np.append(_long(np.diff(t)) if record.dt is None and len(t) > 1 else np.zeros(len(t) - 1, bool), False)
        self.long = (long[self.rows] | (np.diff(self.rows, append=len(t)) > 1)) & (u.shape[-1] > 0)
        self.long[-1] = False
        T, m = self.unknown.shape
        self.variance, self.diffusion = np.zeros((*u.shape[:-2], T, m)), np.zeros((*u.shape[:-2], T, m))
        ends = np.searchsorted(self.rows, record.breaks)  # the first row that is run after each break
        self.restart = np.zeros(T, bool)
        self.restart[np.unique(ends[ends > 0]) - 1] = True
        self.breaks = self.restart.copy()
        self.found: list[Gap] = []

    def plan(self) -> GapPlan | None:
        """The whole plan."""
        partly = self._affected()
        for i in np.flatnonzero(self.restart).tolist():
            self._done(i, i + 1, "break", "the record says that nothing connects")
        for i in np.flatnonzero(self.long & ~partly & ~self.restart).tolist():
            self._decide(i, i + 1, self._whole)
        for j in range(self.unknown.shape[1]):
            for a, b in _runs(self.unknown[:, j]):
                self._run(j, a, b)
        if self.settings.how == "refuse" and self.found:
            gap = min(self.found, key=lambda one: one.row)
            self.faults.add(
                f"the input is unknown from row {gap.row} to row {gap.end} (t = {gap.start:g} s, {gap.seconds:.3g} s long): "
                'give gaps = "bridge", "break" or "auto".'
            )
        if not self.found and not np.any(self.unknown):
            return None
        return self._result()

    def _affected(self) -> np.ndarray:
        """The intervals with an input that is not known at an end that matters."""
        partly = np.array(self.unknown.any(axis=1))
        if self.first_order:
            partly = partly | np.append(partly[1:], False)
        partly[-1] = False
        return partly

    def _decide(self, i: int, end: int, bridge: Callable[[int, int, float], None]) -> None:
        """Bridge or break the gap from row i to row `end`."""
        seconds = float(self.t[end] - self.t[i])
        words = self._why_break(seconds)
        if words:
            self.restart[end - 1] = True
            self._done(i, end, "break", words)
        else:
            self._done(
                i,
                end,
                "bridge",
                "the state stays known better than at a restart" if self.settings.how == "auto" else "",
            )
        bridge(i, end, seconds)

    def _why_break(self, seconds: float) -> str:
        """Why a gap is a break; empty for a bridge."""
        if self.settings.how != "auto":
            return "as asked" if self.settings.how == "break" else ""
        return self.known.why_break(seconds, self._diffusion(seconds), float(self.t[-1] - self.t[0]), SHARE)

    def _diffusion(self, seconds: float) -> np.ndarray:
        """The variance per second of each input over a gap, (.., m)."""
        if self.settings.diffusion is not None:
            return np.asarray(self.settings.diffusion)
        return Bridge(self.all_t, self.all_u).diffusion(seconds)

    def _whole(self, i: int, end: int, seconds: float) -> None:
        """A gap between two rows with known inputs."""
        if not self.restart[i]:
            g = self._diffusion(seconds)
            if self.known.exact:
                self.diffusion[..., i, :] = g
            else:  # an error that lasts for the whole gap, of the largest variance
                self.variance[..., i, :] = g * seconds / (4 if self.first_order else 1)

    def _run(self, j: int, a: int, b: int) -> None:
        """Input j is unknown in rows a to b - 1."""
        before, after = a - 1 if a else None, b if b < len(self.t) else None
        self._fill(j, a, b, before, after)
        first = a if not self.first_order or before is None else before
        last = min(b, len(self.t) - 1)
        if last <= first:
            return  # of the last row nothing is predicted
        begin = first if before is None else before
        if not self.restart[last - 1] and not any(gap.end == self.rows[last] for gap in self.found):
            self._decide(begin, last, lambda i, end, seconds: None)
        seconds = float(self.t[last] - self.t[begin])
        g = self._diffusion(seconds)[..., j]
        for i in range(first, last):
            span = (self.t[i] - self.t[begin], self.t[i + 1] - self.t[begin])
            v = self._worst(g, span, seconds, before, after, j)
            self.variance[..., i, j] = (last - first) * v
            if self.long[i] and not self.restart[i] and self.known.exact:
                self.diffusion[..., i, j] = (last - first) * g

    def _worst(
        self, g: np.ndarray, span: tuple[float, float], seconds: float, before: int | None, after: int | None, j: int
    ) -> np.ndarray:
        """The largest variance of the error of input j over an interval of a gap."""
        if before is None and after is None:
            return self.known.variance(self.all_u)[..., j]
        if before is None:
            return g * (seconds - span[0])
        if not self.first_order:
            return g * span[0]
        if after is None:
            return g * span[1]
        s = np.clip(seconds / 2, *span)
        return g * s * (seconds - s) / seconds

    def _fill(self, j: int, a: int, b: int, before: int | None, after: int | None) -> None:
        """The mean of an unknown input: a straight line where it moves, else the last value."""
        u = self.u
        if before is None and after is None:
            mean = self.known.point[j]
            u[..., a:b, j] = mean
        elif before is None:
            u[..., a:b, j] = u[..., after, j][..., None]
        elif after is None or not self.first_order:
            u[..., a:b, j] = u[..., before, j][..., None]
        else:
            s = (self.t[a:b] - self.t[before]) / (self.t[after] - self.t[before])
            start, end = u[..., before, j][..., None], u[..., after, j][..., None]
            u[..., a:b, j] = start + s * (end - start)

    def _done(self, i: int, end: int, done: str, why: str) -> None:
        row, last = int(self.rows[i]), int(self.rows[end])
        self.found.append(Gap(row, last, float(self.t[i]), float(self.t[end] - self.t[i]), done, why))

    def _result(self) -> GapPlan:
        lengths = np.where(self.restart & (self.long | self.breaks), self.median, self.seconds)
        return GapPlan(
            self.rows,
            self.u,
            self.seconds,
            lengths,
            _diagonals(self.variance) if self.variance.any() else None,
            np.ascontiguousarray(self.diffusion) if self.diffusion.any() else None,
            self.restart if self.restart.any() else None,
            tuple(sorted(self.found, key=lambda gap: gap.row)),
        )


def _diagonals(variance: np.ndarray) -> np.ndarray:
    return variance[..., None] * np.eye(variance.shape[-1])


def _runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """(first, after the last) of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
