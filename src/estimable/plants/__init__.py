"""Simulated plants for examples and tests: aircraft, multirotors, tanks, a motor, a pendulum, a car, and JSBSim's F-16."""

from . import f16, f16_failure, f16_in_jsbsim, multirotors, tanks, worlds
from .dc_motor import dc_motor
from .f16_lateral import f16_lateral
from .jsbsim_f16 import JsbsimF16
from .multirotors import multirotor
from .nonlinear_plant import NonlinearPlant
from .pendulum import pendulum
from .quarter_car import quarter_car
from .tanks import two_tanks

__all__ = [
    "JsbsimF16",
    "NonlinearPlant",
    "dc_motor",
    "f16",
    "f16_failure",
    "f16_in_jsbsim",
    "f16_lateral",
    "multirotor",
    "multirotors",
    "pendulum",
    "quarter_car",
    "tanks",
    "two_tanks",
    "worlds",
]
