"""Whether unknown inputs can be known: ranks, zeros, delays, and what a lost output costs."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import StateSpace, UnknownInput, estimate, unknown_input_existence
from estimable.analysis.zeros import invariant_zeros
from estimable.data.record import Record
from estimable.models.prior import Prior
from oracles.unknown_input import maps

A, B = np.diag([0.67, 0.53]), np.array([[1.0], [0.53]])
C, D = np.array([[0.55, 0.11], [0.0, 0.29]]), np.array([[0.4], [0.2]])
EXAMPLE = StateSpace(A, B, C, D, Q=0.08 * np.eye(2), R=0.08 * np.eye(2), dt=1)


def random(seed, n, p, d, D=True):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, n)), rng.normal(size=(n, d)), rng.normal(size=(p, n)), rng.normal(size=(p, d)) * D


@pytest.mark.parametrize("seed", range(10))
def test_zeros_of_a_square_system_are_the_poles_of_its_inverse(seed):
    a, b, c, d = random(seed, 4, 2, 2)
    expected = np.linalg.eigvals(a - b @ np.linalg.solve(d, c))
    found = invariant_zeros(a, b, c, d)
    assert found.normal_rank == 2
    assert_allclose(np.sort_complex(found.values), np.sort_complex(expected), rtol=1e-8)


@pytest.mark.parametrize("seed", range(10))
def test_at_a_zero_the_system_matrix_loses_rank_and_nowhere_else(seed):
    a, b, c, d = random(seed, 5, 2, 2, D=False)
    zeros = invariant_zeros(a, b, c, d)

    def smallest(z):
        return np.linalg.svd(np.block([[z * np.eye(5) - a, -b], [c, d]]), compute_uv=False)[-1]

    assert len(zeros.values) == 3  # n - d where C B is regular
    assert all(smallest(z) < 1e-8 for z in zeros.values)
    assert smallest(0.123 + 0.456j) > 1e-4


def test_a_tall_system_has_the_zeros_that_all_outputs_share():
    rng = np.random.default_rng(3)
    T = rng.normal(size=(3, 3))
    a = T @ np.diag([0.3, 0.6, 1.7]) @ np.linalg.inv(T)
    c = rng.normal(size=(2, 3))
    c = c - c @ np.outer(T[:, 2], np.linalg.inv(T)[2])  # the mode at 1.7 is not seen
    found = invariant_zeros(a, rng.normal(size=(3, 1)), c, np.ones((2, 1)))
    assert_allclose(found.values, [1.7], rtol=1e-9)
    assert invariant_zeros(*random(1, 4, 3, 1)).values.size == 0


def test_the_verdict_of_the_example():
    verdict = unknown_input_existence(EXAMPLE, unknown=["u1"])
    assert verdict.exists
    assert (verdict.method, verdict.delay, verdict.rank_D, verdict.normal_rank) == ("feedthrough", 0, 1, 1)
    assert 0.6 < verdict.spectral_radius < 0.67
    assert 0.6 < verdict.fang_spectral_radius < 0.67
    assert "known at once" in verdict.sentence


def test_square_systems_converge_exactly_where_their_zeros_lie_inside():
    for seed in range(12):
        a, b, c, d = random(seed, 3, 1, 1)
        a = 0.9 * a / np.abs(np.linalg.eigvals(a)).max()
        model = StateSpace(a, b, c, d, Q=np.eye(3), R=np.eye(1), dt=1)
        verdict = unknown_input_existence(model, unknown=[0])
        inside = np.all(np.abs(verdict.zeros) < 1)
        assert verdict.exists == inside
        if inside:  # nothing is left to correct with: errors move as the zeros do
            assert_allclose(verdict.spectral_radius, np.abs(verdict.zeros).max(), rtol=1e-6)


def test_the_spectral_radius_is_the_rate_at_which_two_priors_come_together():
    verdict = unknown_input_existence(EXAMPLE, unknown=[0])
    record = Record(np.zeros((60, 2)), dt=1)
    apart = [
        estimate(UnknownInput(EXAMPLE, unknown=[0]), record, prior=Prior(mean, 0.5 * np.eye(2))).mean
        for mean in ([0.0, 0.0], [1.0, -1.0])
    ]
    gap = np.linalg.norm(apart[1] - apart[0], axis=1)
    assert_allclose((gap[50] / gap[30]) ** (1 / 20), verdict.spectral_radius, rtol=1e-3)


@pytest.mark.parametrize(
    ("c", "d", "delay", "method"),
    [
        ([[0.0, 0.0, 1.0]], 0.0, 1, "no_feedthrough"),
        ([[0.0, 1.0, 0.0]], 0.0, 2, "delayed"),
        ([[1.0, 0.0, 0.0]], 0.0, 3, "delayed"),
        ([[1.0, 0.0, 0.0]], 1.0, 0, "feedthrough"),
    ],
)
def test_the_delay_counts_the_steps_from_input_to_output(c, d, delay, method):
    chain = StateSpace(
        [[0.1, 1.0, 0.0], [0.0, 0.1, 1.0], [0.0, 0.0, 0.1]], [[0.0], [0.0], [1.0]], c, [[d]], R=[[1.0]], dt=1
    )
    verdict = unknown_input_existence(chain, unknown=[0])
    assert (verdict.delay, verdict.method) == (delay, method)


def test_continuous_models_count_derivatives():
    position = StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], dt=0)
    verdict = unknown_input_existence(position, unknown=[0])
    assert verdict.exists
    assert verdict.delay == 2
    assert "after 2 derivatives" in verdict.sentence


def least_delays(model, seen):
    """By definition: d[k] is known from y[0..k'] where no other input would have given the same."""
    T, d = len(seen), model.m
    _, Y = maps(model, tuple(range(d)), T)
    found = np.full((T, d), np.nan)
    for k in range(T):
        for end in range(T - 1, k - 1, -1):
            M = Y[: end + 1].reshape(-1, T * d)[seen[: end + 1].ravel()][:, : (end + 1) * d]
            s, V = np.linalg.svd(M)[1:] if len(M) else (np.zeros(0), np.eye((end + 1) * d))
            free = V[int(np.sum(s > 1e-9)) :]
            for i in range(d):
                if np.abs(free[:, k * d + i]).max(initial=0.0) < 1e-7:
                    found[k, i] = end - k
    return found


@pytest.mark.parametrize("seed", range(8))
def test_with_a_pattern_of_losses_the_delays_are_those_of_the_definition(seed):
    rng = np.random.default_rng(seed)
    shapes = ((2, 2, 1), (3, 2, 1), (3, 3, 2), (2, 2, 2))
    a, b, c, d = random(seed, *shapes[seed % 4], D=seed < 4)
    model = StateSpace(a / np.abs(np.linalg.eigvals(a)).max(), b, c, d, R=np.eye(len(c)), dt=1)
    seen = rng.random((10, len(c))) < 0.75
    verdict = unknown_input_existence(model, unknown=range(model.m), seen=seen)
    assert_allclose(verdict.input_delay, least_delays(model, seen))


def test_what_a_lost_output_costs():
    seen = np.ones((8, 2), bool)
    seen[2] = False
    once = unknown_input_existence(EXAMPLE, unknown=[0], seen=seen)
    assert once.input_delay[:, 0].tolist() == [0, 0, 1, 0, 0, 0, 0, 0]
    assert once.state_known.tolist() == [True] * 8
    seen[3] = False
    twice = unknown_input_existence(EXAMPLE, unknown=[0], seen=seen)
    assert twice.input_delay[:4, 0].tolist() == [0, 0, 3, 2]
    assert not twice.state_known[3:5].any()
    assert twice.state_known[5:].all()
    square = StateSpace(A, B, C[:1], D[:1], R=np.eye(1), dt=1)
    seen = np.ones((8, 1), bool)
    seen[2] = False
    forever = unknown_input_existence(square, unknown=[0], seen=seen)
    assert np.isnan(forever.input_delay[2:]).all()
    assert not forever.state_known[3:].any()
