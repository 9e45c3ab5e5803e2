"""W10: the nonlinear filters compared with the Kalman filter, at equal n and p; ratios are to the first row."""

import jax.numpy as jnp

from estimable import ExtendedKalman, Kalman, NonlinearModel, SecondOrderKalman, UnscentedKalman, estimate

from .common import best, problem, recorded, row

FILTERS = {
    "ExtendedKalman": ExtendedKalman,
    "SecondOrderKalman": SecondOrderKalman,
    "SecondOrderKalman, bias only": lambda model: SecondOrderKalman(model, moments="bias_only"),
    "UnscentedKalman": UnscentedKalman,
}


def curved():
    """n = 4, p = 2: every state has a sine in f, and every output a product in h; with the linear model nearby and its prior."""
    linear, prior = problem(4, 2)
    A, C = jnp.asarray(linear.A), jnp.asarray(linear.C)
    model = NonlinearModel(
        lambda x, u, θ: A @ x + 0.01 * jnp.sin(x), lambda x, u, θ: C @ x + 0.01 * jnp.cos(x[:2]) * x[2:], Q=linear.Q, R=linear.R,
        dt=1,
    )  # fmt: skip
    return model, linear, prior


def nonlinear(name, T, keep):
    """Every filter on a record of the linear model."""
    model, linear, prior = curved()
    record = recorded(linear, prior, T)
    algorithms = {"Kalman": Kalman(linear)} | {n: make(model) for n, make in FILTERS.items()}
    for contender, algorithm in algorithms.items():
        seconds, first, result = best(lambda a=algorithm: estimate(a, record, prior=prior, keep=keep))
        yield row(name, f"{contender}, {result.engine}", seconds, first)
