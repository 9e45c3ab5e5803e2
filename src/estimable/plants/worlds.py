"""Plants in closed loops with everything that a flight needs, to simulate by name with events."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..controllers.state_feedback import StateFeedback
from ..design.gains import lqr_gain
from ..filters.kalman_filter import Kalman
from ..frozen import replace
from ..models.actuator import Actuator
from ..models.controlled import ControlledPlant
from ..models.dryden import Dryden
from ..models.events import Event
from ..models.prior import Prior
from ..models.state_space import StateSpace
from ..models.turbulence import Turbulence
from ..protocols import Algorithm, Controller, Link, Plant
from ..results import ClosedLoop
from ..simulation.close_loop import close_loop
from . import f16, f16_in_jsbsim
from .jsbsim_f16 import JsbsimF16
from .multirotors import MAX_THRUST, TIME_CONSTANT, multirotor

Q = np.diag([1e-3, 0.1])  # density of process noise that represents the error of a linear model of the F-16
ELEVATOR = Actuator(f16.ACTUATOR, limits=(-25.0, 25.0), rate=60.0)
SEVERITIES = ("none", "light", "moderate", "severe")  # of turbulence
ALTITUDE, AIRSPEED = 6096.0, 275.0  # [m], [m/s]: the flight condition of the models


class World(NamedTuple):
    """A plant, its controller and estimator, the `reference` (T, r), the step `dt` [s], and the prior of the state."""

    plant: Any
    controller: Controller[Any]
    estimator: Algorithm[Any]
    reference: np.ndarray
    dt: float
    prior: Prior

    @property
    def model(self) -> StateSpace:
        """The linear model of the plant, with the states of the turbulence."""
        return (self.plant.linear if isinstance(self.plant, Plant) else self.plant).model

    def fly(self, *, seed: int, input_link: Link | None = None, output_link: Link | None = None) -> ClosedLoop:
        """Simulate the loop; the actuators hold what is lost."""
        return close_loop(
            self.plant, self.controller, self.estimator, reference=self.reference, seed=seed, prior=self.prior, dt=self.dt,
            lost="hold", input_link=input_link, output_link=output_link,
        )  # fmt: skip


def f16_world(events: Sequence[Event] = (), turbulence: str = "none") -> World:
    """The short period of the F-16 under its fixed pitch-rate law, for 16.5 s: three doublets of ±10 deg/s. The elevator has
    limits of ±25 deg and a rate of 60 deg/s.
    """
    model = f16.short_period(Q=Q)
    t = np.arange(round(f16.SECONDS * f16.RATE) + 1) / f16.RATE
    plant = ControlledPlant(model, actuator=ELEVATOR, events=list(events), turbulence=_air(turbulence))
    return World(plant, f16.law(), Kalman(model), f16.pitch_command(t)[:, None], 1 / f16.RATE, _exact(2))


def jsbsim_world(events: Sequence[Event] = (), turbulence: str = "none", about: str = "trim") -> World:
    """The F-16 of JSBSim under a fixed pitch-rate law, for 16.5 s: three doublets of ±2.5 deg/s."""
    aircraft = JsbsimF16(about=about, events=events, turbulence=_air(turbulence))
    t = np.arange(round(f16.SECONDS * f16.RATE) + 1) / f16.RATE
    law, estimator = f16_in_jsbsim.law(aircraft.model), Kalman(f16_in_jsbsim.with_upset(aircraft.model))
    return World(aircraft, law, estimator, f16_in_jsbsim.doublets(t)[:, None], 1 / f16.RATE, _exact(3))


def multirotor_world(events: Sequence[Event] = (), turbulence: str = "none") -> World:
    """A quadrotor under a linear-quadratic law of attitude and height, for 20 s: roll doublets of ±10 deg. Gusts are those of
    `multirotor` where `turbulence` is "moderate", half as strong where it is "light", and twice where it is "severe". The motors
    have a lag of .04 s and limits of 0 and 8.55 N. The estimator uses all sensors but the accelerometer.
    """
    model = multirotor(attitude=True)
    point: Any = model.operating_point
    gusts = (0.0, 0.5, 1.0, 2.0)[SEVERITIES.index(turbulence)]
    seen = [i for i, name in enumerate(model.outputs) if name != "specific_force_m_s2"]
    known = StateSpace(
        model.A, model.B, model.C[seen], G=model.G, Q=model.Q, R=model.R[np.ix_(seen, seen)], dt=0, states=model.states,
        inputs=model.inputs, outputs=[model.outputs[i] for i in seen], operating_point={"inputs": point.inputs},
    )  # fmt: skip
    F = lqr_gain(model, np.diag([1.0, 1, 1, 100, 100, 20, 5, 20, 0, 0, 0, 0]), 0.5 * np.eye(4)).feedback
    law = StateFeedback(F, reference_gain=F[:, [3, 4, 5, 7]], operating_point={"inputs": point.inputs})
    motor = Actuator(1 / TIME_CONSTANT, limits=(0.0, MAX_THRUST))
    plant = ControlledPlant(replace(model, Q=gusts**2 * model.Q), actuator=motor, events=list(events))
    t = np.arange(5000) * 0.004
    reference = np.zeros((len(t), 4))
    reference[:, 0] = np.radians(10.0) * np.sign(np.sin(2 * np.pi * t / 4)) * (t > 1)
    return World(plant, law, Kalman(known), reference, 0.004, _exact(model.n))


def _air(severity: str) -> Turbulence | None:
    """The turbulence of a severity, which enters alpha; the vane feels it."""
    if severity == "none":
        return None
    return Turbulence(Dryden.at(ALTITUDE, AIRSPEED, severity=severity), {"alpha": "alpha"}, angle="deg")


def _exact(n: int) -> Prior:
    return Prior(np.zeros(n), np.zeros((n, n)))


WORLDS: dict[str, Callable[..., World]] = {"f16": f16_world, "jsbsim": jsbsim_world, "multirotor": multirotor_world}


def world(name: str, events: Sequence[Event] = (), *, turbulence: str = "none", **settings: str) -> World:
    """A world of `WORLDS` by name, with `events` and `turbulence` ("none", "light", "moderate" or "severe").

    >>> from estimable import Stuck
    >>> world("f16", [Stuck(4.5, "elevator_deg")]).fly(seed=1).events
    (Stuck(time=4.5, input='elevator_deg', at=None),)
    """
    faults = checks.Faults()
    faults.choice("name", name, tuple(WORLDS))
    faults.choice("turbulence", turbulence, SEVERITIES)
    faults.finish()
    return WORLDS[name](events, turbulence, **settings)
