"""Is the estimate consistent with what it claims? Pure functions of arrays and results."""

from .consistency import Consistency, nees, nis

__all__ = ["Consistency", "nees", "nis"]
