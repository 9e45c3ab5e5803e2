"""The point about which a model is linear."""

from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np

from .. import checks
from ..frozen import frozen

PARTS = ("states", "inputs", "outputs")


@frozen
class OperatingPoint:
    """The point about which a model is linear: `states` (n,), `inputs` (m,) and `outputs` (p,), in the user's absolute units."""

    states: Annotated[Any, "n"]
    inputs: Annotated[Any, "m"]
    outputs: Annotated[Any, "p"]

    @staticmethod
    def of(given: Any, C: np.ndarray, D: np.ndarray, faults: checks.Faults) -> "OperatingPoint | None":
        """The operating point from a mapping or an `OperatingPoint`. By default states and inputs are zero, and outputs C
        states + D inputs.
        """
        if given is None:
            return None
        if isinstance(given, Mapping):
            unknown = [key for key in given if key not in PARTS]
            if unknown:
                near = checks.suggestion(unknown[0], PARTS)
                faults.add(
                    f"`operating_point` may have the keys states, inputs and outputs. Got {checks.listed(unknown)}.{near}"
                )
            parts = given
        elif isinstance(given, OperatingPoint):
            parts = {"states": given.states, "inputs": given.inputs, "outputs": given.outputs}
        else:
            faults.add(
                "`operating_point` must be a mapping {'states': ..., 'inputs': ..., 'outputs': ...}. "
                f"Got {checks.short(given)}."
            )
            return None
        n, m = C.shape[-1], D.shape[-1]
        states, inputs, outputs = (parts.get(part) for part in PARTS)
        states = faults.array("operating_point states", np.zeros(n) if states is None else states, "n")
        inputs = faults.array("operating_point inputs", np.zeros(m) if inputs is None else inputs, "m")
        if states is None or inputs is None:
            return None
        if outputs is None and C.ndim + D.ndim > 4:
            faults.add("`operating_point` must give outputs if C or D varies in time.")
            return None
        outputs = C @ states + D @ inputs if outputs is None else faults.array("operating_point outputs", outputs, "p")
        return None if outputs is None else OperatingPoint(states, inputs, outputs)
