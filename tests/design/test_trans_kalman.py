"""Trans-Kalman designs: against the Kalman filter, dense sampling of the set, and searches over grids of gains."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cases import case, covariance
from estimable import (
    AssumptionError,
    InputError,
    StateSpace,
    alpha_beta_covariance,
    filter_covariance,
    kalman_gain,
    trans_kalman,
)
from estimable.design.trans_kalman import CRITERIA
from estimable.frozen import replace

TRACK = StateSpace([[1.0, 1.0], [0.0, 1.0]], C=[[1.0, 0.0]], Q=np.zeros((2, 2)), R=[[1.0]], dt=1)
ACCELERATION = np.array([[1 / 3, 1 / 2], [1 / 2, 1]])


def tracks(*densities):
    """Corners (Q, R) of a track whose acceleration and measurement noise have these densities."""
    return [(a * ACCELERATION, [[float(s)]]) for a, s in densities]


def problem(seed, corners, sizes=(3, 2, 2)):
    c = case(seed, sizes)
    q, p = c.model.Q.shape[0], c.model.p
    noises = [(covariance(c.rng, q) * 10 ** c.rng.uniform(-2, 1), covariance(c.rng, p)) for _ in range(corners)]
    return c.model, noises, c.rng


@pytest.mark.parametrize("seed", range(4))
def test_at_known_noises_every_weight_gives_the_kalman_gain(seed):
    model, _, rng = problem(seed, 1)
    best = kalman_gain(model)
    for weight in (None, covariance(rng, 3), rng.normal(size=3), np.diag([1e6, 1.0, 1e-6]), [1.0, 0.0, 0.0]):
        design = trans_kalman(model, weight=weight)
        assert_allclose(design.filter, best.filter, rtol=1e-8)
        assert_allclose(design.covariance[0], best.covariance, rtol=1e-8)
        assert design.regret[0] == 0


def test_the_kalman_gain_is_least_in_every_component_at_once():
    model, _, rng = problem(5, 1)
    best = kalman_gain(model)
    for size in (1e-4, 1e-2, 0.1):
        P = filter_covariance(model, best.filter + size * rng.normal(size=best.filter.shape))
        assert np.linalg.eigvalsh(P - best.covariance).min() > -1e-14
        assert np.all(np.diagonal(P) > np.diagonal(best.covariance))


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("corners", [2, 4])
def test_the_worst_case_holds_over_the_whole_set(criterion, corners):
    model, noises, rng = problem(6 + corners, corners)
    W = covariance(rng, 3)
    design = trans_kalman(model, noises=noises, criterion=criterion, weight=W)
    assert_allclose(design.worst, design.bound, rtol=1e-9)
    for λ in rng.dirichlet(np.full(corners, 0.5), 60):
        truth = replace(
            model, Q=np.tensordot(λ, [Q for Q, _ in noises], 1), R=np.tensordot(λ, [R for _, R in noises], 1)
        )
        cost, best = (np.sum(W * P) for P in (filter_covariance(truth, design.filter), kalman_gain(truth).covariance))
        assert cost > best
        charged = {"cost": cost, "regret": cost - best, "relative_regret": cost / best - 1}[criterion]
        assert charged <= design.worst * (1 + 1e-9)


def test_no_gain_does_better_on_a_grid_of_closed_forms():
    pairs = [(0.01, 1.0), (30.0, 1.0), (1.0, 5.0)]
    design = trans_kalman(TRACK, noises=tracks(*pairs), weight=[1.0, 0.0])
    α, share = np.meshgrid(np.linspace(0.02, 1.2, 60), np.linspace(0.02, 0.8, 60))
    best = [kalman_gain(replace(TRACK, Q=np.array(Q), R=np.array(R))).covariance[0, 0] for Q, R in tracks(*pairs)]

    def worst(a, b):
        P = [alpha_beta_covariance(a, b, dt=1, sigma_a2=q, sigma_s2=r)[0, 0] for q, r in pairs]
        return np.max(np.array(P) / best - 1)

    grid = [worst(a, 2 * (2 - a) * part) for a, part in zip(α.ravel(), share.ravel(), strict=True)]
    assert_allclose(worst(*design.filter[:, 0]), design.worst, rtol=1e-9)
    assert design.worst <= min(grid) <= 1.02 * design.worst


def test_what_is_lost_is_the_difference_of_two_covariances():
    model, noises, rng = problem(11, 3)
    W = covariance(rng, 3)
    design = trans_kalman(model, noises=noises, weight=W)
    for i, (Q, R) in enumerate(noises):
        truth = replace(model, Q=Q, R=R)
        cost = np.sum(W * filter_covariance(truth, design.filter))
        best = np.sum(W * kalman_gain(truth).covariance)
        assert_allclose([design.cost[i], design.optimal[i]], [cost, best], rtol=1e-10)
        assert_allclose(design.regret[i], cost - best, rtol=1e-8, atol=1e-12 * cost)
        for j, (Qj, Rj) in enumerate(noises):
            guess = kalman_gain(replace(model, Q=Qj, R=Rj)).filter
            assert_allclose(design.guessed[j, i], np.sum(W * filter_covariance(truth, guess)), rtol=1e-10)
    assert np.all(design.regret >= 0)
    assert np.all(np.diagonal(design.guessed) == design.optimal)
    assert (
        design.relative_regret.max() <= (design.guessed / design.optimal - 1).max(axis=1).min()
    )  # no guess is as safe
    table = design.to_pandas()
    assert table.shape == (4, 4)
    assert_allclose(table["worst"].iloc[0], 1 + design.worst)


def test_it_is_the_kalman_filter_of_the_least_favourable_noise():
    model, noises, _ = problem(12, 3)
    design = trans_kalman(model, noises=noises)
    assert_allclose(kalman_gain(design.least_favourable).filter, design.filter, rtol=1e-9, atol=1e-12)
    assert_allclose(design.shares.sum(), 1)
    scaled = [(s * np.array(Q), s * np.array(R)) for s, (Q, R) in zip((1e-4, 1.0, 1e4), noises, strict=True)]
    again = trans_kalman(model, noises=scaled)  # the size of a corner's noise is no part of a relative regret
    assert_allclose(again.filter, design.filter, rtol=1e-7, atol=1e-10)
    assert_allclose(np.sort_complex(again.poles), np.sort_complex(design.poles), rtol=1e-7)
    assert 0 < design.margin().margin <= 1 - np.abs(design.poles).max() + 1e-12


def test_a_sparse_gain_is_the_best_of_its_kind():
    model = StateSpace([[0.9, 0.3], [0.0, 0.8]], C=np.eye(2), Q=np.diag([1.0, 0.5]), R=np.diag([1.0, 2.0]), dt=1)
    noises = [(model.Q, model.R), (4 * model.Q, model.R)]
    design = trans_kalman(model, noises=noises, criterion="cost", free=np.eye(2))
    assert np.all(design.filter[[0, 1], [1, 0]] == 0)
    assert design.shares is None
    grid = np.linspace(0.2, 1.0, 41)
    worst = [np.trace(filter_covariance(replace(model, Q=noises[1][0]), np.diag([a, b]))) for a in grid for b in grid]
    assert design.bound < design.worst <= min(worst) <= 1.01 * design.worst
    apart = StateSpace(np.diag([0.9, 1.1]), C=np.eye(2), Q=np.eye(2), R=np.eye(2), dt=1)
    assert_allclose(trans_kalman(apart, free=np.eye(2)).filter, kalman_gain(apart).filter, rtol=1e-6, atol=1e-8)


def test_a_sparse_gain_of_an_unstable_model_is_brought_home():
    model = StateSpace([[1.2, 0.5], [0.4, 1.1]], C=np.eye(2), Q=np.eye(2), R=np.eye(2), dt=1)
    free = np.array([[False, True], [False, False]])  # a gain that, cut out of the Kalman filter's, does not stabilise
    with pytest.raises(
        AssumptionError, match="no stabilising gain was found with 1 of 4 entries free: free more of them"
    ):
        trans_kalman(model, free=free)
    model = StateSpace([[1.2, 0.4], [-0.9, -1.5]], C=[[1.8, -0.1], [-0.7, 0.1]], Q=np.eye(2), R=np.eye(2), dt=1)
    cut = np.diag(np.diagonal(kalman_gain(model).filter))
    assert np.abs(np.linalg.eigvals(model.A - cut @ model.C @ model.A)).max() > 1
    design = trans_kalman(model, free=np.eye(2), criterion="cost")
    assert np.abs(design.poles).max() < 1
    near = [
        np.trace(filter_covariance(model, design.filter + np.diag(d)))
        for d in 0.02 * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    ]
    assert design.bound < design.worst < min(near)


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: trans_kalman(TRACK, noises=[]), "`noises` must hold at least one pair (Q, R): an empty set has no worst case"),
        (lambda: trans_kalman(TRACK, noises=[np.eye(2)]), "`noises` must be a list of pairs (Q, R). Got [array("),
        (lambda: trans_kalman(TRACK, noises=[(-np.eye(2), [[1.0]])]), "`noises[0][0]` must be positive semidefinite"),
        (lambda: trans_kalman(TRACK, noises=[(np.eye(2), np.eye(2))]), "`noises[0][1]` must be (p, p) = (1, 1)"),
        (lambda: trans_kalman(TRACK, criterion="worst"), "`criterion` must be one of 'relative_regret', 'regret', 'cost'"),
        (lambda: trans_kalman(TRACK, weight=[0.0, 0.0]), "`weight` must not be zero: every gain would have the same cost."),
        (lambda: trans_kalman(TRACK, weight=-np.eye(2)), "`weight` must be positive semidefinite"),
        (lambda: trans_kalman(TRACK, free=[[2.0], [1.0]]), "`free` must hold only True (may be nonzero) or False."),
        (lambda: trans_kalman(StateSpace([[0.0]], R=[[1.0]], dt=0)),
         "`model` must be discrete, because the gain applies to a sample"),
        (lambda: trans_kalman(StateSpace([[0.5]], Q=[[1.0]], R=[[1.0]], S=[[0.5]], dt=1)), "`model` has cross noise S"),
        (lambda: trans_kalman(StateSpace([[0.5]], dt=1)), "`model` has no R: give the covariance of the measurement noise"),
        (lambda: trans_kalman(None), "`model` must be a StateSpace. Got None."),
        (lambda: trans_kalman(StateSpace([[0.5]], R=[[1.0]], dt=1)),
         'at noises[0] the cost of the Kalman filter is zero, so that no relative regret exists: use criterion = "regret".'),
    ],
)  # fmt: skip
def test_what_is_refused(call, sentence):
    with pytest.raises(InputError) as caught:
        call()
    assert any(fault.startswith(sentence) for fault in caught.value.faults), caught.value.faults


def test_a_corner_without_a_stationary_filter_is_named():
    hidden = StateSpace(np.diag([1.2, 0.5]), C=[[0.0, 1.0]], Q=np.eye(2), R=[[1.0]], dt=1)
    with pytest.raises(AssumptionError, match=r"at noises\[0\] there is no stationary Kalman filter: "):
        trans_kalman(hidden)
