"""Outputs, parameters and inputs of unknown arrival of an output-error model, as one Gaussian belief."""

import math
from dataclasses import KW_ONLY
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array, Numbers
from ..data.record import LOST
from ..frozen import frozen, replace, set_field, static
from ..kernels import bilinear as kernel
from ..kernels.small import factor, gram, triangularise
from ..models.prior import Prior
from ..protocols import Anticipating
from ..results import Info, Interval, Names, Sample, outcome_code
from . import recursive
from .channels import Channels

POLES = (0.9, 0.5, 0.0, -0.5, -0.9)  # of the members, for A of degree 1
PAIRS = (  # and of degree 2 and more, with the other poles at 0
    (0.85, 0.85), (0.5, 0.5), (0.8, -0.8), (-0.6, -0.6), (0.7j, -0.7j), (0.6 + 0.5j, 0.6 - 0.5j), (-0.5 + 0.5j, -0.5 - 0.5j),
)  # fmt: skip
AROUND = 0.3  # standard deviation of each coefficient of A in a member
LIGHTEST = -600.0  # logarithm of a weight
WILD = 100.0  # times the largest value seen of an output or expected from its inputs: its largest standard deviation


@frozen
class JointBelief:
    """The belief, output by output a sum of G Gaussian members: past outputs x° (p, G, nx), inputs of unknown arrival
    (p, G, nv), θ (p, G, d), a factor of the covariance of all three (p, G, n, n), and the logarithms of the weights (p, G).

    `lags` (m, q) are the known inputs before this sample, `largest` (p, G) the largest output so far.
    """

    outputs: Any
    inputs: Any
    parameters: Any
    factor: Any
    lags: Any
    largest: Any
    weights: Any


