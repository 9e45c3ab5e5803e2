"""Common types: arrays, the values accepted for an array, and trees of arrays."""

from typing import Any, ClassVar, Protocol, TypeAlias

import jax
import numpy as np
from numpy.typing import ArrayLike

__all__ = ["AnyRecord", "Array", "ArrayLike", "Numbers", "Tree"]

Array: TypeAlias = jax.Array | np.ndarray
Numbers: TypeAlias = ArrayLike | jax.Array  # values that a user may pass for an array


class AnyRecord(Protocol):
    """A frozen record: a dataclass registered with JAX as a tree."""

    __dataclass_fields__: ClassVar[dict[str, Any]]


Tree: TypeAlias = Array | float | str | AnyRecord | tuple["Tree", ...] | list["Tree"] | dict[str, "Tree"] | None
