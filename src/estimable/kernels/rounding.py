"""Thresholds of rounding that the filters share, and the sizes they refer to.

A sum is known to about 1e-16 of the size of its terms. A result far below that size carries no information, and is taken
as zero: a variance that is exactly zero, a direction that is exactly known. Sizes have no derivative: nothing is a function of
them but a choice.
"""

import jax.numpy as jnp
from jax.lax import stop_gradient

from .shapes import Float
from .small import Real, apply

KNOWN = 1e-26         # a variance this far below the square of its terms, or of the datum, is zero
DETERMINED = 1e-20    # so is the variance of a datum along diffuse directions, this far below its terms (10 digits)
SNAPPED = 1e-13       # and a difference this far below its terms
CONTRADICTION = 1e-9  # a datum may miss a value that is known exactly by this much of its size
MEMORY = 0.9          # decay of the size of a state in a step: its rounding remains when the state crosses zero


def terms(C: Float[Real, "p n"], Z: Float[Real, "n k"]) -> Float[Real, " p"]:
    """The sum over j, k of (C_ij Z_jk)²: the square of row i of C Z if its terms were orthogonal."""
    return apply(C * C, jnp.sum(Z * Z, axis=1))


def magnitude(
    y: Float[Real, " p"], C: Float[Real, "p n"], d: Float[Real, " p"], size: Float[Real, " n"]
) -> Float[Real, " p"]:
    """The size of a datum and of the terms of its prediction C x + d, for an x whose terms have this `size`."""
    return stop_gradient(jnp.abs(y) + jnp.abs(d) + apply(jnp.abs(C), size))


def next_size(
    F: Float[Real, "n n"], m: Float[Real, " n"], c: Float[Real, " n"], size: Float[Real, " n"]
) -> Float[Real, " n"]:
    """The size of the terms of F m + c, for an m whose terms have this `size`."""
    return stop_gradient(jnp.maximum(apply(jnp.abs(F), jnp.abs(m)) + jnp.abs(c), MEMORY * size))


def is_rounding(difference: Real, size: Real) -> Real:
    """Whether a difference of terms of this size is their rounding."""
    return jnp.abs(difference) <= SNAPPED * size
