"""A mixture of algorithms, each run by itself: members that differ in numbers only share one program."""

import jax
import jax.numpy as jnp
import numpy as np

from .. import forks
from ..data.record import Record
from ..filters.mixture import Mixture
from ..models.prior import Prior
from ..results import Estimate, Origin
from .estimate import estimate


def estimate_mixture(mixture: Mixture, record: Record, *, prior: Prior) -> Estimate:
    """The estimate of a mixture from those of its members: as `estimate`, without compiling all members as one step.

    The weights follow from the members' log-likelihoods; the reports are merged row by row.
    """
    runs = [estimate(member, record, prior=prior) for member in mixture.algorithms]
    infos = [run.info for run in runs]
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
    first, origin = runs[0], Origin(mixture, record, prior)
    return Estimate(info, first.t, float(total[-1]), first.outcome, first.engine, mixture.names, origin, first.gaps)
