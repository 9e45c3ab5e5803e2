"""Arrays by their shapes: `Float[Array, "T n"]` is read by people and type checkers, and checked at every call in the tests.

The tests load jaxtyping first. Elsewhere nothing looks at the shapes, so that jaxtyping need not be there, or be loaded.
"""

import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING or "jaxtyping" in sys.modules:
    from jaxtyping import Bool, Float
else:

    class Float:
        """Of an array and its shape, the array."""

        def __class_getitem__(cls, described: tuple[Any, str]) -> Any:
            return described[0]

    Bool = Float

__all__ = ["Bool", "Float"]
