"""The state and the loop gain, estimated jointly."""

from dataclasses import KW_ONLY, field
from typing import Any, Self

import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array, Numbers
from ..frozen import frozen, replace, set_field
from ..kernels import joint_gain
from ..kernels.bank_moments import gaussian_quantiles
from ..kernels.kalman import Measurement, Posterior, Transition
from ..kernels.small import factors, gram, triangularise
from ..kernels.smoothing import Instant
from ..models import gain_blocks
from ..models.prior import Prior
from ..models.sampled import Clock, SampledModel, sample
from ..models.state_space import StateSpace
from ..models.uncertainty import ModelUncertainty, skewed, tangents
from ..protocols import JumpingGains, Smoothable
from ..results import Info, Interval, Names, Sample, outcome_code
from . import belief, uncertain
from .belief import Belief
from .input_noise import refuse_unknown_input, with_input_noise
from .sample_noise import noise_of

WIDEST = 0.05  # standard deviation of a gain next to which the scale of B can be estimated


@frozen
class UnknownGain(JumpingGains[Belief], Smoothable[Belief]):
    """The exact joint posterior of the state and of the unknown gain of a measured input.

    Model: x[k+1] = A x[k] + B(θ) u[k] + G w[k], y[k] = C x[k] + D(θ) u[k] + v[k], with the gains θ (p,). B(θ) = fixed + Σ θ_i
    directions_i and D(θ) = D + Σ θ_i feedthrough_i. The gains are constant, random walks, or subject to forgetting.

    Assumes that the input is measured without error (it may come from feedback). For a known input the model is linear in
    (x, θ), so this is not an approximation: the estimate is unbiased and its covariance right. Both the
    estimate and the covariance depend on the input. Noise on u, or a gain on the process noise, violates the assumption.
    Without excitation the variance of θ stays constant, or grows under a walk, and so shows that the gain is undetermined.
    A walk follows a gain that jumps; to find the time of the jump, `MovingWindow` or `ChangeDetection` is better.

    Settings:

    - `model`: a `StateSpace` with R. `gain`: the `Prior` of θ.
    - `directions`: how θ acts on B. None or "one": one θ on all of B; "per_input": one θ per actuator; "every_entry": θ is B,
      row by row; or the matrices, (p, n, m).
    - `fixed` (n, m): the known part of B, which no θ multiplies (default zero).
    - `feedthrough`: how θ acts on D. None: D is known; "scaled": as on B (for "one" and "per_input"); or the matrices,
      (p, outputs, m).
    - `walk`: the variance per second of each θ, (p,) or one number, or a covariance (p, p) per second. θ is constant over a
      step and moves at its end.
    - `uncertainty`: a `ModelUncertainty` of A, B or C (default None: they are right); of B, it is that of the matrix that the
      gains multiply. The gain then has `gain_quantiles`, with the skew of a quotient where B is uncertain.
    - `forgetting` λ in (0, 1]: after each sample the covariance P of (x, θ) becomes D P D with D = diag(I, λ^-1/2 I), so that
      old information about θ loses weight.

    Cost: that of `Kalman` with n + p states.

    Reference: M. Pachter (1999), (31)-(37), Theorems 1 and 2; A. G. Sillence (1999), (31)-(37) and §6.3.

    >>> model = StateSpace([[0.5]], [[1.0]], Q=[[0.0]], R=[[0.01]], dt=1)
    >>> UnknownGain(model, Prior([1.0], [[1.0]]), walk=0.02).names.gains
    ('gain',)
    """

    takes_uncertain_inputs = True
    model: StateSpace
    gain: Prior
    _: KW_ONLY
    directions: Any = None
    fixed: Any = None
    feedthrough: Any = None
    walk: Any = 0.0
    forgetting: Any = 1.0
    uncertainty: ModelUncertainty | None = None
    ready: SampledModel | None = field(default=None, init=False)
    walk_factor: Any = field(default=None, init=False)

    def __post_init__(self):
        faults = checks.Faults()
        faults.instance("model", self.model, StateSpace)
        faults.instance("gain", self.gain, Prior)
        faults.finish()
        directions = gain_blocks.read_directions(self.directions, self.model, faults)
        self._check_gain(self.directions, faults)
        feedthrough = gain_blocks.read_feedthrough(self.feedthrough, self.directions, faults)
        fixed = None if self.fixed is None else faults.array("fixed", self.fixed, "n m")
        walk = self.read_walk(self.walk, faults)
        if self.model.B_end is not None and (fixed is not None or not gain_blocks.is_word(directions)):
            faults.add(
                "the model was discretised for an input that moves between samples (it has `B_end`). `fixed` and `directions` "
                "as matrices have no meaning for it: give the continuous model (dt = 0)."
            )
        forgetting = faults.number("forgetting", self.forgetting, above=0.0, upper=1.0)
        if self.uncertainty is not None:
            self._check_uncertainty(directions, faults)
        faults.finish()
        set_field(self, directions=directions, feedthrough=feedthrough, fixed=fixed, walk=walk, forgetting=forgetting)

    def _check_uncertainty(self, directions: Any, faults: checks.Faults) -> None:
        given = self.uncertainty
        if not faults.instance("uncertainty", given, ModelUncertainty) or given is None:
            return
        given.check(self.model, faults)
        if faults.sentences or "B" not in given.of(self.model):
            return
        if not gain_blocks.is_word(directions):
            faults.add("`uncertainty` of B has no meaning here: `directions` replace the B of the model.")
        widest = float(np.sqrt(np.max(np.diagonal(np.asarray(self.gain.covariance), axis1=-2, axis2=-1), initial=0.0)))
        if given.treat == "estimated" and (widest > WIDEST or self.gain.diffuse is not None):
            faults.add(
                f'`uncertainty` with treat = "estimated" cannot distinguish a gain from the scale of B: the prior of the gain '
                f'must have a standard deviation of at most {WIDEST:g}. It has {widest:.3g}. Use treat = "considered".'
            )

    def _check_gain(self, directions: Numbers | str | None, faults: checks.Faults) -> None:
        p = faults.sizes.get("p", self.gain.size)
        if self.gain.size != p:
            hint = ' For one gain per input: directions="per_input".' if directions is None else ""
            gains = checks.counted(p, "gain")
            faults.add(f"`gain` must be a prior of {gains}: {faults.sources['p']}. Got {self.gain.size}.{hint}")

    def read_walk(self, given: Numbers, faults: checks.Faults) -> Any:
        """A walk of these gains as a covariance per second (p, p)."""
        if checks.is_traced(given):
            return given
        p = self.gain.size
        faults.learn("gains", p, f"`gain` is a prior of {checks.counted(p, 'gain')}")
        walk = [given] * p if isinstance(given, int | float) else given
        if np.ndim(np.asarray(walk, object)) == 2:
            return faults.covariance("walk", walk, "gains gains")
        variances = faults.array("walk", walk, "gains")
        if variances is not None and np.any(variances < 0):
            faults.add(f"`walk` must be variances per second, at least 0. Got {checks.short(given)}.")
        return None if variances is None else np.diag(variances)

    @property
    def names(self) -> Names:
        """Names of states, inputs, outputs and gains."""
        model = self.model
        gains = gain_blocks.gain_names(self.directions, self.gain.size, model)
        return Names(model.states, model.inputs, model.outputs, gains)

    @property
    def gain_is_effectiveness(self) -> bool:
        """Whether the gains multiply the B of the model, so that 1 minus a gain is the part of the effect that is lost."""
        return gain_blocks.is_word(self.directions) and self.fixed is None

    def sampled(self, clock: Clock) -> Self:
        """The same filter with its model and each block of B(θ) discretised, and its noises factored."""
        ready = sample(self._in_blocks(self.model), clock)
        if self.uncertainty is not None:
            ready = replace(ready, tangents=tangents(self.model, self.uncertainty, clock, self._in_blocks))
        return replace(self, ready=ready, walk_factor=factors(self.walk), model=None)

    def in_blocks(self) -> StateSpace:
        """The model with the directions of the gains side by side in B."""
        return self._in_blocks(self.model)

    def _in_blocks(self, model: StateSpace) -> StateSpace:
        p = self.gain.mean.shape[-1]
        return gain_blocks.in_blocks(
            model, p, directions=self.directions, fixed=self.fixed, feedthrough=self.feedthrough
        )

    def at(self, k: int | Array) -> Self:
        """The filter at row k of a time-varying model."""
        ready = self._ready
        return replace(ready, ready=ready.ready.at(k))

    @property
    def _ready(self) -> Any:
        return self.sampled(Clock.every(self.model.dt)) if self.ready is None else self

    def init(self, prior: Prior) -> Belief:
        """The belief about (x[0], θ) before y[0]: the state from `prior`, the gain from this filter's own prior."""
        ready = self._ready.ready
        state = belief.believe(prior, ready.point.states, ready.added)
        if ready.tangents is not None:
            state = uncertain.with_entries(state, jnp.asarray(ready.tangents.sigma))
        return belief.side_by_side(state, belief.believe(self.gain))

    def correct(self, state: Belief, sample: Sample) -> tuple[Belief, Info]:
        """Update the belief with one sample."""
        state, post = self.condition(state, sample)
        info = replace(
            self.tell(state),
            innovation=post.innovation,
            innovation_covariance=post.innovation_covariance,
            log_likelihood=post.log_likelihood,
            outcome=outcome_code(post.contradicted, state.mean, state.factor, state.diffuse),
        )
        return state, info

    def constant(self, walk: Array, persistence: Array) -> Self:
        """The same filter with gains that walk by `walk` per second only, and `persistence` times its process noise."""
        model = replace(self.model, Q=persistence * self.model.Q)
        return replace(self, walk=walk, forgetting=0 * self.forgetting + 1, model=model)

    def condition(self, state: Belief, sample: Sample, about: Belief | None = None) -> tuple[Belief, Posterior]:
        """The belief about (x, θ) after one sample, and the whole update. `about` has no effect, as the model is linear."""
        ready = self._ready.ready
        measurement = self._measurement(sample, state if about is None else about)
        return belief.correct(
            state, measurement, sample, independently=ready.independent, considered=self._considered(state)
        )

    def _considered(self, state: Belief) -> slice | None:
        """The uncertain entries in the state, where they are not estimated."""
        if self.uncertainty is None or self.uncertainty.treat == "estimated":
            return None
        end = state.mean.shape[0] - self.gain.mean.shape[0]
        return slice(end - self.uncertain_entries, end)

    @property
    def uncertain_entries(self) -> int:
        """The number of uncertain entries of the model."""
        found = self._ready.ready.tangents
        return 0 if found is None else found.count

    def skewed(self, quantiles: Array) -> Array:
        """The quantiles (p, 5) of the gains with the skew of a quotient where the B that they multiply is uncertain."""
        found = self._ready.ready.tangents
        return skewed(quantiles) if found is not None and found.skew else quantiles

    def tell(self, state: Belief) -> Info:
        """Mean and covariance of a belief about (x, θ), in the user's units."""
        p = self.gain.mean.shape[0]
        end = state.mean.shape[0] - p
        n = end - self.uncertain_entries
        covariance, extra, diffuse = state.covariance, {}, None
        extra["state_gain_covariance"] = covariance[:n, end:]
        if state.diffuse.shape[1]:
            diffuse = gram(state.diffuse)
            extra["gain_diffuse_covariance"] = diffuse[end:, end:]
        quantiles = None
        if self.uncertainty is not None:
            found = self.skewed(gaussian_quantiles(state.mean[end:], covariance[end:, end:]))
            unknown = jnp.sum(state.diffuse[end:] ** 2, axis=1) > 0
            quantiles = jnp.where(unknown[:, None], jnp.nan, found)
        return Info(
            mean=state.mean[:n] + self._ready.ready.point.states,
            covariance=covariance[:n, :n],
            gain=state.mean[end:],
            gain_covariance=covariance[end:, end:],
            gain_quantiles=quantiles,
            diffuse_covariance=None if diffuse is None else diffuse[:n, :n],
            extra=extra,
        )

    def predict(self, state: Belief, interval: Interval) -> Belief:
        """Move to the next sample."""
        transition = self._transition(interval, state)
        return self._forget(belief.predict(state, transition, self._cross_noise(self._ready.ready)))

    @property
    def for_smoothing(self) -> Self:
        """The filter itself. Raises `InputError` for an uncertain model."""
        uncertain.refuse_smoothing(self.uncertainty)
        return self

    def instant(self, sample: Sample, interval: Interval) -> Instant:
        """This row of the model of (x, θ), for the smoother; not defined with forgetting."""
        refuse_unknown_input(interval)  # its effect depends on the gain
        return Instant(self._transition(interval), self._measurement(sample))

    def instant_about(self, sample: Sample, interval: Interval, predicted: Belief, filtered: Belief) -> Instant:
        """This row of the model, with the effect of an unknown input at the filtered gain."""
        return Instant(self._transition(interval, filtered), self._measurement(sample))

    def _measurement(self, sample: Sample, about: Belief | None = None) -> Measurement:
        """y = H (x, θ) + d + V e; `about`: the belief at which the effect of uncertain entries is linear."""
        model, C, constant = self._ready.ready, self._ready.ready.C, 0.0
        if model.tangents is not None and about is not None:
            now = uncertain.parts(about.mean, model.tangents.count, self.gain.mean.shape[0])
            C, constant = uncertain.observation(model, model.tangents, now)
        d = joint_gain.effects(model.D, sample.u - model.point.inputs, self.gain.mean.shape[0] + 1)
        H = joint_gain.observation(C, d[:, 1:])
        V = noise_of(model.V, sample)
        return Measurement(H, model.point.outputs + d[:, 0] + constant, V, self._cross_noise(model), model.turn)

    def _transition(self, interval: Interval, state: Belief | None = None) -> Transition:
        """The step to the next (x, θ); `state` is the belief about θ where inputs are uncertain."""
        model, p = self._ready.ready, self.gain.mean.shape[0]
        noise = model.W if state is None else with_input_noise(model.W, model, interval, _moments(state, p))
        if model.tangents is not None and state is not None:
            now = uncertain.parts(state.mean, model.tangents.count, p)
            A, b, constant = uncertain.motion(model, model.tangents, now, interval)
            noise = uncertain.noise(noise, model.tangents.count)
        else:
            A, constant, b = model.A, 0.0, joint_gain.effects(model.B, interval.u - model.point.inputs, p + 1)
            if model.B_end is not None:
                b = b + joint_gain.effects(model.B_end, interval.u_end - model.point.inputs, p + 1)
        W = joint_gain.block_diagonal(noise, self._ready.walk_factor * jnp.sqrt(interval.dt))
        return Transition(joint_gain.transition(A, b[:, 1:]), jnp.concatenate([b[:, 0] + constant, jnp.zeros(p)]), W)

    def _cross_noise(self, model: SampledModel):
        """Ω of (x, θ): the process noise of θ is independent of the noise of the outputs."""
        p = self.gain.mean.shape[0] + self.uncertain_entries
        return None if model.Ω is None else jnp.concatenate([model.Ω, jnp.zeros((p, model.Ω.shape[1]))])

    def _forget(self, state: Belief) -> Belief:
        """P <- D P D with D = diag(I, λ^-1/2 I)."""
        p = self.gain.mean.shape[0]
        D = jnp.ones(state.mean.shape[0]).at[-p:].set(self.forgetting**-0.5)[:, None]
        return replace(state, factor=D * state.factor, diffuse=D * state.diffuse)


def _moments(state: Belief, p: int) -> Array:
    """A factor (1 + p, 1 + k) of E[θ~ θ~'] with θ~ = (1, θ): E[θ θ'] = θ^ θ^' + P."""
    known = jnp.concatenate([jnp.ones(1), state.mean[-p:]])
    spread = jnp.concatenate([jnp.zeros((1, state.factor.shape[1])), state.factor[-p:]])
    return triangularise(jnp.concatenate([known[:, None], spread], axis=1))
