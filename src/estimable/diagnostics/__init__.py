"""Is the estimate consistent with what it claims? Pure functions of arrays and results."""

from .changes import Change, changes
from .check_innovations import Diagnosis, diagnose
from .consistency import Consistency, nees, nis
from .cramer_rao import Efficiency, cramer_rao, efficiency, efficient_estimate, information
from .innovations import Correlations, cross_correlation, standardised, whiteness
from .nonlinearity import Nonlinearity, nonlinearity
from .responses import frequency_response, poles, simulation_sigma, spread_of, step_response, zeros

__all__ = [
    "Change",
    "Consistency",
    "Correlations",
    "Diagnosis",
    "Efficiency",
    "Nonlinearity",
    "changes",
    "cramer_rao",
    "cross_correlation",
    "diagnose",
    "efficiency",
    "efficient_estimate",
    "frequency_response",
    "information",
    "nees",
    "nis",
    "nonlinearity",
    "poles",
    "simulation_sigma",
    "spread_of",
    "standardised",
    "step_response",
    "whiteness",
    "zeros",
]
