"""Several algorithms side by side, weighted by how well they predict the record."""

from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY
from typing import Any, Self

import jax
import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array, Tree
from ..frozen import frozen, replace, set_field, static
from ..kernels import bank_moments
from ..models.prior import Prior
from ..models.sampled import Clock
from ..protocols import Algorithm
from ..results import Info, Interval, Names, Sample
from . import wrapped

WALKS, SHARES = (0.0, 3e-4, 3e-3), (0.7, 0.2, 0.1)  # of a gain that may drift: variances per second, and their priors
LARGE = 300  # numbers of a member from which a loop over the members compiles faster than each by itself
OF_THE_FIRST = ("statistic", "alarm", "onset", "onset_sigma", "jump", "jumped", "gain_diffuse_covariance")


@frozen
class Members:
    """The states of the members, and the logarithms of their weights (K,)."""

    states: Any
    log_weight: Any


@frozen
class Mixture(Algorithm[Members]):
    """A bank of algorithms, each with its own belief, weighted by their likelihoods of the record so far.

    Model: exactly one of the K algorithms is right, the k-th with the prior `probability` π_k. Its weight after a sample is
    proportional to π_k times its likelihood of the record so far. The reported mean and covariance are those of the mixture of
    the beliefs. So are the quantiles of the gains.

    Assumes that one of the algorithms is nearly right. Between two of them, as for a time constant between two values, the
    interval remains nearly right if they are not far apart. If all are wrong, the least wrong takes the whole weight, and its
    covariance is too small: `diagnostics.check_innovations` shows that.

    The algorithms have the same inputs, outputs and gains, by name. The reported states are those that all of them have; further
    states may only be those of `markov_disturbance`, whose prior the model has. The prior describes the common states.

    A `ChangeDetection` contributes its likelihood with jumps: at an alarm, the likelihood ratio of the alarm over
    `seconds_between_changes`; between alarms, also that of jumps that are not yet decided. Alarms and onsets in `extra` are
    those of the first algorithm.

    Settings: `algorithms`: a sequence of algorithms; `probability` (K,): their prior probabilities (default None: equal).

    Reports in `extra`: `probability` (K,), the weights.

    Cost: the sum of those of its members. Members of one kind, with models of one size, are compiled once.

    Reference: D. T. Magill, IEEE Trans. Automatic Control 10 (1965) 434-439.

    >>> model = StateSpace([[0.5]], [[1.0]], Q=[[0.0]], R=[[0.01]], dt=1)
    >>> walks = [UnknownGain(model, Prior([1.0], [[0.1]]), walk=walk) for walk in (0.0, 0.1)]
    >>> record = Record([0.0, 1.0, 1.5, 1.75, 1.4, 1.2], np.ones(6), dt=1)
    >>> result = estimate(Mixture(walks, probability=[0.9, 0.1]), record, prior=Prior([0.0], [[0.0]]))
    >>> bool(result.extra["probability"][-1, 1] > 0.9)  # the gain drops
    True
    """

    algorithms: Any
    _: KW_ONLY
    probability: Any = None
    columns: tuple[tuple[int, ...], ...] = static(default=(), init=False)

    def __post_init__(self):
        faults = checks.Faults()
        algorithms = self._read_algorithms(faults)
        faults.finish()
        K = len(algorithms)
        given = np.full(K, 1 / K) if self.probability is None else self.probability
        faults.learn("algorithms", K, f"there are {checks.counted(K, 'algorithm')}")
        probability = faults.array("probability", given, "algorithms")
        _check_probability(probability, faults)
        faults.finish()
        set_field(self, algorithms=algorithms, probability=probability, columns=_columns(algorithms))

    def _read_algorithms(self, faults: checks.Faults) -> tuple[Any, ...]:
        if not isinstance(self.algorithms, list | tuple) or not self.algorithms:
            faults.add(
                "`algorithms` must be a list of algorithms, such as [UnknownGain(..), UnknownGain(..)]. "
                f"Got {checks.short(self.algorithms)}."
            )
            return ()
        algorithms = tuple(self.algorithms)
        for algorithm in algorithms:
            wrapped.check_algorithm(algorithm, faults)
        if not faults.sentences:
            self._check_names(algorithms, faults)
        return algorithms

    def _check_names(self, algorithms: tuple[Any, ...], faults: checks.Faults) -> None:
        first, *rest = (algorithm.names for algorithm in algorithms)
        common = _common(algorithms)
        for i, names in enumerate(rest, start=2):
            for kind in ("inputs", "outputs", "gains", "unknown_inputs"):
                ours, theirs = (checks.listed(getattr(one, kind)) or "none" for one in (first, names))
                if getattr(first, kind) != getattr(names, kind):
                    kinds = kind.replace("_", " ")
                    faults.add(
                        f"`algorithms` must have the same {kinds}: the first has {ours}, algorithm {i} has {theirs}."
                    )
        for i, algorithm in enumerate(algorithms, start=1):
            extra = set(algorithm.names.states) - set(common) - set(wrapped.disturbances(algorithm))
            if extra:
                faults.add(
                    f"`algorithms` must have the same states, apart from those of markov_disturbance. Only algorithm {i} has "
                    f"{checks.listed(sorted(extra))}."
                )

    @property
    def names(self) -> Names:
        """Names of the columns of the first algorithm, with the states that all have."""
        return self.algorithms[0].names._replace(states=_common(self.algorithms))

    @property
    def innermost(self) -> Algorithm[Any]:
        """The algorithm with the fewest states, inside its wrappers."""
        return min(self.algorithms, key=lambda algorithm: len(algorithm.names.states)).innermost

    @property
    def has_state_prior(self) -> bool:
        """Whether the algorithms need a `prior`."""
        return self.algorithms[0].has_state_prior

    @property
    def has_innovation_covariance(self) -> bool:
        """Whether all report the covariance of their innovations."""
        return all(algorithm.has_innovation_covariance for algorithm in self.algorithms)

    def check_record(self, rows: int, faults: checks.Faults) -> None:
        """Report a fault if a record is too short for one of the algorithms."""
        for algorithm in self.algorithms:
            algorithm.check_record(rows, faults)

    def sampled(self, clock: Clock) -> Self:
        """The same mixture of sampled algorithms."""
        return replace(self, algorithms=tuple(algorithm.sampled(clock) for algorithm in self.algorithms))

    def at(self, k: int | Array) -> Self:
        """The mixture at row k of time-varying models."""
        return replace(self, algorithms=tuple(algorithm.at(k) for algorithm in self.algorithms))

    def init(self, prior: Prior | None) -> Members:
        """The beliefs before y[0], and the prior weights."""
        states = self._each(lambda algorithm: algorithm.init(prior))
        return Members(states, jnp.log(jnp.maximum(self.probability, 1e-300)))

    def correct(self, state: Members, sample: Sample) -> tuple[Members, Info]:
        """Update each member with one sample, and merge their reports."""
        after = self._each(lambda algorithm, one: algorithm.correct(one, sample), state.states)
        states = tuple(one for one, _ in after)
        infos = [info for _, info in after]
        log_likelihood = jnp.stack([jnp.asarray(info.log_likelihood, float) for info in infos])
        largest = jnp.max(log_likelihood)
        w = jax.nn.softmax(state.log_weight)
        total = largest + jnp.log(1 + jnp.sum(w * (jnp.exp(log_likelihood - largest) - 1)))
        log_weight = state.log_weight + log_likelihood - total
        unseen = [_unseen(info) for info in infos]
        probability = jax.nn.softmax(log_weight - jnp.log(1 - jnp.stack(unseen)))
        return Members(states, log_weight), self.merged(infos, probability, total)

    def merged(self, infos: list[Info], probability: Array, log_likelihood: Array) -> Info:
        """The moments of the mixture of the reports, and its quantiles."""
        shared = [
            replace(info, mean=_rows(info.mean, at), covariance=_block(info.covariance, at))
            for info, at in zip(infos, self.columns, strict=True)
        ]
        first = infos[0]
        extra = {name: value for name, value in (first.extra or {}).items() if name in OF_THE_FIRST}
        found = {}
        for mean, covariance in (("mean", "covariance"), ("gain", "gain_covariance"), ("innovation", "innovation_covariance"),
                                 ("unknown_input", "unknown_input_covariance")):  # fmt: skip
            if all(getattr(info, mean) is not None and getattr(info, covariance) is not None for info in shared):
                m, P = (jnp.stack([getattr(info, name) for info in shared]) for name in (mean, covariance))
                found[mean], found[covariance] = bank_moments.merged(probability, m, P)
        if "gain" in found:
            x = jnp.stack([_quantiles_of(info) for info in shared])
            merged = bank_moments.merged_quantiles(probability, x)
            found["gain_quantiles"] = jnp.where(jnp.any(jnp.isnan(x), axis=(0, 2))[:, None], jnp.nan, merged)
            found["jump_probability"] = jnp.sum(probability * jnp.stack([_unseen(info) for info in infos]))
        if first.diffuse_covariance is not None:
            found["diffuse_covariance"] = _block(first.diffuse_covariance, self.columns[0])
        outcome = jnp.max(jnp.stack([jnp.asarray(info.outcome) for info in infos]))
        return Info(
            **found, log_likelihood=log_likelihood, outcome=outcome, extra={**extra, "probability": probability}
        )

    def predict(self, state: Members, interval: Interval) -> Members:
        """Move each member to the next sample."""
        return replace(state, states=self._each(lambda algorithm, one: algorithm.predict(one, interval), state.states))

    def _each(self, step: Callable[..., Any], *states: tuple[Any, ...]) -> tuple[Any, ...]:
        """A step of each member: in a loop, which is compiled once, where the members differ in numbers only."""
        parts = list(zip(self.algorithms, *states, strict=True))
        if len(parts) == 1 or _size(parts[0]) < LARGE or not _alike(parts):
            return tuple(step(*part) for part in parts)
        together = jax.tree_util.tree_map(lambda *leaves: jnp.stack(leaves), *parts)
        after = jax.lax.map(lambda part: step(*part), together)
        return tuple(jax.tree_util.tree_map(lambda leaf, i=i: leaf[i], after) for i in range(len(parts)))


