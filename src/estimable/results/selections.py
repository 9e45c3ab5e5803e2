"""Chosen sensors."""

from typing import Annotated, Any

import numpy as np

from ..frozen import frozen, static


@frozen
class SensorSelection:
    """The result of `sensor_selection`.

    - `sensors`: the names of the chosen sensors.
    - `names` (q,): the quantities. `sigma` (q,): theirs with the chosen sensors, `sigma_all` (q,) with every sensor.
    - `worst`: the largest sigma relative to its requirement (without requirements: to `sigma_all`); `worst_all`: with every
      sensor, which no choice can beat.
    - `exact`: whether no other set of that size is better; else the choice is greedy with exchanges.
    - `evaluations`: the number of sets tried.
    """

    sensors: tuple[str, ...] = static()
    names: Annotated[tuple[str, ...], "q"] = static()
    sigma: Annotated[Any, "q"]
    sigma_all: Annotated[Any, "q"]
    worst: float
    worst_all: float
    exact: bool = static()
    evaluations: int = static()

    @property
    def sentences(self) -> tuple[str, ...]:
        """The choice, and how far it is from every sensor."""
        proven = "no other set of this size is better" if self.exact else "another set may be better"
        values = ", ".join(
            f"{name} {σ:.3g}" for name, σ in zip(self.names, np.asarray(self.sigma, float).tolist(), strict=True)
        )
        return (
            f"Choose {' and '.join(self.sensors)}: {proven}.",
            f"Sigma: {values}. The largest, relative to what is wanted, is {self.worst:.3g}; with every sensor it is "
            f"{self.worst_all:.3g}.",
        )

    def __repr__(self) -> str:
        return f"SensorSelection({' '.join(self.sentences)})"
