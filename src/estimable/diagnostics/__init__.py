"""Is the estimate consistent with what it claims? Pure functions of arrays and results."""

from .changes import Change, changes
from .consistency import Consistency, nees, nis
from .diagnose import Diagnosis, diagnose
from .innovations import Correlations, cross_correlation, standardised, whiteness
from .nonlinearity import Nonlinearity, nonlinearity

__all__ = [
    "Change",
    "Consistency",
    "Correlations",
    "Diagnosis",
    "Nonlinearity",
    "changes",
    "cross_correlation",
    "diagnose",
    "nees",
    "nis",
    "nonlinearity",
    "standardised",
    "whiteness",
]
