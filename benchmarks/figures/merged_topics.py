"""Topics of several rates on one grid: the innovations of the right model, by how the rows are made.

A = [[0, 1], [-20, -2]], u at 400 Hz, rows of .01 s, 30 % of y lost, 1e4 rows. NIS and its lag-1 correlation are 1 and 0 where the
rows are right. Compared with inputs of the last sample, with outputs interpolated, and with inputs logged at 10 Hz.
"""

import argparse

import numpy as np

import estimable as es
from estimable.frozen import replace

H, FAST = 0.01, 4
MODEL = es.StateSpace(
    [[0.0, 1.0], [-20.0, -2.0]],
    [[0.0], [20.0]],
    [[1.0, 0.0]],
    Q=np.diag([0.0, 1.0]),
    R=[[1e-3]],
    dt=0,
    outputs=["y"],
    inputs=["u"],
)


def drawn(seed, rows):
    """The topics of outputs and inputs, the states at the rows, and all inputs."""
    from scipy.signal import lfilter

    rng, h = np.random.default_rng(seed), H / FAST
    n, step = rows * FAST, MODEL.discretise(h)
    a = np.exp(-h / 0.1)
    u = lfilter([np.sqrt(1 - a * a)], [1, -a], rng.normal(size=n))
    w = rng.normal(size=(n, 2)) @ np.linalg.cholesky(step.Q + 1e-18 * np.eye(2)).T
    x = np.zeros((n, 2))
    for k in range(n - 1):
        x[k + 1] = step.A @ x[k] + step.B @ u[k : k + 1] + w[k]
    y = x[::FAST, 0] + np.sqrt(1e-3) * rng.normal(size=rows)
    left = rng.random(rows) >= 0.3
    left[0] = True
    ticks = np.arange(n) * round(h * 1e6)
    return (
        es.Topic("imu", ticks[::FAST][left], 1e-6, {"y": y[left]}),
        es.Topic("motor", ticks, 1e-6, {"u": u}),
        x[::FAST],
        u,
    )


def judged(record, x):
    """NIS, lag-1 correlation, and rms error of the second state."""
    found = es.estimate(es.Kalman(MODEL), record, prior=es.Prior([0.0, 0.0], 0.01 * np.eye(2)))
    z = found.innovation[200:, 0] / np.sqrt(found.innovation_covariance[200:, 0, 0])
    z = z[~np.isnan(z)]
    error = np.sqrt(np.mean((found.mean[200:, 1] - x[200 : len(record), 1]) ** 2))
    return np.mean(z**2), np.mean(z[1:] * z[:-1]) / np.mean(z**2), error


def figure(seed, rows):
    """{how the rows are made: (NIS, lag-1, rms)}."""
    imu, motor, x, u = drawn(seed, rows)
    record = es.Log([imu, motor]).record(outputs=["y"], inputs=["u"], grid=H)
    T, y = len(record), record.y[:, 0]
    filled = np.interp(record.t, record.t[~np.isnan(y)], y[~np.isnan(y)])
    slow = es.Topic("motor", motor.ticks[:: 10 * FAST], 1e-6, {"u": u[:: 10 * FAST]})
    return {
        "placed, mean over the row": judged(record, x),
        "last sample of u": judged(replace(record, u=u[FAST - 1 :: FAST][:T, None]), x),
        "y interpolated": judged(replace(record, y=filled[:, None]), x),
        "u at 10 Hz, held": judged(es.Log([imu, slow]).record(outputs=["y"], inputs=["u"], grid=H), x),
    }


def main():
    """Print the figure."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--draws", type=int, default=5)
    options.add_argument("--rows", type=int, default=10_000)
    given = options.parse_args()
    found = [figure(seed, given.rows) for seed in range(given.draws)]
    for how in found[0]:
        nis, lag, rms = np.mean([one[how] for one in found], axis=0)
        print(f"{how}: NIS {nis:.2f}, lag-1 {lag:+.3f}, rms of state 2 {rms:.3f}")


if __name__ == "__main__":
    main()
