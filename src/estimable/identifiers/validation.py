"""Comparison of a fitted model with the records it was fitted to."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from ..analysis.excitation import excitation_check
from ..analysis.positive_real import positive_real_check
from ..data.record import Record
from ..diagnostics import chi_squared
from ..diagnostics.cramer_rao import information, noise_of
from ..models.output_error import OutputError
from ..results import Check, Validation
from .residuals import residual_checks

ROUNDING = 1e-9  # of the size of the outputs
PROBABILITY = 0.999  # of the band in which the residuals' variance lies under a right noise variance


class Searched(Protocol):
    """The end of a search."""

    @property
    def converged(self) -> bool:
        """Whether it reached a maximum."""
        ...


def validated(
    model: OutputError,
    records: Sequence[Record],
    noise_variance: np.ndarray | float | None = None,
    residuals: Sequence[np.ndarray] | None = None,
    information: np.ndarray | None = None,
    pseudo_linear: bool = False,
    directions: np.ndarray | None = None,
    stability: Sequence[Check] = (),
) -> Validation:
    """The residuals, the fit and the assumptions of a model.

    `noise_variance` (p,): the assumed one, if any. `residuals`: of a model that did not start from rest. `information`
    (d, d) about the parameters in all records; None: computed from rest. `pseudo_linear`: whether the method needs
    1/A - 1/2 positive real. `directions` (d, r): the undetermined ones, and `stability`: of poles at their bounds, where the
    method knows them.
    """
    if residuals is None:
        residuals = tuple(record.y - model.response(record.applied()) for record in records)
    if information is None:
        information = information_of(model, records)
    checks = [
        excitation_check(information, model.parameter_names, directions),
        *(stability or [stability_check(model)]),
        positive_real_check(model, needed=pseudo_linear),
    ]
    weighed = any(record.sigma is not None for record in records)
    standardised = [
        e / np.sqrt(noise_of(model.noise_variance, record)) if weighed else e
        for e, record in zip(residuals, records, strict=True)
    ]
    if weighed:
        checks.append(noise_check(standardised, 1.0))
    elif noise_variance is not None:
        checks.append(noise_check(residuals, noise_variance))
    if _beyond_rounding(residuals, records):
        checks += residual_checks(standardised, records, direct=model.delay == 0)
    return Validation(tuple(residuals), fit_percent(residuals, records), tuple(checks))


def _beyond_rounding(residuals: Sequence[np.ndarray], records: Sequence[Record]) -> bool:
    """Whether the residuals exceed rounding."""
    e, y = np.concatenate(residuals), np.concatenate([record.y for record in records])
    return bool(np.nansum(e**2) > (ROUNDING * np.sqrt(np.nansum(y**2))) ** 2)


def information_of(model: OutputError, records: Sequence[Record]) -> np.ndarray:
    """The information about the parameters in all records, from rest."""
    return np.sum([information(model, record) for record in records], axis=0)


def fit_percent(residuals: Sequence[np.ndarray], records: Sequence[Record]) -> np.ndarray:
    """100 (1 - |y - model| / |y - mean|) of each output, over the seen samples; NaN where there are none."""
    e, y = np.concatenate(residuals), np.concatenate([record.y for record in records])
    fit = np.full(y.shape[1], np.nan)
    for i in range(y.shape[1]):
        seen = ~np.isnan(y[:, i])
        spread = np.linalg.norm(y[seen, i] - y[seen, i].mean()) if seen.any() else 0.0
        fit[i] = 100 * (1 - np.linalg.norm(e[seen, i]) / spread) if spread > 0 else np.nan
    return fit


def stability_check(model: OutputError) -> Check:
    """Check that the fitted poles lie inside the unit circle."""
    largest = max((float(np.abs(poles).max()) for poles in model.poles if len(poles)), default=0.0)
    found = f"Stability: the largest pole of the fit has modulus {largest:.4g}"
    if largest < 1:
        return Check("stability", True, largest, 1.0, f"{found}.")
    return Check(
        "stability",
        False,
        largest,
        1.0,
        f"{found}: an output-error model must be stable. Are input and output swapped?",
    )


class Pole(NamedTuple):
    """A pole at its bound: where the search would leave it, its standard deviation, and where it is fixed."""

    value: complex
    sigma: float
    fixed: float


def pole_checks(poles: Sequence[Pole | None], outputs: Sequence[str]) -> list[Check]:
    """What became of the poles at their bounds: an integrator passes, a model that would be unstable fails."""
    return [_pole_check(pole, name) for pole, name in zip(poles, outputs, strict=True) if pole is not None]


def _pole_check(pole: Pole, name: str) -> Check:
    if pole.fixed == 1:
        sentence = (
            f"Stability: {name} integrates: its largest pole is {pole.value.real:.6g} ± {pole.sigma:.2g}, and was fixed at 1. "
            "Its level is its initial state."
        )
        return Check("stability", True, pole.value.real, 1.0, sentence)
    shown = f"{pole.value.real:.6g}" if not pole.value.imag else f"{abs(pole.value):.6g} in modulus"
    sentence = (
        f"Stability: a pole of {name} is at its bound {pole.fixed:g}: the best one is {shown}, and an output-error model must be "
        'stable. Check the orders, the level (level="trend") and the inputs, or use PredictionError.'
    )
    return Check("stability", False, abs(pole.value), pole.fixed, sentence)


def sigma_check(Σ: np.ndarray, white: np.ndarray, names: Sequence[str]) -> Check:
    """The factor between the standard deviations of the parameters and those for white residuals; it never fails."""
    known = np.diagonal(white) > 0
    ratio = np.sqrt(np.where(known, np.diagonal(Σ), 1.0) / np.where(known, np.diagonal(white), 1.0))
    i = int(np.argmax(np.abs(np.log(np.maximum(ratio, 1e-12))))) if len(ratio) else 0
    factor = float(ratio[i]) if len(ratio) else 1.0
    found = "Sigma: the standard deviations follow from the spectrum of the residuals"
    said = (
        "which are white"
        if np.allclose(ratio, 1.0)
        else f"and are {factor:.2g} times those for white residuals ({names[i]})"
    )
    return Check("sigma", True, factor, np.inf, f"{found}, {said}.")


def search_checks(ends: Sequence[Searched]) -> list[Check]:
    """A failed check where the search of some output has not reached a maximum; none otherwise."""
    missed = sum(not end.converged for end in ends)
    found = (
        "Search: the search stopped before the best parameters. Do not use the parameters or their sigma: lower the orders, or "
        "check the record."
    )
    return [Check("search", False, float(missed), 0.0, found)] if missed else []


def noise_check(residuals: Sequence[np.ndarray], noise_variance: np.ndarray | float | None) -> Check:
    """Check that the residuals are as large as the assumed noise."""
    e = np.concatenate(residuals) / np.sqrt(np.asarray(noise_variance))
    degrees = int(np.sum(~np.isnan(e)))
    if degrees == 0:
        return Check("noise", False, 0.0, 1.0, "Noise: no output was seen, so its noise cannot be judged.")
    ratio = float(np.nansum(e**2) / degrees)
    lower, upper = chi_squared.quantile([(1 - PROBABILITY) / 2, (1 + PROBABILITY) / 2], degrees) / degrees
    found = f"Noise: the residuals' variance is {ratio:.3g} times the assumed one ({lower:.2f} to {upper:.2f} expected)"
    if lower <= ratio <= upper:
        return Check("noise", True, ratio, float(upper), f"{found}.")
    reason = (
        "the orders or the assumed variance are too low. The covariance of the parameters is too small"
        if ratio > upper
        else "the assumed variance is too large"
    )
    return Check("noise", False, ratio, float(upper), f"{found}: {reason}.")


def noise_of_innovations(standardised: Sequence[np.ndarray]) -> Check:
    """Check that the innovations are as large as predicted: the mean of their squares is 1 if Q and R are right."""
    e = np.concatenate(standardised)
    degrees = int(np.sum(~np.isnan(e)))
    if degrees == 0:
        return Check("noise", False, 0.0, 1.0, "Noise: no output was seen, so its noise cannot be judged.")
    ratio = float(np.nansum(e**2) / degrees)
    lower, upper = chi_squared.quantile([(1 - PROBABILITY) / 2, (1 + PROBABILITY) / 2], degrees) / degrees
    found = f"Noise: the innovations' variance is {ratio:.3g} times the filter's ({lower:.2f} to {upper:.2f} expected)"
    advice = "" if lower <= ratio <= upper else ": Q or R is too small" if ratio > upper else ": Q or R is too large"
    return Check("noise", lower <= ratio <= upper, ratio, float(upper), f"{found}{advice}.")
