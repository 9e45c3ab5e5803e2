# pyright: reportUnknownArgumentType=false, reportUnknownLambdaType=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false
"""The most probable states of a nonlinear model: Gauss-Newton over a whole record, each step of which is a smoother."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .. import forks
from ..annotations import Array
from ..engines import choice
from ..filters import belief, nonlinear
from ..filters.belief import Belief
from ..frozen import frozen, replace
from ..kernels.kalman import innovation_of
from ..kernels.rounding import KNOWN
from ..kernels.small import apply, diagonal, solve_lower, triangularise
from ..kernels.smoothing import Instant
from ..models.prior import Prior
from ..results import Info, outcome_code
from .binding import Bound
from .two_filters import Passed, PassedRow, SmootherRows, Smoothing, backwards, select_passed

CLOSE = 1e-10  # of a standard deviation: a smaller change ends the iterations
ROUNDING = 1e-5  # times a state: CLOSE of it is a few units in the last place
SMALL = 1e-8  # of a standard deviation: a change below it that does not become smaller is rounding
ROUNDING_OF_COST = 1e-12
RELAXED = 1e-3  # standard deviations count one where there is no noise
NOT_CONVERGED = 5


@frozen
class About:
    """The filter of the model linearised about a given trajectory, as a step for an engine: rows carry its states."""

    algorithm: Any

    def at(self, k: int | Array) -> "About":
        """The algorithm at row k."""
        return replace(self, algorithm=self.algorithm.at(k))

    def init(self, prior: Prior) -> Belief:
        """The belief before y[0]."""
        return self.algorithm.init(prior)

    def correct(self, state: Belief, row: SmootherRows) -> tuple[Belief, PassedRow]:
        """Update with one sample, and report the belief before it."""
        instant = self._instant(row)
        independently = nonlinear.ready_of(self.algorithm).ready.independent
        after, post = belief.correct(state, instant.measurement, row.sample, independently=independently)
        code = outcome_code(post.contradicted, after.mean, after.factor, after.diffuse)
        return after, PassedRow(Passed(state, instant), post.log_likelihood, code)

    def predict(self, state: Belief, row: SmootherRows) -> Belief:
        """Move to the next sample."""
        return belief.predict(state, self._instant(row).transition, None)

    def _instant(self, row: SmootherRows) -> Instant:
        n = row.about.shape[0]
        point = Belief(row.about, jnp.zeros((n, n)), jnp.zeros((n, 0)), jnp.zeros(n), jnp.zeros(()))
        return self.algorithm.instant_about(row.sample, row.interval, point, point)


class Point(NamedTuple):
    """A trajectory (T, n), the smoother with the model linearised about it, and that model row by row.

    `step` leads to the smoothed states, whose standard deviations are `sigma`; `change` (T,) is its largest entry in these.
    """

    about: np.ndarray
    run: Smoothing
    instant: Instant
    step: np.ndarray
    sigma: np.ndarray
    change: np.ndarray

    @property
    def is_last(self) -> bool:
        """Whether it cannot be improved: the change is negligible, or the numbers failed."""
        return bool(self.run.code) or self.change.max() <= CLOSE


def repeated(bound: Bound, prior: Prior, engine: str, start: Smoothing, iterations: int) -> Smoothing:
    """Linearise about the smoothed states and smooth again, `iterations` times in all, until nothing changes.

    A step that does not lessen the cost is halved. The cost has the noises of the point where the step begins.
    """
    if start.code:
        return start
    problem = _Problem(bound, prior, engine)
    base, length = problem.at(problem.states(start.info)[0]), 1.0
    for _ in range(iterations - 2):
        if base.is_last:
            break
        trial = problem.at(base.about + length * base.step)
        if not problem.cost(trial, base) <= problem.cost(base, base) * (1 + ROUNDING_OF_COST):
            length /= 2
            continue
        if base.change.max() <= trial.change.max() <= SMALL:
            return trial.run
        base, length = trial, min(1.0, 2 * length)
    return base.run if base.is_last else base.run._replace(code=NOT_CONVERGED, at=int(np.argmax(base.change)))


class _Problem:
    """The record, the model and the prior."""

    def __init__(self, bound: Bound, prior: Prior, engine: str):
        self.bound, self.prior, self.engine = bound, prior, engine
        self.algorithm = replace(bound.algorithm, iterations=1)
        self.origin = np.asarray(nonlinear.ready_of(self.algorithm).ready.origin)
        self.start = self.algorithm.init(prior)

    def at(self, about: np.ndarray) -> Point:
        """Both passes with the model linearised about a trajectory."""
        rows = SmootherRows(self.bound.samples, self.bound.intervals, about=about)
        _, run = choice.scan(
            self.engine, About(self.algorithm), self.prior, rows, rows, keep="all", select=select_passed
        )
        rows = replace(rows, predicted=run.info.predicted, instant=run.info.instant, about=None)
        back = backwards(self.bound, rows, run, self.engine)
        states, sigma = self.states(back.info)
        step, scale = states - about, sigma + ROUNDING * np.abs(states)
        change = np.max(np.abs(step) / np.where(scale > 0, scale, 1.0), axis=1)
        return Point(about, back, run.info.instant, step, sigma, change)

    def states(self, info: Info) -> tuple[np.ndarray, np.ndarray]:
        """The smoothed (x, θ), with states in deviations from their origin, and their standard deviations."""
        means, covariances = [np.asarray(info.mean) - self.origin], [info.covariance]
        if info.gain is not None:
            means, covariances = [*means, info.gain], [*covariances, info.gain_covariance]
        variances = [np.diagonal(P, axis1=1, axis2=2) for P in covariances]
        return np.concatenate(means, axis=1), np.sqrt(np.concatenate(variances, axis=1))

    def cost(self, point: Point, weights: Point) -> float:
        """Minus twice the logarithm of the posterior density of a trajectory, but for a constant."""
        samples, about = self.bound.samples, point.about
        record = _cost_of_record(point.instant, weights.instant, about, samples.y, samples.seen, weights.sigma)
        return np.inf if point.run.code else float(record) + _cost_of_start(self.start, about[0])


@forks.jit
def _cost_of_record(values: Instant, weights: Instant, about: Array, y: Array, seen: Array, sigma: Array):
    """The cost of all samples and of all steps between two, with the noises of `weights`."""

    def of_output(values: Instant, weights: Instant, x: Array, y: Array, seen: Array, σ: Array):
        (C, d, _, _, period), V = values.measurement, weights.measurement.V
        e = innovation_of(y, seen, C, x, d, period)
        V = jnp.concatenate([jnp.where(seen[:, None], V, 0.0), jnp.diag(jnp.where(seen, 0.0, 1.0))], axis=1)
        return _squared(e, V, apply(jnp.abs(C), σ))

    def of_step(values: Instant, weights: Instant, x: Array, after: Array, σ: Array):
        F, c, _ = values.transition
        return _squared(after - apply(F, x) - c, weights.transition.W, σ)

    outputs = jax.vmap(of_output)(values, weights, about, y, seen, sigma)
    values, weights = jax.tree_util.tree_map(lambda leaf: leaf[:-1], (values, weights))
    steps = jax.vmap(of_step)(values, weights, about[:-1], about[1:], sigma[1:])
    return jnp.sum(outputs) + jnp.sum(steps)


def _squared(e: Array, W: Array, σ: Array):
    """e' (W W')^-1 e; a part of e that W does not reach counts in RELAXED standard deviations σ, so that it may remain small."""
    L = triangularise(W)
    without = diagonal(L) ** 2 <= KNOWN * jnp.sum(W * W, axis=1)
    return jnp.sum(solve_lower(L + jnp.diag(jnp.where(without, RELAXED * σ - diagonal(L), 0.0)), e[:, None]) ** 2)


def _cost_of_start(start: Belief, x: np.ndarray) -> float:
    """The squared distance of x from its prior, along the directions with a finite variance that is not zero."""
    D = np.asarray(start.diffuse)
    across = np.linalg.svd(D)[0][:, np.linalg.matrix_rank(D) :] if D.size else np.eye(len(x))
    e, Z = across.T @ (x - np.asarray(start.mean)), across.T @ np.asarray(start.factor)
    return float(np.sum(np.linalg.lstsq(Z, e, rcond=None)[0] ** 2))
