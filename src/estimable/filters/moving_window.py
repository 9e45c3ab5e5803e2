"""An algorithm that uses the last samples only."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array
from ..frozen import frozen, replace, static
from ..models.prior import Prior
from ..protocols import Wrapper
from ..results import Info, Interval, Sample
from . import wrapped
from .actuated import Actuated


@frozen
class Copies:
    """`length` copies of an algorithm's state, the newest first, and the initial state of the next copy."""

    copies: Any
    fresh: Any


@frozen
class MovingWindow(Wrapper[Copies]):
    """A wrapper around another algorithm, which estimates from the last `length` samples alone.

    Model: that of the algorithm. Row k is the result at k of a run that begins at row k - length + 1, from `state_prior` and
    the algorithm's own prior of gains. Before the first full window, the run begins at row 0 from the prior of the run.

    Assumes that the gain is constant over a window. A window forgets a jump completely after `length` samples. In return its
    noise is always that of so few samples. The prior of the state is diffuse by default. In the reference each window begins
    with the same wrong state, which causes a bias at a low signal-to-noise ratio. `ChangeDetection` reacts to a jump as fast,
    with less noise before it.

    Settings: `algorithm`, any; `length`, in samples; `state_prior`, a `Prior` of the state at the first sample of a full
    window (default None: exactly diffuse).

    Cost: `length` times that of the algorithm. In some cases it is about that of five filters for any length, over a record:
    for `Kalman` and `UnknownGain` of a constant model with at most three states and gains together, at most three outputs,
    uncorrelated noises and no forgetting.

    Reference: A. G. Sillence (1999) §5.4.

    >>> model = StateSpace([[1.0]], C=[[1.0]], Q=[[0.0]], R=[[1.0]], dt=1)
    >>> mean_of_two = MovingWindow(Kalman(model), 2)
    >>> result = estimate(mean_of_two, Record([1.0, 3.0, 7.0], dt=1), prior=Prior([0.0], [[1.0]]))
    >>> result.mean.ravel().round(9).tolist()
    [0.5, 2.0, 5.0]
    """

    algorithm: Any
    length: int = static()
    state_prior: Prior | None = None

    def __post_init__(self):
        faults = checks.Faults()
        wrapped.check_algorithm(self.algorithm, faults)
        faults.whole("length", self.length, 1)
        if self.state_prior is not None:
            faults.instance("state_prior", self.state_prior, Prior, " None means diffuse.")
        if isinstance(self.algorithm, Actuated):
            faults.add(
                "`algorithm` must not be Actuated: a window starts it again and again. Put Actuated around the MovingWindow."
            )
        faults.finish()
        self._check_sizes(faults)
        faults.finish()

    def _check_sizes(self, faults: checks.Faults) -> None:
        n, p, gains = (len(getattr(self.algorithm.names, kind)) for kind in ("states", "outputs", "gains"))
        if self.state_prior is not None:
            if self.state_prior.size != n:
                faults.add(f"`state_prior` must describe n = {n} states. Got {self.state_prior.size}.")
        elif self.length * p < n + gains:
            unknown = checks.counted(n, "state") + (f" and {checks.counted(gains, 'gain')}" if gains else "")
            faults.add(
                f"`length` must be at least {-(-(n + gains) // p)}: a window of {checks.counted(self.length, 'sample')} "
                f"holds {checks.counted(self.length * p, 'number')}, which cannot determine {unknown}. "
                "Give a longer window, or a `state_prior`."
            )

    def check_record(self, rows: int, faults: checks.Faults) -> None:
        """Check that the record is at least as long as a window."""
        self.algorithm.check_record(rows, faults)
        if rows < self.length:
            faults.add(f"the window has {self.length} samples, but the record only {rows}: no window is ever full.")

    def init(self, prior: Prior) -> Copies:
        """The states of the copies before y[0]: the one that will fill the first full window, and those before it."""
        fresh, first = map(self.algorithm.init, self.priors(prior))

        def side_by_side(new: Array, old: Array):
            return jnp.concatenate([new[None], jnp.broadcast_to(old, (self.length - 1, *jnp.shape(old)))])

        return Copies(jax.tree_util.tree_map(side_by_side, fresh, first), fresh)

    def priors(self, prior: Prior) -> tuple[Prior, Prior]:
        """The priors of a full window and of the run, with equally many diffuse directions; they may have a batch axis."""
        own = self.state_prior
        if own is None:
            nothing, ones = 0.0 * prior.covariance, (1,) * (prior.covariance.ndim - 2)
            own = replace(
                prior, covariance=nothing, diffuse=nothing + np.eye(prior.size).reshape(ones + (prior.size,) * 2)
            )
        columns = max(_columns(own), _columns(prior))
        return _with_columns(own, columns), _with_columns(prior, columns)

    def correct(self, state: Copies, sample: Sample) -> tuple[Copies, Info]:
        """Update every copy with one sample; the oldest reports."""
        copies, infos = jax.vmap(self.algorithm.correct, in_axes=(0, None))(state.copies, sample)
        return replace(state, copies=copies), jax.tree_util.tree_map(lambda leaf: leaf[-1], infos)

    def restarted(self, state: Copies, fresh: Callable[[Any], Any]) -> Copies:
        """Where the record breaks, x restarts in every copy but the newest, which begins there."""
        after = self.algorithm.restarted(state.copies, fresh)
        copies = jax.tree_util.tree_map(lambda new, old: jnp.concatenate([old[:1], new[1:]]), after, state.copies)
        return replace(state, copies=copies)

    def predict(self, state: Copies, interval: Interval) -> Copies:
        """Move to the next sample: a copy begins and the oldest ends."""
        moved = jax.vmap(self.algorithm.predict, in_axes=(0, None))(state.copies, interval)
        copies = jax.tree_util.tree_map(
            lambda new, old: jnp.concatenate([jnp.asarray(new)[None], old[:-1]]), state.fresh, moved
        )
        return replace(state, copies=copies)


def _columns(prior: Prior) -> int:
    """The number of diffuse directions."""
    return 0 if prior.diffuse is None else prior.diffuse.shape[-1]


def _with_columns(prior: Prior, columns: int) -> Prior:
    """The same prior with that many diffuse directions; the added ones have length zero, and so no effect."""
    missing = columns - _columns(prior)
    if missing == 0:
        return prior
    zeros = 0.0 * prior.covariance[..., :1] * np.ones((1,) * (prior.covariance.ndim - 1) + (missing,))
    return replace(prior, diffuse=zeros if prior.diffuse is None else jnp.concatenate([prior.diffuse, zeros], axis=-1))
