"""The records that a step takes and gives, and those that the drivers return."""

from .estimates import Estimate, EstimateBank, Forecast, Kept, Origin, Shown, SmoothedEstimate
from .fits import Check, Excitation, Fit, Simulation, Validation
from .steps import OUTCOMES, Info, Interval, Names, Outcome, Sample, outcome_code

__all__ = [
    "OUTCOMES",
    "Check",
    "Estimate",
    "EstimateBank",
    "Excitation",
    "Fit",
    "Forecast",
    "Info",
    "Interval",
    "Kept",
    "Names",
    "Origin",
    "Outcome",
    "Sample",
    "Shown",
    "Simulation",
    "SmoothedEstimate",
    "Validation",
    "outcome_code",
]
