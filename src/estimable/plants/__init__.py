"""Plants for examples and tests."""

from . import f16, f16_failure, f16_in_jsbsim
from .jsbsim_f16 import JsbsimF16

__all__ = ["JsbsimF16", "f16", "f16_failure", "f16_in_jsbsim"]
