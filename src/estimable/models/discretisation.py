"""From continuous to discrete time, with the noise that accumulates over a step.

Letters: Φ = e^{A h}; Γ(h) = ∫_0^h e^{A s} ds; Qd(h) = ∫_0^h e^{A s} G Q G' e^{A' s} ds. Products alone, so that complex
matrices give derivatives too (`complex_step`).
Reference: C. F. Van Loan, Computing integrals involving the matrix exponential, IEEE TAC 23 (1978) 395-404.
"""

import numpy as np

from .. import checks
from ..annotations import Numbers

HOLDS = ("zero_order", "first_order")
NODES = 24  # nodes of Gauss's rule over a step
SWEEPS = 20  # at most so many passes over the states, to find their units


def read_steps(dt: Numbers, rows: int | None, faults: checks.Faults):
    """One step length, or one for each row, in seconds; `rows`: the number of rows of a time-varying model."""
    try:
        steps = np.asarray(dt)
    except ValueError:  # ragged
        steps = np.zeros(0)
    if steps.dtype.kind not in "fiu" or steps.size == 0 or not np.all(np.isfinite(steps)) or np.any(steps <= 0):
        faults.add(f"`dt` must be a positive number of seconds. Got {checks.short(dt)}.")
        return np.ones(1)
    if steps.ndim > 1 or (steps.ndim == 1 and rows not in (None, len(steps))):
        because = "" if rows is None else f": the model has {rows} rows in time"
        faults.add(f"`dt` must be one number, or one for each row (T,){because}. Got {steps.shape}.")
    return steps.astype(float)


def over(A: np.ndarray, B: np.ndarray, GQG: np.ndarray, h: Numbers, *, hold: str):
    """Φ, B, B_end (None for a zero-order hold) and Qd over steps h; leading axes of A, B, GQG and h are broadcast."""
    h = np.asarray(h, float)
    size = _sizes(A)
    units = size[..., :, None] / size[..., None, :]  # of Φ: powers of two, so that scaling rounds nothing
    with np.errstate(over="ignore", invalid="ignore"):
        A = A / units
        Φ, Γ, Γ2 = (units * integral for integral in _input_integrals(A, h))
        squares = size[..., :, None] * size[..., None, :]
        Qd = squares * _noise_integral(A, GQG / squares, h)
    if not (np.all(np.isfinite(Φ)) and np.all(np.isfinite(Qd))):
        checks.refuse(
            f"the model overflows within a step of {np.max(h):g} s: its fastest entry is "
            f"{np.abs(A).max():.3g} per second. Are A and dt in seconds?"
        )
    if hold == "zero_order":
        return Φ, Γ @ B, None, Qd
    ramp = Γ2 / np.where(h > 0, h, 1.0)[..., None, None]  # of u[k+1]: ∫ e^{A (h-s)} (s / h) ds
    return Φ, (Γ - ramp) @ B, ramp @ B, Qd


def transition(A: np.ndarray, h: Numbers) -> np.ndarray:
    """Φ over steps h; leading axes of A and h are broadcast."""
    size = _sizes(A)
    units = size[..., :, None] / size[..., None, :]
    return units * exponential(A / units * np.asarray(h, float)[..., None, None])


def _sizes(A: np.ndarray) -> np.ndarray:
    """Powers of two (.., n): the units of the states in which rows and columns of A have similar sizes.

    Osborne's iteration (J. ACM 7, 1960, 338-345). If a row or a column is zero off the diagonal, the diagonal bounds it.
    """
    n = A.shape[-1]
    size, off = np.ones(A.shape[:-1]), np.abs(A) * (1 - np.eye(n))
    least = np.abs(np.diagonal(A, axis1=-2, axis2=-1)).max(axis=-1, initial=0.0)
    for _ in range(SWEEPS):
        moved = False
        for i in range(n):
            row, column = off[..., i, :].sum(-1) + least, off[..., :, i].sum(-1) + least
            known = (row > 0) & (column > 0) & np.isfinite(row) & np.isfinite(column)
            power = np.where(known, np.log2(np.where(known, row, 1.0) / np.where(known, column, 1.0)) / 2, 0.0)
            factor = 2.0 ** np.where(np.abs(power) > 1, np.round(power), 0.0)
            if np.any(factor != 1):
                moved = True
                size[..., i] *= factor
                off[..., i, :] /= factor[..., None]
                off[..., :, i] *= factor[..., None]
        if not moved:
            break
    return size


