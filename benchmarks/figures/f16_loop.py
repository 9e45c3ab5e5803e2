"""The F-16 of the specification in closed loop: its short period with an actuator, under the P law on its noisy sensors.

Other figures import `fly` and `standing`; run as a command, it does nothing.
"""

import numpy as np

import estimable as es
from estimable.frozen import replace
from estimable.plants import f16

Q = np.diag([1e-3, 0.1])  # density per second
GAIN = es.Prior([1.0], [[0.25]])
START = es.Prior([0.0, 0.0], np.zeros((2, 2)))
DT = 1 / f16.RATE


def model(scale=1.0):
    """The model of the estimator, with white process noise of `scale` times Q."""
    return f16.short_period(Q=scale * Q)


def gains(t, *changes):
    """A gain that is 1 and then takes each (time, value) in turn."""
    value = np.ones(len(t))
    for time, after in changes:
        value = np.where(t >= time - 1e-9, after, value)
    return value


def fly(draws, seed, *, amp=10.0, seconds=f16.SECONDS, gain=None, white=1.0, markov=None, A=None, B=None, offset=0.0):
    """Records of `draws` flights and the gain (T,). The command is the standard one, `amp` deg/s in size.

    `gain`: from the times to the gain. Process noise: `white` times Q, and `markov` (τ, factors of Q of each state): Gauss-Markov
    disturbances. `A` (draws, 2, 2), `B` (draws, 2, 1): the true matrices. `offset`: of the measured deflection [deg].
    """
    t = np.arange(round(seconds / DT) + 1) * DT
    rng, command = np.random.default_rng(seed), amp / 10 * f16.pitch_command(t)
    K = np.ones(len(t)) if gain is None else gain(t)
    steps = _steps(K, white, markov, A, B)
    x = np.zeros((draws, steps[0][0].shape[-1]))
    if markov is not None:
        τ, factors = markov
        x[:, 3:] = rng.normal(size=(draws, 2)) * np.sqrt(factors * np.diag(Q) / (2 * τ))
    y, de = np.zeros((len(t), draws, 2)), np.zeros((len(t), draws))
    sigmas = np.array([f16.SIGMA_ALPHA, f16.SIGMA_Q])
    for k in range(len(t)):
        y[k], de[k] = x[:, :2] + sigmas * rng.normal(size=(draws, 2)), x[:, 2]
        dec = f16.COMMAND * command[k] + y[k] @ f16.FEEDBACK[:2] + f16.FEEDBACK[2] * x[:, 2]
        Φ, Γ, W = (M[k] for M in steps)
        x = np.einsum("...ij,...j->...i", Φ, x) + Γ[..., 0] * dec[:, None]
        x = x + np.einsum("...ij,...j->...i", W, rng.normal(size=x.shape))
    records = [
        es.Record(y[:, i], de[:, i] + offset, dt=DT, hold="first_order", outputs=f16.OUTPUTS, inputs=f16.INPUTS)
        for i in range(draws)
    ]
    return records, K


def _steps(K, white, markov, A, B):
    """For each row the transition of (alpha, q, deflection, disturbances), the effect of the command, and a noise factor."""
    A, B = (f16.A if A is None else A), (f16.B if B is None else B)
    count = 3 if markov is None else 5
    found = {}
    for gain in np.unique(K):
        F = np.zeros((*A.shape[:-2], count, count))
        F[..., :2, :2], F[..., :2, 2:3], F[..., 2, 2] = A, gain * B, -f16.ACTUATOR
        density = np.zeros((count, count))
        density[:2, :2] = white * Q
        if markov is not None:
            τ, factors = markov
            F[..., 0, 3] = F[..., 1, 4] = 1.0
            F[..., 3, 3] = F[..., 4, 4] = -1 / τ
            density[3:, 3:] = np.diag(factors * np.diag(Q)) / τ**2
        G = np.zeros((count, 1))
        G[2] = f16.ACTUATOR
        found[gain] = [
            np.array(part)
            for part in zip(*map(lambda F: _step(F, G, density), F.reshape(-1, count, count)), strict=True)
        ]
        if A.ndim == 2:
            found[gain] = [part[0] for part in found[gain]]
    return [[found[gain][i] for gain in K] for i in range(3)]


def _step(F, G, density):
    step = es.StateSpace(F, G, Q=density, dt=0).discretise(DT)
    values, vectors = np.linalg.eigh(step.Q)
    return step.A, step.B, vectors * np.sqrt(np.maximum(values, 0.0))


def standing(bank, truth, row=-1):
    """(z, half-width / 1.96) of the first gain of each run at a row: by the median and the printed 95 % interval."""
    quantiles = bank.info.gain_quantiles
    if quantiles is None:
        sigma = np.sqrt(bank.gain_covariance[:, row, 0, 0])
        return (bank.gain[:, row, 0] - truth) / sigma, sigma
    low, _, median, _, high = quantiles[:, row, 0].T
    sigma = (high - low) / 2 / 1.959964
    return (median - truth) / sigma, sigma


def covered(bank, truth, row=-1):
    """The share of runs whose printed 95 % interval holds the true gain."""
    low, high = bank.info.gain_quantiles[:, row, 0, 0], bank.info.gain_quantiles[:, row, 0, 4]
    return float(np.mean((low <= truth) & (truth <= high)))


def rms(z):
    """The root mean square."""
    return float(np.sqrt(np.mean(np.square(z))))


__all__ = ["DT", "GAIN", "START", "Q", "covered", "fly", "gains", "model", "replace", "rms", "standing"]
