"""The F-16 of the specification in closed loop: its short period with an actuator, under the P law on its noisy sensors.

Other figures import `fly` and `standing`; run as a command, it does nothing.
"""

from typing import NamedTuple

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


class Disturbance(NamedTuple):
    """What acts on the aircraft besides white noise: its A and noise density, its covariance at the start, and its effect `into`
    (2, d) on the rates of alpha and of the pitch rate."""

    A: np.ndarray
    density: np.ndarray
    start: np.ndarray
    into: np.ndarray


def markov(τ, factors):
    """Gauss-Markov disturbances of both state equations, of `factors` (2,) times the density Q and the time constant τ [s]."""
    density = np.diag(factors * np.diag(Q))
    return Disturbance(-np.eye(2) / τ, density / τ**2, density / (2 * τ), np.eye(2))


def turbulence(severity, altitude=304.8, airspeed=153.0):
    """Dryden's vertical gusts, which change the angle of attack of the air."""
    air = es.Dryden.at(altitude, airspeed, severity=severity)
    step, own = air.model(), slice(1, 3)  # the gust w and its lag
    into = np.column_stack([f16.A[:, 0] * np.rad2deg(1 / airspeed), np.zeros(2)])
    return Disturbance(step.A[own, own], (step.G @ step.G.T)[own, own], air.covariance()[own, own], into)


NONE = Disturbance(np.zeros((0, 0)), np.zeros((0, 0)), np.zeros((0, 0)), np.zeros((2, 0)))


def fly(
    draws, seed, *, amp=10.0, seconds=f16.SECONDS, gain=None, white=1.0, disturbance=NONE, A=f16.A, B=f16.B, along=None,
    offset=0.0, limit=np.inf,
):  # fmt: skip
    """Records of `draws` flights and the gain (T,) or (T, draws). The command is the standard one, `amp` deg/s in size.

    `gain`: from the times to the gain. Process noise: `white` times Q, and a `Disturbance`. `A` (draws, 2, 2), `B` (draws, 2, 1):
    the true matrices; `along`: from the times to a factor of both, as of the dynamic pressure. `offset`: of the measured
    deflection [deg]. `limit`: of the deflection, which the log does not show [deg].
    """
    t = np.arange(round(seconds / DT) + 1) * DT
    rng, command = np.random.default_rng(seed), (amp / 10 * f16.pitch_command(t)[:, None]).T
    K, factor = (np.ones(len(t)) if one is None else one(t) for one in (gain, along))
    (Φ, Γ, W), at = _steps(K, factor, white, disturbance, A, B)
    x = np.zeros((draws, Φ.shape[-1]))
    x[:, 3:] = rng.normal(size=(draws, len(disturbance.start))) @ np.linalg.cholesky(disturbance.start).T
    y, de, logged = np.zeros((len(t), draws, 2)), np.zeros((len(t), draws)), np.zeros(draws)
    sigmas = np.array([f16.SIGMA_ALPHA, f16.SIGMA_Q])
    for k in range(len(t)):
        y[k], de[k] = x[:, :2] + sigmas * rng.normal(size=(draws, 2)), logged
        dec = f16.COMMAND * command[..., k] + y[k] @ f16.FEEDBACK[:2] + f16.FEEDBACK[2] * x[:, 2]
        now = at[k] if Φ.ndim == 3 else (at[k], np.arange(draws))
        logged = Φ[now][..., 2, 2] * logged + Γ[now][..., 2, 0] * dec
        x = np.einsum("...ij,...j->...i", Φ[now], x) + Γ[now][..., 0] * dec[:, None]
        x = x + np.einsum("...ij,...j->...i", W[now], rng.normal(size=x.shape))
        x[:, 2] = np.clip(x[:, 2], -limit, limit)
    records = [
        es.Record(y[:, i], de[:, i] + offset, dt=DT, hold="first_order", outputs=f16.OUTPUTS, inputs=f16.INPUTS)
        for i in range(draws)
    ]
    return records, K


def _steps(K, factor, white, disturbance, A, B):
    """Of each pair of a gain and a factor: the transition of (alpha, q, deflection, disturbance), the effect of the command, and
    a noise factor; and the pair of each row."""
    pairs, at = np.unique(K.T + 1j * factor, return_inverse=True)
    count = 3 + len(disturbance.A)
    F = np.zeros((len(pairs), *np.broadcast_shapes(A.shape[:-2], B.shape[:-2]), count, count))
    gain, factor = (part.reshape(-1, *[1] * (F.ndim - 1)) for part in (pairs.real, pairs.imag))
    F[..., :2, :2], F[..., :2, 2:3], F[..., 2, 2] = factor * A, gain * factor * B, -f16.ACTUATOR
    F[..., :2, 3:], F[..., 3:, 3:] = disturbance.into, disturbance.A
    density, G = np.zeros((count, count)), np.zeros((count, 1))
    density[:2, :2], density[3:, 3:], G[2] = white * Q, disturbance.density, f16.ACTUATOR
    return _discretised(F, G, density), at.reshape(K.T.shape).T


def _discretised(F, G, density):
    """Transition, effect of a held input, and a factor of the noise covariance over a step (Van Loan, 1978)."""
    from scipy.linalg import expm

    count = F.shape[-1]
    M = np.zeros((*F.shape[:-2], 2 * count, 2 * count))
    M[..., :count, :count], M[..., :count, count:], M[..., count:, count:] = -F, density, F.swapaxes(-1, -2)
    M = expm(M * DT)
    Φ = M[..., count:, count:].swapaxes(-1, -2)
    values, vectors = np.linalg.eigh(Φ @ M[..., :count, count:])
    held = np.zeros((*F.shape[:-2], count + 1, count + 1))
    held[..., :count, :count], held[..., :count, count:] = F, G
    return Φ, expm(held * DT)[..., :count, count:], vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]


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
