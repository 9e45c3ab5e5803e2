"""Fang (2009) (3.12)-(3.17) as printed, for one input and one output, in a loop."""

import numpy as np


def printed_recursion(y, u, na, nb, noise_variance, P):
    """θ (T, d) after each sample, z and x; y is NaN where it was lost, u what was applied."""
    θ, x_past, u_past = np.zeros(len(P)), np.zeros(na), np.zeros(nb + 1)
    found = []
    for k in range(len(y)):
        u_past = np.append(u[k], u_past[:-1])
        φ = np.append(-x_past, u_past)
        z = φ @ θ if np.isnan(y[k]) else y[k]
        if not np.isnan(y[k]):
            s = noise_variance + φ @ P @ φ
            θ = θ + P @ φ / s * (z - φ @ θ)
            P = P - np.outer(P @ φ, P @ φ) / s
        x = φ @ θ
        x_past = np.append(x, x_past)[:na]
        found.append((θ, z, x))
    return tuple(np.array(column) for column in zip(*found, strict=True))
