"""A bound record with gaps: the rows that the engine runs, and the empty rows inside gaps."""

from typing import Any, NamedTuple

import jax
import numpy as np

from .. import checks
from ..data.record import Record, groups, scatter
from ..filters.belief import Belief, believe
from ..filters.mixture import Mixture
from ..frozen import replace
from ..models.nonlinear_model import NonlinearModel
from ..models.prior import Prior
from ..models.sampled import Clock
from ..models.state_space import StateSpace
from ..protocols import Algorithm, Wrapper
from ..results import Info, Interval
from . import gaps
from .gap_numbers import Known
from .gaps import GapPlan, Gaps


class Gapped(NamedTuple):
    """The plan of a record, and what is known about its algorithm."""

    plan: GapPlan
    known: Known
    record: Record

    def clock(self) -> Clock:
        """The steps between the rows that are run."""
        plan, hold = self.plan, self.record.hold
        lengths, wanders = plan.lengths, plan.u_diffusion is not None
        regular = self.known.dt or None
        width = scatter(plan.seconds, np.median(lengths))
        if np.ptp(lengths) <= width:
            return Clock.every(float(lengths[0]) if regular is None else regular, hold, wanders=wanders)
        distinct, rows = groups(lengths, width)
        filled = 2 ** int(np.ceil(np.log2(len(distinct))))
        return Clock(np.append(distinct, np.full(filled - len(distinct), distinct[-1])), rows, hold, wanders)

    def intervals(self, plain: Interval) -> Interval:
        """The intervals with the uncertainty of their inputs, and the breaks."""
        plan, shape = self.plan, np.shape(plain.dt)
        u_diffusion, u_covariance, restart = plan.u_diffusion, plan.u_covariance, plan.restart
        m = plan.u.shape[-1]
        return replace(
            plain,
            u_diffusion=None if u_diffusion is None else np.broadcast_to(u_diffusion, (*shape, m)),
            u_covariance=None if u_covariance is None else np.broadcast_to(u_covariance, (*shape, m, m)),
            restart=None if restart is None else np.broadcast_to(restart, shape),
        )


def fresh_of(known: Known, settings: Gaps) -> Belief:
    """The belief about the deviation of x after a break."""
    if settings.restart is not None:
        point = known.states if known.linear else 0.0
        return believe(replace(settings.restart, mean=settings.restart.mean - point))
    if known.logged is None:  # how far the input goes is not known, and so neither the state
        n = len(known.states)
        return believe(Prior(np.zeros(n), np.zeros((n, n)), diffuse=np.eye(n)))
    found = known.spread_of(known.moves)
    diffuse = found.diffuse if found.diffuse.shape[1] else None
    return believe(Prior(np.zeros(len(found.covariance)), _rounded(found.covariance), diffuse=diffuse))


def restarts_of(known: Known, settings: Gaps) -> Belief | tuple[Belief, ...]:
    """The same, for a `Mixture` of each of its algorithms, whose models may have further states."""
    algorithm = known.algorithm
    while isinstance(algorithm, Wrapper):
        algorithm = algorithm.algorithm
    if not isinstance(algorithm, Mixture):
        return fresh_of(known, settings)
    return tuple(fresh_of(known.of(one), settings) for one in algorithm.algorithms)


