"""Runs and their arrays: how they lie in memory, and who runs them."""

import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import numpy as np

DTYPES = {"double": float, "i64": int, "i8": bool, "i1": bool}


def sizes(shapes: Any) -> np.ndarray:
    """Where each array ends among columns side by side."""
    return np.cumsum([math.prod(leaf.shape) for leaf in jax.tree_util.tree_leaves(shapes)])


def shaped(arrays: list, shapes: Any) -> Any:
    """Arrays with flat entries as what has these shapes."""
    leaves, structure = jax.tree_util.tree_flatten(shapes)
    return jax.tree_util.tree_unflatten(structure, [
        array.reshape(*array.shape[:-1], *leaf.shape).astype(leaf.dtype, copy=False)
        for array, leaf in zip(arrays, leaves, strict=True)
    ])  # fmt: skip


def on_all_processors(work: Any, items: Sequence[int]) -> None:
    """Each item once, in threads: machine code and copies release Python's lock."""
    if len(items) == 1:
        work(items[0])
        return
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(work, items))  # raises what a thread raised
