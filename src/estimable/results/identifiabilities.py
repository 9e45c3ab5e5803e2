"""Whether the structure of a model lets its outputs determine everything."""

from typing import Annotated, Any

import numpy as np

from ..frozen import frozen, static


@frozen
class StructuralIdentifiability:
    """The result of `structural_identifiability`: what noise-free outputs determine about the N states and parameters.

    - `identifiable`: whether every state and parameter is determined, locally.
    - `names` (N,): the states, then the parameters.
    - `identifiable_combinations`: the combinations that are determined: products and quotients, or sums. Empty where neither
      explains what is hidden.
    - `kind`: "all", "products", "sums", or "local" (`directions` then hold at the first point only).
    - `directions` (r, N): the hidden directions at the first random point.
    - `singular_values` (points, N): of the tangents with columns of norm 1, in descending order.
    - `one_branch`: whether every point took the same branches of max, where, abs: otherwise the answer is for a mixture.
    - `sentences`: the result as sentences.
    """

    identifiable: bool = static()
    names: Annotated[tuple[str, ...], "N"] = static()
    identifiable_combinations: tuple[str, ...] = static()
    kind: str = static()
    directions: Annotated[Any, "r N"]
    singular_values: Any
    one_branch: bool = static(default=True)

    @property
    def sentences(self) -> tuple[str, ...]:
        """What is determined, and what is not."""
        least = float(np.min(self.singular_values))
        if self.identifiable:
            found = [f"The outputs determine every state and parameter: the smallest singular value is {least:.2g}."]
        elif self.kind == "local":
            count = len(self.directions)
            found = [
                f"The outputs do not determine everything: {count} direction{'s are' if count > 1 else ' is'} hidden at every "
                "point, and neither products nor sums name what is left."
            ]
        else:
            alone = [one for one in self.identifiable_combinations if one in self.names]
            only = [one for one in self.identifiable_combinations if one not in self.names]
            hidden = [name for name in self.names if name not in alone]
            seen = f" They determine only {' and '.join(only)}." if only else ""
            found = [f"The outputs do not determine {' and '.join(hidden)} one by one.{seen}"]
        if not self.one_branch:
            found.append(
                "The points took different branches of max, where or abs, so the answer is for all of them together."
            )
        return tuple(found)

    def __repr__(self) -> str:
        return f"StructuralIdentifiability({' '.join(self.sentences)})"
