"""The nonlinear F-16 of the flight simulator JSBSim, with an elevator that loses part of its effect.

JSBSim and its aircraft come with the extra `flight`. The aircraft is copied to a temporary folder and changed there: the
effective elevator becomes r + K (δ - r), with K the remaining effect and r the deflection about which the effect is lost.
"""

import contextlib
import os
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .. import checks
from ..annotations import Array, Numbers
from ..models.actuator import Actuator
from ..models.controlled import ControlledPlant
from ..models.disturbances import Gust, Upset
from ..models.event_rows import acts, value_of
from ..models.events import Change, Event, Failure
from ..models.state_space import StateSpace
from ..models.turbulence import Turbulence
from ..protocols import Plant
from . import f16
from .moving_actuators import MovingActuators

AIRCRAFT, ELEVATOR = "f16", "estimable/elevator-rad"
FULL = np.degrees(0.436)  # [deg]: the elevator at a command of -1 or 1
MOST = (-FULL, 0.44 * FULL)  # [deg], within which commands are followed
STEPS_A_SECOND = 200  # at least, in the simulator
NUDGE = 0.05  # [deg], [deg/s]: the steps of the linearisation
COLUMN = '<independentVar lookup="column">{}</independentVar>'
PLACE = '<summer name="fcs/dht-left-pos-rad">'  # the first element that reads the elevator position
HEAD = '<flight_control name="F-16 FC">'
SEEN_BY_THE_AIR = f"""<fcs_function name="estimable/effective"><function><sum>
 <property>estimable/about-rad</property> <property>estimable/nudge-rad</property>
 <product><property>estimable/effect</property>
  <difference><property>fcs/elevator-pos-rad</property><property>estimable/about-rad</property></difference></product>
</sum></function><output>{ELEVATOR}</output></fcs_function>
"""
PITCH = '<axis name="PITCH">'
UPSET = """
 <function name="estimable/upset"><sum><property>estimable/upset-lbsft</property><value>0</value></sum></function>
"""
PROPERTIES = {
    "estimable/effect": 1.0,
    "estimable/upset-lbsft": 0.0,
    "estimable/about-rad": 0.0,
    "estimable/nudge-rad": 0.0,
    ELEVATOR: 0.0,
}


