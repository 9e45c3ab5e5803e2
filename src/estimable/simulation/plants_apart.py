"""Banks of loops whose plants differ, such as in their events: those of one form run side by side, as one compiled step."""

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from ..annotations import Tree
from ..engines import choice, xla
from ..engines.step import Select
from ..models.prior import Prior
from .loop import ControlLoop, LoopInputs, intervals_of


def scan_bank(
    engine: str, each: Sequence[tuple[ControlLoop, LoopInputs]], prior: Prior | None, step: float, *, select: Select
) -> tuple[str, xla.Run]:
    """`choice.scan_bank` for loops that differ in their plants and their rows, each with the rows of one run."""
    groups: dict[Any, list[int]] = defaultdict(list)
    for i, one in enumerate(each):
        groups[_form(one)].append(i)
    order, used, runs = [i for group in groups.values() for i in group], engine, []
    for group in groups.values():
        loops = jax.tree_util.tree_map(lambda *leaves: np.stack(leaves), *(each[i][0] for i in group))
        rows = jax.tree_util.tree_map(lambda *leaves: np.concatenate(leaves), *(each[i][1] for i in group))
        used, run = choice.scan_bank(
            engine, loops, prior, rows, intervals_of(rows, step), axes=(0, 0, None), keep="all", select=select
        )
        runs.append(run._replace(log_likelihood=None, state=None))
    back = np.argsort(order)
    return used, jax.tree_util.tree_map(lambda *leaves: np.concatenate(leaves)[back], *runs)


def _form(one: Tree) -> Any:
    """What a compiled step depends on: the structure and the shapes."""
    leaves, structure = jax.tree_util.tree_flatten(one)
    return structure, tuple(np.shape(leaf) for leaf in leaves)
