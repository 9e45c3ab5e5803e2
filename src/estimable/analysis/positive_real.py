"""The condition under which the pseudo-linear recursion converges."""

import numpy as np

from .. import checks
from ..models.output_error import OutputError
from ..results import Check


def positive_real_margin(model: OutputError) -> np.ndarray:
    """The smallest value over all frequencies ω of Re(1/A(e^jω) - 1/2), for each output (p,).

    A is the denominator polynomial of an `OutputError` model. A positive margin means that 1/A - 1/2 is strictly positive
    real. Recursions of the pseudo-linear kind need this to converge. Because Re(1/A - 1/2) = (1 - |A - 1|²) / (2 |A|²), the
    condition is |A(e^jω) - 1| < 1.

    Reference: H. Fang (2009), (A4).

    >>> round(float(positive_real_margin(OutputError([0.523, 0.349], [1.0], noise_variance=0.1, dt=1))[0]), 3)
    0.034
    """
    checks.require(model=(model, OutputError))
    ω = np.linspace(0.0, np.pi, 8193)
    lags = np.exp(-1j * np.outer(ω, np.arange(1, model.na + 1)))
    tail = lags @ np.asarray(model.a).T  # A - 1, one column an output
    size = np.abs(1 + tail) ** 2  # zero at a pole on the unit circle, where |A - 1| = 1
    return np.min((1 - np.abs(tail) ** 2) / (2 * np.where(size > 0, size, 1.0)), axis=0, initial=0.5)


def positive_real_check(model: OutputError, *, needed: bool) -> Check:
    """Check that 1/A - 1/2 is positive real; `needed`: whether the method relies on it."""
    margin = float(np.min(positive_real_margin(model)))
    holds = f"Positive realness: the smallest Re(1/A - 1/2) is {margin:.3g}"
    if margin > 0:
        return Check("positive-real", True, margin, 0.0, f"{holds}: recursions of the pseudo-linear kind converge too.")
    if not needed:
        reason = "a recursion of the pseudo-linear kind need not converge here, but this method is of another kind"
        return Check("positive-real", True, margin, 0.0, f"{holds}: {reason}.")
    advice = (
        'it is not positive, so that method="printed" need not converge. Use method="refined", whose gradient is that of the '
        "model, or OutputErrorML."
    )
    return Check("positive-real", False, margin, 0.0, f"{holds}: {advice}")
