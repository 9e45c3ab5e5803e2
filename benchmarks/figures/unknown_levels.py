"""An unknown input with two levels in noise: NEES, the stated and actual share of right decisions, and the error of the state."""

import argparse

import numpy as np

import estimable as es

A, B, C = np.diag([0.67, 0.53]), np.array([[1.0], [0.53]]), [[0.55, 0.11], [0, 0.29]]
NOISE = 0.08


def found(level, draws=12, rows=300):
    """NEES per state, mean stated probability, share of right decisions, mean square error, and rows beyond 3 sigma."""
    model = es.StateSpace(A, B, C, [[0.4], [0.2]], Q=NOISE * np.eye(2), R=NOISE * np.eye(2), dt=1)
    method, prior = es.UnknownInput(model, unknown=["u1"], levels=[-level, level]), es.Prior([0, 0], np.eye(2))
    nees, stated, right, square, beyond = [], [], [], [], []
    for seed in range(draws):
        u = np.random.default_rng(seed).choice([-level, level], size=(rows, 1))
        drawn = es.simulate(model, u, seed=seed)
        result = es.estimate(method, es.Record(drawn.record.y, dt=1), prior=prior)
        e = result.mean - drawn.state
        nees.append(np.einsum("ti,ti->t", e, np.linalg.solve(result.covariance, e[..., None])[..., 0]) / 2)
        known = result.extra["level"] >= 0
        stated.append(result.extra["level_probability"][known])
        delay = result.names.input_delay
        right.append((np.array([-level, level])[result.extra["level"]] == np.roll(u[:, 0], delay))[known])
        square.append(np.sum(e**2, axis=1))
        beyond.append(np.abs(e) > 3 * np.sqrt(np.diagonal(result.covariance, axis1=1, axis2=2)))
    return tuple(float(np.mean(np.concatenate(one))) for one in (nees, stated, right, square, beyond))


def main():
    """Print the figures."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--draws", type=int, default=12)
    draws = options.parse_args().draws
    for level in (0.5, 1.0, 2.0):
        nees, stated, right, square, beyond = found(level, draws)
        print(
            f"levels +-{level}: NEES/n {nees:.2f}, stated {stated:.3f}, right {right:.3f}, mean square error {square:.3f}, "
            f"beyond 3 sigma {beyond:.4f}"
        )


if __name__ == "__main__":
    main()
