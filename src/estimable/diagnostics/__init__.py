"""Is the estimate consistent with what it claims? Pure functions of arrays and results."""

from .changes import Change, changes
from .consistency import Consistency, nees, nis
from .nonlinearity import Nonlinearity, nonlinearity

__all__ = ["Change", "Consistency", "Nonlinearity", "changes", "nees", "nis", "nonlinearity"]
