"""The parameters of an output-error model, sample by sample, from incomplete data."""

from dataclasses import KW_ONLY
from typing import Any

import jax
import jax.numpy as jnp

from .. import checks
from ..annotations import Array
from ..frozen import frozen, replace, set_field, static
from ..kernels import auxiliary_model as kernel
from ..kernels.small import apply, factor, gram
from ..models.prior import Prior
from ..protocols import Anticipating
from ..results import Info, Interval, Names, Sample, outcome_code
from . import recursive

METHODS = ("refined", "printed")
EARLY = 3.0  # α: at first the i-th of n samples has weight (i/n)^α; without this, one draw in three locks
LEARNING = 40  # arrivals per parameter until α is zero, each weighted by its share of signal
PSEUDOLINEAR = 10  # arrivals per parameter from which the gradient is that of the auxiliary model
MEMORY = 5  # arrivals per parameter over which the squared innovation is averaged
OUTLIER = 9.0  # times its variance: a squared innovation is clipped to this
MOST_FORGOTTEN = 0.5  # of P^-1 in one step
MOST_DOUBT = 1e12  # times its variance: largest inflation of the prior when innovations contradict it


@frozen
class Recursion:
    """The state of the recursion, output by output: θ (p, d), factors of P and Σ, past auxiliary outputs and their slopes.

    `lags` (m, q) are the inputs applied before this sample; `arrivals`, `informative`, `misfit`, `doubt` and `turn` (p,)
    control the forgetting.
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
class RecursiveOutputError(Anticipating[Recursion]):
    """A recursive identifier of an output-error model: it estimates the parameters sample by sample, where inputs and outputs
    are lost.

    Model: `OutputError`: x°[k] = B(z)/A(z) u°[k], y[k] = x°[k] + v[k]; each output has its own polynomials. A lost output
    leaves the estimate unchanged. A lost input is replaced by what the actuator applied instead; an acknowledgement reports
    the loss.

    Assumes a stable plant at rest before the first sample, right orders and noise variance, white v, and an exciting input.
    With a constant input the covariance stays large in the unexcited directions. With too small a noise variance the estimate
    is good but its covariance too small. With one far too small, the identifier never stops forgetting.

    Settings:

    - `na`, `nb`: degrees of A and B (Ljung's (na, nb, nk) is (na, nb - 1, delay = nk) here); `delay` in steps.
    - `noise_variance` of v, one number or (p,), greater than 0.
    - `prior` of θ, the parameters of one output after the other: first a, then b input by input. None: zero, and vague. The
      stability of A limits the prior of a, so that a variance of 1e6 is as good as 1.
    - `forgetting` λ in (0, 1], per arrival, for plants that change.
    - `alarm`: when the mean squared innovation exceeds its expected value by this many standard deviations, past data are
      forgotten until the innovations fit again. This also follows a plant that jumped.
    - `method`: "refined"; or "printed", the recursion as printed in its source, which from vague priors locks on a wrong
      estimate.
    - `inputs`, `outputs`: names of the channels (`identify` takes those of the record).

    The refined method differs from the source. When θ changes, the past outputs that the recursion calculated from it (the
    auxiliary outputs) are corrected. The gradient is that of the model once the estimate is near. A is stabilised. Early
    samples, with poor estimates, get a smaller weight. The prior replaces forgotten information.

    Reports: `Info.mean` is θ. `Info.covariance` is that of its error at the gain in use, unlike the P of the recursion. In
    `Info.extra`: "output" estimates x°[k]; "completed" is y where it was seen, otherwise its prediction, the z[k] of (3.12).

    Cost: about 4 d³ multiplications per sample and output, d = na + m (nb + 1); 0.6 us at d = 4 as machine code.

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

    in_a_loop = "white"

    def __post_init__(self):
        faults = checks.Faults()
        faults.choice("method", self.method, METHODS)
        read = recursive.read(self, faults)
        forgetting = faults.number("forgetting", self.forgetting, above=0.0, upper=1.0)
        alarm = faults.number("alarm", self.alarm, above=0.0)
        faults.finish()
        set_field(self, forgetting=forgetting, alarm=alarm, **read)
        recursive.check_prior(self)

    model = property(recursive.channels)
    for_channels, fitted = recursive.for_channels, recursive.fitted

    @property
    def names(self) -> Names:
        """Names of the parameters (as states), inputs and outputs."""
        return recursive.names(self)

    @property
    def _believed(self) -> tuple[Any, Any]:
        return recursive.believed(self, bounded=self.method != "printed")

    def init(self, prior: None) -> Recursion:
        """The belief before the first sample; the plant is at rest."""
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
        """The belief when another record begins: θ as before, and a plant at rest."""
        return replace(
            state, outputs=jnp.zeros_like(state.outputs), slopes=jnp.zeros_like(state.slopes),
            lags=jnp.zeros_like(state.lags),
        )  # fmt: skip

    def ahead(self, state: Recursion) -> Info:
        """The belief before the next sample: θ, and in `extra` past outputs (p, na) and inputs (m, nb + delay)."""
        return Info(
            mean=state.parameters.ravel(), covariance=recursive.block_diagonal(jax.vmap(gram)(state.error_factor)),
            extra={"past_outputs": state.outputs, "past_inputs": state.lags},
        )  # fmt: skip

    def correct(self, state: Recursion, sample: Sample) -> tuple[Recursion, Info]:
        """Update with one sample; the acknowledgement has reported its input."""
        mean, P = self._believed
        variance = jnp.sum(P * jnp.eye(P.shape[-1])[None], axis=2)
        lags = recursive.window(state.lags, sample.u, self.delay)
        blank = replace(state, lags=None)

        def one(state: Recursion, y: Array, seen: Array, r: Array, mean: Array, variance: Array):
            return self._learn(state, lags, y, seen, r, mean, variance)

        after, steps = jax.vmap(one)(
            blank, jnp.asarray(sample.y), jnp.asarray(sample.seen), recursive.noise_of(self, sample), mean, variance
        )
        return replace(after, lags=state.lags), _informed(after, steps, sample)

    def _learn(self, state: Recursion, lags: Array, y: Array, seen: Array, r: Array, mean: Array, variance: Array):
        """One output: θ after its datum, and the report of it."""
        θ, a, d = state.parameters, state.parameters[: self.na], state.parameters.shape[0]
        φ = kernel.regressor(state.outputs, lags)
        ψ = kernel.slope(φ, a, state.slopes)
        predicted = jnp.sum(φ * θ)
        e = y - predicted
        refined = self.method == "refined"
        g = jnp.where(state.informative < PSEUDOLINEAR * d, φ, ψ) if refined else φ
        state, λ = (
            self._remembered(state, g, e, predicted, seen, r) if refined else (state, jnp.asarray(self.forgetting))
        )
        K, L = kernel.learn(state.gain_factor, g, r, λ)
        h = jnp.where(jnp.arange(d, dtype=float) == state.turn, 1.0, 0.0)
        own = jnp.sum(h * variance) * state.doubt
        w = jnp.where(
            own > 0, (1 - λ) * d / jnp.where(own > 0, own, 1.0), 0.0
        )  # the prior replaces forgotten information
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

    def _remembered(self, state: Recursion, g: Array, e: Array, predicted: Array, seen: Array, r: Array):
        """The share λ of P^-1 that remains, and the counts that determine it."""
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
        """Move to the next sample: the auxiliary model's output and its slope join the stored ones (3.16)."""
        lags = recursive.window(state.lags, interval.u, self.delay)

        def one(θ: Array, outputs: Array, slopes: Array):
            φ = kernel.regressor(outputs, lags)
            ψ = kernel.slope(φ, θ[: self.na], slopes)
            x = jnp.sum(φ * θ)
            return jnp.concatenate([x[None], outputs])[: self.na], jnp.concatenate([ψ[None, :], slopes])[: self.na]

        outputs, slopes = jax.vmap(one)(state.parameters, state.outputs, state.slopes)
        lags_held = self.nb + self.delay
        shifted = jnp.concatenate([jnp.asarray(interval.u)[:, None], state.lags], axis=1)[:, :lags_held]
        return replace(state, outputs=outputs, slopes=slopes, lags=shifted)


def _informed(state: Recursion, steps: tuple, sample: Sample) -> Info:
    """The report of all outputs together: their noises, and so their errors, are independent."""
    e, S, x, completed = steps
    p, d = state.parameters.shape
    Σ = recursive.block_diagonal(jax.vmap(gram)(state.error_factor))
    seen = jnp.asarray(sample.seen)
    likelihood = -0.5 * jnp.sum(jnp.where(seen, jnp.log(2 * jnp.pi * S) + e * e / S, 0.0))
    return Info(
        mean=state.parameters.ravel(), covariance=Σ, innovation=jnp.where(seen, e, jnp.nan),
        innovation_covariance=jnp.eye(p) * S[:, None], log_likelihood=likelihood,
        outcome=outcome_code(jnp.asarray(False), state.parameters.ravel(), state.error_factor.reshape(p * d, d)),
        extra={"output": x, "completed": completed},
    )  # fmt: skip
