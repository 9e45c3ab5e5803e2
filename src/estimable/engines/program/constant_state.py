"""The entries of a state that keep their initial value, found without lowering the step again for each that does not.

All are assumed constant at first. An entry whose next value differs is not constant, and its dependents are evaluated again:
each scalar stops being a constant at most once.
"""

import heapq
from collections import defaultdict
from typing import Any

from .primitives import folded, row
from .simplification import simplify
from .straight_line import Program, ScalarOperation

VARIES = object()  # the value of a scalar that is not constant


def constant_entries(known: dict[tuple[int, int], Any], step: Program, fixed: int) -> dict[tuple[int, int], Any]:
    """The entries of `known`, (input array, entry), that `step` leaves unchanged.

    `step` was lowered with none of them known; its outputs begin with the next values of its inputs from array `fixed` on.
    """
    values = _Values(step, known)
    of = {place: int(step.outputs[place[0] - fixed].ravel()[place[1]]) for place in known}
    entries = defaultdict(list)
    for place, name in of.items():
        entries[name].append(place)
    lost = [place for place, name in of.items() if not _same(values.now[name], known[place])]
    left = dict(known)
    while lost:
        for place in lost:
            del left[place]
        changed = values.without(left, [int(step.inputs[array].ravel()[entry]) for array, entry in lost])
        lost = [place for name in changed for place in entries[name] if place in left]
    return left


class _Values:
    """The constant value of each scalar, or VARIES, given constant values of some inputs."""

    def __init__(self, step: Program, known: dict):
        self.step, self.users = step, defaultdict(list)
        self.now: list[Any] = []
        for name, operation in enumerate(step.operations):
            self.now.append(self.value(operation, known))
            for argument in operation.arguments:
                self.users[argument].append(name)

    def without(self, known: dict, inputs: list[int]) -> list[int]:
        """Evaluate `inputs` and their dependents again: the scalars whose value has changed, in order."""
        waiting, changed = [name for name in inputs if name >= 0], []
        heapq.heapify(waiting)
        while waiting:
            name = heapq.heappop(waiting)
            value = self.value(self.step.operations[name], known)
            if not _same(value, self.now[name]):
                self.now[name] = value
                changed.append(name)
                for user in self.users[name]:
                    heapq.heappush(waiting, user)
        return changed

    def value(self, operation: ScalarOperation, known: dict) -> Any:
        """The constant value of a scalar, or VARIES."""
        name, arguments = operation.name, operation.arguments
        if name == "constant":
            return operation.value
        if name == "input":
            return known.get(operation.value, VARIES)
        given = [self.now[argument] for argument in arguments]
        constants = [None if value is VARIES else value for value in given]
        if None not in constants:
            found = folded(row(name, tuple(self.step.operations[a].type for a in arguments)), constants)
            if found is not None:
                return found
        simpler = simplify(name, arguments, constants)
        return VARIES if simpler is None else self.now[simpler] if isinstance(simpler, int) else simpler[0]


def _same(a: Any, b: Any) -> bool:
    return type(a) is type(b) and repr(a) == repr(b)
