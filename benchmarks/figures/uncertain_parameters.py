"""The effect of a torque on a pendulum whose stiffness and damping are uncertain: taken as right, and considered."""

import argparse

import jax.numpy as jnp
import numpy as np

import estimable as es
from benchmarks.figures.f16_loop import rms

STEP, ROWS, SUBSTEPS, EFFECT = 0.05, 200, 20, 0.8
STIFFNESS, DAMPING = (4.0, 0.4), (0.3, 0.09)  # value, standard deviation
START = es.Prior([0.0, 0.0], np.diag([0.01, 0.01]))
TORQUE = 3.0 * np.sign(np.sin(1.3 * STEP * np.arange(ROWS)))[:, None]


def pendulum():
    """The model, with the nominal parameters."""

    def slope(x, u, θ):
        return jnp.array([x[1], -θ[0] * jnp.sin(x[0]) - θ[1] * x[1] + θ[2] * u[0]])

    return es.NonlinearModel(
        slope, lambda x, u, θ: x[:1], Q=np.diag([0.0, 1e-3]), G=np.eye(2), R=[[1e-3]], dt=0, states=["angle", "rate"],
        inputs=["torque"], parameters={"stiffness": STIFFNESS[0], "damping": DAMPING[0], "effect": 1.0}, substeps=2,
    )  # fmt: skip


def swing(draws, seed=0):
    """Records of pendulums whose stiffness and damping are drawn, and their last states (draws, 2)."""
    rng = np.random.default_rng(seed)
    k, c = (value + sd * rng.normal(size=draws) for value, sd in (STIFFNESS, DAMPING))
    angle, rate = 0.1 * rng.normal(size=(2, draws))
    y, h = np.empty((draws, ROWS)), STEP / SUBSTEPS
    last = None
    for row in range(ROWS):
        y[:, row], last = angle + np.sqrt(1e-3) * rng.normal(size=draws), np.stack([angle, rate], axis=1)
        for _ in range(SUBSTEPS):
            force = -k * np.sin(angle) - c * rate + EFFECT * TORQUE[row, 0]
            rate = rate + h * force + np.sqrt(1e-3 * h) * rng.normal(size=draws)
            angle = angle + h * rate
    return [es.Record(one, TORQUE, dt=STEP, inputs=["torque"]) for one in y], last


def main():
    """Print rms z of the effect and of the states, and the median sigma of the effect."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--draws", type=int, default=400)
    records, last = swing(options.parse_args().draws)
    sure = {"parameters": es.Prior([STIFFNESS[0], DAMPING[0], 1.0], np.diag([0.0, 0.0, 0.25]))}
    parameters = {"stiffness": STIFFNESS[1], "damping": DAMPING[1]}
    unsure = {"parameters": es.Prior([1.0], [[0.25]]), "uncertainty": es.ModelUncertainty(parameters=parameters)}
    for filter in (es.ExtendedKalman, es.SecondOrderKalman, es.UnscentedKalman):
        for name, how in (("as right", sure), ("considered", unsure)):
            bank = es.estimate_bank(filter(pendulum(), **how), records, prior=START)
            sigma = np.sqrt(bank.gain_covariance[:, -1, -1, -1])
            of_state = (bank.mean[:, -1] - last) / np.sqrt(np.diagonal(bank.covariance[:, -1], axis1=1, axis2=2))
            states = ", ".join(f"{rms(z):.2f}" for z in of_state.T)
            print(f"{filter.__name__:18s} {name:11s} rms z: effect {rms((bank.gain[:, -1, -1] - EFFECT) / sigma):5.2f}, "
                  f"states {states}; median sigma {np.median(sigma):.4f}")  # fmt: skip


if __name__ == "__main__":
    main()
