"""Whether a saved run can be resumed: its state must fit its algorithm."""

from typing import Any

import jax
import numpy as np

from .. import checks
from ..annotations import Tree
from ..models.sampled import Clock
from ..results import Interval, Sample
from .binding import model_of
from .following import nominal


def check_state(progress: Any) -> None:
    """Raise an error for a state in which a step fails, or whose shape it changes; only shapes are computed."""
    names, held = progress.algorithm.names, np.zeros(len(progress.algorithm.names.inputs))
    try:
        after, info = jax.eval_shape(lambda state: _cycle(progress, state, held), progress.state)
        fits = _shapes(after) == _shapes((progress.state, progress.held)) and info.mean.shape == (len(names.states),)
    except Exception:  # a step may fail anywhere in a state of another algorithm
        fits = False
    if not fits:
        checks.refuse(
            "`state` does not fit `algorithm`: a step fails, changes its shape, or gives a mean of another size."
        )


def _cycle(progress: Any, state: Tree, u: np.ndarray) -> Any:
    """The state one sample later, with the held input, and the report of that sample."""
    model = model_of(progress.algorithm)
    dt, y = float(progress.dt or model.dt or 1.0), np.zeros(model.p)
    algorithm = nominal(progress.algorithm).sampled(Clock.every(dt, progress.hold)).at(0)
    interval = Interval(u, u, None, np.asarray(dt))
    if progress.corrected:
        state = algorithm.predict(state, interval)
    fates = np.full(u.shape, np.nan) if progress.algorithm.takes_unknown_arrivals else None
    state, info = algorithm.correct(state, Sample(y, y == y, u, fates))
    return (state if progress.corrected else algorithm.predict(state, interval), u), info


def _shapes(tree: Tree) -> Any:
    leaves, structure = jax.tree_util.tree_flatten(tree)
    return structure, [np.shape(leaf) for leaf in leaves]