@frozen
class JointOutputError(Anticipating[JointBelief]):
    """A recursive identifier of an output-error model that estimates parameters and past outputs jointly. It copes with gaps
    and jumps.

    Model: `OutputError`, as in `RecursiveOutputError`. The parameters θ and the past noise-free outputs x° have a joint
    Gaussian distribution. The next output is a sum of products of them, whose mean and variance are exact. The uncertainty of
    a poor early estimate is therefore represented in every direction, and the estimate does not lock on a wrong value. No
    fading of early data is needed.

    Without a `prior` the belief is a sum of Gaussian members (7, or 5 for na = 1) with poles all over the unit circle, each with
    its weight: a single wide one learns nothing between seen rows. What is reported are the moments of the sum.

    Assumes a stable plant at rest before the first sample, right orders and noise variance, and white v. Each member is taken
    as Gaussian after every sample. With fewer than 50 seen rows a parameter and no prior, the check "belief" fails. Too small a
    noise variance raises false alarms.

    Settings:

    - `na`, `nb`, `delay`, `noise_variance`, `prior`, `inputs`, `outputs`: as in `RecursiveOutputError`. A prior makes one member.
    - `alarm`: an innovation of more than this many standard deviations (default 5) means that the plant jumped. `jump` times
      the prior's covariance is then added to that of θ (default .1), and the variance of past outputs is raised by the
      innovation squared.
    - `arrival`: for inputs of unknown arrival (UDP-like), the rate at which they arrive, one number or (m,)
      (default None: every arrival is known). u is then the sent input, and the applied input is estimated. A known arrival
      (`arrived` 0 or 1) is used as it is. `lost`: what the actuator does without an input, "zero" or "hold".

    Reports: `Info.mean` is θ. In `Info.extra`: "output" (p,) estimates x°[k] from y[0..k]; "completed" (p,) is y where it was
    seen, otherwise its prediction; "alarm" (p,); with `arrival`, "applied" (p, m), the estimate of the applied inputs from
    each output.

    Cost: about n² (2 n + d) multiplications per sample and output, for d parameters of an output; n = na + d, or
    n = na + d + m (nb + delay + 1) with `arrival`.

    Reference: ours; the sum is that of D. Alspach & H. Sorenson (1972); the moments are those of M. Athans, R. Wishner & A.
    Bertolini (1968), exact here. Model and losses: H. Fang (2009), (3.1)-(3.5), (4.1)-(4.3).

    >>> plant = OutputError([-0.5], [1.0], noise_variance=0.01, dt=1)
    >>> record = simulate(plant, np.random.default_rng(1).normal(size=300), seed=1, output_link=BernoulliLink(0.5)).record
    >>> fit = identify(JointOutputError(1, 0, noise_variance=0.01), record)
    >>> bool(np.all(np.abs(fit.parameters - plant.parameters) < 4 * fit.sigma))
    True
    """

    na: int = static()
    nb: int = static()
    _: KW_ONLY
    delay: int = static(default=0)
    noise_variance: Any
    prior: Prior | None = None
    alarm: Any = 5.0
    jump: Any = 0.1
    arrival: Any = None
    lost: str = static(default="zero")
    inputs: Any = static(default=None)
    outputs: Any = static(default=None)

    in_a_loop = "white"

    def __post_init__(self):
        faults = checks.Faults()
        read = recursive.read(self, faults)
        alarm = faults.number("alarm", self.alarm, above=0.0)
        jump = faults.number("jump", self.jump, lower=0.0)
        faults.choice("lost", self.lost, LOST)
        arrival = None if self.arrival is None else _read_arrival(self.arrival, faults)
        faults.finish()
        set_field(self, alarm=alarm, jump=jump, arrival=arrival, **read)
        recursive.check_prior(self)

    for_channels, fitted = recursive.for_channels, recursive.fitted

    @property
    def names(self) -> Names:
        """Names of the parameters (as states), inputs and outputs."""
        return recursive.names(self)

    @property
    def model(self) -> Channels:
        """The channels: all that is known about the model before there are data."""
        return recursive.channels(self)._replace(direct=self.delay == 0 or self.arrival is not None)

    @property
    def takes_unknown_arrivals(self) -> bool:
        """Whether the arrival of inputs may be unknown."""
        return self.arrival is not None

    @property
    def _sizes(self) -> tuple[int, int]:
        """The numbers of outputs and of inputs of unknown arrival in the belief."""
        return max(self.na, 1), 0 if self.arrival is None else self.model.m * (self.nb + self.delay + 1)

    def init(self, prior: None) -> JointBelief:
        """The belief before the first sample; the plant is at rest."""
        mean, P = self._members()
        p, G, d = mean.shape
        nx, nv = self._sizes
        none = jnp.zeros((p, G, nx + nv, nx + nv + d))
        factors = jnp.concatenate([jnp.zeros((p, G, d, nx + nv)), jax.vmap(jax.vmap(factor))(P)], axis=3)
        return JointBelief(
            jnp.zeros((p, G, nx)), jnp.zeros((p, G, nv)), mean, jnp.concatenate([none, factors], axis=2),
            jnp.zeros((self.model.m, self.nb + self.delay)), jnp.zeros((p, G)), jnp.full((p, G), -math.log(G)),
        )  # fmt: skip

    def _members(self) -> tuple[Array, Array]:
        """Means (p, G, d) and covariances (p, G, d, d) of θ before the first sample: one member, or poles all over the circle
        where no prior is given: between seen rows a wide belief about A multiplies that about the outputs, and learns nothing.
        """
        mean, P = recursive.believed(self)
        if self.prior is not None or self.na == 0:
            return mean[:, None], P[:, None]
        pairs = np.array(PAIRS if self.na > 1 else [(pole, 0.0) for pole in POLES])
        a = np.real(np.column_stack([-pairs.sum(axis=1), pairs.prod(axis=1)]))[:, : self.na]
        centre = np.zeros((len(a), mean.shape[1]))
        centre[:, : a.shape[1]] = a
        variance = np.concatenate([np.full(self.na, AROUND**2), np.full(mean.shape[1] - self.na, recursive.VAGUE)])
        p, G = mean.shape[0], len(a)
        return jnp.broadcast_to(centre, (p, *centre.shape)), jnp.broadcast_to(np.diag(variance), (p, G, *P.shape[1:]))

    def rested(self, state: JointBelief) -> JointBelief:
        """The belief when another record begins: θ as before, and a plant at rest."""
        nx, nv = self._sizes
        Θ = state.factor[:, :, nx + nv :]
        alone = lambda one: triangularise(jnp.concatenate([jnp.zeros((nx + nv, one.shape[1])), one]))  # noqa: E731
        factors = jax.vmap(jax.vmap(alone))(Θ)
        return replace(
            state, outputs=jnp.zeros_like(state.outputs), inputs=jnp.zeros_like(state.inputs), factor=factors,
            lags=jnp.zeros_like(state.lags),
        )  # fmt: skip

    def ahead(self, state: JointBelief) -> Info:
        """The belief before the next sample: θ, and in `extra` past outputs (p, na) and inputs (m, nb + delay)."""
        _, nv = self._sizes
        θ, P = self._mixture(state)
        lags = state.lags
        if nv:  # the mean over the outputs: each has its own belief
            lags = jnp.mean(_mean(state.weights, state.inputs), axis=0).reshape(self.model.m, -1)
            lags = lags[:, : self.nb + self.delay]
        return Info(
            mean=θ.ravel(), covariance=recursive.block_diagonal(P),
            extra={"past_outputs": _mean(state.weights, state.outputs)[:, : self.na], "past_inputs": lags},
        )  # fmt: skip

    def _mixture(self, state: JointBelief) -> tuple[Array, Array]:
        """The mean (p, d) and covariance (p, d, d) of θ over the members."""
        nx, nv = self._sizes
        θ = _mean(state.weights, state.parameters)
        apart = state.parameters - θ[:, None]
        each = jax.vmap(jax.vmap(gram))(state.factor[:, :, nx + nv :]) + apart[..., :, None] * apart[..., None, :]
        return θ, _mean(state.weights, each)

    def correct(self, state: JointBelief, sample: Sample) -> tuple[JointBelief, Info]:
        """Update the belief with one sample."""
        _, P0 = recursive.believed(self)
        window = recursive.window(state.lags, sample.u, self.delay)
        arrivals = self._arrivals(sample)
        jumped = jnp.sqrt(self.jump) * jax.vmap(factor)(P0)

        def one(belief: JointBelief, y: Array, seen: Array, r: Array, J: Array):
            return self._learn(belief, window, arrivals, y, seen, r, J)

        after, steps = jax.vmap(one)(
            replace(state, lags=None), jnp.asarray(sample.y), jnp.asarray(sample.seen), recursive.noise_of(self, sample),
            jumped,
        )  # fmt: skip
        return replace(after, lags=state.lags), _informed(self, after, steps, sample)

    def _arrivals(self, sample: Sample) -> tuple[Array, Array] | None:
        """The sent input and the probability that it arrived, (m,) each; None where every arrival is known."""
        if self.arrival is None:
            return None
        rate = jnp.broadcast_to(jnp.asarray(self.arrival), jnp.shape(sample.u))
        if sample.arrived is None:
            return jnp.asarray(sample.u), rate
        arrived = jnp.asarray(sample.arrived)
        return jnp.asarray(sample.u), jnp.where(arrived == arrived, arrived, rate)

    def _learn(
        self,
        belief: JointBelief,
        window: Array,
        arrivals: tuple[Array, Array] | None,
        y: Array,
        seen: Array,
        r: Array,
        J: Array,
    ) -> tuple[JointBelief, Any]:
        """One output: the belief after its datum, and the report of it."""
        ahead = jax.vmap(lambda one: self._ahead(one, window, arrivals))(belief)
        x = ahead.x
        e_each, S_each = y - x, jnp.sum(ahead.linear**2, axis=1) + ahead.rest + r
        mean = _mean(belief.weights[None], x[None])[0]
        S, e = _mean(belief.weights[None], (S_each + (x - mean) ** 2)[None])[0], y - mean
        alarmed = seen & (e * e > self.alarm**2 * S)
        after, shown = jax.vmap(lambda one, its: self._taught(one, its, alarmed, y, seen, r, J))(belief, ahead)
        likelihood = _log_density(e_each, S_each)
        if x.shape[0] > 1:
            weights = jnp.where(alarmed, 0.0, belief.weights + jnp.where(seen, shown, 0.0))
            after = replace(after, weights=jnp.maximum(weights - _log_sum(weights), LIGHTEST))
        return after, (e, S, jnp.where(seen, y, mean), alarmed, _log_sum(belief.weights + likelihood))

    def _ahead(self, belief: JointBelief, window: Array, arrivals: tuple[Array, Array] | None) -> "_NextOutput":
        """The prediction of one member."""
        nx, nv = self._sizes
        v, Z = belief.inputs, belief.factor
        X, V, Θ = Z[:nx], Z[nx : nx + nv], Z[nx + nv :]
        if arrivals is not None:
            v, V, noise = self._sent(v, V, *arrivals)
            X, Θ = (jnp.concatenate([M, jnp.zeros((M.shape[0], noise.shape[1]))], axis=1) for M in (X, Θ))
            V = jnp.concatenate([V, noise], axis=1)
            window = recursive.delayed(v, self.model.m, self.delay)
        φ = jnp.concatenate([-belief.outputs[: self.na], window])
        return _NextOutput(*self._moments(belief.parameters, φ, Θ, X, V), φ, v, X, V, Θ)

    def _taught(
        self, belief: JointBelief, ahead: "_NextOutput", alarmed: Array, y: Array, seen: Array, r: Array, J: Array
    ) -> tuple[JointBelief, Array]:
        """One member after a datum, and its log-likelihood."""
        nx, nv = self._sizes
        φ, v, e = ahead.φ, ahead.v, y - ahead.x
        S = jnp.sum(ahead.linear**2) + ahead.rest + r
        doubt = jnp.where(alarmed, jnp.sqrt(jnp.maximum(e * e - S, 0.0)), 0.0)
        X, V, Θ = _widened(ahead.X, ahead.V, ahead.Θ, doubt * jnp.eye(nx), jnp.where(alarmed, J, 0.0))
        x, linear, rest = self._moments(belief.parameters, φ, Θ, X, V)
        largest = jnp.maximum(belief.largest, jnp.where(seen, jnp.abs(y), jnp.sqrt(r)))
        largest = jnp.maximum(largest, _driven(belief.parameters, φ, Θ, self.na))
        x, linear, rest = _tamed(x, linear, rest, WILD * largest)
        rows = jnp.concatenate([linear[None], X[: nx - 1], V, Θ])
        only_x = jnp.where(jnp.arange(rows.shape[0]) == 0, jnp.sqrt(rest), 0.0)
        Z = triangularise(jnp.concatenate([rows, only_x[:, None]], axis=1))
        m = jnp.concatenate([x[None], belief.outputs[: nx - 1], v, belief.parameters])
        m_seen, Z_seen = kernel.observe(m, Z, y - x, r)
        m, Z = jnp.where(seen, m_seen, m), jnp.where(seen, Z_seen, Z)
        after = replace(
            belief, outputs=m[:nx], inputs=m[nx : nx + nv], parameters=m[nx + nv :], factor=Z, largest=largest
        )
        return after, _log_density(y - x, jnp.sum(linear * linear) + rest + r)

    def _moments(self, θ: Array, φ: Array, Θ: Array, X: Array, V: Array):
        """The moments of the product θ'φ; known inputs have no variance."""
        if V.shape[0]:
            inputs = recursive.delayed(V, self.model.m, self.delay)
            return kernel.product_moments(θ, φ, Θ, jnp.concatenate([-X[: self.na], inputs]))
        x, linear, rest = kernel.product_moments(θ[: self.na], φ[: self.na], Θ[: self.na], -X[: self.na])
        b, u = Θ[self.na :], φ[self.na :]
        return x + jnp.sum(θ[self.na :] * u), linear + jnp.sum(u[:, None] * b, axis=0), rest

    def _sent(self, v: Array, V: Array, u: Array, probability: Array):
        """The inputs with the one just sent, channel by channel, and the factor of its uncertainty."""
        m = self.model.m
        size = v.shape[0] // m
        means, rows, noises = [], [], []
        for j in range(m):
            held = (v[j * size], V[j * size]) if self.lost == "hold" else (0.0 * v[0], 0.0 * V[0])
            mean, row, variance = kernel.come(u[j], *held, probability[j])
            stored = slice(j * size, (j + 1) * size - 1)
            means += [mean[None], v[stored]]
            rows += [row[None], V[stored]]
            noise = jnp.where(jnp.arange(m) == j, jnp.sqrt(variance), 0.0)
            noises += [noise[None], jnp.zeros((size - 1, m))]
        return jnp.concatenate(means), jnp.concatenate(rows), jnp.concatenate(noises)

    def predict(self, state: JointBelief, interval: Interval) -> JointBelief:
        """Move to the next sample: the input joins the stored ones."""
        stored = self.nb + self.delay
        shifted = jnp.concatenate([jnp.asarray(interval.u)[:, None], state.lags], axis=1)[:, :stored]
        return replace(state, lags=shifted)


