"""Smoothers of nonlinear models over many draws: errors as large as their covariances say, and smaller than the filter's."""

import jax.numpy as jnp
import numpy as np
import pytest

import estimable as es

DRAWS, T = 50, 40
F, G = np.kron(np.eye(2), [[1.0, 1.0], [0.0, 1.0]]), np.kron(np.eye(2), [[0.5], [1.0]])
TRACK = es.NonlinearModel(
    lambda x, u, θ: F @ x, lambda x, u, θ: jnp.stack([jnp.arctan2(x[2], x[0]), jnp.hypot(x[0], x[2])]), G=G,
    Q=0.05 * np.eye(2), R=np.diag([4e-4, 25.0]), dt=1, states=("east", "east_speed", "north", "north_speed"),
)  # fmt: skip
PRIOR = es.Prior([300.0, -8.0, 300.0, 4.0], np.diag([2500.0, 9.0, 2500.0, 9.0]))


def drawn(seed):
    """A track seen from the origin by its bearing (to 20 mrad) and its range (to 5 m), a fifth of either missing."""
    run = es.simulate(TRACK, seed=seed, steps=T, prior=PRIOR)
    y = run.record.y.copy()
    y[np.random.default_rng(seed).random(y.shape) < 0.2] = np.nan
    return run.state, es.Record(y, dt=1)


@pytest.mark.parametrize(
    ("make", "settings"),
    [
        (es.ExtendedKalman, {}),
        (es.ExtendedKalman, {"iterations": 60}),
        (es.SecondOrderKalman, {}),
        (es.UnscentedKalman, {}),
    ],
)
def test_on_tracks_of_bearings_and_ranges_errors_are_as_large_as_the_smoother_says(make, settings):
    algorithm, z, ratio = make(TRACK), [], []
    for seed in range(DRAWS):
        states, record = drawn(seed)
        result = es.smooth(algorithm, record, prior=PRIOR, **settings)
        filtered = es.estimate(algorithm, record, prior=PRIOR)
        z.append((result.mean - states) / np.sqrt(np.diagonal(result.covariance, axis1=1, axis2=2)))
        ratio.append(np.mean((result.mean - states) ** 2, axis=0) / np.mean((filtered.mean - states) ** 2, axis=0))
    assert 0.9 < np.sqrt(np.mean(np.square(z))) < 1.1
    assert np.median(ratio) < 0.5
