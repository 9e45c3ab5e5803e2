"""Results: the records that a step takes and returns, and those that the functions return.

A user reads these records and seldom constructs one. Each is loaded on first use, like the names of `estimable`.
"""

from ..lazy import lazy

_HOMES = {
    "ArrivalCovariance": "results.margins",
    "BatchGain": "results.estimates",
    "Check": "results.fits",
    "ClosedLoop": "results.simulations",
    "ClosedLoopBank": "results.simulations",
    "Comparison": "results.comparisons",
    "CovarianceAnalysis": "analysis.covariance_analysis",
    "CovarianceQuestion": "results.covariance_analyses",
    "DeadTime": "results.order_selection",
    "Delivery": "networks.delivery",
    "DetectableLoss": "results.detectable",
    "Direction": "results.trusts",
    "DisturbanceAccommodation": "results.designs",
    "Divided": "results.comparisons",
    "Estimability": "results.verdicts",
    "Estimate": "results.estimates",
    "EstimateBank": "results.estimates",
    "Excitation": "results.information",
    "FeedbackGain": "results.stationary_gains",
    "Fit": "results.fits",
    "Forecast": "results.estimates",
    "GainAssessment": "results.detectable",
    "GainInformation": "results.information",
    "Gap": "results.steps",
    "Info": "results.steps",
    "Interval": "results.steps",
    "KalmanGain": "results.stationary_gains",
    "LossTolerance": "results.margins",
    "ModelFile": "models.files",
    "MonteCarlo": "results.simulations",
    "Names": "results.steps",
    "NoiseFit": "results.fits",
    "OUTCOMES": "results.steps",
    "Observability": "results.verdicts",
    "Online": "estimation.online",
    "Optimum": "results.designs",
    "OrderCandidate": "results.order_selection",
    "OrderRanking": "results.order_selection",
    "OrderSelection": "results.order_selection",
    "Origin": "results.estimates",
    "Outcome": "results.steps",
    "Outputs": "results.steps",
    "Perturbed": "results.margins",
    "Ranked": "results.comparisons",
    "Reachability": "results.verdicts",
    "Reduction": "results.verdicts",
    "Regulability": "results.verdicts",
    "Remedy": "results.covariance_analyses",
    "RhoMargin": "results.margins",
    "RhoSynthesis": "results.designs",
    "Sample": "results.steps",
    "Score": "results.information",
    "Simulation": "results.simulations",
    "SmoothedEstimate": "results.estimates",
    "StabilityRadius": "results.margins",
    "Stacked": "results.stacked",
    "Suspect": "results.trusts",
    "TrackerChoices": "results.stationary_gains",
    "TransKalman": "results.designs",
    "Trust": "results.trusts",
    "UnknownInputExistence": "results.verdicts",
    "Untestable": "results.trusts",
    "Validation": "results.fits",
    "outcome_code": "results.steps",
}
__all__ = list(_HOMES)  # pyright: ignore[reportUnsupportedDunderAll]
__getattr__ = lazy(__name__, _HOMES)


def __dir__() -> list[str]:
    return list(__all__)
