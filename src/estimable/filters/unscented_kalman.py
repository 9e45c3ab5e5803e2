"""The unscented and the cubature Kalman filter."""

from dataclasses import KW_ONLY, field
from typing import Any

import jax.numpy as jnp

from .. import checks
from ..annotations import Array
from ..frozen import frozen, set_field, static
from ..kernels import flow, schmidt
from ..kernels.expansion import from_points, sigma_points
from ..kernels.joint_gain import block_diagonal
from ..kernels.kalman import Gaussian, Measurement, Transition, correct
from ..kernels.rounding import KNOWN, MEMORY
from ..kernels.small import apply, diagonal, factor, product, solve_lower, triangularise
from ..kernels.smoothing import Instant
from ..models.plant import Functions
from ..models.prior import Prior
from ..models.uncertainty import ModelUncertainty
from ..protocols import GainAlgorithm
from ..results import Info, Interval, Names, Sample
from . import nonlinear
from .belief import Belief
from .linearised import Linearised
from .sample_noise import noise_of


@frozen
class UnscentedKalman(GainAlgorithm[Belief], Linearised):
    """The unscented Kalman filter: it finds mean and covariance of f and h from 2 n + 1 points, without derivatives.

    Model: that of `ExtendedKalman`. For a continuous model the differential equation moves each point, and its derivatives
    along the mean propagate the noise between samples.

    Assumes that the belief is nearly Gaussian. Mean and covariance are exact where f and h are linear, and the mean also
    where they are quadratic. For quadratic functions of several correlated states the covariance is approximate;
    `SecondOrderKalman` computes it exactly. The filter needs no derivatives, so f and h may have corners. The prior may not
    be diffuse.

    Settings: `model`, `parameters`, `walk`, `uncertainty` as in `ExtendedKalman`; `kappa` κ >= 0, which places the points at
    sqrt(n + κ) standard deviations. None: max(0, 3 - n), with which they match the fourth moments of a Gaussian for n <= 3. 0:
    the cubature filter.

    Cost: 2 n + 1 evaluations of f and of h instead of the derivatives of `ExtendedKalman`.

    Reference: S. J. Julier, J. K. Uhlmann, Proc. IEEE 92 (2004) 401-422, (12)-(15); I. Arasaratnam, S. Haykin, IEEE TAC 54
    (2009) 1254-1269, (38)-(49).

    >>> import jax.numpy as jnp
    >>> model = NonlinearModel(lambda x, u, θ: x, lambda x, u, θ: jnp.abs(x), Q=[[0.0]], R=[[0.1]], dt=1)
    >>> result = estimate(UnscentedKalman(model), Record([1.0], dt=1), prior=Prior([0.0], [[1.0]]))
    >>> float(result.innovation[0, 0].round(6))  # 1 - sqrt(3) / 3: the mean of |x| is .8, that of the points .58
    0.42265
    """

    model: Any
    _: KW_ONLY
    parameters: Prior | None = None
    walk: Any = 0.0
    uncertainty: ModelUncertainty | None = None
    kappa: float | None = static(default=None)
    ready: Any = field(default=None, init=False)
    walk_factor: Any = field(default=None, init=False)

    curved = True

    def __post_init__(self):
        faults = checks.Faults()
        κ = None if self.kappa is None else faults.number("kappa", self.kappa, lower=0.0)
        faults.finish()
        set_field(self, kappa=κ)
        nonlinear.check(self)

    @property
    def names(self) -> Names:
        """Names of states, inputs, outputs, and of the estimated parameters, as gains."""
        return nonlinear.names(self)

    gain, takes_uncertain_inputs = property(nonlinear.gain), True
    sampled, at, init, tell = nonlinear.sampled, nonlinear.at, nonlinear.init, nonlinear.tell

    def _κ(self, n: int) -> float:
        return max(0.0, 3.0 - n) if self.kappa is None else self.kappa

    def correct(self, state: Belief, sample: Sample) -> tuple[Belief, Info]:
        """Update the belief with one sample: condition ξ of x = m + L ξ, which needs no inverse of L."""
        b, size = state, state.mean.shape[0]
        L, line, V = self._outputs(state, sample)
        white = Gaussian(jnp.zeros(size), jnp.eye(size), jnp.zeros((size, 0)), jnp.zeros(size), b.log_scale)
        post = correct(
            white,
            Measurement(line.slope, line.mean, V, None, nonlinear.turn(nonlinear.ready_of(self).ready.period)),
            sample.y,
            sample.seen,
        )
        m, Z = b.mean + apply(L, post.state.m), product(L, post.state.Z)
        found = Gaussian(m, Z, b.diffuse, b.size, b.log_scale)
        if (rows := nonlinear.considered(self)) is not None:
            found = schmidt.unmoved(found, b.gaussian._replace(Z=L), rows)
        after = Belief(*found)
        return after, nonlinear.tell_sample(self, after, post, line.bias)

    def predict(self, state: Belief, interval: Interval) -> Belief:
        """Move to the next sample."""
        b, (_, mean, slope, noise) = state, self._moved(state, interval)
        Z = triangularise(jnp.concatenate([slope, noise], axis=1))
        return Belief(mean, Z, b.diffuse, jnp.maximum(jnp.abs(mean), MEMORY * b.size), b.log_scale)

    def instant_about(self, sample: Sample, interval: Interval, predicted: Belief, filtered: Belief) -> Instant:
        """A row of the model for the smoother: the linear fits to the points of `correct` and `predict`."""
        L, line, V = self._outputs(predicted, sample)
        C = slope_on_state(line.slope, L)
        period = nonlinear.turn(nonlinear.ready_of(self).ready.period)
        measurement = Measurement(C, line.mean - apply(C, predicted.mean), V, None, period)
        L, mean, slope, noise = self._moved(filtered, interval)
        F = slope_on_state(slope, L)
        return Instant(Transition(F, mean - apply(F, filtered.mean), noise), measurement)

    def _outputs(self, b: Belief, sample: Sample):
        """The factor of the belief, h by its points, and the factor of the noise with the residual of h."""
        ready, L = nonlinear.ready_of(self).ready, triangularise(b.factor)
        line = sigma_points(
            nonlinear.output_of(ready, sample), b.mean, L, self._κ(b.mean.shape[0]), nonlinear.turn(ready.period)
        )
        return L, line, nonlinear.noise_of(line, noise_of(ready.V, sample), truncated=False)

    def _moved(self, b: Belief, interval: Interval) -> tuple[Array, Array, Array, Array]:
        """The factor of the belief, and the mean, the slope on its variables and the factor of the noise at the next sample."""
        algorithm = nonlinear.ready_of(self)
        ready, walk, L = algorithm.ready, nonlinear.walk_columns(algorithm, b, interval), triangularise(b.factor)
        turn = nonlinear.turn(ready.state_period, len(b.mean) - ready.n)
        if ready.continuous:
            mean, slope, *noise = self._flowed(ready, b, L, interval)
        elif ready.noise_input is None:
            line = sigma_points(nonlinear.move_of(ready, interval), b.mean, L, self._κ(len(b.mean)), turn)
            W = nonlinear.padded(ready.noise(*nonlinear.split(b.mean, ready), interval.u), b)
            mean, slope, *noise = line.mean, line.slope, line.rest, W
        else:
            mean, slope, *noise = self._with_noise_input(ready, b, L, interval, turn)
        return L, mean, slope, jnp.concatenate([*noise, walk], axis=1)

    def _with_noise_input(self, ready: Functions, b: Belief, L: Array, interval: Interval, turn: Array | None):
        """Points in (z, e): the noise input is evaluated at each."""
        size, q = b.mean.shape[0], ready.white.shape[0]
        g = nonlinear.noisy(ready, b, nonlinear.move_of(ready, interval), interval)
        at, spread = jnp.concatenate([b.mean, jnp.zeros(q)]), block_diagonal(L, jnp.eye(q))
        line = sigma_points(g, at, spread, self._κ(size + q), turn)
        return line.mean, line.slope[:, :size], line.slope[:, size:], line.rest

    def _flowed(self, ready: Functions, b: Belief, L: Array, interval: Interval):
        """Each point moved by the differential equation; one call of the integrator for all."""
        size = b.mean.shape[0]
        f, W = nonlinear.augmented(ready, b, interval)
        noise = flow.moment_derivative(f, W, 1)

        def derivative(t: Array | float, y: tuple):
            return jnp.stack([f(y[0][:, j], t) for j in range(2 * size)], axis=1), noise(t, y[1])

        reach = (size + self._κ(size)) ** 0.5
        points = b.mean[:, None] + reach * jnp.concatenate([L, -L], axis=1)
        start = points, flow.Moments(b.mean, jnp.zeros((size, 0)), jnp.zeros((size, size)))
        (points, along), reached = flow.integrate(derivative, start, interval.dt, ready.substeps)
        line = from_points(points, along.m, self._κ(size))
        return jnp.where(reached, line.mean, jnp.nan), line.slope, line.rest, factor(along.N)


def slope_on_state(slope: Array, L: Array):
    """The slope on x = m + L ξ from that on ξ; zero along directions that are known exactly."""
    known = diagonal(L) ** 2 <= KNOWN * jnp.sum(L * L, axis=1)
    return solve_lower(jnp.where(known[None, :], 0.0, L), slope.T, transpose=True).T
