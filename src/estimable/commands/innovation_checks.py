"""Whether the innovations of a result are consistent with its covariances."""

from typing import Any

from ..data.record import Record
from ..diagnostics.consistency import Consistency, nis
from ..diagnostics.innovation_tests import check_innovations
from ..errors import InputError
from ..results import Estimate

NOTHING = "no innovation to judge: no output with measurement noise was seen"


def innovation_check(result: Estimate) -> Consistency | None:
    """The normalised innovations squared of a result; None if it has no innovation to judge."""
    if result.innovation is None or result.innovation_covariance is None:
        return None
    try:
        return nis(result.innovation, result.innovation_covariance)
    except InputError:
        return None


def warning(check: Consistency | None) -> tuple[str, ...]:
    """The warning to print before any number if the innovations are larger than the covariances allow."""
    if check is None or check.mean <= check.upper:
        return ()
    return (
        f"The model does not explain this record: its innovations are {check.mean / check.expected:.3g} times what the "
        "covariances allow, so the sigmas of the numbers here are too small as well. Check the units, the time, the order "
        "and signs of the columns, and lost inputs; then Q and R.",
    )


def described(check: Consistency | None) -> dict[str, Any] | None:
    """A check, as JSON."""
    return None if check is None else {**check._asdict(), "consistent": check.consistent, "sentence": check.sentence}


def sentence(check: Consistency | None) -> str:
    """A check, as a sentence."""
    return f"Innovation check (NIS): {NOTHING if check is None else check.sentence}."


def faults(result: Estimate, record: Record) -> tuple[str, ...]:
    """Further faults of the model that the innovations show: they are not white, or are correlated with an input."""
    try:
        found = check_innovations(result, record)
    except InputError:
        return ()
    checks = (*found.cross_correlation.values(), *found.whiteness.values())
    return tuple(check.sentence for check in checks if not check.passed)


def also(faults: tuple[str, ...]) -> list[str]:
    """The faults as sentences, one on each line."""
    return [f"{fault[:1].upper()}{fault[1:]}." for fault in faults]