class JsbsimF16(Plant):
    """The F-16 of the flight simulator JSBSim in trimmed, level flight, with six degrees of freedom, as a plant for
    `close_loop`.

    The states are alpha [deg] and the pitch rate [deg/s], and the input is the elevator [deg]. All are deviations from the
    trim. The elevator follows its command by 20 / (s + 20), without the flight control computer of the aircraft. `model` is
    the linear model at the trim, and `linear` that model with its actuator.

    At `failure_time` [s] the effect of the elevator drops from 1 to `gain_after`. `about="trim"`: the effect of its
    deflection from the trim drops. `about="zero"`: the effect of its whole deflection drops, so that the failure also changes
    the trim; the positions of events are then whole deflections, else deviations from the trim.

    The air is still, or `turbulence` moves it: a `Turbulence` that enters alpha only, {"alpha": "alpha"} in degrees. Its states
    follow those of the aircraft, and the gust is linear between samples.

    `events`: as in `ControlledPlant`: `Failure`, `Stuck`, `Floating`, `HardOver`, `Offset`, `ActuatorChange`, `SensorFault`, a
    `Gust` of alpha [deg], which the vane feels, and an `Upset` of the pitch rate [deg/s²].

    Settings: `mach`, `altitude_ft`; `sigma_alpha`, `sigma_q`: the standard deviations of the sensors; `Q` (2, 2): a density
    of process noise that represents the error of the linear model (default 1e-3, .1: measured on this aircraft).

    Needs the extra `flight`. The numbers change slightly with the version of JSBSim.
    """

    def __init__(
        self,
        gain_after: float = 1.0,
        *,
        failure_time: float = 4.5,
        about: str = "trim",
        mach: float = 0.9,
        altitude_ft: float = 20_000.0,
        sigma_alpha: float = f16.SIGMA_ALPHA,
        sigma_q: float = f16.SIGMA_Q,
        Q: Numbers | None = None,
        events: Sequence[Event] = (),
        turbulence: Turbulence | None = None,
    ):
        faults = checks.Faults()
        self.gain_after = faults.number("gain_after", gain_after)
        self.failure_time = faults.number("failure_time", failure_time, lower=0.0, unit="seconds")
        self.mach = faults.number("mach", mach, above=0.0)
        self.altitude_ft = faults.number("altitude_ft", altitude_ft, lower=0.0, unit="feet")
        faults.choice("about", about, ("trim", "zero"))
        _check_turbulence(turbulence, faults)
        sigma_alpha = faults.number("sigma_alpha", sigma_alpha, lower=0.0)
        sigma_q = faults.number("sigma_q", sigma_q, lower=0.0)
        faults.finish()
        self.about = about
        simulator = _Simulator(self.mach, self.altitude_ft)
        self.trim = simulator.trim
        A, B = simulator.linearised()
        R = np.diag([sigma_alpha**2, sigma_q**2])
        Q = np.diag([1e-3, 0.1]) if Q is None else Q
        names = {"states": f16.STATES, "inputs": f16.INPUTS, "outputs": f16.OUTPUTS}
        self.model = StateSpace(A, B, Q=Q, R=R, dt=0, **names)
        about_deg = self.trim["elevator_deg"] if about == "zero" else 0.0
        limits = np.array(MOST) - (self.trim["elevator_deg"] - about_deg)
        actuator = Actuator(f16.ACTUATOR, limits=limits, operating_point=about_deg)
        dropped = [Failure(self.failure_time, self.gain_after)] if self.gain_after != 1.0 else []
        self.linear = ControlledPlant(self.model, actuator=actuator, events=[*dropped, *events], turbulence=turbulence)
        self.turbulence = turbulence
        _check_events(self.linear.events, self.model)

    def __repr__(self) -> str:
        return f"JsbsimF16(gain_after={self.gain_after:g}, about={self.about!r}, mach={self.mach:g})"

    def begin(self, dt: float) -> "_Flight":
        """Begin a flight from the trim, with samples `dt` seconds apart."""
        return _Flight(self, dt)