def wandering(A: np.ndarray, h: np.ndarray, *, hold: str):
    """M (.., n, n, n) of an input error that wanders: ∫_0^h e^{A (h-s)} w(s) ds = Σ_k M_k ε_k, ε unit white.

    w is a Brownian motion of unit diffusion with w(0) = 0. Its end is free for a zero-order hold; for a first-order hold it is
    a bridge to w(h) = 0. By parts, the integral is ∫ Γ(h - s) dw(s); a bridge subtracts the mean of Γ. Gauss's rule turns it
    into a sum, exact to rounding for |A| h up to about 8. Its terms are polynomials in A, so n of them are independent.
    """
    h, n = np.asarray(h, float), A.shape[-1]
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    t = h[..., None] * (1 + nodes) / 2
    _, Γ, _ = _input_integrals(A[..., None, :, :], t)
    if hold == "first_order":
        Γ = Γ - _input_integrals(A, h)[2][..., None, :, :] / h[..., None, None, None]
    terms = (np.sqrt(h[..., None] * weights / 2)[..., None, None] * Γ).reshape(*Γ.shape[:-2], n * n)
    size = np.abs(terms).max(axis=-2, keepdims=True)
    size = np.where(size > 0, size, 1.0)  # entry by entry: the entries of integrators differ by powers of h
    U = np.linalg.svd(np.real(terms / size), full_matrices=False)[0]  # a rotation of the noises, without derivative
    return (np.swapaxes(U[..., :n], -1, -2) @ terms).reshape(*terms.shape[:-2], -1, n, n)


def _input_integrals(A: np.ndarray, h: np.ndarray):
    """Φ, Γ and ∫_0^h Γ(s) ds, from one exponential of [[A h, I, 0], [0, 0, I], [0, 0, 0]], time in units of h."""
    n = A.shape[-1]
    h = h[..., None, None]
    M = np.zeros((*np.broadcast_shapes(A.shape[:-2], h.shape[:-2]), 3 * n, 3 * n), A.dtype)
    M[..., :n, :n] = A * h
    M[..., :n, n : 2 * n] = M[..., n : 2 * n, 2 * n :] = np.eye(n)
    E = exponential(M)
    return E[..., :n, :n], h * E[..., :n, n : 2 * n], h * h * E[..., :n, 2 * n :]


def _noise_integral(A: np.ndarray, GQG: np.ndarray, h: np.ndarray):
    """Qd by Van Loan's exponential over h / 2^s, then s doublings Qd(2h) = Qd(h) + Φ Qd(h) Φ'.

    One exponential over a long step contains e^{-A h}, which overflows if A is stable and fast. Time is in units of the step
    and GQG' in units of its largest entry, so that neither affects the norm of the exponent.
    """
    n = A.shape[-1]
    doublings = _halvings(A * h[..., None, None])
    step = (h / 2.0**doublings)[..., None, None]
    M = np.zeros((*np.broadcast_shapes(A.shape[:-2], GQG.shape[:-2], h.shape), 2 * n, 2 * n), np.result_type(A, GQG))
    size = np.abs(GQG).max(initial=0.0) or 1.0
    M[..., :n, :n], M[..., :n, n:], M[..., n:, n:] = -A * step, GQG / size, np.swapaxes(A, -1, -2) * step
    E = exponential(M)
    Φ = np.swapaxes(E[..., n:, n:], -1, -2)
    Qd = size * step * (Φ @ E[..., :n, n:])  # Van Loan (1.4)
    for _ in range(doublings):
        Qd = Qd + Φ @ Qd @ np.swapaxes(Φ, -1, -2)
        Φ = Φ @ Φ
    return (Qd + np.swapaxes(Qd, -1, -2)) / 2


def exponential(M: np.ndarray):
    """e^M of each matrix of a stack: Taylor's series of M / 2^s at a norm of at most 1/2, squared s times.

    18 terms leave 1e-22. Accurate entry by entry for chains of integrators, whose terms are all positive, where Padé's
    approximation (SciPy's expm) is accurate relative to the largest entry only: it loses a variance of h^7.
    """
    halvings = _halvings(M)
    M = M / 2.0**halvings
    term = np.broadcast_to(np.eye(M.shape[-1]), M.shape)
    E = term
    for k in range(1, 19):
        term = term @ M / k
        E = E + term
    for _ in range(halvings):
        E = E @ E
    return E


def _halvings(M: np.ndarray) -> int:
    """How often M must be halved for a norm of at most 1/2."""
    size = np.abs(M).sum(-1).max(initial=0.0)
    return max(0, int(np.ceil(np.log2(max(size, 1e-300)))) + 1) if np.isfinite(size) else 0
