"""The interface that the smoother requires of the filters of nonlinear models."""

from abc import abstractmethod
from typing import Any, Self

from ..kernels.smoothing import Instant
from ..protocols import Algorithm
from ..results import Info, Interval, Sample
from .belief import Belief
from .uncertain import refuse_smoothing


class Linearised(Algorithm[Belief]):
    """An algorithm of a nonlinear model, linear about each belief, which `smooth` runs backwards."""

    uncertainty: Any = None  # a `ModelUncertainty`

    @abstractmethod
    def instant_about(self, sample: Sample, interval: Interval, predicted: Belief, filtered: Belief) -> Instant:
        """A row of the model, linearised about the beliefs before and after its sample."""

    @abstractmethod
    def tell(self, state: Belief) -> Info:
        """What a belief says, in the user's units."""

    @property
    def for_smoothing(self) -> Self:
        """The algorithm in the form for the smoother. Raises `InputError` where it cannot be smoothed."""
        refuse_smoothing(self.uncertainty)
        return self
