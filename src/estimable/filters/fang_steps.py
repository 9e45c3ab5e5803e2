"""The steps of Fang's Algorithm 1, for `UnknownInput`."""

from typing import Any

import jax.numpy as jnp

from .. import checks
from ..frozen import frozen, replace
from ..kernels import fang_filter as kernel
from ..kernels.small import apply, factor, gram, product
from ..models.prior import Prior
from ..models.sampled import SampledModel
from ..results import Info, Interval, Sample, outcome_code
from .input_noise import refuse_unknown_input
from .unknown_layout import Layout, pick


@frozen
class FangState:
    """The predicted state (n,), the algorithm's covariance and the true covariance as factors; between `correct` and
    `predict` also the input's gain, the innovation and the mask of seen outputs."""

    mean: Any
    own: Any
    true: Any
    gain: Any = None
    innovation: Any = None
    seen: Any = None


def init(prior: Prior, model: SampledModel) -> FangState:
    """The prior is the first prediction."""
    if prior.diffuse is not None:
        checks.refuse(
            'Fang\'s Algorithm 1 has no diffuse start: give `prior` a large covariance, or use method="auto", which has one.'
        )
    root = factor(prior.covariance)
    return FangState(jnp.asarray(prior.mean) - model.point.states, root, root)


def correct(state: FangState, model: SampledModel, layout: Layout, sample: Sample) -> tuple[FangState, Info]:
    """The input of this sample."""
    if state.gain is not None:
        raise ValueError("correct was called twice without predict: Fang's Algorithm 1 uses a sample only once.")
    c = model.point.outputs + apply(pick(model.D, layout.known), sample.u - pick(model.point.inputs, layout.known))
    corrected = kernel.correct(
        state.mean, state.own, state.true, model.C, pick(model.D, layout.unknown), c, model.V, sample.y, sample.seen
    )
    info = Info(
        mean=state.mean + model.point.states,
        covariance=gram(state.true),
        unknown_input=corrected.input + pick(model.point.inputs, layout.unknown),
        unknown_input_covariance=gram(corrected.Z_input),
        innovation=corrected.innovation,
        innovation_covariance=gram(jnp.concatenate([product(model.C, state.true), model.V], axis=1)),
        outcome=jnp.where(corrected.deficient, 3, outcome_code(False, state.mean, state.true, state.own)),
        extra={"own_covariance": gram(state.own)},
    )
    return replace(state, gain=corrected.H, innovation=jnp.nan_to_num(corrected.innovation), seen=sample.seen), info


def predict(state: FangState, model: SampledModel, layout: Layout, interval: Interval) -> FangState:
    """The state of the next sample."""
    refuse_unknown_input(interval)
    d, p = layout.d, model.C.shape[0]
    c = apply(pick(model.B, layout.known), interval.u - pick(model.point.inputs, layout.known))
    H, e, seen = state.gain, state.innovation, state.seen
    if H is None:
        H, e, seen = jnp.zeros((d, p)), jnp.zeros(p), jnp.zeros(p, bool)
    moved = kernel.predict(
        state.mean, state.own, state.true, H, e, seen,
        model.A, pick(model.B, layout.unknown), model.C, pick(model.D, layout.unknown), c, model.V, model.Ω, model.W,
    )  # fmt: skip
    return FangState(moved.m, moved.Z_hat, moved.Z)
