"""Derivatives of the numbers of an algorithm by a complex step: f(x + i ε dx) = f(x) + i ε df, without a difference.

Sampling a model is products, quotients and roots, which NumPy computes of complex matrices too, and ε² vanishes in rounding: the
derivative is exact to rounding.

Reference: W. Squire, G. Trapp, SIAM Review 40 (1998) 110-112.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import jax
import numpy as np

from ..annotations import Tree

Some = TypeVar("Some")  # a tree of numbers
STEP = 1e-60  # ε: its square is nothing next to any number that is not


def along_each(function: Callable[[np.ndarray], Some], θ: np.ndarray) -> Some:
    """The trees `function(θ + i ε e_j)` of all unit vectors e_j, stacked: derivatives are in their imaginary parts."""
    trees = [function(θ + 1j * STEP * unit) for unit in np.eye(len(θ))]
    return jax.tree_util.tree_map(lambda *leaves: np.stack(leaves), *trees)


def value_of(tree: Tree) -> Any:
    """The values of complex numbers, and all other numbers as they are."""
    return jax.tree_util.tree_map(lambda leaf: leaf.real.copy() if np.iscomplexobj(leaf) else leaf, tree)


def slope_of(tree: Tree) -> Any:
    """The derivatives: zero for floats that are not complex; other entries as they are."""
    return jax.tree_util.tree_map(_slope, tree)


def _slope(leaf: Any) -> Any:
    leaf = np.asarray(leaf)
    if np.iscomplexobj(leaf):
        return leaf.imag / STEP
    return np.zeros_like(leaf) if leaf.dtype.kind == "f" else leaf
