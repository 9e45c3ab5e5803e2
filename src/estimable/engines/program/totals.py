"""The totals of a run, as scalars carried by its rows: the sum of the log-likelihoods, and the first failure.

The sum is Kahan's (Communications of the ACM 8 (1965) 40), so that its rounding does not grow with the rows.
"""

from typing import NamedTuple

from .primitives import FLOAT, INTEGER, UnsupportedError, row
from .straight_line import Program, ScalarOperation

COUNTS = 4  # scalars that `totalled` adds


class Totals(NamedTuple):
    """The sum, its compensation for rounding, the code of the first failure or 0, and the rows before it."""

    sum: int
    lost: int
    code: int
    before: int


def totalled(program: Program, log_likelihood: int, outcome: int) -> tuple[Program, Totals, Totals]:
    """The program with the totals, and their names before and after a row; they begin at 0. Raises `UnsupportedError`."""
    operations = list(program.operations)
    if [operations[name].type for name in (log_likelihood, outcome)] != [FLOAT, INTEGER]:
        raise UnsupportedError(
            "the algorithm reports a log-likelihood that is not a float, or an outcome that is not an integer"
        )

    def append(operation: ScalarOperation) -> int:
        operations.append(operation)
        return len(operations) - 1

    def add(name: str, *arguments: int) -> int:
        found = row(name, tuple(operations[a].type for a in arguments))
        return append(ScalarOperation(name, arguments, None, found.result))

    types = FLOAT, FLOAT, INTEGER, INTEGER
    now = Totals(*(append(ScalarOperation("input", (), ("total", i), type_)) for i, type_ in enumerate(types)))
    zero, none = append(ScalarOperation("constant", (), 0.0)), append(ScalarOperation("constant", (), 0, INTEGER))
    term = add("sub", log_likelihood, now.lost)
    total = add("add", now.sum, term)
    lost = add("sub", add("sub", total, now.sum), term)
    code = add("select", add("eq", now.code, none), outcome, now.code)
    before = add("add", now.before, add("to_integer", add("eq", code, none)))
    after = Totals(total, add("select", add("is_finite", total), lost, zero), code, before)
    return program._replace(operations=tuple(operations)), now, after
