"""The Kalman filter."""

from dataclasses import KW_ONLY, field
from typing import Self

import jax.numpy as jnp

from .. import checks
from ..annotations import Array
from ..frozen import frozen, replace
from ..kernels.kalman import Measurement, Transition
from ..kernels.small import apply, gram
from ..kernels.smoothing import Instant
from ..models.prior import Prior
from ..models.sampled import Clock, SampledModel, sample
from ..models.state_space import StateSpace
from ..models.uncertainty import ModelUncertainty, tangents
from ..protocols import Smoothable
from ..results import Info, Interval, Names, Sample, outcome_code
from . import belief, uncertain
from .belief import Belief
from .input_noise import with_input_noise
from .sample_noise import noise_of


@frozen
class Kalman(Smoothable[Belief]):
    """The Kalman filter: the exact posterior of the state of a known linear Gaussian model, sample by sample.

    Model: x[k+1] = A x[k] + B u[k] + G w[k], y[k] = C x[k] + D u[k] + v[k], constant or time-varying, with known inputs and
    possibly with cross noise S. Outputs may be missing channel by channel. The prior may be exact (zero covariance), proper
    or diffuse.

    Assumes that A, B, C, D, G, Q, R, S are right and the noises white and Gaussian. For other noises it is the best linear
    estimator. With a wrong Q or R its covariance is wrong; `diagnostics.check_innovations` detects this. If the effect of an
    input is unknown, use `UnknownGain`.

    Settings: `model`, a `StateSpace` with R, continuous or discrete. A continuous one is discretised for each distinct step
    of the record. `uncertainty`, a `ModelUncertainty` of A, B or C (default None: they are right).

    Cost: about 2 p (p + n)(p + n) + n² (2 (n + p) + q) multiplications per sample, with q process noises;
    0.15 us at n = 4, p = 2 as machine code.

    Reference: T. Kailath, A. H. Sayed, B. Hassibi, Linear Estimation (2000), ch. 12; J. Durbin, S. J. Koopman, Time Series
    Analysis by State Space Methods (2012), ch. 5 for the diffuse start. With a known gain Sillence (1999) (31)-(37) and
    Pachter (1999) Corollary 4 are this filter.

    >>> model = StateSpace([[0.9]], C=[[1.0]], Q=[[0.1]], R=[[0.2]], dt=1)
    >>> state = Kalman(model).init(Prior([0.0], [[1.0]]))
    >>> bool(state.mean.shape == (1,))
    True
    """

    takes_uncertain_inputs = True
    model: StateSpace
    _: KW_ONLY
    uncertainty: ModelUncertainty | None = None
    ready: SampledModel | None = field(default=None, init=False)

    def __post_init__(self):
        faults = checks.Faults()
        faults.instance("model", self.model, StateSpace)
        if self.uncertainty is not None and faults.instance("uncertainty", self.uncertainty, ModelUncertainty):
            self.uncertainty.check(self.model, faults)
        faults.finish()

    @property
    def names(self) -> Names:
        """Names of states, inputs and outputs."""
        return Names(self.model.states, self.model.inputs, self.model.outputs)

    def sampled(self, clock: Clock) -> Self:
        """The same filter with its model discretised for the steps of `clock` and its noises factored."""
        return replace(self, ready=self._sampled(clock), model=None)

    def _sampled(self, clock: Clock) -> SampledModel:
        ready = sample(self.model, clock)
        if self.uncertainty is None:
            return ready
        return replace(ready, tangents=tangents(self.model, self.uncertainty, clock, lambda model: model))

    def at(self, k: int | Array) -> Self:
        """The filter at row k of a time-varying model."""
        return replace(self, ready=self._ready.at(k))

    @property
    def _ready(self) -> SampledModel:
        return self._sampled(Clock.every(self.model.dt)) if self.ready is None else self.ready

    def init(self, prior: Prior) -> Belief:
        """The belief about x[0], before y[0]."""
        ready = self._ready
        state = belief.believe(prior, ready.point.states, ready.added)
        return state if ready.tangents is None else uncertain.with_entries(state, jnp.asarray(ready.tangents.sigma))

    def correct(self, state: Belief, sample: Sample) -> tuple[Belief, Info]:
        """Update the belief with one sample."""
        ready, considered = self._ready, None
        if self.uncertainty is not None and self.uncertainty.treat == "considered":
            considered = slice(state.mean.shape[0] - ready.tangents.count, state.mean.shape[0])
        state, post = belief.correct(
            state, self.measurement(sample, state), sample, independently=ready.independent, considered=considered
        )
        info = replace(
            self.tell(state),
            innovation=post.innovation,
            innovation_covariance=post.innovation_covariance,
            log_likelihood=post.log_likelihood,
            outcome=outcome_code(post.contradicted, state.mean, state.factor, state.diffuse),
        )
        return state, info

    def tell(self, state: Belief) -> Info:
        """Mean and covariance of a belief, in the user's units."""
        origin = self._ready.point.states
        n = origin.shape[0]
        diffuse = gram(state.diffuse)[:n, :n] if state.diffuse.shape[1] else None
        return Info(state.mean[:n] + origin, state.covariance[:n, :n], diffuse_covariance=diffuse)

    def predict(self, state: Belief, interval: Interval) -> Belief:
        """Move to the next sample."""
        Ω, q = self._ready.Ω, state.mean.shape[0] - self._ready.A.shape[0]
        if Ω is not None and q:
            Ω = jnp.concatenate([Ω, jnp.zeros((q, Ω.shape[1]))])
        return belief.predict(state, self._transition(interval, state), Ω)

    @property
    def for_smoothing(self) -> Self:
        """The filter itself. Raises `InputError` for an uncertain model."""
        uncertain.refuse_smoothing(self.uncertainty)
        return self

    def instant(self, sample: Sample, interval: Interval) -> Instant:
        """This row of the model, for the smoother."""
        return Instant(self._transition(interval), self.measurement(sample))

    def measurement(self, sample: Sample, about: Belief | None = None) -> Measurement:
        """y = C x + d + V e, where d comes from the known input. `about`: the belief, of a model with uncertain entries."""
        model = self._ready
        d = model.point.outputs + apply(model.D, sample.u - model.point.inputs)
        V = noise_of(model.V, sample)
        if model.tangents is None or about is None:
            return Measurement(model.C, d, V, model.Ω, model.turn)
        q = model.tangents.count
        C, constant = uncertain.observation(model, model.tangents, uncertain.parts(about.mean, q, 0))
        Ω = None if model.Ω is None else jnp.concatenate([model.Ω, jnp.zeros((q, model.Ω.shape[1]))])
        return Measurement(C, d + constant, V, Ω, model.turn)

    def _transition(self, interval: Interval, state: Belief | None = None) -> Transition:
        """x+ = A x + c + W e', where c comes from the known input; noise of the input is part of W."""
        model = self._ready
        if model.tangents is not None and state is not None:
            q = model.tangents.count
            A, b, constant = uncertain.motion(model, model.tangents, uncertain.parts(state.mean, q, 0), interval)
            W = uncertain.noise(with_input_noise(model.W, model, interval, jnp.ones((1, 1))), q)
            return Transition(A, b[:, 0] + constant, W)
        c = apply(model.B, interval.u - model.point.inputs)
        if model.B_end is not None:
            c = c + apply(model.B_end, interval.u_end - model.point.inputs)
        return Transition(model.A, c, with_input_noise(model.W, model, interval, jnp.ones((1, 1))))
