"""The question of a covariance analysis, and a remedy that it found."""

from typing import Annotated, Any, NamedTuple

from ..frozen import frozen, saved
from ..models.prior import Prior


@frozen
class CovarianceQuestion:
    """The arguments of `covariance_analysis`, from which a result answers another question about the same model."""

    model: Any
    prior: Prior
    horizon: float | None = None
    dt: float | None = None
    u: Any = None
    record: Any = None
    arrival: Any = None
    wanted: dict[str, Any] | None = None
    requirement: dict[str, Any] | None = None
    learnt: float = 0.01
    parameters: Prior | None = None
    draws: int = 0
    filter: Any = None


@saved
class Remedy(NamedTuple):
    """A change of the model, and what it does: the new sigma (q,) at the end and the new `time_to_requirement` (q,)."""

    change: str
    sigma: Annotated[Any, "q"]
    time_to_requirement: Annotated[Any, "q"]
