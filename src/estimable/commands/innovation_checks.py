"""Whether the innovations of a result are what its covariances say."""

from typing import Any

from ..data.record import Record
from ..diagnostics.consistency import Consistency, nis
from ..diagnostics.innovation_tests import check_innovations
from ..errors import InputError
from ..results import Estimate

NOTHING = "no innovation to judge by: no output was seen with noise"


def innovation_check(result: Estimate) -> Consistency | None:
    """The normalised innovations squared of a result; None where there is nothing to judge by."""
    if result.innovation is None or result.innovation_covariance is None:
        return None
    try:
        return nis(result.innovation, result.innovation_covariance)
    except InputError:
        return None


def warning(check: Consistency | None) -> tuple[str, ...]:
    """What to say before any number, where the innovations are larger than the covariances allow."""
    if check is None or check.mean <= check.upper:
        return ()
    return (
        f"The model does not explain this record: its innovations are {check.mean / check.expected:.3g} times what the "
        "covariances allow, so neither are the numbers here what their sigmas say. Look at the units, the time, the order "
        "and signs of the columns, lost inputs; then at Q and R.",
    )


def described(check: Consistency | None) -> dict[str, Any] | None:
    """A check as JSON holds it."""
    return None if check is None else {**check._asdict(), "consistent": check.consistent, "sentence": check.sentence}


def sentence(check: Consistency | None) -> str:
    """A check in words."""
    return f"Innovation check (NIS): {NOTHING if check is None else check.sentence}."


def faults(result: Estimate, record: Record) -> tuple[str, ...]:
    """What else the innovations say against the model: that they are not white, or that an input is left in them."""
    try:
        found = check_innovations(result, record)
    except InputError:
        return ()
    checks = (*found.cross_correlation.values(), *found.whiteness.values())
    return tuple(check.sentence for check in checks if not check.passed)


def also(told: tuple[str, ...]) -> list[str]:
    """The faults in words, one a line."""
    return [f"{sentence[:1].upper()}{sentence[1:]}." for sentence in told]
