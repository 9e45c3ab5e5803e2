"""The decay of the norm of A^k or e^{At}, and the distance of A from instability. NumPy, outside jit.

Letters: a_k = ||A^k|| (continuous: ||e^{A h k}||), all norms spectral; λ a decay rate, γ(λ) its overshoot.

References: R. W. Bass, Satellite Navigation Technical Exchange (2005), ρ; D. Hinrichsen, A. J. Pritchard, Systems & Control
Letters 7 (1986) 1, the complex stability radius; N. A. Bruinsma, M. Steinbuch, ibid. 14 (1990) 287, its computation.
"""

from bisect import bisect_left
from typing import NamedTuple

import numpy as np

from ..frozen import saved
from .shapes import Float

Real = np.ndarray
SMALLEST = 1e-13      # of the norm at the start: later terms change no sum
MOST = 20_000         # powers computed
FINE = 0.01           # ||A|| h, the first step in continuous time
BENT = 0.001          # of the norm: largest deviation from a straight line between two times
CHUNK = 500           # powers made at once
ON_AXIS = 1e-7        # of its size: an eigenvalue this near the axis or the circle counts as on it


def norms(A: Float[Real, "n n"]) -> Float[Real, " k"]:
    """||A^k|| for k = 0, 1, .. until they are below `SMALLEST`, at most `MOST` of them."""
    block = [np.eye(len(A))]
    for _ in range(CHUNK - 1):
        block.append(block[-1] @ A)
    stack, leap = np.array(block), block[-1] @ A
    found = []
    for _ in range(MOST // CHUNK):
        found.append(np.linalg.norm(stack, ord=2, axis=(-2, -1)))
        small = found[-1] < SMALLEST
        if small.any():
            found[-1] = found[-1][: np.argmax(small) + 1]
            break
        stack = stack @ leap
    return np.concatenate(found)


@saved
class Course(NamedTuple):
    """Norms a (k,) at times t (k,). Between two times the norm is at most ε (k - 1,) above the straight line through both
    norms, and at most e^{ωs} times the first norm, s after it. Discrete time has nothing between two samples."""

    t: Real
    a: Real
    ε: Real
    ω: float


def course(A: Float[Real, "n n"]) -> Course:
    """||e^{At}|| until it is below `SMALLEST`, at growing steps, with a bound for the times between.

    e^{At} leaves the straight line between two of its values by h²/8 max ||A² e^{At}|| at most (Taylor), and the maximum over
    a step is g ||A² e^{At}|| of its start, g the largest norm of e^{As} up to s = h: e^{ωh}, or a value found before.
    """
    from scipy.linalg import expm

    ω = float(np.linalg.eigvalsh((A + A.T) / 2)[-1])                       # logarithmic norm: ||e^{At}|| <= e^{ωt}
    h, A2 = float(FINE / np.linalg.norm(A, 2)), A @ A
    leaps = [expm(A * h)]
    M, j = np.eye(len(A)), 0
    t, a, ε, largest = [0.0], [1.0], [0.0], [1.0]                          # largest: the norm's bound up to each time

    def growth(step: float) -> float:
        """A bound on ||e^{As}|| up to s = step."""
        known = largest[bisect_left(t, step)] if step <= t[-1] else np.inf
        return min(known, float(np.exp(min(max(ω, 0.0) * step, 700.0))))

    while a[-1] > SMALLEST and len(t) < MOST:
        bend = float(np.linalg.norm(A2 @ M)) / 8
        j += 1                                                             # at most twice the step before, or as small as needed
        while j > 0 and (h * 2.0**j) ** 2 * growth(h * 2.0**j) * bend > BENT * a[-1]:
            j -= 1
        while len(leaps) <= j:
            leaps.append(leaps[-1] @ leaps[-1])
        step = h * 2.0**j
        M = leaps[j] @ M
        ε.append(step**2 * growth(step) * bend)
        a.append(float(np.linalg.norm(M, 2)))
        t.append(t[-1] + step)
        largest.append(max(largest[-1], a[-2] + ε[-1], a[-1] + ε[-1]))
    return Course(np.array(t), np.array(a), np.array(ε[1:]), ω)


def singular_value(A: Float[Real, "n n"], θ: float, continuous: bool) -> float:
    """The smallest singular value of zI - A at z = iθ (continuous) or e^{iθ}."""
    z = 1j * θ if continuous else np.exp(1j * θ)
    return float(np.linalg.svd(z * np.eye(len(A)) - A, compute_uv=False)[-1])


def crossings(A: Float[Real, "n n"], σ: float, continuous: bool) -> Float[Real, " k"]:
    """Where σ is a singular value of zI - A: θ of the eigenvalues on the axis (continuous) or on the circle, sorted.

    (zI - A) v = σ u and (zI - A)* u = σ v are an eigenvalue problem in (v, u), of a Hamiltonian or a symplectic pencil.
    """
    from scipy.linalg import eigvals

    identity, zero = np.eye(len(A)), np.zeros_like(A)
    if continuous:
        z = np.asarray(eigvals(np.block([[A, σ * identity], [-σ * identity, -A.T]])))
        return np.sort(np.imag(z)[np.abs(np.real(z)) < ON_AXIS * np.linalg.norm(A, 2)])
    left, right = [[A, σ * identity], [zero, identity]], [[identity, zero], [σ * identity, A.T]]
    z = np.asarray(eigvals(np.block(left), np.block(right)))
    return np.sort(np.angle(z[np.abs(np.abs(z) - 1) < ON_AXIS]))


def nearest_instability(A: Float[Real, "n n"], continuous: bool, tolerance: float = 1e-10) -> tuple[float, float]:
    """The complex stability radius, min over θ of the smallest singular value of zI - A, and its θ."""
    poles = np.linalg.eigvals(A)
    θs = np.concatenate([[0.0] if continuous else [0.0, np.pi], np.abs(poles.imag if continuous else np.angle(poles))])
    values = [singular_value(A, θ, continuous) for θ in θs]
    best, at = min(values), float(θs[int(np.argmin(values))])
    for _ in range(50):
        θs = crossings(A, best * (1 - tolerance), continuous)
        if len(θs) < 2:
            break
        middles = (θs[1:] + θs[:-1]) / 2
        values = [singular_value(A, θ, continuous) for θ in middles]
        if min(values) >= best * (1 - tolerance):
            break
        best, at = min(values), float(abs(middles[int(np.argmin(values))]))
    return best, at
