"""Turbulence in the model of an aircraft, through its aerodynamic columns."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..frozen import frozen, replace, set_field, static
from .dryden import COMPONENTS, Dryden, diagonal
from .operating_point import OperatingPoint
from .prior import Prior
from .sampled import point_of
from .state_space import StateSpace

VELOCITIES = {"u": "gust_u", "v": "gust_v", "w": "gust_w", "alpha": "gust_w", "beta": "gust_v"}
RATES = {"p": "gust_p", "q": "gust_q", "r": "gust_r"}
ENTRIES = VELOCITIES | RATES
UNITS = {"rad": 1.0, "deg": 180 / np.pi}
ANGULAR = ("alpha", "beta", *RATES)


@frozen
class Turbulence:
    """Turbulence that acts on a model: the gusts of `dryden` enter the states that the `entry` names.

    Model: dx/dt = A_a (x + E g) + (A - A_a) x + B u + G w, with the gusts g and the aerodynamic part A_a of A: A without the
    entries of `kinematics`. An output in `vanes` measures C (x + E g), relative to the air; the others measure C x.

    Settings:

    - `dryden`: a `Dryden`.
    - `entry`: {state: gust}, where a gust is "u", "v", "w" [m/s], "alpha" (w/V), "beta" (v/V), "p", "q" or "r". An
      example is {"alpha": "alpha", "pitch_rate": "q"}.
    - `angle`: the unit of the angles and rates of the model, "rad" or "deg".
    - `vanes`: the outputs that are measured relative to the air. None: every output that depends on a state which "u",
      "v", "w", "alpha" or "beta" enters. (): none, as with inertial sensors.
    - `kinematics`: [(row, column), ..] of A, by the names of states, which are kinematic, as that of the pitch rate in the
      derivative of alpha. Turbulence does not act through them.

    The same object puts turbulence into a filter (`with_turbulence`) and drives a `ControlledPlant(turbulence=)`.
    """

    dryden: Dryden
    entry: Any = static()
    angle: str = static(default="rad")
    vanes: tuple[str, ...] | None = static(default=None)
    kinematics: tuple[tuple[str, str], ...] = static(default=())

    def __post_init__(self):
        faults = checks.Faults()
        faults.instance("dryden", self.dryden, Dryden)
        faults.choice("angle", self.angle, tuple(UNITS))
        entry = _read_entry(self.entry, faults)
        vanes = None if self.vanes is None else faults.names("vanes", self.vanes, "", "")
        pairs = _read_pairs(self.kinematics, faults)
        faults.finish()
        set_field(self, entry=entry, vanes=vanes, kinematics=pairs)

    def into(self, model: StateSpace) -> StateSpace:
        """The model with the states of the turbulence after its own; where it has a schedule, the turbulence acts through the
        scheduled A. Raises `InputError` with every fault."""
        faults = checks.Faults()
        if not faults.instance("model", model, StateSpace):
            faults.finish()
        _check_model(self, model, faults)
        faults.finish()
        if not model.schedule:
            return self._into(model)
        here = replace(self, vanes=self._vanes_of(model))

        def joined(matrices: Mapping[str, Numbers]) -> dict[str, Any]:
            read = {name: np.asarray(M, float) for name, M in matrices.items()}
            both = here._into(replace(model.nominal, **read))
            return {name: getattr(both, name) for name in read}

        return replace(here._into(model.nominal), schedule=tuple(one.mapped(joined) for one in model.schedule))

    def _into(self, model: StateSpace) -> StateSpace:
        air = self.dryden.model(self._which)
        E = self._effects(model, air.states)
        aerodynamic = model.A.copy()
        for row, column in self.kinematics:
            aerodynamic[model.states.index(row), model.states.index(column)] = 0.0
        n, g = model.n, air.n
        vanes = np.array([name in self._vanes_of(model) for name in model.outputs])[:, None]
        point = model.operating_point and point_of(model)
        return StateSpace(
            np.block([[model.A, aerodynamic @ E], [np.zeros((g, n)), air.A]]), np.vstack([model.B, np.zeros((g, model.m))]),
            np.hstack([model.C, vanes * (model.C @ E)]), model.D, G=diagonal(model.G, air.G),
            Q=diagonal(model.Q, air.Q), R=model.R, dt=0, states=(*model.states, *air.states), inputs=model.inputs,
            outputs=model.outputs,
            operating_point=point and OperatingPoint(np.append(point.states, np.zeros(g)), point.inputs, point.outputs),
        )  # fmt: skip

    def prior(self, prior: Prior) -> Prior:
        """The prior of `into(model)` from that of the model: the turbulence is stationary."""
        P = self.dryden.covariance(self._which)
        diffuse = prior.diffuse
        if diffuse is not None:
            diffuse = np.vstack([diffuse, np.zeros((len(P), diffuse.shape[1]))])
        return Prior(np.append(prior.mean, np.zeros(len(P))), diagonal(prior.covariance, P), diffuse=diffuse)

    @property
    def _which(self) -> str:
        """The block of the turbulence that has all the gusts."""
        wanted = {ENTRIES[gust] for _, gust in self.entry}
        return next((name for name, states in COMPONENTS.items() if wanted <= set(states)), "both")

    def _effects(self, model: StateSpace, gusts: tuple[str, ...]) -> np.ndarray:
        """E (n, g): the deviation of each state relative to the air, in the units of the model."""
        E = np.zeros((model.n, len(gusts)))
        for state, gust in self.entry:
            size = UNITS[self.angle] if gust in ANGULAR else 1.0
            E[model.states.index(state), gusts.index(ENTRIES[gust])] += (
                size / self.dryden.airspeed if gust in ("alpha", "beta") else size
            )
        return E

    def _vanes_of(self, model: StateSpace) -> tuple[str, ...]:
        if self.vanes is not None:
            return self.vanes
        entered = [model.states.index(state) for state, gust in self.entry if gust in VELOCITIES]
        return tuple(name for i, name in enumerate(model.outputs) if np.any(model.C[i, entered] != 0))


def with_turbulence(
    model: StateSpace,
    dryden: Dryden,
    entry: Mapping[str, str],
    *,
    angle: str = "rad",
    vanes: Iterable[str] | None = None,
    kinematics: Iterable[tuple[str, str]] = (),
) -> StateSpace:
    """A model of an aircraft with the states of the turbulence that acts on it, for filters and simulations.

    `model`: continuous, constant or with a schedule, without cross noise. The other arguments are the settings of `Turbulence`,
    whose `prior` gives the prior.

    Returns a `StateSpace`. Raises `InputError` with every fault of the call.

    >>> aircraft = StateSpace([[-1.3, 1.0], [-3.5, -1.1]], [[-0.1], [-24.0]], R=np.eye(2), dt=0, states=["alpha", "q"])
    >>> air = Dryden.at(6000.0, 275.0, severity="light")
    >>> with_turbulence(aircraft, air, {"alpha": "alpha", "q": "q"}, kinematics=[("alpha", "q")]).states
    ('alpha', 'q', 'gust_u', 'gust_w', 'gust_w_lag', 'gust_q')
    """
    given: Any = vanes
    return Turbulence(dryden, entry, angle, given, tuple(kinematics)).into(model)


def _read_entry(
    given: Mapping[str, str] | tuple[tuple[str, str], ...], faults: checks.Faults
) -> tuple[tuple[str, str], ...]:
    """((state, gust), ..)."""
    pairs = tuple(given.items()) if isinstance(given, Mapping) else given
    if (
        not isinstance(pairs, tuple)
        or not pairs
        or not all(isinstance(pair, tuple) and len(pair) == 2 for pair in pairs)
    ):
        faults.add(
            f"`entry` must be a mapping of states to gusts, such as {{'alpha': 'alpha'}}. Got {checks.short(given)}."
        )
        return ()
    for _, gust in pairs:
        faults.choice("entry", gust, tuple(ENTRIES))
    return pairs


def _read_pairs(given: Iterable[tuple[str, str]], faults: checks.Faults) -> tuple[tuple[str, str], ...]:
    pairs: list = list(given) if isinstance(given, list | tuple) else [None]
    if not all(isinstance(pair, list | tuple) and len(pair) == 2 for pair in pairs):
        faults.add(f"`kinematics` must be a list of (row, column), by names of states. Got {checks.short(given)}.")
        return ()
    return tuple((row, column) for row, column in pairs)


def _check_model(turbulence: Turbulence, model: StateSpace, faults: checks.Faults) -> None:
    if not model.is_continuous or model.varying:
        faults.add(
            "`model` must be continuous (dt = 0), constant or with a schedule: turbulence enters its derivatives."
        )
    named = [state for state, _ in turbulence.entry] + [name for pair in turbulence.kinematics for name in pair]
    for name in dict.fromkeys(named):
        if name not in model.states:
            near = checks.suggestion(name, model.states)
            faults.add(f"the model has no state {name!r}. Its states are {checks.listed(model.states)}.{near}")
    for name in turbulence.vanes or ():
        if name not in model.outputs:
            near = checks.suggestion(name, model.outputs)
            faults.add(f"`vanes` names {name!r}, but the outputs are {checks.listed(model.outputs)}.{near}")
    if any(name.startswith("gust_") for name in model.states):
        faults.add("`model` already has states of turbulence.")
