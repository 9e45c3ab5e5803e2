"""Random well-posed problems, from a seed and sizes."""

from typing import NamedTuple

import numpy as np

from estimable import Prior, Record, StateSpace, catalogue

SIZES = ((1, 1, 1), (2, 1, 1), (3, 2, 2), (4, 1, 3))  # n, m, p: few, so that little is compiled


SHORT = {  # settings of the catalogue's for few rows, and those that have no default
    "moving-window": {"length": 3},
    "change-detection": {"slots": 5, "levels": 2},
    "mixture": {"algorithm": "unknown-gain"},
    "alpha-beta": {"alpha": 0.5, "beta": 0.2},
    "fixed-gain": {"filter": [[0.3, 0.1], [-0.1, 0.2]]},
}


def file_for(name, file):
    """A model file as an entry takes it: the nonlinear filters refuse the [gain] of a linear model, a tracker needs a track."""
    if name == "alpha-beta":
        track = StateSpace([[0.0, 1.0], [0.0, 0.0]], C=[[1.0, 0.0]], G=[[0.0], [1.0]], Q=[[0.1]], R=[[9e-4]], dt=0,
                           states=file.model.states, outputs=file.model.outputs[:1])  # fmt: skip
        return file._replace(model=track if file.model.is_continuous else track.discretise(file.model.dt))
    return file._replace(gain=None) if name in catalogue.NONLINEAR else file


class Case(NamedTuple):
    model: StateSpace
    prior: Prior
    record: Record
    rng: np.random.Generator


def covariance(rng, n, rank=None):
    M = rng.normal(size=(n, rank or n))
    return M @ M.T / n + (0.1 * np.eye(n) if rank is None else 0.0)


def case(seed, sizes=(3, 2, 2), T=12, *, missing=0.3, cross=False, varying=False, feedthrough=True, singular=False):
    """A stable model with every feature that is asked for, a prior, and a record drawn at random (not from the model)."""
    rng = np.random.default_rng(seed)
    n, m, p = sizes
    lead = (T,) if varying else ()
    A = rng.normal(size=(*lead, n, n))
    A = A * (0.95 / np.abs(np.linalg.eigvals(A)).max(-1))[..., None, None]
    q = n + 1
    joint = covariance(rng, q + p)
    Q, R = joint[:q, :q], joint[q:, q:]
    if singular:
        R = covariance(rng, p, rank=max(p - 1, 1)) if p > 1 else np.zeros((1, 1))
    model = StateSpace(
        A, rng.normal(size=(*lead, n, m)), rng.normal(size=(*lead, p, n)),
        rng.normal(size=(p, m)) if feedthrough else None, G=rng.normal(size=(n, q)), Q=Q, R=R,
        S=joint[:q, q:] if cross and not singular else None, dt=0.5,
    )  # fmt: skip
    y = rng.normal(size=(T, p)) * 3
    y[rng.random((T, p)) < missing] = np.nan
    prior = Prior(rng.normal(size=n), covariance(rng, n))
    return Case(model, prior, Record(y, rng.normal(size=(T, m)), dt=0.5), rng)