class _NextOutput(NamedTuple):
    """The moments of one member's next output, and what they were made of."""

    x: Array
    linear: Array
    rest: Array
    φ: Array
    v: Array
    X: Array
    V: Array
    Θ: Array


def _mean(weights: Array, values: Array) -> Array:
    """The mean of values (p, G, ..) over the members."""
    if values.shape[1] == 1:
        return values[:, 0]
    w = jnp.exp(weights).reshape(weights.shape + (1,) * (values.ndim - 2))
    return jnp.sum(w * values, axis=1)


def _log_density(e: Array, S: Array) -> Array:
    """The logarithm of a Gaussian density."""
    return -0.5 * (jnp.log(2 * jnp.pi * S) + e * e / S)


def _log_sum(logs: Array) -> Array:
    """log Σ exp (G,)."""
    if logs.shape[0] == 1:
        return logs[0]
    top = jnp.max(logs)
    return top + jnp.log(jnp.sum(jnp.exp(logs - top)))


def _widened(X: Array, V: Array, Θ: Array, doubt: Array, J: Array):
    """Factors after a jump: of past outputs by `doubt`, of parameters by J."""
    nx, d = X.shape[0], Θ.shape[0]
    X = jnp.concatenate([X, doubt, jnp.zeros((nx, d))], axis=1)
    V = jnp.concatenate([V, jnp.zeros((V.shape[0], nx + d))], axis=1)
    return X, V, jnp.concatenate([Θ, jnp.zeros((d, nx)), J], axis=1)


