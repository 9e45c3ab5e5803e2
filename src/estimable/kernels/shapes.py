"""Arrays with their shapes: people and type checkers read `Float[Array, "T n"]`, and the tests check it at every call.

The tests load jaxtyping first. Elsewhere the shapes are not used, so that jaxtyping need not be installed or loaded.
"""

import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING or "jaxtyping" in sys.modules:
    from jaxtyping import Bool, Float, Inexact
else:

    class Float:
        """The array type; its shape is dropped."""

        def __class_getitem__(cls, described: tuple[Any, str]) -> Any:
            return described[0]

    Bool = Inexact = Float

__all__ = ["Bool", "Float", "Inexact"]
