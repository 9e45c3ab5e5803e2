"""Riccati and Lyapunov equations: published exact solutions, SciPy, and what must hold whatever the numbers are."""

import json
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

from estimable import AssumptionError
from estimable.kernels.riccati import care, clyap, dare, dlyap

KNOWN = Path(__file__).parents[3] / "shared" / "data" / "known-answers.json"
SHIFT = np.eye(5, k=1)
LAUB = np.array([[4.0, 3.0], [-4.5, -3.5]]), np.array([[1.0], [-1.0]]), np.array([[9.0, 6.0], [6.0, 4.0]])
INTEGRATOR, FORCE = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])

DISCRETE = {  # DAREX, J. Abels & P. Benner, SLICOT Working Note 1999-14: example: A, B, Q, R, X
    "1.1 Laub": (*LAUB, np.eye(1), (1 + 5**0.5) / 2 * LAUB[2]),
    "1.3 Jonckheere": (INTEGRATOR, FORCE, np.array([[1.0, 2.0], [2.0, 4.0]]), np.eye(1),
                       np.array([[1.0, 2.0], [2.0, 2 + 5**0.5]])),
    "2.1 Laub, R = 1e6": (*LAUB, 1e6 * np.eye(1), (1 + (1 + 4e6) ** 0.5) / 2 * LAUB[2]),
    "2.3 Kenney, Laub & Wette": (1e6 * INTEGRATOR, FORCE, np.eye(2), np.eye(1), np.diag([1.0, 1 + 1e12])),
    "4.1 Pappas, Laub & Sandell": (SHIFT, np.eye(5)[:, 4:], np.eye(5), np.eye(1), np.diag([1.0, 2.0, 3.0, 4.0, 5.0])),
    "R singular": (np.array([[2.0]]), np.eye(1), np.eye(1), np.zeros((1, 1)), np.eye(1)),
    "an unstable mode that costs nothing": (np.array([[2.0]]), np.eye(1), np.zeros((1, 1)), np.eye(1), 3 * np.eye(1)),
}  # fmt: skip
E6 = (1 + 1e-12) ** 0.5
CONTINUOUS = {  # CAREX, J. Abels & P. Benner, SLICOT Working Note 1999-16: example: A, B, Q, R, X
    "1.1": (INTEGRATOR, FORCE, np.diag([1.0, 2.0]), np.eye(1), np.array([[2.0, 1.0], [1.0, 2.0]])),
    "1.2 Laub": (*LAUB, np.eye(1), (1 + 2**0.5) * LAUB[2]),
    "2.1 Arnold & Laub, almost not stabilisable": (
        np.diag([1.0, -2.0]), np.array([[1e-6], [0.0]]), np.ones((2, 2)), np.eye(1),
        np.array([[(1 + E6) / 1e-12, 1 / (2 + E6)], [1 / (2 + E6), (1 - 1e-12 / (2 + E6) ** 2) / 4]]),
    ),
    "2.3 Kenney, Laub & Wette": (
        1e6 * INTEGRATOR, FORCE, np.eye(2), np.eye(1),
        np.array([[(1 + 2e6) ** 0.5 / 1e6, 1.0], [1.0, (1 + 2e6) ** 0.5]]),
    ),
}  # fmt: skip


