"""Tests whether an estimate agrees with its own covariance, error bounds, and the poles and responses of fitted models."""

from .changes import DetectedChange, changes
from .consistency import Consistency, nees, nis
from .cramer_rao import Efficiency, cramer_rao, efficiency, efficient_estimate, information
from .feedback import Feedback, feedback
from .gain_rows import gain_rows, sentence_of
from .innovation_tests import InnovationChecks, check_innovations
from .innovations import Correlations, cross_correlation, standardised, whiteness
from .nonlinearity import Nonlinearity, nonlinearity
from .responses import frequency_response, poles, simulation_sigma, spread_of, step_response, zeros

__all__ = [
    "Consistency",
    "Correlations",
    "DetectedChange",
    "Efficiency",
    "Feedback",
    "InnovationChecks",
    "Nonlinearity",
    "changes",
    "check_innovations",
    "cramer_rao",
    "cross_correlation",
    "efficiency",
    "efficient_estimate",
    "feedback",
    "frequency_response",
    "gain_rows",
    "information",
    "nees",
    "nis",
    "nonlinearity",
    "poles",
    "sentence_of",
    "simulation_sigma",
    "spread_of",
    "standardised",
    "step_response",
    "whiteness",
    "zeros",
]
