"""The parameters of an output-error model, sample by sample, from incomplete data."""

from dataclasses import KW_ONLY
from math import comb
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .. import checks
from ..frozen import frozen, replace, set_field, static
from ..kernels import auxiliary_model as kernel
from ..kernels.small import apply, factor, gram
from ..models.output_error import OutputError, parameter_names, read_variance
from ..models.prior import Prior
from ..models.sampled import Clock
from ..results import Info, Interval, Names, Sample, outcome_code
from .channels import Channels

METHODS = ("refined", "printed")
VAGUE = 1e6  # prior variance of an entry of b where none is given, in squared units of output over input
EARLY = 3.0  # α: while it learns, a sample that is i-th of n weighs (i/n)^α; without it one draw in three locks
LEARNING = 40  # arrivals per parameter until α is zero, counted by how much signal is in them
PSEUDOLINEAR = 10  # arrivals per parameter from which the gradient is that of the auxiliary model
MEMORY = 5  # arrivals per parameter over which the squared innovation is averaged
OUTLIER = 9.0  # times its variance: more of one squared innovation does not count
MOST_FORGOTTEN = 0.5  # of P^-1 in one step
MOST_DOUBT = 1e12  # times its variance: how far the prior is given up when innovations contradict it


@frozen
class Recursion:
    """What a recursion holds, output by output: θ (p, d), factors of P and Σ, past auxiliary outputs and their slopes.

    `lags` (m, q) are the inputs applied before this sample; `arrivals`, `informative`, `misfit`, `doubt` and `turn` (p,) set
    how much is forgotten, and for what.
    """

    parameters: Any
    gain_factor: Any
    error_factor: Any
    outputs: Any
    slopes: Any
    lags: Any
    arrivals: Any
    informative: Any
    misfit: Any
    doubt: Any
    turn: Any


