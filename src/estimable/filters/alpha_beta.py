"""The α-β and α-β-γ trackers, over steps of any length."""

from dataclasses import KW_ONLY, InitVar, field
from typing import Any, Self

import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array
from ..frozen import frozen, replace, set_field, static
from ..kernels import tracker_error as kernel
from ..models.discretisation import over
from ..models.prior import Prior
from ..models.sampled import Clock
from ..models.state_space import StateSpace
from ..protocols import Algorithm
from ..results import Info, Interval, Names, Sample
from .belief import Belief
from .fixed_gain import correct_by
from .kalman_filter import Kalman

STATES = ("position", "velocity", "acceleration")
INDEX = "kalata"


@frozen
class Track:
    """The belief of a tracker, and the seconds since its last sample (or its prior)."""

    belief: Belief
    elapsed: Any


@frozen
class AlphaBeta(Algorithm[Track]):
    """A tracker of a position with two or three constant gains. It reports the true covariance of its error, for steps of any
    length.

    Model: the target has the position r and the velocity v, dr/dt = v, and its acceleration dv/dt is white noise of density
    σ_a². With `gamma` the acceleration a is a state, and da/dt is that noise. The sensor gives y[k] = r + noise. Let T be the
    seconds since the last seen sample, and e the innovation, y minus the predicted r. At a sample r moves by α e, v by
    (β / T) e, and a by (γ / T²) e.

    Assumes that the target moves like this. The gains need no variances. At a constant T the poles of the error do not depend
    on T. Where T changes by large factors from sample to sample, constant gains may be unstable: the gains of Bass are at
    T = 1, 10, 1, 10, .. s. Then use alpha="kalata". The covariance holds for the given gains; it needs σ_a² and the noise of
    the sensor.

    Settings:

    - `alpha`, `beta`, `gamma`: the gains, such as `alpha_beta_gains` returns (other authors divide this γ by 2). Or
      alpha="kalata": α and β are computed for each step from the index Λ = T² σ_w / σ_v with σ_w² = σ_a² / T and the sensor's
      σ_v, so that each sample is weighted by its T.
    - `sigma_a2`: the density σ_a². `sigma_s2`: the density σ_s² of a sensor that averages over T, so that a sample has the
      variance σ_s² / T. The first row has no T before it and is then not used. Without both, only the means are estimated.
    - `model`, instead of the densities: a `StateSpace` of a position and its derivatives with the process noise Q. Its R is
      the variance of every sample.
    - `output`: the name of the measured channel.

    A missing sample has the effect of a missing row: the next T is longer. The first row, at the time of the prior, corrects
    the position only; with alpha="kalata" it corrects nothing, because T = 0. A diffuse prior is treated as in `Kalman`: two
    samples determine r and v.

    Cost: that of `Kalman` with 2 or 3 states. Reference: R. W. Bass (2005); P. R. Kalata, IEEE TAES 20 (1984) 174.

    >>> tracker = AlphaBeta(0.5, 0.25, sigma_a2=0.1, sigma_s2=1.0)
    >>> result = estimate(tracker, Record([0.0, 2.0], t=[0.0, 2.0]), prior=Prior([0.0, 0.0], np.eye(2)))
    >>> result.mean[1].tolist()  # half of the innovation, and a quarter over 2 s
    [1.0, 0.25]
    """

    alpha: Any
    beta: Any = None
    _: KW_ONLY
    gamma: Any = None
    sigma_a2: InitVar[Any] = None
    sigma_s2: InitVar[Any] = None
    output: InitVar[str | None] = None
    model: StateSpace | None = None
    averages: bool = static(default=False, init=False)
    silent: bool = static(default=False, init=False)
    kalman: Kalman | None = field(default=None, init=False)
    density: Any = field(default=None, init=False)

    def __post_init__(self, sigma_a2: float | None, sigma_s2: float | None, output: str | None):
        faults = checks.Faults()
        _check_gains(self, faults)
        order = 2 if self.gamma is None else 3
        if self.model is None:
            noises = _noises(sigma_a2, sigma_s2, self.alpha, faults)
            faults.finish()
            model = _chain(order, *noises, output)
            set_field(self, model=model, averages=sigma_s2 is not None, silent=sigma_s2 is None)
        else:
            if any(one is not None for one in (sigma_a2, sigma_s2, output)):
                faults.add("give `model`, or `sigma_a2`, `sigma_s2` and `output`, not both: the model has its own.")
            if faults.instance("model", self.model, StateSpace):
                _check_model(self.model, order, self.alpha, faults)
            faults.finish()

    @property
    def _model(self) -> StateSpace:
        assert self.model is not None
        return self.model

    @property
    def has_innovation_covariance(self) -> bool:
        """False where the noises were not given."""
        return not self.silent

    @property
    def names(self) -> Names:
        """Names of states, inputs and outputs."""
        return Names(self._model.states, self._model.inputs, self._model.outputs)

    def sampled(self, clock: Clock) -> Self:
        """The same tracker with its model discretised for the steps of `clock` and its noises factored."""
        model = self._model
        density = (
            (model.G @ model.Q @ jnp.swapaxes(model.G, -1, -2))[..., -1, -1] if isinstance(self.alpha, str) else None
        )
        return replace(self, kalman=Kalman(model).sampled(clock), density=density, model=None)

    def at(self, k: int | Array) -> Self:
        """The tracker at row k of a record whose steps vary."""
        return replace(self, kalman=self._kalman_filter.at(k))

    @property
    def _kalman_filter(self) -> Kalman:
        """The Kalman filter of the same model."""
        return Kalman(self._model).sampled(Clock.every(self._model.dt)) if self.kalman is None else self.kalman

    def init(self, prior: Prior) -> Track:
        """The belief before y[0]."""
        return Track(self._kalman_filter.init(prior), jnp.zeros(()))

    def correct(self, state: Track, sample: Sample) -> tuple[Track, Info]:
        """Update the belief with one sample."""
        kalman, T = self._kalman_filter, state.elapsed
        later = T > 0
        rate = jnp.where(later, 1 / jnp.where(later, T, 1.0), 0.0)
        seen = sample.seen
        if self.averages:
            assert kalman.ready is not None
            seen = seen & later  # an average over no time carries no information
            kalman = replace(kalman, ready=replace(kalman.ready, V=kalman.ready.V * jnp.sqrt(rate)))
        K = self._gains(kalman, T) * jnp.stack([jnp.ones(()), rate, rate**2][: 2 if self.gamma is None else 3])
        belief, info = correct_by(K[:, None], kalman, state.belief, replace(sample, seen=seen))
        if self.silent:
            info = Info(mean=info.mean, innovation=info.innovation, outcome=info.outcome)
        return Track(belief, jnp.where(sample.seen[0], 0.0, T)), info

    def _gains(self, kalman: Kalman, T: Array):
        """(α, β) or (α, β, γ)."""
        if not isinstance(self.alpha, str):
            gains = (self.alpha, self.beta) if self.gamma is None else (self.alpha, self.beta, self.gamma)
            return jnp.stack([jnp.asarray(gain, float) for gain in gains])
        assert kalman.ready is not None
        variance = kalman.ready.V[0, 0] ** 2
        known = variance > 0  # a sensor without noise: Λ is infinite
        ratio = self.density * T**3 / jnp.where(known, variance, 1.0)
        Λ = jnp.where(ratio > 0, jnp.sqrt(jnp.where(ratio > 0, ratio, 1.0)), 0.0)
        α, β = kernel.kalata(Λ)
        return jnp.where(known, jnp.stack([α, β]), jnp.array([1.0, 2.0]))

    def predict(self, state: Track, interval: Interval) -> Track:
        """Move to the next sample."""
        return Track(self._kalman_filter.predict(state.belief, interval), state.elapsed + interval.dt)


