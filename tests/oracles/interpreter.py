"""A straight-line program run in Python, a scalar at a time."""

from typing import Any

import numpy as np

from estimable.engines.program.straight_line import SCALAR, Program


def interpret(program: Program, inputs: list[Any]) -> list[np.ndarray]:
    """The outputs of a program, by Python's own arithmetic."""
    flat = [np.asarray(array).ravel() for array in inputs]
    values: list[Any] = []
    for operation in program.operations:
        if operation.name in ("input", "truth_input"):
            place, i = operation.value
            entry = flat[place][i]
            values.append(bool(entry) if operation.name == "truth_input" else float(entry))
        elif operation.name == "constant":
            values.append(operation.value)
        else:
            values.append(SCALAR[operation.name](*(values[a] for a in operation.arguments)))
    return [np.array([values[n] for n in array.ravel()]).reshape(array.shape) for array in program.outputs]
