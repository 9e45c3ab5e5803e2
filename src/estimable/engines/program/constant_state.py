"""Which entries of a state stay what they are at the start, found without writing the step out again for each that does not.

All are taken as constants at first. Where the next value of one is something else, it is none, and what depends on it is
looked at again: each scalar stops being a constant at most once.
"""

import heapq
from collections import defaultdict
from typing import Any

from .straight_line import SCALAR, Operation, Program, simplify

VARIES = object()  # the value of what is no constant


def lasting(known: dict[tuple[int, int], Any], row: Program, fixed: int) -> dict[tuple[int, int], Any]:
    """Those of the entries `known`, (input array, entry), that `row` leaves as they are.

    `row` has been written out with none of them known; its outputs begin with the next values of its inputs from array
    `fixed` on.
    """
    values = _Values(row, known)
    of = {place: int(row.outputs[place[0] - fixed].ravel()[place[1]]) for place in known}
    entries = defaultdict(list)
    for place, name in of.items():
        entries[name].append(place)
    lost = [place for place, name in of.items() if not _same(values.now[name], known[place])]
    kept = dict(known)
    while lost:
        for place in lost:
            del kept[place]
        changed = values.without(kept, [int(row.inputs[array].ravel()[entry]) for array, entry in lost])
        lost = [place for name in changed for place in entries[name] if place in kept]
    return kept


class _Values:
    """The constant that each scalar is, or VARIES, where some inputs are constants."""

    def __init__(self, row: Program, known: dict):
        self.row, self.users = row, defaultdict(list)
        self.now: list[Any] = []
        for name, operation in enumerate(row.operations):
            self.now.append(_value(operation, self.now, known))
            for argument in operation.arguments:
                self.users[argument].append(name)

    def without(self, known: dict, inputs: list[int]) -> list[int]:
        """Look again at `inputs` and at what depends on them: the scalars whose value is another now, in order."""
        waiting, changed = [name for name in inputs if name >= 0], []
        heapq.heapify(waiting)
        while waiting:
            name = heapq.heappop(waiting)
            value = _value(self.row.operations[name], self.now, known)
            if not _same(value, self.now[name]):
                self.now[name] = value
                changed.append(name)
                for user in self.users[name]:
                    heapq.heappush(waiting, user)
        return changed


def _value(operation: Operation, values: list, known: dict) -> Any:
    """The constant that a scalar is, or VARIES."""
    name, arguments, value = operation
    if name == "constant":
        return value
    if name in ("input", "truth_input"):
        return known.get(value, VARIES)
    given = [values[argument] for argument in arguments]
    constants = [None if value is VARIES else value for value in given]
    if all(value is not None for value in constants):
        try:
            return SCALAR[name](*constants)
        except (OverflowError, ValueError):
            return VARIES
    simpler = simplify(name, arguments, constants)
    return VARIES if simpler is None else values[simpler] if isinstance(simpler, int) else simpler[0]


def _same(a: Any, b: Any) -> bool:
    return type(a) is type(b) and repr(a) == repr(b)
