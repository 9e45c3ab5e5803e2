"""The point about which a model is linear."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from .. import checks
from ..frozen import frozen


@frozen
class OperatingPoint:
    """States (n,), inputs (m,) and outputs (p,) about which a model is linear, in the user's absolute units."""

    states: Any
    inputs: Any
    outputs: Any

    @staticmethod
    def of(given: Any, C: np.ndarray, D: np.ndarray, faults: checks.Faults) -> "OperatingPoint | None":
        """Read what the user gave: a mapping or an `OperatingPoint`; outputs not given are C states + D inputs."""
        if given is None:
            return None
        if isinstance(given, Mapping):
            unknown = sorted(set(given) - {"states", "inputs", "outputs"})
            if unknown:
                faults.add(f"`operating_point` has states, inputs and outputs. Got {checks.listed(unknown)}.")
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
        states = faults.array("operating_point states", parts.get("states", np.zeros(n)), "n")
        inputs = faults.array("operating_point inputs", parts.get("inputs", np.zeros(m)), "m")
        if states is None or inputs is None:
            return None
        outputs = parts.get("outputs")
        if outputs is None and C.ndim + D.ndim > 4:
            faults.add("`operating_point` must give outputs where C or D varies in time.")
            return None
        outputs = C @ states + D @ inputs if outputs is None else faults.array("operating_point outputs", outputs, "p")
        return None if outputs is None else OperatingPoint(states, inputs, outputs)
