"""Plants in closed loops with everything that a flight needs, to simulate by name with events: `fly`."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..filters.kalman_filter import Kalman
from ..models.actuator import Actuator
from ..models.controlled import ControlledPlant
from ..models.events import Event
from ..models.prior import Prior
from ..protocols import Algorithm, Controller, Link
from ..results import ClosedLoop
from ..simulation.close_loop import close_loop
from . import f16, f16_in_jsbsim
from .jsbsim_f16 import JsbsimF16

Q = np.diag([1e-3, 0.1])  # density of process noise that represents the error of a linear model of the F-16
ELEVATOR = Actuator(f16.ACTUATOR, limits=(-25.0, 25.0), rate=60.0)
NO_TURBULENCE = "none"


class World(NamedTuple):
    """A plant, its controller and estimator, the `reference` (T, r), the step `dt` [s], and the prior of the state."""

    plant: Any
    controller: Controller[Any]
    estimator: Algorithm[Any]
    reference: np.ndarray
    dt: float
    prior: Prior


def f16_world(events: Sequence[Event] = ()) -> World:
    """The short period of the F-16 under its fixed pitch-rate law, for 16.5 s: three doublets of ±10 deg/s. The elevator has
    limits of ±25 deg and a rate of 60 deg/s.
    """
    model = f16.short_period(Q=Q)
    t = np.arange(round(f16.SECONDS * f16.RATE) + 1) / f16.RATE
    plant = ControlledPlant(model, actuator=ELEVATOR, events=list(events))
    return World(plant, f16.law(), Kalman(model), f16.pitch_command(t)[:, None], 1 / f16.RATE, _exact(2))


def jsbsim_world(events: Sequence[Event] = (), about: str = "trim") -> World:
    """The F-16 of JSBSim under a fixed pitch-rate law, for 16.5 s: three doublets of ±2.5 deg/s."""
    aircraft = JsbsimF16(about=about, events=events)
    t = np.arange(round(f16.SECONDS * f16.RATE) + 1) / f16.RATE
    law, estimator = f16_in_jsbsim.law(aircraft.model), Kalman(f16_in_jsbsim.with_upset(aircraft.model))
    return World(aircraft, law, estimator, f16_in_jsbsim.doublets(t)[:, None], 1 / f16.RATE, _exact(3))


def _exact(n: int) -> Prior:
    return Prior(np.zeros(n), np.zeros((n, n)))


WORLDS: dict[str, Callable[..., World]] = {"f16": f16_world, "jsbsim": jsbsim_world}


def fly(
    name: str,
    *,
    seed: int,
    events: Sequence[Event] = (),
    turbulence: str = NO_TURBULENCE,
    input_link: Link | None = None,
    output_link: Link | None = None,
    **settings: str,
) -> ClosedLoop:
    """Simulate a plant of `WORLDS` in its closed loop, with `events`. `settings`: of the world.

    >>> from estimable import Stuck
    >>> fly("f16", seed=1, events=[Stuck(4.5, "elevator_deg")]).events
    (Stuck(time=4.5, input='elevator_deg', at=None),)
    """
    faults = checks.Faults()
    faults.choice("name", name, tuple(WORLDS))
    faults.choice("turbulence", turbulence, (NO_TURBULENCE,))
    faults.finish()
    world = WORLDS[name](events, **settings)
    return close_loop(
        world.plant, world.controller, world.estimator, reference=world.reference, seed=seed, prior=world.prior, dt=world.dt,
        input_link=input_link, output_link=output_link, lost="hold",
    )  # fmt: skip