def _check_gains(tracker: AlphaBeta, faults: checks.Faults) -> None:
    """Check that the gains are stable at a constant step, or the name of the index."""
    if isinstance(tracker.alpha, str):
        faults.choice("alpha", tracker.alpha, (INDEX,))
        for name in ("beta", "gamma"):
            if getattr(tracker, name) is not None:
                faults.add(f"`{name}` must not be given with alpha = {INDEX!r}, which computes the gains.")
        return
    if tracker.beta is None:
        faults.add("`beta` must be given with `alpha`: α-β trackers have two gains, as from alpha_beta_gains.")
        return
    named = {"alpha": tracker.alpha, "beta": tracker.beta, "gamma": tracker.gamma}
    gains = {name: faults.number(name, value, above=0.0) for name, value in named.items() if value is not None}
    set_field(tracker, **gains)
    if any(gain is None for gain in gains.values()) or checks.is_traced(*gains.values()):
        return
    if len(gains) == 2 and not kernel.stable(*gains.values()):
        faults.add(kernel.UNSTABLE.format(*gains.values()))
    elif (radius := np.abs(kernel.poles(*gains.values())).max()) >= 1:
        faults.add(f"the error is unstable with these gains: its largest pole has modulus {radius:.6g}, not < 1.")


def _noises(
    sigma_a2: float | None, sigma_s2: float | None, alpha: float | str | None, faults: checks.Faults
) -> tuple[float, float]:
    """Both densities, or neither."""
    if sigma_a2 is None and sigma_s2 is None:
        if isinstance(alpha, str):
            faults.add(
                f"alpha = {alpha!r} needs `sigma_a2` and `sigma_s2`, or a `model`: the gains are computed from them."
            )
        return 0.0, 1.0
    given = {"sigma_a2": sigma_a2, "sigma_s2": sigma_s2}
    for name in (name for name, value in given.items() if value is None):
        faults.add(f"`sigma_a2` and `sigma_s2` must be given together: the covariance needs both. `{name}` is missing.")
    return tuple(faults.number(name, value, lower=0.0) for name, value in given.items() if value is not None)  # type: ignore[return-value]


def _chain(order: int, σ_a2: float, σ_s2: float, output: str | None) -> StateSpace:
    """A position and its derivatives, the last driven by white noise."""
    return StateSpace(
        np.eye(order, k=1), C=np.eye(1, order), G=np.eye(order)[:, -1:], Q=[[σ_a2]], R=[[σ_s2]], dt=0,
        states=STATES[:order], outputs=None if output is None else [output],
    )  # fmt: skip


def _check_model(model: StateSpace, order: int, alpha: float | str | None, faults: checks.Faults) -> None:
    """Check that the model is a measured position and its derivatives."""
    shift = np.eye(order, k=1)
    A = shift if model.is_continuous else over(shift, np.eye(order), shift, model.dt, hold="zero_order")[0]
    alike = np.shape(model.A) == A.shape and np.shape(model.C) == (1, order)
    if not alike or not (np.allclose(model.A, A, rtol=1e-9, atol=0) and np.array_equal(model.C, np.eye(1, order))):
        faults.add(
            f"`model` must describe a measured position and its derivatives: for {order} gains A = {A.tolist()}, "
            f"C = {np.eye(1, order).tolist()}. Got A = {checks.short(np.asarray(model.A).tolist())}."
        )
    if isinstance(alpha, str) and not model.is_continuous:
        faults.add(f"alpha = {alpha!r} needs a continuous `model` (dt = 0), whose Q is a density.")