class _Flight:
    """One flight, at its current sample."""

    def __init__(self, aircraft: JsbsimF16, dt: float):
        self.aircraft, self.dt = aircraft, dt
        self.simulator = _Simulator(aircraft.mach, aircraft.altitude_ft)
        self.steps = int(np.ceil(dt * STEPS_A_SECOND - 1e-9))
        self.actuators = MovingActuators(aircraft.linear, dt)
        self.gusts = [event for event in aircraft.linear.events if isinstance(event, Gust)]
        self.upsets = [event for event in aircraft.linear.events if isinstance(event, Upset)]
        self.moving_air = bool(self.gusts) or aircraft.turbulence is not None
        motion = aircraft.linear.steps(dt)
        self.air, (self.A, self.W) = np.zeros(aircraft.linear.model.n - 2), (M[0][2:] for M in (motion.A, motion.W))
        self.simulator.fdm.set_dt(dt / self.steps)

    @property
    def state(self) -> np.ndarray:
        """Alpha and pitch rate about the trim, then the turbulence."""
        fdm, trim = self.simulator.fdm, self.aircraft.trim
        alpha = fdm["aero/alpha-deg"]
        if self.moving_air:  # relative to the earth: `close_loop` adds what the vane feels
            alpha = np.degrees(np.arctan2(fdm["velocities/w-fps"], fdm["velocities/u-fps"]))
        return np.array([alpha - trim["alpha_deg"], np.degrees(fdm["velocities/q-rad_sec"]), *self.air])

    @property
    def input(self) -> np.ndarray:
        """The elevator about the trim."""
        return self.actuators.acting

    @property
    def output(self) -> np.ndarray:
        """What the sensors would read without noise."""
        return self.aircraft.linear.model.C @ self.state

    def move(self, command: Array, e: Array) -> None:
        """Fly one sample under a held command (1,), with unit normal numbers e for the turbulence."""
        fdm, trim, stage = self.simulator.fdm, self.aircraft.trim["elevator_deg"], self.actuators.stage
        gain, about = float(stage.gain[0]), trim if self.aircraft.about == "trim" else 0.0
        fdm["estimable/effect"], fdm["estimable/about-rad"] = gain, np.radians(about)
        each, before = self.dt / self.steps, self.air
        self.air = self.A[:, 2:] @ before + self.W @ e
        for step in range(self.steps):
            mean = self.actuators.move(command, each).mean[0] + stage.offset[0]
            t = np.array([self.actuators.samples * self.dt + (step + 0.5) * each])
            gust = sum(float(value_of(event, t)[0]) for event in self.gusts) + self._alpha_of(
                before, (step + 0.5) / self.steps
            )
            upset = sum(
                float(event.rates(self.aircraft.model)[1]) for event in self.upsets if acts(event, t - each / 2)[0]
            )
            if self.moving_air:  # up, so that it adds to alpha
                fdm["atmosphere/gust-down-fps"] = -fdm["velocities/vt-fps"] * np.tan(np.radians(gust))
            fdm["estimable/upset-lbsft"] = np.radians(upset) * fdm["inertia/iyy-slugs_ft2"]
            fdm["fcs/elevator-cmd-norm"] = (mean + trim) / FULL
            fdm.run()
        self.actuators.end_sample()

    def _alpha_of(self, before: np.ndarray, part: float) -> float:
        """The angle [deg] of the turbulence at a part of the sample."""
        if self.aircraft.turbulence is None:
            return 0.0
        w = (1 - part) * before[1] + part * self.air[1]
        return float(np.degrees(w / self.aircraft.turbulence.dryden.airspeed))


def _check_turbulence(turbulence: Turbulence | None, faults: checks.Faults) -> None:
    if turbulence is None or not faults.instance("turbulence", turbulence, Turbulence):
        return
    if turbulence.entry != ((f16.STATES[0], "alpha"),) or turbulence.angle != "deg":
        faults.add(
            f'`turbulence` of the simulator must enter {f16.STATES[0]!r} only, as Turbulence(dryden, {{"{f16.STATES[0]}": '
            f'"alpha"}}, angle="deg"). Got {checks.short(turbulence.entry)}, in {turbulence.angle}.'
        )


def _check_events(events: Sequence[Event], model: StateSpace) -> None:
    faults = checks.Faults()
    for event in events:
        if isinstance(event, Change):
            faults.add("`events`: the simulator cannot take a Change of its model.")
        if isinstance(event, Gust) and event.state not in (None, f16.STATES[0]):
            faults.add(f"`events`: a Gust of the simulator acts on {f16.STATES[0]!r}. Got {event.state!r}.")
        if isinstance(event, Upset) and event.rates(model)[0] != 0:
            faults.add(f"`events`: an Upset of the simulator acts on {f16.STATES[1]!r} only.")
    faults.finish()


