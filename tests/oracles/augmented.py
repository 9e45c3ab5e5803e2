"""(x, θ) written by hand as one time-varying state: what the library does not do."""

import numpy as np

from estimable import Prior, StateSpace


def augmented(model, gain, directions, fixed, feedthrough, walk, u):
    """(x, θ) as a time-varying model with no unknown left; `walk` is a covariance per step."""
    n, p, T = model.n, gain.size, len(u)
    A, C = np.zeros((T, n + p, n + p)), np.zeros((T, model.p, n + p))
    for k in range(T):
        A[k] = np.block([[model.A, (directions @ u[k]).T], [np.zeros((p, n)), np.eye(p)]])
        C[k] = np.hstack([model.C, (feedthrough @ u[k]).T])
    G = np.block([[model.G, np.zeros((n, p))], [np.zeros((p, model.G.shape[1])), np.eye(p)]])
    q = model.Q.shape[0]
    Q = np.block([[model.Q, np.zeros((q, p))], [np.zeros((p, q)), walk]])
    S = None if model.S is None else np.vstack([model.S, np.zeros((p, model.p))])
    B = np.vstack([fixed, np.zeros((p, model.m))])
    return StateSpace(A, B, C, model.D, Q=Q, G=G, R=model.R, S=S, dt=model.dt)


def together(prior, gain):
    n, p = prior.size, gain.size
    P = np.block([[prior.covariance, np.zeros((n, p))], [np.zeros((p, n)), gain.covariance]])
    return Prior(np.concatenate([prior.mean, gain.mean]), P)
