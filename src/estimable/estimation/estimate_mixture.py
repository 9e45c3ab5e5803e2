"""A mixture of algorithms, each run by itself: members that differ in numbers only share one program."""

from typing import Any

import jax
import numpy as np

from ..data.record import Record
from ..engines import choice
from ..filters.mixture import Mixture
from ..frozen import frozen
from ..models.prior import Prior
from ..results import Estimate, Info, Interval, Origin, Sample
from .binding import select
from .estimate import estimate
from .stateless import Stateless


@frozen
class Merging(Stateless):
    """The reports of the members, in `extra` of each sample with their probabilities and the log-likelihood, as one report."""

    mixture: Any

    def correct(self, state: tuple[()], sample: Sample) -> tuple[tuple[()], Info]:
        """The report of the mixture."""
        return state, self.mixture.merged(*sample.extra)


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
    seen = np.ones((len(steps), 1), bool)
    reports = Sample(None, seen, None, extra=(infos, probability, np.diff(total, prepend=0.0)))
    _, run = choice.scan("auto", Merging(mixture), None, reports, Interval(None, None), keep="all", select=select)
    info = jax.tree_util.tree_map(np.asarray, run.info)
    first, origin = runs[0], Origin(mixture, record, prior)
    return Estimate(info, first.t, float(total[-1]), first.outcome, first.engine, mixture.names, origin, first.gaps)
