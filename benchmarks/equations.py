"""W7: Riccati and Lyapunov equations, with residual and time."""

import importlib.util

import numpy as np
import scipy.linalg

from estimable.kernels.riccati import dare, dlyap

from .common import best, row


def riccati(name, n):
    """X = A'X A - A'X B (R + B'X B)^-1 B'X A + Q, two inputs."""
    A, B, Q = _problem(n)
    R = np.eye(2)

    def residual(X):
        AX = A.T @ X
        return AX @ A - AX @ B @ np.linalg.solve(R + B.T @ X @ B, B.T @ AX.T) + Q - X

    contenders = {
        "estimable dare": lambda: dare(A, B, Q, R).X,
        "SciPy solve_discrete_are": lambda: scipy.linalg.solve_discrete_are(A, B, Q, R),
        "slycot sb02od": _slycot("sb02od", n, 2, A, B, Q, R, "D"),
    }
    yield from _compared(name, contenders, residual)


def lyapunov(name, n):
    """X = A X A' + Q."""
    A, _, Q = _problem(n, radius=0.95)
    contenders = {
        "estimable dlyap": lambda: dlyap(A, Q),
        "SciPy solve_discrete_lyapunov": lambda: scipy.linalg.solve_discrete_lyapunov(A, Q),
        "slycot sb03md57": _slycot("sb03md57", A.T, C=-Q, dico="D", trana="N"),
    }
    yield from _compared(name, contenders, lambda X: A @ X @ A.T + Q - X)


def _problem(n, radius=1.02):
    rng = np.random.default_rng(n)
    A = rng.normal(size=(n, n))
    return A * radius / np.abs(np.linalg.eigvals(A)).max(), rng.normal(size=(n, 2)), np.eye(n)


def _slycot(routine, *arguments, **options):
    """A function that returns slycot's X; None where it is not installed."""
    if importlib.util.find_spec("slycot") is None:
        return None
    import slycot

    place = {"sb02od": 0, "sb03md57": 2}[routine]  # of X among what the routine returns

    def run():
        copies = (a.copy(order="F") if isinstance(a, np.ndarray) else a for a in arguments)
        copied = {name: a.copy(order="F") if isinstance(a, np.ndarray) else a for name, a in options.items()}
        return getattr(slycot, routine)(*copies, **copied)[place]

    return run


def _compared(name, contenders, residual):
    for contender, run in contenders.items():
        whose = "ours" if contender.startswith("estimable") else "library"
        if run is None:
            yield row(name, contender, absent="not installed", whose=whose)
            continue
        seconds, first, X = best(run)
        error = float(np.linalg.norm(residual(X)) / np.linalg.norm(X))
        yield row(name, contender, seconds, first, error, whose=whose)