def _driven(θ: Array, φ: Array, Θ: Array, na: int):
    """The root mean square of the part of an output due to the inputs."""
    b, u = θ[na:], φ[na:]
    return jnp.sqrt(jnp.sum(b * u) ** 2 + jnp.sum(jnp.sum(u[:, None] * Θ[na:], axis=0) ** 2))


def _tamed(x: Array, linear: Array, rest: Array, most: Array | float):
    """An output whose standard deviation is limited to `most`."""
    sigma = jnp.sqrt(jnp.sum(linear * linear) + rest)
    scale = jnp.where(sigma > most, most / jnp.where(sigma > 0, sigma, 1.0), 1.0)
    return scale * x, scale * linear, scale * scale * rest


def _informed(method: JointOutputError, state: JointBelief, steps: tuple, sample: Sample) -> Info:
    """The report of all outputs together: their noises, and so their errors, are independent."""
    e, S, completed, alarmed, likelihood = steps
    θ, P = method._mixture(state)
    p = θ.shape[0]
    _, nv = method._sizes
    seen = jnp.asarray(sample.seen)
    extra = {"output": _mean(state.weights, state.outputs)[:, 0], "completed": completed, "alarm": alarmed}
    if nv:
        extra["applied"] = _mean(state.weights, state.inputs).reshape(p, method.model.m, -1)[:, :, 0]
    return Info(
        mean=θ.ravel(), covariance=recursive.block_diagonal(P), innovation=jnp.where(seen, e, jnp.nan),
        innovation_covariance=jnp.eye(p) * S[:, None], log_likelihood=jnp.sum(jnp.where(seen, likelihood, 0.0)),
        outcome=outcome_code(jnp.asarray(False), state.parameters.ravel(), state.factor.reshape(-1, 1)), extra=extra,
    )  # fmt: skip


def _read_arrival(value: Numbers, faults: checks.Faults) -> Any:
    """Arrival rates, one number or (m,), greater than 0 and at most 1."""
    if checks.is_traced(value):
        return jnp.atleast_1d(jnp.asarray(value))
    read = faults.array("arrival", np.atleast_1d(value), "channels")
    if read is not None and np.any((read <= 0) | (read > 1)):
        faults.add(f"`arrival` must be rates, greater than 0 and at most 1. Got {checks.short(value)}.")
    return read
