"""A mixture of algorithms that differ in numbers only, run as a bank: one program in several lanes."""

import jax
import jax.numpy as jnp
import numpy as np

from .. import forks
from ..data.record import Record
from ..filters.mixture import Mixture
from ..models.prior import Prior
from ..results import Estimate, Info
from .estimate_bank import estimate_bank


def estimate_mixture(mixture: Mixture, record: Record, *, prior: Prior) -> Estimate:
    """The estimate of a mixture, from a bank of its members: as `estimate`, with the members compiled once.

    The weights follow from the members' log-likelihoods; the reports are merged row by row.
    """
    bank = estimate_bank(list(mixture.algorithms), record, prior=prior)
    infos = [_of(bank.info, i) for i in range(len(mixture.algorithms))]
    steps = np.stack([np.asarray(info.log_likelihood) for info in infos], axis=1)
    weights = np.log(np.maximum(mixture.probability, 1e-300)) + np.cumsum(steps, axis=0)
    total = np.logaddexp.reduce(weights, axis=1)
    unseen = np.stack(
        [np.zeros(len(steps)) if one.jump_probability is None else one.jump_probability for one in infos], 1
    )
    scores = weights - np.log(1 - unseen)
    probability = np.exp(scores - np.logaddexp.reduce(scores, axis=1, keepdims=True))
    merged = forks.jit(jax.vmap(mixture.merged))(
        infos, jnp.asarray(probability), jnp.asarray(np.diff(total, prepend=0.0))
    )
    info = jax.tree_util.tree_map(np.asarray, merged)
    failed = next((one for one in bank.outcomes if one.code), bank.outcomes[0])
    return Estimate(info, bank.t, float(total[-1]), failed, bank.engine, mixture.names)


def _of(info: Info, i: int) -> Info:
    """The report of one run of a bank."""
    return jax.tree_util.tree_map(lambda leaf: leaf[i], info)
