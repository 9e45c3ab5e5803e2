"""A coordinated turn whose heading is logged from -pi to pi: NEES of filters and smoothers, and their distance from a run on a
log that goes on through the turns."""

import argparse

import jax.numpy as jnp
import numpy as np

import estimable as es
from estimable.diagnostics import nees
from estimable.estimation.smooth_bank import smooth_bank

DT, ROWS = 0.1, 200
Q, R = np.diag([1e-4, 1e-4, 1e-5, 1e-3, 1e-5]), np.diag([0.25, 0.25, 0.02**2])
PRIOR = es.Prior([0.0, 0.0, 0.0, 5.0, 0.5], np.diag([1.0, 1.0, 0.01, 0.1, 0.01]))
FILTERS = (es.ExtendedKalman, es.SecondOrderKalman, es.UnscentedKalman)
OUTPUTS = ["east", "north", "yaw"]


def move(x, u, θ):
    """East, north, heading, speed and turn rate, a step later."""
    return jnp.array([x[0] + DT * x[3] * jnp.sin(x[2]), x[1] + DT * x[3] * jnp.cos(x[2]), x[2] + DT * x[4], x[3], x[4]])


def model(**angles):
    """The turn, with positions and heading measured."""
    states = ["east", "north", "heading", "speed", "turn_rate"]
    return es.NonlinearModel(move, lambda x, u, θ: x[:3], Q=Q, R=R, dt=DT, states=states, outputs=OUTPUTS, **angles)


def flights(draws):
    """The states (draws, rows, 5), and the outputs without wrapping."""
    rng, x = np.random.default_rng(7), np.zeros((draws, ROWS, 5))
    x[:, 0] = rng.multivariate_normal(PRIOR.mean, PRIOR.covariance, size=draws)
    for k in range(ROWS - 1):
        moved = np.stack([np.asarray(move(one, None, None)) for one in x[:, k]])
        x[:, k + 1] = moved + rng.normal(size=(draws, 5)) * np.sqrt(np.diag(Q))
    return x, x[..., :3] + rng.normal(size=(draws, ROWS, 3)) * np.sqrt(np.diag(R))


def wrapped(values):
    """Values whose third column is from -pi to pi."""
    return np.concatenate([values[..., :2], np.angle(np.exp(1j * values[..., 2:3])), values[..., 3:]], axis=-1)


def figure(draws, filters=FILTERS):
    """(name, NEES half-way, distance from the run without wrapping) of each filter and smoother."""
    x, y = flights(draws)
    declared = model(angles={"heading": "rad", "yaw": "rad"})
    logged = [es.Record(wrapped(one), dt=DT, outputs=OUTPUTS) for one in y]
    running_on = [es.Record(one, dt=DT, outputs=OUTPUTS, angles={"yaw": None}) for one in y]
    rows = []
    for kind in filters:
        for run in (es.estimate_bank, smooth_bank):
            found = run(kind(declared), logged, prior=PRIOR)
            plain = run(kind(model()), running_on, prior=PRIOR)
            error = wrapped(found.mean[:, ROWS // 2] - x[:, ROWS // 2])
            distance = np.abs(wrapped(found.mean - plain.mean)).max()
            rows.append((f"{kind.__name__} {run.__name__}", nees(error, found.covariance[:, ROWS // 2]), distance))
    return rows


def main():
    """Print the figure."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--draws", type=int, default=50)
    for name, found, distance in figure(options.parse_args().draws):
        print(f"{name}: NEES {found.sentence}; {distance:.1e} from the run without wrapping")


if __name__ == "__main__":
    main()