@frozen
class RecursiveOutputError:
    """The parameters of an output-error model, sample by sample, when inputs and outputs get lost.

    Model: `OutputError`: x°[k] = B(z)/A(z) u°[k], y[k] = x°[k] + v[k], each output with polynomials of its own. A lost
    output leaves the estimate where it was; a lost input is what the actuator did instead, known by the acknowledgement.

    Assumes a stable plant at rest before the first sample, orders and noise variance that are right, v white, and an input
    that excites (with a constant one the covariance stays large in what it does not show). With a noise variance too
    small the estimate is good and its covariance too small; far too small, and it never stops forgetting.

    Settings: `na`, `nb`: degrees of A and B (Ljung's (na, nb, nk) is (na, nb - 1, delay = nk) here); `delay` in steps;
    `noise_variance` of v, one number or (p,), greater than 0; `prior` of θ (output by output, a then b, input by input;
    None: zero, and vague). Of a no more is believed than that A is stable, so that a variance of 1e6 is as good as 1.
    `forgetting` λ in (0, 1], per arrival, for plants that change; `alarm`: when the mean squared innovation lies this many
    standard deviations above its variance, what was learnt is forgotten until it fits again (which also follows a plant that
    jumped). `method`: "refined", or "printed": the recursion as its source has it, which locks on a wrong answer from vague
    priors. `inputs`, `outputs` name the channels (`identify` takes those of the record).

    How it differs from the source: past auxiliary outputs are corrected when θ changes; the gradient is that of the model
    (ψ) once it is about right; A is kept stable; early samples, of wild estimates, fade as a power of their age; what
    is forgotten gives way to the prior. `Info.mean` is θ, `Info.covariance` that of its error at the gain in use, which the
    P of the recursion is not. `Info.extra["output"]` estimates x°[k], `extra["completed"]` is z[k]: y where it was seen,
    else what was predicted (3.12).

    Cost: about 4 d³ multiplications a sample and output, d = na + m (nb + 1); 0.6 us at d = 4 as machine code.

    Reference: H. Fang (2009), (3.12)-(3.17); L. Ljung, System Identification (1999), §11.4-11.5.

    >>> RecursiveOutputError(2, 1, noise_variance=0.1).names.states
    ('a1', 'a2', 'b0', 'b1')
    """

    na: int = static()
    nb: int = static()
    _: KW_ONLY
    delay: int = static(default=0)
    noise_variance: Any
    prior: Prior | None = None
    forgetting: Any = 1.0
    alarm: Any = 3.0
    method: str = static(default="refined")
    inputs: Any = static(default=None)
    outputs: Any = static(default=None)

    has_state_prior = False  # `prior` is a setting: the drivers take none

    def __post_init__(self):
        faults = checks.Faults()
        for name, lower in (("na", 0), ("nb", 0), ("delay", 0)):
            faults.whole(name, getattr(self, name), lower)
        faults.choice("method", self.method, METHODS)
        inputs, outputs = _names(self.inputs, "inputs", faults), _names(self.outputs, "outputs", faults)
        if outputs is not None:
            faults.learn("p", len(outputs), f"`outputs` holds {checks.counted(len(outputs), 'name')}")
        noise = _read_noise(self.noise_variance, faults)
        forgetting = faults.number("forgetting", self.forgetting, above=0.0, upper=1.0)
        alarm = faults.number("alarm", self.alarm, above=0.0)
        if self.prior is not None and faults.instance("prior", self.prior, Prior) and self.prior.diffuse is not None:
            faults.add(
                "`prior` must not have diffuse directions: leave it out where nothing is known of the parameters."
            )
        faults.finish()
        set_field(self, noise_variance=noise, forgetting=forgetting, alarm=alarm, inputs=inputs, outputs=outputs)
        if self.prior is not None and (wrong := self._prior_fault()):
            checks.refuse(wrong)

    def _prior_fault(self) -> str:
        channels = self.model
        wanted = len(self.names.states)
        if self.prior is None or np.shape(self.prior.mean)[-1] == wanted:
            return ""
        of = f"{checks.counted(channels.p, 'output')} and {checks.counted(channels.m, 'input')}"
        orders = f"na = {self.na}, nb = {self.nb} with {of} have {checks.counted(wanted, 'parameter')}"
        return f"`prior` must be of θ: {orders}. Got {np.shape(self.prior.mean)[-1]}."

    @property
    def model(self) -> Channels:
        """The channels: all that is known of the model before there are data."""
        default = tuple(f"y{i + 1}" for i in range(np.shape(self.noise_variance)[-1]))
        return Channels(self.inputs or ("u1",), self.outputs or default, self.delay == 0)

    @property
    def names(self) -> Names:
        """Names of the parameters (as states), inputs and outputs."""
        channels = self.model
        return Names(
            parameter_names(self.na, self.nb, channels.inputs, channels.outputs), channels.inputs, channels.outputs
        )

    def for_channels(self, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> "RecursiveOutputError":
        """The same identifier with the names of a record, where it has none of its own. Raises `InputError`."""
        outputs, noise = self.outputs or outputs, np.ravel(self.noise_variance)
        noise = np.broadcast_to(noise, (len(outputs),)) if len(noise) == 1 else noise
        return RecursiveOutputError(
            self.na, self.nb, delay=self.delay, noise_variance=noise, prior=self.prior, forgetting=self.forgetting,
            alarm=self.alarm, method=self.method, inputs=self.inputs or inputs, outputs=outputs,
        )  # fmt: skip

    def fitted(self, parameters: Any, dt: float) -> OutputError:
        """The model of a parameter vector."""
        channels = self.model
        return OutputError.of_parameters(
            parameters, na=self.na, nb=self.nb, delay=self.delay, noise_variance=self.noise_variance, dt=dt,
            inputs=channels.inputs, outputs=channels.outputs,
        )  # fmt: skip

    def sampled(self, clock: Clock) -> "RecursiveOutputError":
        """The same: a sampled model has no other clock than its record's."""
        return self

    def at(self, k) -> "RecursiveOutputError":
        """The same at every row."""
        return self

    @property
    def _believed(self) -> tuple[Any, Any]:
        """Mean (p, d) and covariance (p, d, d) of the prior; of a, no more than that A is stable."""
        channels = self.model
        d = self.na + channels.m * (self.nb + 1)
        bounds = np.array([comb(self.na, i + 1) for i in range(self.na)] + [np.inf] * (d - self.na), float)
        if self.prior is None:
            variance = np.minimum(bounds**2, VAGUE)
            return jnp.zeros((channels.p, d)), jnp.broadcast_to(np.diag(variance), (channels.p, d, d))
        rows = [slice(i * d, (i + 1) * d) for i in range(channels.p)]
        P = jnp.concatenate([jnp.asarray(self.prior.covariance)[row, row][None] for row in rows])
        mean = jnp.asarray(self.prior.mean).reshape(channels.p, d)
        if self.method == "printed":
            return mean, P
        variance = jnp.sum(P * jnp.eye(d)[None], axis=2)
        scale = jnp.where(
            variance > bounds[None] ** 2, bounds[None] / jnp.sqrt(jnp.where(variance > 0, variance, 1.0)), 1.0
        )
        return mean, P * scale[:, :, None] * scale[:, None, :]

    def init(self, prior: None) -> Recursion:
        """What is believed before the first sample; the plant is at rest."""
        mean, P = self._believed
        p, d = mean.shape
        L = jax.vmap(factor)(P)
        lags = jnp.zeros((self.model.m, self.nb + self.delay))
        none = jnp.zeros(p)
        return Recursion(
            mean,
            L,
            L,
            jnp.zeros((p, self.na)),
            jnp.zeros((p, self.na, d)),
            lags,
            none,
            none,
            jnp.ones(p),
            jnp.ones(p),
            none,
        )

    def rested(self, state: Recursion) -> Recursion:
        """What is believed when another record begins: the same of θ, and a plant at rest."""
        return replace(
            state, outputs=jnp.zeros_like(state.outputs), slopes=jnp.zeros_like(state.slopes),
            lags=jnp.zeros_like(state.lags),
        )  # fmt: skip

    def correct(self, state: Recursion, sample: Sample) -> tuple[Recursion, Info]:
        """Learn from one sample, whose input the acknowledgement has told."""
        mean, P = self._believed
        variance = jnp.sum(P * jnp.eye(P.shape[-1])[None], axis=2)
        lags = self._window(state.lags, sample.u)
        blank = replace(state, lags=None)

        def one(state, y, seen, r, mean, variance):
            return self._learn(state, lags, y, seen, r, mean, variance)

        after, told = jax.vmap(one)(
            blank, jnp.asarray(sample.y), jnp.asarray(sample.seen), jnp.asarray(self.noise_variance), mean, variance
        )
        return replace(after, lags=state.lags), _informed(after, told, sample)

    def _window(self, lags: Any, u: Any) -> Any:
        """The inputs of φ, input by input: u[k - delay] .. u[k - delay - nb]."""
        return jnp.concatenate([jnp.asarray(u)[:, None], lags], axis=1)[:, self.delay :].ravel()

    def _learn(self, state: Recursion, lags, y, seen, r, mean, variance):
        """One output: θ after its datum, and what was told of it."""
        θ, a, d = state.parameters, state.parameters[: self.na], state.parameters.shape[0]
        φ = kernel.regressor(state.outputs, lags)
        ψ = kernel.slope(φ, a, state.slopes)
        predicted = jnp.sum(φ * θ)
        e = y - predicted
        refined = self.method == "refined"
        g = jnp.where(state.informative < PSEUDOLINEAR * d, φ, ψ) if refined else φ
        state, λ = self._kept(state, g, e, predicted, seen, r) if refined else (state, jnp.asarray(self.forgetting))
        K, L = kernel.learn(state.gain_factor, g, r, λ)
        h = jnp.where(jnp.arange(d, dtype=float) == state.turn, 1.0, 0.0)
        own = jnp.sum(h * variance) * state.doubt
        w = jnp.where(
            own > 0, (1 - λ) * d / jnp.where(own > 0, own, 1.0), 0.0
        )  # what is forgotten gives way to the prior
        K_prior, L = kernel.recall(L, h, w)
        moved = θ + K * e
        moved = moved + K_prior * jnp.sum(h * (mean - moved))
        if refined:
            moved = jnp.concatenate([kernel.stabilise(moved[: self.na]), moved[self.na :]])
        Z = kernel.spread(state.error_factor, ψ, K, r, h, K_prior, w)
        θ_next = jnp.where(seen, moved, θ)
        outputs = kernel.corrected(state.outputs, state.slopes, θ_next - θ) if refined else state.outputs
        after = replace(
            state, parameters=θ_next, gain_factor=jnp.where(seen, L, state.gain_factor),
            error_factor=jnp.where(seen, Z, state.error_factor), outputs=outputs,
        )  # fmt: skip
        S = jnp.sum(apply(state.error_factor.T, ψ) ** 2) + r
        x = jnp.sum(kernel.regressor(outputs, lags) * θ_next)
        return after, (e, S, x, jnp.where(seen, y, predicted))

    def _kept(self, state: Recursion, g, e, predicted, seen, r):
        """How much of P^-1 is kept (λ), and the counts that say so."""
        d = g.shape[0]
        one = jnp.where(seen, 1.0, 0.0)
        arrivals = state.arrivals + one
        square = predicted * predicted
        informative = state.informative + one * square / (square + r)
        power = EARLY * jnp.maximum(0.0, 1 - informative / (LEARNING * d))
        fading = jnp.minimum(MOST_FORGOTTEN, power / jnp.maximum(arrivals, 1.0))
        λ = jnp.where(arrivals <= d, 1.0, 1 - fading)  # the first d only solve for θ
        memory = MEMORY * d
        normalised = jnp.minimum(e * e / (r + jnp.sum(apply(state.gain_factor.T, g) ** 2)), OUTLIER)
        misfit = state.misfit + one / jnp.minimum(arrivals + 1, memory) * (normalised - state.misfit)
        alarmed = (misfit > 1 + self.alarm * (2 / memory) ** 0.5) & (arrivals > memory)
        λ = jnp.where(alarmed, jnp.minimum(λ, 1 - 2 / memory), λ) * self.forgetting
        doubt = jnp.where(alarmed & seen, jnp.minimum(state.doubt / (1 - 2 / memory), MOST_DOUBT), state.doubt)
        turn = state.turn + one
        turn = jnp.where(turn >= d, 0.0, turn)
        return replace(state, arrivals=arrivals, informative=informative, misfit=misfit, doubt=doubt, turn=turn), λ

    def predict(self, state: Recursion, interval: Interval) -> Recursion:
        """Move to the next sample: the auxiliary model's output and its slope join those that are kept (3.16)."""
        lags = self._window(state.lags, interval.u)

        def one(θ, outputs, slopes):
            φ = kernel.regressor(outputs, lags)
            ψ = kernel.slope(φ, θ[: self.na], slopes)
            x = jnp.sum(φ * θ)
            return jnp.concatenate([x[None], outputs])[: self.na], jnp.concatenate([ψ[None, :], slopes])[: self.na]

        outputs, slopes = jax.vmap(one)(state.parameters, state.outputs, state.slopes)
        kept = self.nb + self.delay
        shifted = jnp.concatenate([jnp.asarray(interval.u)[:, None], state.lags], axis=1)[:, :kept]
        return replace(state, outputs=outputs, slopes=slopes, lags=shifted)


def _informed(state: Recursion, told, sample: Sample) -> Info:
    """What is said of all outputs together: independent noises leave their errors independent."""
    e, S, x, completed = told
    p, d = state.parameters.shape
    blocks = jax.vmap(gram)(state.error_factor)
    Σ = (jnp.eye(p)[:, None, :, None] * blocks[:, :, None, :]).reshape(p * d, p * d)
    seen = jnp.asarray(sample.seen)
    likelihood = -0.5 * jnp.sum(jnp.where(seen, jnp.log(2 * jnp.pi * S) + e * e / S, 0.0))
    return Info(
        mean=state.parameters.ravel(), covariance=Σ, innovation=jnp.where(seen, e, jnp.nan),
        innovation_covariance=jnp.eye(p) * S[:, None], log_likelihood=likelihood,
        outcome=outcome_code(jnp.asarray(False), state.parameters.ravel(), state.error_factor.reshape(p * d, d)),
        extra={"output": x, "completed": completed},
    )  # fmt: skip


def _names(given: Any, argument: str, faults: checks.Faults) -> tuple[str, ...] | None:
    return None if given is None else faults.names(argument, given, argument, argument[0])


def _read_noise(value: Any, faults: checks.Faults) -> Any:
    noise = read_variance("noise_variance", value, faults)
    if noise is not None and not checks.is_traced(noise) and np.any(noise <= 0):
        faults.add(
            f"`noise_variance` must be greater than 0. Got {checks.short(value)}. For outputs without noise give a small one, "
            "as 1e-6 of the mean square of y."
        )
    return noise