def problem(seed, n=6, m=2, *, size=1.3):
    """Random data with a cross term, [[Q, N], [N', R]] positive definite."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    A *= size / np.abs(np.linalg.eigvals(A)).max()
    joint = rng.normal(size=(n + m, n + m))
    joint = joint @ joint.T
    return A, rng.normal(size=(n, m)), joint[:n, :n], joint[n:, n:], joint[:n, n:]


def relative(X, Y):
    return np.linalg.norm(X - Y) / np.linalg.norm(Y)


@pytest.mark.parametrize("name", DISCRETE)
def test_discrete_problems_with_exact_solutions(name):
    A, B, Q, R, exact = DISCRETE[name]
    X, K, F = dare(A, B, Q, R)
    assert relative(X, exact) < (1e-11 if "1e6" in name else 1e-13)  # there a closed-loop pole is at 1 - 1e-3
    assert np.allclose(F, A - B @ K, rtol=1e-12, atol=1e-12 * np.abs(F).max())
    assert np.abs(np.linalg.eigvals(F)).max() < 1


@pytest.mark.parametrize("name", CONTINUOUS)
def test_continuous_problems_with_exact_solutions(name):
    A, B, Q, R, exact = CONTINUOUS[name]
    X, K, F = care(A, B, Q, R)
    assert relative(X, exact) < 1e-13
    assert np.linalg.eigvals(F).real.max() < 0


@pytest.mark.skipif(not KNOWN.exists(), reason="the shared data are not beside this checkout")
def test_discrete_solutions_computed_by_slicot():
    cases = [case for case in json.loads(KNOWN.read_text()) if case["topic"] == "DARE exact solution"]
    assert len(cases) >= 2
    for case in cases:
        given = {name: np.array(value) for name, value in case["inputs"].items()}
        X = dare(given["A"], given["B"], given["Q"], given["R"], given["S"]).X
        assert relative(X, np.array(case["expected"]["X"])) < 1e-11


@pytest.mark.parametrize("seed", range(5))
def test_riccati_solutions_agree_with_scipy(seed):
    A, B, Q, R, N = problem(seed)
    assert relative(dare(A, B, Q, R, N).X, scipy.linalg.solve_discrete_are(A, B, Q, R, s=N)) < 1e-11
    assert relative(care(A, B, Q, R, N).X, scipy.linalg.solve_continuous_are(A, B, Q, R, s=N)) < 1e-11


def test_the_value_is_the_limit_of_the_recursion():
    A, B, Q, R, N = problem(7, size=0.9)
    X = np.zeros_like(Q)
    for _ in range(400):
        V = A.T @ X @ B + N
        X = A.T @ X @ A - V @ np.linalg.solve(R + B.T @ X @ B, V.T) + Q
    assert relative(dare(A, B, Q, R, N).X, X) < 1e-12


@pytest.mark.parametrize("scale", [1e-8, 1e8])
def test_units_do_not_matter(scale):
    A, B, Q, R, N = problem(3)
    D = np.diag([1.0, scale, 1.0, 1 / scale, 1.0, 1.0])
    D_inverse = np.diag(1 / np.diagonal(D))
    for solve in (dare, care):
        X = solve(A, B, Q, R, N).X
        turned = solve(D @ A @ D_inverse, D @ B, D_inverse @ Q @ D_inverse, R, D_inverse @ N).X
        size = np.sqrt(np.diagonal(X))
        assert np.all(np.abs(D @ turned @ D - X) <= 1e-9 * size[:, None] * size)


@pytest.mark.parametrize("seed", range(3))
def test_lyapunov_solutions_agree_with_scipy_and_are_semidefinite(seed):
    A, _, Q, _, _ = problem(seed, size=0.99)
    X = dlyap(A, Q)
    assert relative(X, scipy.linalg.solve_discrete_lyapunov(A, Q)) < 1e-11
    assert np.linalg.eigvalsh(X)[0] > 0
    A = A - 1.2 * np.eye(len(A))
    X = clyap(A, Q)
    assert relative(X, scipy.linalg.solve_continuous_lyapunov(A, -Q)) < 1e-11
    assert np.linalg.eigvalsh(X)[0] > 0


def test_slow_and_fast_modes_together():
    poles = -np.array([1e-6, 1e-3, 1.0, 1e3, 1e6])
    assert np.allclose(clyap(np.diag(poles), np.ones((5, 5))), -1 / (poles[:, None] + poles), rtol=1e-9, atol=0)
    poles = 1 - np.array([1e-6, 1e-3, 0.5])
    assert np.allclose(dlyap(np.diag(poles), np.eye(3)), np.diag(1 / (1 - poles**2)), rtol=1e-9, atol=0)


def test_what_has_no_solution_is_refused_with_the_number():
    with pytest.raises(AssumptionError, match=r"largest modulus of an eigenvalue is 1\.1, not < 1"):
        dlyap(np.diag([1.1, 0.5]), np.eye(2))
    with pytest.raises(AssumptionError, match="largest modulus of an eigenvalue is 1, not < 1"):
        dlyap(np.diag([1.0, 0.5]), np.diag([0.0, 1.0]))
    with pytest.raises(AssumptionError, match=r"largest real part of an eigenvalue is 0\.5, not < 0"):
        clyap(np.diag([0.5, -1.0]), np.eye(2))
    with pytest.raises(AssumptionError, match="largest real part of an eigenvalue is 0, not < 0"):
        clyap(np.zeros((2, 2)), np.eye(2))
    for solve, unstable in ((dare, 1.5), (care, 0.5)):
        with pytest.raises(AssumptionError, match="no stabilising solution"):
            solve(np.diag([unstable, 0.1]), np.array([[0.0], [1.0]]), np.eye(2), np.eye(1))
