"""The actuators of a plant in a simulator, moved piece by piece, with the events of a `ControlledPlant`."""

from typing import Any, NamedTuple

import numpy as np

from .. import forks
from ..annotations import Array
from ..kernels.actuator_motion import glide
from ..models.actuator import parts_of
from ..models.controlled import ControlledPlant
from ..models.events import PlantPhase
from ..models.plant_steps import FASTEST


class MovedPiece(NamedTuple):
    """The positions just after the beginning of a piece, and their mean over it, (m,)."""

    begin: np.ndarray
    mean: np.ndarray


class MovingActuators:
    """The actuators of `plant` during a run with samples `dt` seconds apart, exactly as in its linear loop.

    `position` (m,): as deviations, without the offsets of faults. All pieces of a run have the same length, in which delays are
    counted.
    """

    def __init__(self, plant: ControlledPlant, dt: float):
        self.plant, self.dt, self.samples = plant, dt, 0
        self.stages, self.commands = plant.stages(), []
        self.position = np.zeros(plant.model.m)
        self._place()

    @property
    def stage(self) -> PlantPhase:
        """The plant and its actuators after the events until now."""
        return self.stages[int(self.plant.phase_rows(np.array([self.samples * self.dt]))[0])]

    @property
    def acting(self) -> np.ndarray:
        """The positions with the offsets of faults."""
        return self.position + self.stage.offset

    def move(self, command: Array, seconds: float) -> MovedPiece:
        """Move for a piece of a sample under a command (m,)."""
        stage = self.stage
        movers = [
            own if drive is None else drive.actuator for own, drive in zip(stage.actuators, stage.drives, strict=True)
        ]
        b, rate, reach = (
            np.array([float(getattr(a, name)) for a in movers]) for name in ("bandwidth", "fastest", "reach")
        )
        self.commands.append(np.asarray(command, float))
        begin, total = None, np.zeros(len(b))
        for part in parts_of(np.array([own.delay for own in stage.actuators]), seconds):
            c = self._towards(stage, part.age)
            moved = _glided(self.position, c, b, np.minimum(rate, FASTEST), reach, part.seconds)
            first, self.position, integral = (np.asarray(one) for one in moved)
            begin, total = first if begin is None else begin, total + integral
        assert begin is not None
        return MovedPiece(begin, total / seconds)

    def end_sample(self) -> None:
        """Begin the next sample."""
        self.samples += 1
        self._place()

    def _towards(self, stage: PlantPhase, ages: np.ndarray) -> np.ndarray:
        """Where each actuator moves: its delayed command within its limits, or where a fault drives it."""
        towards = np.zeros(len(ages))
        for i, (own, drive, age) in enumerate(zip(stage.actuators, stage.drives, ages.astype(int), strict=True)):
            late = self.commands[-1 - age][i] if age < len(self.commands) else 0.0
            driven = None if drive is None else self.position[i] if drive.to is None else drive.to
            towards[i] = np.clip(late, *own.stops) if driven is None else driven
        return towards

    def _place(self) -> None:
        """Let faults that begin now move their actuators at once."""
        for i, drive in enumerate(self.stage.drives):
            if drive is not None and drive.place is not None:
                self.position = np.where(np.arange(len(self.position)) == i, drive.place, self.position)


@forks.jit
def _glided(p: Array, c: Array, b: Array, rate: Array, reach: Array, h: Array) -> tuple[Any, Any, Any]:
    """The positions just after the beginning, at the end, and their integral over h seconds."""
    return glide(p, c, b, rate, reach, 0.0 * h)[0], *glide(p, c, b, rate, reach, h)
