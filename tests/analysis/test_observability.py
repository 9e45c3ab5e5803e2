"""Observability and reachability: textbook ranks, duality, unstable parts, Gramians."""

import numpy as np
import pytest
import scipy.linalg

from cases import case
from estimable import StateSpace, observability, reachability


def test_textbook_ranks_on_random_models():
    rng = np.random.default_rng(0)
    for _ in range(20):
        n, k = 5, int(rng.integers(0, 3))
        A = np.triu(rng.integers(-2, 3, size=(n, n)).astype(float))
        A[: n - k, n - k :] = 0
        C = rng.integers(1, 4, size=(1, n)).astype(float)
        C[:, n - k :] = 0
        outputs = np.vstack([C @ np.linalg.matrix_power(A, i) for i in range(n)])
        rank = np.linalg.matrix_rank(outputs)
        seen = observability(StateSpace(A, C=C, dt=1))
        assert seen.observable == (rank == n)
        assert len(seen.directions) == n - rank
        assert np.abs(outputs @ seen.directions.T).max(initial=0.0) < 1e-8 * np.abs(outputs).max()
        assert np.allclose(
            seen.singular_values, np.linalg.svd(outputs, compute_uv=False), atol=1e-9 * np.abs(outputs).max()
        )


@pytest.mark.parametrize("dt", [1.0, 0.0])
def test_what_is_hidden_may_not_die_out(dt):
    rng = np.random.default_rng(1)
    spiral = np.array([[1.0, 1.0], [-1.0, 1.0]])  # unstable either way
    A = scipy.linalg.block_diag(spiral, 0.5 * np.eye(1) if dt else -np.eye(1), -0.2 * np.eye(1))
    T = rng.normal(size=(4, 4))
    C = np.array([[0.0, 0.0, 0.0, 1.0]]) @ T
    seen = observability(StateSpace(np.linalg.solve(T, A @ T), C=C, dt=dt))
    assert (seen.observable, seen.detectable) == (False, False)
    assert len(seen.directions) == 3
    assert len(seen.unstable_directions) == 2
    assert np.allclose(
        T @ seen.unstable_directions.T * [[0], [0], [1], [1]], 0, atol=1e-9
    )  # in the plane of the spiral
    assert sorted(np.round(seen.hidden_modes, 9), key=lambda z: (z.real, z.imag))[-1] == pytest.approx(1 + 1j)
    assert "does not die out by itself" in seen.sentences[-1]


def test_what_is_hidden_and_dies_out():
    model = StateSpace(np.diag([1.2, 0.5]), [[1.0], [0.0]], C=[[1.0, 0.0]], Q=np.diag([0.0, 1.0]), dt=1)
    seen, moved, disturbed = observability(model), reachability(model), reachability(model, by="noise")
    assert (seen.observable, seen.detectable, moved.reachable, moved.stabilisable) == (False, True, False, True)
    assert (disturbed.reachable, disturbed.stabilisable) == (False, False)
    assert seen.sentences == ("x2 never shows in y1.", "It dies out by itself.")
    assert moved.sentences == ("x2 is not moved by u1.", "It dies out by itself.")
    assert disturbed.sentences == ("x1 is not moved by process noise.", "x1 does not die out by itself.")


@pytest.mark.parametrize("horizon", [None, 4])
def test_duality(horizon):
    model = case(2, (4, 1, 3), feedthrough=False).model
    model = StateSpace(model.A, C=model.C, dt=1)  # R would give the units of the sensors
    seen = observability(model, horizon=horizon)
    moved = reachability(StateSpace(model.A.T, model.C.T, dt=1), horizon=horizon)
    assert np.allclose(seen.singular_values, moved.singular_values, rtol=1e-12)
    assert np.allclose(seen.gramian, moved.gramian, rtol=1e-12)
    assert seen.distance == moved.distance


def test_gramians():
    model = case(0, T=5, varying=True, feedthrough=False).model
    Φ, seen = np.eye(3), np.zeros((3, 3))
    moved = np.zeros((3, 3))
    for k in range(5):
        seen += Φ.T @ model.C[k].T @ model.C[k] @ Φ
        moved = model.A[k] @ moved @ model.A[k].T + model.B[k] @ model.B[k].T
        Φ = model.A[k] @ Φ
    assert np.allclose(observability(model).gramian, seen, rtol=1e-12)
    assert np.allclose(reachability(model).gramian, moved, rtol=1e-12)
    chain = StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], C=[[1.0, 0.0]], dt=0)
    t = 2.0
    assert np.allclose(observability(chain, horizon=t).gramian, [[t, t**2 / 2], [t**2 / 2, t**3 / 3]], rtol=1e-12)
    assert np.allclose(reachability(chain, horizon=t).gramian, [[t**3 / 3, t**2 / 2], [t**2 / 2, t]], rtol=1e-12)
    assert observability(chain).gramian is None
    assert observability(chain).detectable
    stable = StateSpace([[0.5]], C=[[1.0]], dt=1)
    assert np.allclose(observability(stable).gramian, 4 / 3, rtol=1e-14)


def test_units_do_not_decide():
    model = case(1, feedthrough=False).model
    scaled = model.in_basis(np.diag([2.0**30, 1.0, 2.0**-30]))
    assert observability(scaled).verdict == reachability(scaled).verdict == "yes"
    hidden = StateSpace(scaled.A, C=np.zeros((1, 3)), dt=1)
    assert len(observability(hidden).directions) == 3


def test_nearly_hidden_is_borderline():
    model = StateSpace(np.diag([0.5, 0.5 + 1e-10]), [[1.0], [1.0]], C=[[1.0, 1.0]], dt=1)
    assert observability(model).verdict == reachability(model).verdict == "borderline"
    assert "rounding could hide" in observability(model).sentences[0]
    assert observability(StateSpace(np.diag([0.5, 0.5]), C=[[1.0, 1.0]], dt=1)).verdict == "no"


def test_no_input_moves_nothing():
    assert reachability(StateSpace([[0.5]], dt=1)).sentences == (
        "x1 is not moved by any input.",
        "It dies out by itself.",
    )


def test_the_unit_of_a_sensor_does_not_turn_the_verdict():
    """With R, which carries the unit; the second sensor alone shows the second state."""
    for unit in (1.0, 1e-12, 1e12):
        model = StateSpace(np.diag([0.5, 0.8]), C=np.diag([1.0, unit]), R=np.diag([1.0, unit**2]), dt=1)
        assert observability(model).verdict == "yes"
