"""Runs and their arrays: their layout in memory, and the threads that run them."""

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import numpy as np

from ..annotations import Tree

DTYPES = {"double": float, "i64": int, "i8": bool, "i1": bool}


def sizes(shapes: Tree) -> np.ndarray:
    """Where each array ends among columns side by side."""
    return np.cumsum([math.prod(leaf.shape) for leaf in jax.tree_util.tree_leaves(shapes)])


def shaped(arrays: list, shapes: Tree) -> Any:
    """Arrays of flat entries, or of the words that hold them, in these shapes."""
    leaves, structure = jax.tree_util.tree_flatten(shapes)
    return jax.tree_util.tree_unflatten(structure, [
        _entries(array, leaf.dtype).reshape(*array.shape[:-1], *leaf.shape) for array, leaf in zip(arrays, leaves, strict=True)
    ])  # fmt: skip


def _entries(array: np.ndarray, dtype: np.dtype) -> np.ndarray:
    held = array.dtype == float and np.dtype(dtype).kind in "iu"
    return (np.ascontiguousarray(array).view(int) if held else array).astype(dtype, copy=False)


def words(leaves: list) -> list:
    """(leaf, axis) with integers as their 64 bits, as machine code stores them among floats."""
    return [(leaf.astype(int).view(float) if leaf.dtype.kind in "iu" else leaf, axis) for leaf, axis in leaves]


def on_all_processors(work: Callable[[int], Any], items: Sequence[int]) -> None:
    """Process each item once, in threads that include this one: machine code and copies release Python's lock."""
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
            other.result()  # raises the exception of a thread
