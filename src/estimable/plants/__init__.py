"""Plants to learn on and to test with."""

from . import f16, f16_failure

__all__ = ["f16", "f16_failure"]
