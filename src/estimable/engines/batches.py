"""Runs and their arrays: how they lie in memory, and who runs them."""

import math
import os
from collections.abc import Callable, Sequence
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


def on_all_processors(work: Callable[[int], Any], items: Sequence[int]) -> None:
    """Each item once, in threads, of which this is one: machine code and copies release Python's lock."""
    left = iter(items)

    def take() -> None:
        for item in left:
            work(item)

    others = min(len(items), os.cpu_count() or 1) - 1
    if others < 1:
        take()
        return
    with ThreadPoolExecutor(others) as pool:
        taken = [pool.submit(take) for _ in range(others)]
        take()
        for other in taken:
            other.result()  # raises what a thread raised
