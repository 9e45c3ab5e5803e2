"""Estimation, identification and adaptive control when part of the loop is unknown."""

from . import precision as _precision  # noqa: F401  float64, before any array is made
from .data.reading import read_record
from .data.record import Record
from .filters.kalman import Kalman
from .filters.unknown_gain import UnknownGain
from .models.prior import Prior
from .models.state_space import StateSpace
from .run.estimate import estimate, log_likelihood
from .run.estimate_bank import estimate_bank
from .run.stack import stack
from .run.online import online
from .run.simulate import simulate, simulate_bank
