"""Other forms of a discrete model: the continuous system that it samples, and states with a meaning.

Letters: A = e^(F h), B = ∫ e^(F s) ds B_c over a step h; x' = T x.
Reference: N. Higham, Functions of Matrices (2008), th. 1.31, for the real logarithm; B. Moore (1981) for balanced states.
"""

from typing import Any

import numpy as np

from .. import checks
from .discretisation import over

FORMS = ("outputs", "balanced", "modal")
NONE = 1e-10  # modulus of a pole that has no logarithm
ALIASED = 2 * np.pi / 3  # radians a step, above which a pole may be an alias


def continuous_matrices(
    A: np.ndarray, B: np.ndarray, B_end: np.ndarray | None, h: float, hold: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """F, B_c and B_end of first-order hold per B_c = I. Refuses A without a real logarithm, or with a pole that may be an alias.

    `B_end` (n, m): the effect of u[k+1] on x[k+1]; None or zero where D has it.
    """
    from scipy.linalg import logm

    poles = np.linalg.eigvals(A)
    negative = (np.abs(poles.imag) < NONE) & (poles.real < NONE)
    if negative.any():
        worst = float(poles[negative].real.min())
        checks.refuse(
            f"the model samples no continuous system: it has a pole at {worst:.4g}, and e^(F h) has none at 0 or below. A dead "
            "time is no pole: leave it out of the model, and delay the input. Or lower the order."
        )
    if (fastest := float(np.abs(np.angle(poles)).max(initial=0.0))) > ALIASED:
        checks.refuse(
            f"a pole turns by {np.degrees(fastest):.0f} degrees a step: it may be the alias of a faster one. Sample faster."
        )
    F = np.real(np.asarray(logm(A))) / h
    n = len(A)
    _, Γ, later, _ = over(F, np.eye(n), np.zeros((n, n)), h, hold=hold)
    ramp = np.zeros((n, n)) if later is None else later
    if hold == "zero_order":
        return F, np.linalg.solve(Γ, B), np.zeros((n, n))
    if B_end is not None and np.any(B_end):
        return F, np.linalg.solve(Γ + ramp, B + B_end), np.zeros((n, n))
    # with ξ = x - B_end u, u[k] enters ξ[k+1] by B + A B_end
    return F, np.linalg.solve(Γ + A @ ramp, B), ramp


def noise_density(F: np.ndarray, A: np.ndarray, Q: np.ndarray) -> np.ndarray | None:
    """Q_c with ∫ e^(F s) Q_c e^(F's) ds = Q over a step: A Q_c A' - Q_c = F Q + Q F'. None where no noise has that sum."""
    n = len(A)
    right = F @ Q + Q @ F.T
    found = np.linalg.lstsq(np.kron(A, A) - np.eye(n * n), right.ravel(), rcond=1e-12)[0].reshape(n, n)
    found = (found + found.T) / 2
    size = max(float(np.abs(np.diagonal(found)).max(initial=0.0)), np.finfo(float).tiny)
    return found if np.linalg.eigvalsh(found).min(initial=0.0) > -1e-9 * size else None


def coordinates(A: np.ndarray, B: np.ndarray, C: np.ndarray, form: str) -> np.ndarray:
    """T (n, n) of x' = T x."""
    return {"outputs": _outputs, "balanced": _balanced, "modal": _modal}[form](A, B, C)


def _outputs(A: np.ndarray, B: np.ndarray, C: np.ndarray) -> np.ndarray:
    """The first independent rows of C, CA, ..: the first states are the outputs without noise."""
    rows: list[np.ndarray] = []
    block = C
    for _ in range(len(A)):
        for row in block:
            trial = np.array([*rows, row])
            scaled = trial / np.maximum(np.linalg.norm(trial, axis=1, keepdims=True), np.finfo(float).tiny)
            if len(rows) < len(A) and np.linalg.svd(scaled, compute_uv=False)[-1] > 1e-9:
                rows.append(row)
        block = block @ A
    if len(rows) < len(A):
        checks.refuse(
            f"the outputs show {len(rows)} of {checks.counted(len(A), 'state')}: reduce(model) first, or take another form."
        )
    return np.array(rows)


def _balanced(A: np.ndarray, B: np.ndarray, C: np.ndarray) -> np.ndarray:
    """States of equal controllability and observability Gramians."""
    from scipy.linalg import solve_discrete_lyapunov

    if np.abs(np.linalg.eigvals(A)).max(initial=0.0) >= 1:
        checks.refuse("only a stable model has balanced states. Take another form.")
    L, M = (_root(np.asarray(solve_discrete_lyapunov(*pair))) for pair in ((A, B @ B.T), (A.T, C.T @ C)))
    U, s, _ = np.linalg.svd(L.T @ M)
    if s[-1] < 1e-12 * s[0]:
        checks.refuse("some state is not excited by the inputs, or not shown by the outputs: reduce(model) first.")
    return (U * np.sqrt(s)).T @ np.linalg.inv(L)


def _root(P: np.ndarray) -> np.ndarray:
    """L with L L' = P."""
    values, vectors = np.linalg.eigh((P + P.T) / 2)
    return vectors * np.sqrt(np.maximum(values, np.finfo(float).tiny))


def _modal(A: np.ndarray, B: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Real modes: one state for a real pole, two for a complex pair."""
    λ, V = np.linalg.eig(A)
    columns: list[Any] = []
    for i, pole in enumerate(λ):
        if pole.imag == 0:
            columns.append(np.real(V[:, i]))
        elif pole.imag > 0:
            columns += [np.real(V[:, i]), np.imag(V[:, i])]
    W = np.column_stack(columns)
    if np.linalg.cond(W / np.linalg.norm(W, axis=0)) > 1e8:
        checks.refuse("the model has repeated poles, and no modes. Take another form.")
    return np.linalg.inv(W)