def _check_probability(probability: np.ndarray | None, faults: checks.Faults) -> None:
    if probability is None or checks.is_traced(probability):
        return
    if np.any(probability < 0) or abs(probability.sum() - 1) > 1e-9:
        faults.add(
            f"`probability` must be at least 0 and sum to 1. Got {checks.short(probability.tolist())}, whose sum is "
            f"{probability.sum():g}."
        )


def _size(part: Tree) -> int:
    """The number of numbers in a tree."""
    return sum(np.size(leaf) for leaf in jax.tree_util.tree_leaves(part))


def _alike(parts: Sequence[Tree]) -> bool:
    """Whether these trees differ in numbers only."""
    kinds = {(jax.tree_util.tree_structure(part), *map(np.shape, jax.tree_util.tree_leaves(part))) for part in parts}
    return len(kinds) == 1


def _common(algorithms: tuple[Any, ...]) -> tuple[str, ...]:
    """The states that all have, in the order of the first."""
    return tuple(name for name in algorithms[0].names.states if all(name in one.names.states for one in algorithms))


def _columns(algorithms: tuple[Any, ...]) -> tuple[tuple[int, ...], ...]:
    """The common states among those of each algorithm."""
    common = _common(algorithms)
    return tuple(tuple(one.names.states.index(name) for name in common) for one in algorithms)


def _rows(M: Array, at: Sequence[int]) -> Array:
    """Some rows, by slices: machine code has no gather."""
    return jnp.stack([M[i] for i in at])


def _block(M: Array, at: Sequence[int]) -> Array:
    """Some rows and the same columns."""
    return _rows(_rows(M, at).T, at).T


def _unseen(info: Info) -> Array:
    """The probability of a jump that has raised no alarm."""
    return jnp.zeros(()) if info.jump_probability is None else info.jump_probability


def _quantiles_of(info: Info) -> Array:
    """The quantiles of the gains; those of a Gaussian where the algorithm reports none, NaN for an undetermined gain."""
    if info.gain_quantiles is not None:
        return info.gain_quantiles
    found = bank_moments.gaussian_quantiles(info.gain, info.gain_covariance)
    undetermined = (info.extra or {}).get("gain_diffuse_covariance")
    if undetermined is None:
        return found
    unknown = jnp.sum(undetermined**2, axis=1) > 0
    return jnp.where(unknown[:, None], jnp.nan, found)
