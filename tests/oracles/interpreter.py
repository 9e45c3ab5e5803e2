"""A straight-line program run in Python, a scalar at a time."""

from typing import Any

import numpy as np

from estimable.engines.program.primitives import PYTHON, row
from estimable.engines.program.straight_line import Program


def interpret(program: Program, inputs: list[Any]) -> list[np.ndarray]:
    """The outputs of a program, by Python's own arithmetic."""
    flat = [np.asarray(array).ravel() for array in inputs]
    values: list[Any] = []
    for operation in program.operations:
        if operation.name == "input":
            place, i = operation.value
            values.append(PYTHON[operation.type](flat[place][i]))
        elif operation.name == "constant":
            values.append(operation.value)
        else:
            types = tuple(program.operations[a].type for a in operation.arguments)
            values.append(row(operation.name, types).fold(*(values[a] for a in operation.arguments)))
    return [np.array([values[n] for n in array.ravel()]).reshape(array.shape) for array in program.outputs]
