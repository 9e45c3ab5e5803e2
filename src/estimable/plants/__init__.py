"""Simulated aircraft for examples and tests: an F-16 as a linear model, and the same aircraft in the simulator JSBSim."""

from . import f16, f16_failure, f16_in_jsbsim, worlds
from .jsbsim_f16 import JsbsimF16

__all__ = ["JsbsimF16", "f16", "f16_failure", "f16_in_jsbsim", "worlds"]
