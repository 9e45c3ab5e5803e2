"""The part of a row that is computed again although nothing it depends on has changed since the previous row.

A covariance without missing data settles: the numbers carried from row to row become bitwise constant, and so does everything
that depends only on them and on unchanged choices. It is found on the scalars, without knowledge of covariances.
"""

from typing import Any, NamedTuple

from .straight_line import Program

WORTH = 64  # operations: fewer are computed as fast as compared


class SteadyPart(NamedTuple):
    """A part of a loop that is constant once its own state is.

    `carry`: its entries of the carry; `slow`: for each scalar, whether it depends only on those and on `choices`; `choices`: the
    bools that the rest computes in each row and the part depends on. `stays`: the bool that chooses for each entry between its
    old value and another, if one bool decides for all.
    """

    carry: frozenset[int]
    slow: tuple[bool, ...]
    choices: tuple[int, ...]
    stays: int | None = None


def same_in_every_row(loop: Any) -> list[bool]:
    """Whether each scalar is the same in every row."""
    moving = {*loop.carry, *(name for array in loop.row for name in array.names)}
    same: list[bool] = []
    for i, op in enumerate(loop.program.operations):
        same.append(i not in moving and all(same[a] for a in op.arguments))
    return same


def steady_part(loop: Any, same: list[bool]) -> SteadyPart | None:
    """The largest steady part; None where it would save nothing. `same`: the scalars that are the same in every row."""
    carry = set(range(len(loop.carry) - loop.counts))
    while True:
        slow = _slow(loop, same, carry)
        left = {i for i in carry if _closed(loop.program, slow, same, loop.next_carry[i])}
        if left == carry:
            break
        carry = left
    operations = loop.program.operations
    if not carry or sum(slow) < WORTH:
        return None
    needed = {a for i in range(len(operations)) if slow[i] for a in _depends_on(loop.program, slow, i)} | {
        loop.next_carry[i] for i in carry
    }
    choices = tuple(sorted(a for a in needed if not slow[a] and not same[a]))
    return SteadyPart(frozenset(carry), tuple(slow), choices, _stays(loop, carry))


def _stays(loop: Any, carry: set[int]) -> int | None:
    """The single condition under which every entry keeps its value."""
    nexts = [(loop.carry[i], loop.program.operations[loop.next_carry[i]]) for i in carry]
    chosen = all(op.name == "select" and op.arguments[1] == now for now, op in nexts)
    conditions = {op.arguments[0] for _, op in nexts} if chosen else set()
    return conditions.pop() if len(conditions) == 1 else None


def _slow(loop: Any, same: list[bool], carry: set[int]) -> list[bool]:
    """Whether each scalar depends only on these entries of the carry and on bools."""
    own = {loop.carry[i] for i in carry}
    slow: list[bool] = []
    for i, op in enumerate(loop.program.operations):
        inputs = op.name == "input"
        arguments = _depends_on(loop.program, slow, i)
        alone = bool(arguments) and all(_closed(loop.program, slow, same, a) for a in arguments)
        moves = any(slow[a] for a in arguments)
        slow.append(i in own or (not inputs and not same[i] and alone and (moves or not loop.program.is_bool(i))))
    return slow


def _depends_on(program: Program, slow: list[bool] | tuple[bool, ...], i: int) -> tuple[int, ...]:
    """The arguments of a scalar that must be constant for it to be constant.

    An entry of a row that is the same as before (`kernels/small.held`) is none: where it differs, the carry does too.
    """
    op = program.operations[i]
    if op.name != "select" or program.operations[op.arguments[0]].name != "settles":
        return op.arguments
    choice, before, entry = op.arguments
    return (choice, before) if slow[before] and program.operations[entry].name == "input" else op.arguments


def _closed(program: Program, slow: list[bool], same: list[bool], name: int) -> bool:
    return slow[name] or same[name] or program.is_bool(name)