class _Simulator:
    """JSBSim with the changed aircraft, trimmed."""

    def __init__(self, mach: float, altitude_ft: float):
        with tempfile.TemporaryDirectory() as folder, _silence():
            self.fdm = _load(Path(folder))
        self.mach, self.altitude_ft = mach, altitude_ft
        self._place()
        self.fdm["fcs/fbw-override"] = 1
        self.fdm["gear/gear-cmd-norm"] = self.fdm["gear/gear-pos-norm"] = 0
        with _silence():
            self.fdm.run_ic()
            self.fdm["propulsion/set-running"] = -1
            try:
                self.fdm["simulation/do_simple_trim"] = 1
            except Exception as reason:  # the exception class of the simulator
                checks.refuse(
                    f"the F-16 cannot be trimmed in level flight at Mach {mach:g} and {altitude_ft:g} ft ({reason})."
                )
        self.trim = {
            "alpha_deg": self.fdm["aero/alpha-deg"], "elevator_deg": self.fdm["fcs/elevator-pos-deg"],
            "throttle": self.fdm["fcs/throttle-cmd-norm"],
        }  # fmt: skip
        self.fdm["fcs/pitch-trim-cmd-norm"] = 0.0
        self.fdm["fcs/elevator-cmd-norm"] = self.trim["elevator_deg"] / FULL

    def _place(self, alpha_deg: float | None = None, q_deg_s: float = 0.0) -> None:
        self.fdm["ic/mach"], self.fdm["ic/h-sl-ft"] = self.mach, self.altitude_ft
        if alpha_deg is None:
            self.fdm["ic/gamma-deg"] = 0.0
            return
        self.fdm["ic/theta-deg"], self.fdm["ic/alpha-deg"] = self.trim["alpha_deg"], alpha_deg
        self.fdm["ic/q-rad_sec"] = np.radians(q_deg_s)

    def linearised(self) -> tuple[np.ndarray, np.ndarray]:
        """A and B at the trim, by central differences. The flight cannot continue afterwards."""
        columns = [(self._rates(step) - self._rates(-step)) / (2 * NUDGE) for step in NUDGE * np.eye(3)]
        return np.stack(columns[:2], axis=1), columns[2][:, None]

    def _rates(self, away: np.ndarray) -> np.ndarray:
        """d(alpha, q)/dt [deg/s], [deg/s²] at a distance `away` from the trim in alpha, q and the elevator."""
        self._place(self.trim["alpha_deg"] + away[0], away[1])
        self.fdm["estimable/nudge-rad"] = np.radians(away[2])
        with _silence():
            self.fdm.run_ic()
        return np.degrees([self.fdm["aero/alphadot-rad_sec"], self.fdm["accelerations/qdot-rad_sec2"]])


def _load(folder: Path) -> Any:
    """The simulator with the changed F-16, in the temporary folder."""
    try:
        import jsbsim
    except ImportError:
        checks.refuse("JSBSim is not installed: pip install 'estimable[flight]'.")
    root = Path(jsbsim.get_default_root_dir())
    shutil.copytree(root / "aircraft" / AIRCRAFT, folder / AIRCRAFT)
    path = folder / AIRCRAFT / f"{AIRCRAFT}.xml"
    path.write_text(_changed(path.read_text()))
    jsbsim.FGJSBBase().debug_lvl = 0
    fdm = jsbsim.FGFDMExec(str(root))
    fdm.set_debug_level(0)
    fdm.set_aircraft_path(str(folder))
    fdm.load_model(AIRCRAFT)
    return fdm


def _changed(text: str) -> str:
    """The aircraft description in which the effective elevator differs from its position."""
    position = COLUMN.format("fcs/elevator-pos-rad")
    if not (position in text and text.count(PLACE) == text.count(HEAD) == text.count(PITCH) == 1):
        checks.refuse(
            "the F-16 of this JSBSim version has an unknown layout and cannot be changed: use jsbsim 1.2 or 1.3."
        )
    given = "".join(f'<property value="{value}">{name}</property>' for name, value in PROPERTIES.items())
    text = text.replace(position, COLUMN.format(ELEVATOR))
    text = text.replace(PITCH, PITCH + UPSET)
    return text.replace(PLACE, SEEN_BY_THE_AIR + PLACE).replace(HEAD, HEAD + given)


@contextlib.contextmanager
def _silence() -> Any:
    """Discard what the simulator prints on stdout."""
    with open(os.devnull, "w") as nowhere:
        stdout = os.dup(1)
        os.dup2(nowhere.fileno(), 1)
        try:
            yield
        finally:
            os.dup2(stdout, 1)
            os.close(stdout)