def _rounded(P: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh((P + P.T) / 2)
    return (vectors * np.maximum(values, 0.0)) @ vectors.T


def treated(
    algorithm: Algorithm[Any], record: Record, rows: Record, u: np.ndarray, settings: Gaps, stacked: bool,
    faults: checks.Faults,
) -> Gapped | None:  # fmt: skip
    """What is done with the gaps of a record, if it has any."""
    model = algorithm.innermost.model
    if not isinstance(model, StateSpace | NonlinearModel) or not gaps.present(record, u):
        return None
    known = Known(algorithm, record.hold, settings, stacked)
    known.see(u, record)
    plan = gaps.plan(record, rows, u, settings, known, faults)
    if plan is not None and plan.restart is not None and not known.linear and settings.restart is None:
        faults.add(
            "a nonlinear model has no stationary spread from which its state could restart after a break: give "
            "gaps=Gaps(..., restart=Prior(...))."
        )
    return None if plan is None else Gapped(plan, known, record)


def expanded(info: Info, gapped: Gapped | None, fresh: Belief | None, axis: int = 0, later: Info | None = None) -> Info:
    """The reports with the rows inside gaps. `later`: smoothed reports, for which `info` are those of the filter."""
    reported = info if later is None else later
    if gapped is None or len(gapped.plan.rows) == len(gapped.record) or reported.mean is None:
        return reported
    T, rows = len(gapped.record), gapped.plan.rows
    source = np.searchsorted(rows, np.arange(T), side="right") - 1
    wide = jax.tree_util.tree_map(lambda leaf: np.array(np.take(leaf, source, axis=axis)), reported)
    inside = np.setdiff1d(np.arange(T), rows)
    at = (slice(None),) * axis + (inside,)
    if wide.innovation is not None:
        wide.innovation[at] = np.nan
    if wide.log_likelihood is not None:
        wide.log_likelihood[at] = 0.0
    runs = range(wide.mean.shape[0]) if axis else [None]
    for run in runs:
        for i in inside.tolist():
            one = _Inside(gapped, i, int(source[i]), run)
            one.write(wide, info, later, fresh)
    return wide


class _Inside:
    """A row inside a gap, from the filtered report before it and, for a smoother, the smoothed one after it."""

    def __init__(self, gapped: Gapped, row: int, before: int, run: int | None):
        self.gapped, self.row, self.before, self.run = gapped, row, before, run
        plan, record = gapped.plan, gapped.record
        t = np.arange(len(record)) * (record.dt or gapped.known.dt or 1.0) if record.t is None else record.t
        k = plan.rows[before]
        self.h, self.S = float(t[row] - t[k]), float(t[plan.rows[before + 1]] - t[k])
        self.broken = plan.restart is not None and bool(plan.restart[before])
        self.at = (row,) if run is None else (run, row)

    def write(self, wide: Info, info: Info, later: Info | None, fresh: Belief | None) -> None:
        """Write mean and covariance of this row."""
        if wide.covariance is None:
            if later is None:
                wide.mean[self.at] = self._moved(info)[0]
            return
        if self.broken and fresh is not None:
            mean, P = np.asarray(fresh.mean) + self.gapped.known.states, np.asarray(fresh.covariance)
        elif later is None:
            mean, P, _ = self._moved(info)
        else:
            mean, P = self._smoothed(info, later)
        wide.mean[self.at], wide.covariance[self.at] = mean, P
        if self.broken and fresh is not None and wide.diffuse_covariance is not None:
            wide.diffuse_covariance[self.at] = np.asarray(fresh.diffuse) @ np.asarray(fresh.diffuse).T
        if wide.innovation_covariance is not None:
            C, R = self.gapped.known.output
            wide.innovation_covariance[self.at] = C @ P @ C.T + R

    def _of(self, info: Info, k: int) -> tuple[np.ndarray, np.ndarray]:
        """(x - point, θ) and its covariance in a report."""
        at = (k,) if self.run is None else (self.run, k)
        x = np.asarray(info.mean)[at] - self.gapped.known.states
        P = None if info.covariance is None else np.asarray(info.covariance)[at]
        if info.gain is None:
            return x, np.zeros((len(x), len(x))) if P is None else P
        z = np.concatenate([x, np.asarray(info.gain)[at]])
        if P is None:
            return z, np.zeros((len(z), len(z)))
        across = (info.extra or {}).get("state_gain_covariance")
        cross = np.zeros((len(x), len(z) - len(x))) if across is None else np.asarray(across)[at]
        return z, np.block([[P, cross], [cross.T, np.asarray(info.gain_covariance)[at]]])

    def _moved(self, info: Info) -> tuple[np.ndarray, np.ndarray, Any]:
        """Mean and covariance of x at this row, and (joint mean, joint covariance, numbers) for the smoother."""
        known, plan = self.gapped.known, self.gapped.plan
        z, P = self._of(info, self.before)
        pick = (self.before,) if self.run is None or plan.u.ndim == 2 else (self.run, self.before)
        nxt = (*pick[:-1], pick[-1] + 1)
        u, u_after = plan.u[pick], plan.u[nxt]
        g = np.zeros(len(u))
        if (D := plan.u_diffusion) is not None:
            g = np.asarray(D)[pick if D.ndim == plan.u.ndim else pick[-1:]]
        whole = known.step(self.S, z, P, u, u_after, g, self.S)
        part = known.step(self.h, z, P, u, u + (u_after - u) * (self.h / self.S), g, self.S)
        n = len(known.states)
        mean, C = part.F @ z + part.c, part.F @ P @ part.F.T + part.N
        return mean[:n] + known.states, C[:n, :n], (mean, C, part, whole, z, P, g)

    def _smoothed(self, info: Info, later: Info) -> tuple[np.ndarray, np.ndarray]:
        """Rauch, Tung & Striebel: x at this row given the smoothed state after the gap."""
        known = self.gapped.known
        _, _, (mean, C, part, whole, z, P, g) = self._moved(info)
        n = len(known.states)
        rest = known.step(self.S - self.h, z, P, self.gapped.plan.u[0] * 0, self.gapped.plan.u[0] * 0, g, self.S)
        after, P_after = self._of(later, self.before + 1)
        foreseen, P_foreseen = whole.F @ z + whole.c, whole.F @ P @ whole.F.T + whole.N
        across = part.F @ P @ whole.F.T + known.across(part, rest, g, self.h, self.S)
        J = across @ np.linalg.pinv(P_foreseen, rcond=1e-13, hermitian=True)
        smoothed = mean + J @ (after - foreseen)
        P_smoothed = C + J @ (P_after - P_foreseen) @ J.T
        return smoothed[:n] + known.states, ((P_smoothed + P_smoothed.T) / 2)[:n, :n]
