"""Tracking of a reference with a plant that is identified at the same time."""

from collections.abc import Mapping
from dataclasses import KW_ONLY
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .. import checks
from ..analysis.zeros import invariant_zeros
from ..annotations import Array
from ..frozen import frozen, replace, set_field, static
from ..kernels import tracking_law as kernel
from ..kernels.auxiliary_model import stabilise
from ..models.controlled import read_limits
from ..models.state_space import StateSpace
from ..protocols import Controller
from ..results import Info, Names

FEEDBACK = ("model", "filtered", "measured")
LAWS = ("mirrored", "inverse")


@frozen
class Remembered:
    """The state of the law, (p, na) each: past measured outputs, their deviations from the model with covariances, and
    δ; the largest reference so far, (p,)."""

    measured: Any
    deviation: Any
    covariance: Any
    offset: Any
    largest: Any


@frozen
class Tracking(Controller[Remembered]):
    """A controller that brings the next output of the plant to its reference, with the current parameters of an identifier.

    Model: A(z) x° = z^-delay B(z) u, y = x° + v, with the polynomials A and B estimated, and as many inputs as outputs
    (`size`). The input is u[k] = (r[k] + Σ a_i x[k-i] - Σ b_i u[k-i]) / b0, for which the output of the model is the
    reference r. Here x[k-i] are past outputs, as `feedback` selects them. With a `delay`, r[k] is reached at k + delay. The
    controller acts before y[k] is measured. It needs an identifier that stores past outputs: `JointOutputError`
    (with a fast start and recovery) or `RecursiveOutputError`.

    Assumes that A is stable.

    Settings:

    - `na`, `nb`, `delay`, `size`: as those of the identifier.
    - `feedback`: which past outputs x the law uses. "model" (the default): those of the identifier's model. The noise is then
      not fed back, which gives the smallest variance, but disturbances are not rejected. "measured": y where it was seen, as
      printed in the source. "filtered": between them. A Kalman filter estimates the plant's deviation from the model, for
      process noise of `noise_ratio` times the variance of v.
    - `law`: "mirrored" (the default, for one input): reflects the zeros of B outside the unit circle into it, and preserves
      the static gain. Its poles are those of the least-squares law with vanishing input weight. It accepts any zeros, equals
      "inverse" where all are inside, and also limits the effect of a poor temporary estimate. "inverse": cancels the zeros of
      B. For a plant with zeros outside the unit circle u then grows without bound, which is an error in `close_loop`.
    - `lower`: the smallest divisor |b0|, in units of output over input (default 0). The divisor is never below 1e-3 of Σ |b|,
      nor, in the mirrored law, below half its standard deviation; it has the sign of the estimate.
    - `reach`: one input may move the output by at most this many times the largest reference so far (default 3). There is no
      such limit while the reference is zero.
    - `limits` (2,): the smallest and the largest input (default None).

    Reports `divisor` (p,), and `minimum_phase` (p,), whether the zeros of the estimated B are inside the unit circle.

    Cost: about 10 (na + nb) multiplications.

    Reference: H. Fang (2009), (4.15) and Theorem 4.1. (4.15) feeds back z, but (4.14) and the theorem need x_b. The mirrored
    law: K. J. Åström & B. Wittenmark, *Computer-Controlled Systems* (1997), §12.4.

    >>> law = Tracking(1, 0)
    >>> now = Info(mean=np.array([-0.5, 2.0]), covariance=np.zeros((2, 2)), extra={
    ...     "past_outputs": np.array([[1.0]]), "past_inputs": np.zeros((1, 0)), "completed": np.zeros(1), "seen": np.ones(1)})
    >>> law.act(law.init(), now, np.array([1.5]))[1].tolist()
    [0.5]
    """

    na: int = static()
    nb: int = static()
    _: KW_ONLY
    delay: int = static(default=0)
    size: int = static(default=1)  # pyright: ignore[reportIncompatibleMethodOverride]  a setting here
    feedback: str = static(default="model")
    law: str = static(default="mirrored")
    noise_ratio: Any = 0.01
    lower: Any = 0.0
    reach: Any = 3.0
    limits: Any = None

    def __post_init__(self):
        faults = checks.Faults()
        for name, least in (("na", 0), ("nb", 0), ("delay", 0), ("size", 1)):
            faults.whole(name, getattr(self, name), least, checks.LARGEST_ORDER)
        faults.choice("feedback", self.feedback, FEEDBACK)
        faults.choice("law", self.law, LAWS)
        faults.finish()
        ratio = faults.number("noise_ratio", self.noise_ratio, lower=0.0)
        lower = faults.number("lower", self.lower, lower=0.0)
        reach = faults.number("reach", self.reach, above=0.0)
        faults.learn("m", self.size, f"`size` is {self.size}")
        limits = read_limits(self.limits, faults)
        if self.law == "mirrored" and self.size != 1:
            faults.add(
                '`law` = "mirrored" is for one input and one output. With more give law="inverse", for plants whose zeros lie '
                "inside the unit circle."
            )
        faults.finish()
        set_field(self, noise_ratio=ratio, lower=lower, reach=reach, limits=limits)

    @property
    def acts_on(self) -> str:
        """ "predicted": the controller acts before the sample is measured, so that its input may enter it at once."""
        return "predicted"

    @property
    def references(self) -> int:
        """The number of references."""
        return self.size

    def check(self, names: Names, faults: checks.Faults) -> None:
        """Check that an identifier whose columns have these names suits this controller."""
        wanted = self.size * (self.na + self.size * (self.nb + 1))
        if len(names.states) != wanted or len(names.outputs) != self.size:
            faults.add(
                f"`controller` has na = {self.na}, nb = {self.nb}, size = {self.size}: {checks.counted(wanted, 'parameter')} for "
                f"{checks.counted(self.size, 'output')}. The estimator has {checks.counted(len(names.states), 'parameter')} for "
                f"{checks.counted(len(names.outputs), 'output')}: {checks.listed(names.states)}."
            )

    def check_plant(self, model: StateSpace, faults: checks.Faults) -> None:
        """Check that the law can control this plant."""
        if self.law == "mirrored" or model.is_continuous:
            return
        zeros = invariant_zeros(model.A, model.B, model.C, model.D).values
        outside = zeros[np.abs(zeros) > 1 + 1e-9]
        if len(outside):
            remedy = 'Give law="mirrored".' if self.size == 1 else "Choose other outputs or a slower step."
            faults.add(
                f'`law` = "inverse" cancels the zeros of the plant, but one lies at {outside[0]:.4g}, outside the unit '
                f"circle: the input would grow without bound. {remedy}"
            )

    def init(self) -> Remembered:
        """The state for a plant at rest that has had no reference yet."""
        p, na = self.size, self.na
        past = jnp.zeros((p, na))
        return Remembered(past, past, jnp.zeros((p, na, na)), past, jnp.zeros(p))

    def act(self, state: Remembered, estimate: Info, reference: Array) -> tuple[Remembered, Array, Mapping[str, Array]]:
        """The input (m,) from the belief before the sample, and a report of its divisor."""
        p, na, lags = self.size, self.na, self.nb + 1
        θ = jnp.asarray(estimate.mean).reshape(p, na + p * lags)
        a, b = θ[:, :na], θ[:, na:].reshape(p, p, lags)
        u = jnp.asarray(estimate.extra["past_inputs"])
        state, outputs = self._fed_back(state, estimate, a)
        outputs = kernel.forecast(a, b, outputs, u, self.delay)
        r = jnp.asarray(reference)
        largest = jnp.maximum(state.largest, jnp.abs(r))
        most = jnp.where(largest > 0, self.reach * largest, jnp.inf)
        solve = self._one if p == 1 else self._several
        command, offset, reported = solve(state.offset, a, b, outputs, u[:, : self.nb], r, most, estimate)
        return replace(state, offset=offset, largest=largest), command, reported

    def _fed_back(self, state: Remembered, estimate: Info, a: Array):
        """The state after the last sample, and the past outputs (p, na) that are fed back."""
        modelled = jnp.asarray(estimate.extra["past_outputs"])
        if self.feedback == "model" or self.na == 0:
            return state, modelled
        y, seen = (jnp.asarray(estimate.extra[name]) for name in ("completed", "seen"))
        if self.feedback == "measured":
            measured = jnp.concatenate([y[:, None], state.measured], axis=1)[:, : self.na]
            return replace(state, measured=measured), measured
        calm = jax.vmap(stabilise)(a)

        def one(ε: Array, P: Array, a: Array, e: Array, seen: Array):
            return kernel.deviate(ε, P, a, e, seen, self.noise_ratio)

        ε, P = jax.vmap(one)(state.deviation, state.covariance, calm, y - modelled[:, 0], seen)
        return replace(state, deviation=ε, covariance=P), modelled + ε

    def _one(self, δ: Array, a: Array, b: Array, outputs: Array, u: Array, r: Array, most: Array, estimate: Info):
        """One input and one output."""
        a, b, δ = a[0], b[0, 0], δ[0]
        P = jnp.asarray(estimate.covariance)[self.na :, self.na :]
        numerator = (kernel.mirrored if self.law == "mirrored" else kernel.as_given)(b, P)
        D = kernel.guarded(numerator.divisor, numerator.variance, b, self.lower)
        b_used = numerator.coefficients
        calm = stabilise(a)
        moved = jnp.sum(b_used[1:] * u[0]) - jnp.sum(a * outputs[0]) - jnp.sum(calm * δ)
        wanted = jnp.clip(r[0] - moved, -most[0], most[0])
        command = jnp.where(D != 0, wanted / jnp.where(D != 0, D, 1.0), 0.0)
        if self.limits is not None:
            command = jnp.clip(command, self.limits[0][0], self.limits[1][0])
        now = jnp.sum((b_used - b) * jnp.concatenate([command[None], u[0]])) - jnp.sum(calm * δ)
        δ = jnp.concatenate([now[None], δ])[: self.na]
        reported = {"divisor": D[None], "minimum_phase": numerator.minimum_phase[None]}
        return command[None], δ[None], reported

    def _several(self, δ: Array, a: Array, b: Array, outputs: Array, u: Array, r: Array, most: Array, estimate: Info):
        """As many inputs as outputs: b0 is a matrix."""
        moved = jnp.sum(b[:, :, 1:] * u[None], axis=(1, 2)) - jnp.sum(a * outputs, axis=1)
        wanted = jnp.clip(r - moved, -most, most)
        first = b[:, :, 0]
        size = jnp.sum(first * first)
        command = kernel.least_squares(first, wanted, self.lower**2 + kernel.LEAST**2 * size)
        if self.limits is not None:
            command = jnp.clip(command, self.limits[0], self.limits[1])
        return (
            command,
            δ,
            {"divisor": jnp.sqrt(jnp.sum(first * first, axis=1)), "minimum_phase": jnp.ones(self.size, bool)},
        )
