"""Models that are hard to judge: stable, marginal, defective, and near to hiding a direction."""

import numpy as np

from estimable import Prior, StateSpace

KINDS = ("stable", "marginal", "defective", "singular", "near", "hidden")


def drawn(seed):
    """A model, a prior and how it was made; n from 1 to 8."""
    rng = np.random.default_rng(seed)
    n, p, kind = int(rng.integers(1, 9)), int(rng.integers(1, 3)), KINDS[seed % len(KINDS)]
    F, C, start = getattr(_Make, kind)(rng, n, p)
    q = int(rng.integers(1, n + 1))
    G = np.diag(rng.uniform(0.5, 2, n)) if kind in ("near", "hidden") else rng.normal(size=(n, q))
    model = StateSpace(F, C=C, G=G, Q=np.eye(G.shape[1]), R=0.1 * np.eye(p), dt=1)
    return model, Prior(np.zeros(n), start), kind


class _Make:
    """F, C and the covariance at the start of each kind."""

    @staticmethod
    def stable(rng, n, p):
        F = rng.normal(size=(n, n))
        return F * (0.9 / np.abs(np.linalg.eigvals(F)).max()), rng.normal(size=(p, n)), np.eye(n)

    @staticmethod
    def marginal(rng, n, p):
        F, C, start = _Make.stable(rng, n, p)
        return F / np.abs(np.linalg.eigvals(F)).max(), C, start

    @staticmethod
    def defective(rng, n, p):
        T = np.round(rng.normal(size=(n, n)), 1) + 3 * np.eye(n)
        return T @ (0.5 * np.eye(n) + np.eye(n, k=1)) @ np.linalg.inv(T), rng.normal(size=(p, n)), np.eye(n)

    @staticmethod
    def singular(rng, n, p):
        F, C, _ = _Make.stable(rng, n, p)
        F[:, -1] = 0
        return F, C, np.diag(rng.integers(0, 2, size=n).astype(float))

    @staticmethod
    def near(rng, n, p):
        """Two parts that move apart; the second is seen, and joined to the first, by 10^-e only."""
        F, C, start = _Make.stable(rng, n, p)
        e, k = rng.uniform(4, 15), max(n // 2, 1)
        F[:k, k:] = F[k:, :k] = 0
        C[:, k:] *= 10**-e
        return F, C, start

    @staticmethod
    def hidden(rng, n, p):
        """The last states are not seen at all."""
        F, C, start = _Make.stable(rng, n, p)
        k = n // 2
        F[:k, k:] = F[k:, :k] = 0
        C[:, k:] = 0
        return F, C, start
