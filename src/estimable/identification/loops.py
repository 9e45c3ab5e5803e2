"""What feedback from the outputs to the inputs means for a fit."""

from collections.abc import Sequence

from ..data.record import Record
from ..diagnostics.feedback import LEVEL, feedback
from ..frozen import field_names, replace
from ..protocols import Method
from ..results import Check, Fit

INSTEAD = "use PredictionError or PredictorSubspace"


def with_feedback_check(fit: Fit, method: Method, records: Sequence[Record]) -> Fit:
    """The fit with a check of feedback, where feedback may harm the method and is seen.

    The check fails for a method that is biased in a loop, and for one that needs white noise where its residuals are not white.
    """
    if method.in_a_loop == "holds" or fit.validation is None or any(one.dt is None for one in records):
        return fit
    found = feedback(records, direct=_acts_at_once(method))
    if not found.closed:
        return (
            _added(fit, Check("feedback", True, found.p, LEVEL, f"Feedback: {found.sentence}"))
            if found.unclear
            else fit
        )
    coloured = any(check.name == "whiteness" and not check.passed for check in fit.validation.checks)
    passed = method.in_a_loop == "white" and not coloured
    means = (
        "this method holds in a loop because its residuals are white"
        if passed
        else f"this method is biased in a loop: {INSTEAD}"
        if method.in_a_loop == "biased"
        else f"this method holds in a loop only for white noise on the outputs: {INSTEAD}"
    )
    check = Check("feedback", passed, found.p, LEVEL, f"Feedback: {found.sentence.rstrip('.')}; {means}.")
    return _added(fit, check)


def _added(fit: Fit, check: Check) -> Fit:
    return replace(fit, validation=fit.validation._replace(checks=(*fit.validation.checks, check)))


def _acts_at_once(method: Method) -> bool | None:
    """Whether an input acts in its own row, as the settings of a method say; None where they leave it to the fit."""
    fields = field_names(type(method))
    if "delay" in fields:
        return method.delay == 0  # type: ignore[attr-defined]
    return None if "feedthrough" not in fields or method.feedthrough else False  # type: ignore[attr-defined]
