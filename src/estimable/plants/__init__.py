"""Plants to learn on and to test with."""

from . import f16

__all__ = ["f16"]
