"""Is the estimate consistent with what it claims? Pure functions of arrays and results."""

from .changes import Change, changes
from .consistency import Consistency, nees, nis

__all__ = ["Change", "Consistency", "changes", "nees", "nis"]
