"""What a run comes to, as scalars that its rows carry: the sum of the log-likelihoods, and the first failure.

The sum is Kahan's (Communications of the ACM 8 (1965) 40), so that its rounding does not grow with the rows.
"""

from typing import Any, NamedTuple

from .straight_line import Operation, Program

COUNTS = 4  # numbers that `totalled` adds


class Totals(NamedTuple):
    """The sum, what it has lost to rounding, the code of the first failure or 0, and the rows before it."""

    sum: int
    lost: int
    code: int
    before: int


def totalled(program: Program, log_likelihood: int, outcome: int) -> tuple[Program, Totals, Totals]:
    """The program with the totals, and their names before and after a row; they begin at 0."""
    operations = list(program.operations)

    def add(name: str, *arguments: int, value: Any = None) -> int:
        operations.append(Operation(name, arguments, value))
        return len(operations) - 1

    def number(name: int) -> int:
        return add("number", name) if program.is_truth(name) else name

    now = Totals(*(add("input", value=("total", i)) for i in range(COUNTS)))
    zero = add("constant", value=0.0)
    term = add("sub", number(log_likelihood), now.lost)
    total = add("add", now.sum, term)
    lost = add("sub", add("sub", total, now.sum), term)
    code = add("select", add("eq", now.code, zero), number(outcome), now.code)
    before = add("add", now.before, add("number", add("eq", code, zero)))
    after = Totals(total, add("select", add("is_finite", total), lost, zero), code, before)
    return program._replace(operations=tuple(operations)), now, after
