"""Two tanks in series, with a pump and a valve, and their faults: leaks, a blockage, a weak pump, a weak valve."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array
from ..models.nonlinear_model import NonlinearModel

GRAVITY = 981.0  # [cm/s²]
AREAS, HOLES = (28.0, 32.0), (0.071, 0.057)  # [cm²]: of the tanks and of their outlets, Johansson's table I
LEVEL = 8.0  # [cm]: that of tank 1 at the operating point


def two_tanks(
    *,
    leak1: float = 0.0,
    leak2: float = 0.0,
    blockage: float = 1.0,
    pump: float = 1.0,
    valve: float = 1.0,
    sigma: float = 0.1,
    flow_density: float = 0.25,
    substeps: int = 2,
) -> NonlinearModel:
    """Two tanks as a continuous nonlinear model: levels [cm]; inputs the flow of the pump [cm³/s] and the opening of the valve.

    Model: A1 h1' = pump u1 - blockage a1 √(2 g h1) - leak1 √(h1/8) + w, A2 h2' = blockage a1 √(2 g h1) -
    valve u2 a2 √(2 g h2) - leak2 √(h2/8). The parameters are the faults: `leak1`, `leak2` [cm³/s at 8 cm] (0: none), and the
    parts that remain of the flow between the tanks (`blockage`), of the pump and of the valve (1: healthy).

    `sigma`: of the level sensors [cm]. `flow_density`: of the noise w of the inflow [cm⁶/s], (.5 cm³/s/√Hz)² by default.

    Reference: K. H. Johansson, IEEE Trans. Control Systems Technology 8 (2000) 456-465 (areas and holes).

    >>> levels, inputs = equilibrium()
    >>> two_tanks().linearised(levels, inputs).A.round(5).tolist()
    [[-0.01986, 0.0], [0.01737, -0.00907]]
    """
    faults = checks.Faults()
    noise, density = (
        faults.number(name, value, lower=0.0) for name, value in (("sigma", sigma), ("flow_density", flow_density))
    )
    given = {"leak1": leak1, "leak2": leak2, "blockage": blockage, "pump": pump, "valve": valve}
    θ = {name: faults.number(name, value, lower=0.0) for name, value in given.items()}
    faults.finish()
    return NonlinearModel(
        levels_change, lambda x, u, θ: x, G=[[1 / AREAS[0]], [0.0]], Q=[[density]], R=np.diag([noise**2] * 2), dt=0,
        substeps=substeps, parameters=θ, states=["level1", "level2"], inputs=["pump_cm3_s", "valve"],
        outputs=["level1_cm", "level2_cm"],
    )  # fmt: skip


def flows(x: Array, u: Array, θ: Array) -> Any:
    """The flows [cm³/s] into tank 1, between the tanks, out of tank 2, and the two leaks, (5,)."""
    leak1, leak2, blockage, pump, valve = θ
    root1, root2 = _root(x[0]), _root(x[1])
    fall = np.sqrt(2 * GRAVITY)
    return jnp.stack([
        pump * u[0], blockage * HOLES[0] * fall * root1, valve * u[1] * HOLES[1] * fall * root2,
        leak1 * root1 / np.sqrt(LEVEL), leak2 * root2 / np.sqrt(LEVEL),
    ])  # fmt: skip


def levels_change(x: Array, u: Array, θ: Array) -> Any:
    """dh/dt [cm/s], (2,)."""
    into, between, out, leak1, leak2 = flows(x, u, θ)
    return jnp.stack([(into - between - leak1) / AREAS[0], (between - out - leak2) / AREAS[1]])


def equilibrium(level: float = LEVEL, valve: float = 0.9) -> tuple[np.ndarray, np.ndarray]:
    """The levels [cm] and inputs at rest for a level of tank 1, of the healthy plant."""
    faults = checks.Faults()
    h = faults.number("level", level, above=0.0, unit="cm")
    opening = faults.number("valve", valve, above=0.0, upper=1.0)
    faults.finish()
    flow = HOLES[0] * np.sqrt(2 * GRAVITY * h)
    second = (flow / (opening * HOLES[1])) ** 2 / (2 * GRAVITY)
    return np.array([h, second]), np.array([flow, opening])


def _root(h: Array) -> Any:
    """√h, and 0 for an empty tank, with a finite slope there."""
    some = jnp.where(h > 0, h, 1.0)
    return jnp.where(h > 0, jnp.sqrt(some), 0.0)
