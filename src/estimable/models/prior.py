"""The belief before the first sample."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Numbers
from ..frozen import frozen, set_field


@frozen
class Prior:
    """A Gaussian belief about a state, a gain or a parameter. Some directions may be diffuse: nothing is known about them.

    - `mean` (n,) and `covariance` (n, n): in the units of the quantities. The covariance is positive semidefinite. It may be
      zero, for a known value.
    - `diffuse` (n, r): its columns span the diffuse directions. The prior variance along them is exactly infinite, not a
      large number. The finite `covariance` is added to it.

    Raises `InputError` if a shape is wrong, the covariance is not symmetric or is indefinite, or `diffuse` is rank deficient.

    >>> Prior([0.0, 1.0], [[1.0, 0.0], [0.0, 4.0]]).size
    2
    >>> Prior([0.0, 0.0], np.zeros((2, 2)), diffuse=[[1.0], [0.0]]).diffuse.shape
    (2, 1)
    """

    mean: Any
    covariance: Any
    diffuse: Any = None

    def __post_init__(self):
        faults = checks.Faults()
        mean = faults.array("mean", self.mean, "n")
        covariance = faults.covariance("covariance", self.covariance, "n n")
        if faults.sizes.get("n") == 0:
            faults.add("`mean` must have at least one entry.")
        diffuse = None if self.diffuse is None else faults.array("diffuse", self.diffuse, "n r")
        if diffuse is not None and diffuse.shape[1] == 0:
            diffuse = None
        if diffuse is not None and not checks.is_traced(diffuse):
            largest = np.abs(diffuse).max(axis=0)  # the scale of the columns does not matter
            rank = np.linalg.matrix_rank(diffuse / np.where(largest > 0, largest, 1.0))
            if rank < diffuse.shape[1]:
                columns = checks.counted(diffuse.shape[1], "column")
                faults.add(f"`diffuse` must have independent columns. Got {columns} of rank {rank}.")
        faults.finish()
        set_field(self, mean=mean, covariance=covariance, diffuse=diffuse)

    @property
    def size(self) -> int:
        """The number n of quantities."""
        return self.mean.shape[-1]

    def in_basis(self, T: Numbers) -> "Prior":
        """The same belief about the combinations T x, with T (k, n). Raises `InputError` for a T of another shape.

        >>> Prior([1.0], [[2.0]]).in_basis([[3.0]]).covariance
        array([[18.]])
        """
        faults = checks.Faults()
        faults.learn("n", self.size, f"`mean` has {checks.counted(self.size, 'entry')}")
        M = faults.array("T", T, "k n")
        faults.finish()
        diffuse = None if self.diffuse is None else M @ self.diffuse
        return Prior(M @ self.mean, M @ self.covariance @ M.T, diffuse=diffuse)


def diffuse_columns(prior: Prior):
    """The diffuse directions of a prior, (n, r), with r = 0 if there are none."""
    return jnp.zeros((prior.mean.shape[-1], 0)) if prior.diffuse is None else jnp.asarray(prior.diffuse)
