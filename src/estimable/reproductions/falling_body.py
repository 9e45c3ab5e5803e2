"""The falling body of Athans, Wishner and Bertolini (1968): a radar next to its path, and a drag that is almost unknown."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .. import forks
from ..annotations import Array
from ..data.record import Record
from ..estimation.estimate_bank import estimate_bank
from ..filters.extended_kalman import ExtendedKalman
from ..filters.second_order_kalman import SecondOrderKalman
from ..kernels.flow import runge_kutta
from ..models.nonlinear_model import NonlinearModel
from ..models.prior import Prior
from .entries import Reproduced, Reproduction, drawn
from .plots import Line, Panel, over_time

SOURCE = "Athans, Wishner & Bertolini (1968)"
TRUTH = np.array([3e5, 2e4, 1e-3])  # altitude [ft], speed downwards [ft/s], ballistic coefficient [1/ft]
PRIOR = Prior([3e5, 2e4, 3e-5], np.diag([1e6, 4e6, 1e-4]))
SECONDS, SIGMA = 30, 100.0  # one reading per second, with noise in feet
REMARK = (
    "The source prints curves of average errors, and no table. The true drag is 33 times the prior mean, a tenth of its "
    "standard deviation away. Errors here are signed, because the second order reduces the bias; one reading per second."
)


def fall(x: Array, u: Array | None, θ: Array | None) -> Array:
    """The derivative of the state: drag falls with altitude and grows with the square of the speed."""
    return jnp.array([-x[1], -jnp.exp(-5e-5 * x[0]) * x[1] ** 2 * x[2], 0.0])


def distance(x: Array, u: Array | None, θ: Array | None) -> Array:
    """The distance from a radar at 1e5 ft of altitude, 1e5 ft away from the path."""
    return jnp.sqrt(1e10 + (x[:1] - 1e5) ** 2)


def altitude_errors(draws: int) -> Reproduced:
    """Errors of altitude and speed by both filters, over draws of the radar's noise."""
    model = NonlinearModel(fall, distance, Q=np.zeros((3, 3)), R=[[SIGMA**2]], dt=0,
                           states=["altitude", "speed", "ballistic"], substeps=4)  # fmt: skip
    path = _path()
    y = np.asarray(jax.vmap(lambda x: distance(x, None, None))(path))
    noise = SIGMA * np.random.default_rng(0).normal(size=(draws, *y.shape))
    records = [Record(y + one, dt=1.0) for one in noise]
    filters = {"extended": ExtendedKalman(model), "second order": SecondOrderKalman(model)}
    errors = {name: estimate_bank(one, records, prior=PRIOR).mean - path for name, one in filters.items()}
    rows = [
        drawn(f"{what} error at {k} s, {name}", unit, None, e[:, k, i])
        for i, what, unit in ((0, "altitude", "ft"), (1, "speed", "ft/s"))
        for k in (10, 20, SECONDS)
        for name, e in errors.items()
    ]
    return Reproduced(tuple(rows), lambda: _figure(errors), (REMARK,))


def _path() -> np.ndarray:
    """The true states, one per second, (T, 3)."""
    step, states = forks.jit(lambda x: runge_kutta(lambda t, x: fall(x, None, None), x, 1.0, 16)), [TRUTH]
    for _ in range(SECONDS):
        states.append(np.asarray(step(states[-1])))
    return np.array(states)


def _figure(errors: dict[str, np.ndarray]) -> Any:
    t = np.arange(SECONDS + 1)
    return over_time(
        [
            Panel(f"average |{what} error| [{unit}]", [Line(name, t, np.abs(e[:, :, i]).mean(axis=0), colour)
                                                        for colour, (name, e) in enumerate(errors.items())])
            for i, what, unit in ((0, "altitude", "ft"), (1, "speed", "ft/s"))
        ]
    )  # fmt: skip


ENTRIES = (
    Reproduction("athans-falling-body", SOURCE, "Average errors of a falling body, by both filters", altitude_errors),
)
