"""Estimability: the source's examples, mpmath, a joint Gaussian without recursion, and what may not matter."""

import mpmath as mp
import numpy as np
import pytest

from cases import case
from estimable import Prior, StateSpace, estimability, kalman_gain
from estimable.analysis.zeros import invariant_zeros
from estimable.kernels.reach import hidden_modes, reach, staircase
from models_for_verdicts import KINDS, drawn
from oracles.exact_rank import smallest_ratio
from oracles.many_digits import after, canonical, digits
from oracles.stacked import covariances, explained

F, G = [[0.7, -0.1], [1.0, 0.0]], [[1.0], [0.0]]


def example(C, **names):
    return StateSpace(F, C=[C], G=G, Q=[[1.0]], R=[[0.3]], dt=1, **names)


def test_an_observable_model_that_is_not_estimable():
    """Its zero at 2 is the reciprocal of its pole at .5."""
    found = estimability(example([1.0, -2.0]))
    assert (found.estimable, found.verdict, found.distance) == (False, "no", 0.0)
    assert np.allclose(found.singular_values, [0.48148, 0.0], atol=5e-6)
    assert np.allclose(np.linalg.eigvalsh(found.prior_covariance - found.covariance), [0.0, 0.049914], atol=5e-7)
    assert np.allclose(found.directions, [np.array([1.0, -0.2]) / np.hypot(1, 0.2)], atol=1e-12)
    assert found.known_directions.shape == (0, 2)
    assert found.sentences == ("0.98 x1 - 0.2 x2 is not revealed by y1.",)


@pytest.mark.parametrize(("C", "hides"), [([1.0, -2.0], True), ([1.0, -5.0], True), ([1.0, -3.0], False)])
def test_what_is_hidden_is_a_zero_at_the_reciprocal_of_a_pole(C, hides):
    """Sufficient for estimability: no zero from noise to outputs is the reciprocal of a pole (poles .5 and .2)."""
    zeros = invariant_zeros(np.array(F), np.array(G), np.array([C]), np.zeros((1, 1))).values
    reciprocal = np.abs(zeros[:, None] * np.linalg.eigvals(F) - 1).min() < 1e-9
    assert reciprocal == hides == (not estimability(example(C)).estimable)


def test_its_neighbour_that_is_estimable():
    found = estimability(example([1.0, -3.0]))
    assert (found.estimable, found.filter_verdict) == (True, "yes")
    assert np.allclose(found.singular_values, [1.84562, 0.018581], rtol=2e-5)
    assert np.allclose(np.linalg.eigvalsh(found.prior_covariance - found.covariance), [4.97852e-5, 0.265469], rtol=2e-6)
    assert found.directions.shape == (0, 2)
    assert "is the least known" in found.sentences[1]


@pytest.mark.parametrize("kind", range(len(KINDS)), ids=KINDS)
def test_the_verdict_is_that_of_fifty_digits(kind):
    """Over 500 models (seeds 0..499) the ratios differ by 9.1e-16 at most; here every twentieth or so."""
    for seed in range(kind, 72, len(KINDS)):
        model, prior, _ = drawn(seed)
        found = estimability(model, horizon=2 * model.n, prior=prior)
        exact = smallest_ratio(model.A, model.G @ model.Q @ model.G.T, model.C, model.R, prior.covariance, 2 * model.n)
        assert found.verdict == ("no" if exact <= 1e-12 else "borderline" if exact < 1e-8 else "yes"), seed
        if exact > 1e-12:
            assert abs(found.distance - exact) < 1e-14


def test_every_verdict_is_drawn():
    verdicts = set()
    for seed in range(4, 72, 6):
        model, prior, _ = drawn(seed)
        verdicts.add(estimability(model, horizon=2 * model.n, prior=prior).verdict)
    assert verdicts == {"yes", "no", "borderline"}


@pytest.mark.parametrize("features", [{}, {"cross": True}, {"varying": True}, {"singular": True}], ids=str)
def test_covariances_are_those_of_the_joint_gaussian(features):
    for seed in range(3):
        c = case(seed, T=8, feedthrough=False, **features)
        steps = 6
        found = estimability(c.model, horizon=steps, prior=c.prior)
        Π, cross, outputs = covariances(c.model, c.prior.covariance, steps)
        p = c.model.p
        assert np.allclose(found.prior_covariance, Π, rtol=1e-10)
        Σ = explained(cross[:, :-p], outputs[:-p, :-p])
        assert np.allclose(found.prior_covariance - found.covariance, Σ, rtol=1e-8, atol=1e-10)
        assert np.allclose(found.variance_reduction, np.diagonal(Σ) / np.diagonal(Π), rtol=1e-8)
        both = explained(cross, outputs)
        assert np.allclose(found.filter_variance_reduction, np.diagonal(both) / np.diagonal(Π), rtol=1e-8)
        assert np.allclose(
            found.squared_correlations, np.sort(np.linalg.eigvals(np.linalg.solve(Π, Σ)).real), rtol=1e-7, atol=1e-12
        )
        assert np.allclose(found.singular_values, np.linalg.svd(cross[:, :-p], compute_uv=False), rtol=1e-9)


@pytest.mark.parametrize("cross", [False, True])
def test_steady_state_is_the_limit_of_a_long_horizon(cross):
    model = case(3, feedthrough=False, cross=cross).model
    found, long = estimability(model), estimability(model, horizon=400)
    assert np.allclose(found.covariance, long.covariance, rtol=1e-9)
    assert np.allclose(found.covariance, kalman_gain(model).predicted_covariance, rtol=1e-9)
    assert np.allclose(found.squared_correlations, long.squared_correlations, rtol=1e-8)
    assert np.allclose(found.filter_variance_reduction, long.filter_variance_reduction, rtol=1e-8)


@pytest.mark.parametrize("dt", [1.0, 0.0])
@pytest.mark.parametrize("poles", ["real", "complex", "repeated", "defective"])
def test_gramian_reachability_and_eigenvector_forms_agree(dt, poles):
    """Corollaries 2.1 to 2.4, with λ conjugate and whole eigenspaces, on models that hide a direction and that do not."""
    rng = np.random.default_rng(5)
    block = {
        "real": np.diag([0.5, 0.2, -0.3]),
        "complex": np.array([[0.4, 0.3, 0.0], [-0.3, 0.4, 0.0], [0.0, 0.0, -0.2]]),
        "repeated": np.diag([0.5, 0.5, 0.2]),
        "defective": np.array([[0.5, 1.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 0.2]]),
    }[poles]
    T = rng.normal(size=(3, 3))
    A = T @ (block if dt else block - 1.5 * np.eye(3)) @ np.linalg.inv(T)
    verdicts = []
    for hide in (False, True):
        C = rng.normal(size=(1, 3))
        if hide:  # C Π f = 0 for a left eigenvector f
            λ, V = np.linalg.eig(A.T)
            Π = estimability(StateSpace(A, Q=np.eye(3), R=np.eye(3), dt=dt)).prior_covariance
            hidden = Π @ np.column_stack([V[:, 0].real, V[:, 0].imag])
            C = C - C @ hidden @ np.linalg.pinv(hidden)
        model = StateSpace(A, C=C, Q=np.eye(3), R=[[0.5]], dt=dt)
        found = estimability(model)
        W = found.singular_values[-1] / found.singular_values[0]
        assert (found.verdict == "yes") == (W > 1e-8) == (_eigenvector_form(model) > 1e-7)
        verdicts.append(found.verdict)
    assert verdicts == (["no", "no"] if poles == "repeated" else ["yes", "no"])


def _eigenvector_form(model):
    """The smallest singular value of H (1/λ* - F)^-1 Q f, or H (-λ* - F)^-1 Q f, over every left eigenspace."""
    λ, f = np.linalg.eig(model.A.T)
    f, least = f.conj(), np.inf
    for i, value in enumerate(λ):
        space = f[:, np.abs(λ - value) < 1e-6]
        basis, σ, _ = np.linalg.svd(space, full_matrices=False)
        basis = basis[:, σ > 1e-6]
        shift = 1 / value.conj() if model.dt else -value.conj()
        response = model.C @ np.linalg.solve(shift * np.eye(model.n) - model.A, model.Q @ basis)
        σ = np.linalg.svd(response, compute_uv=False)
        least = min(least, σ[-1] if response.shape[0] >= response.shape[1] else 0.0)
        assert i < model.n
    return least


def test_a_delay_is_known_to_the_filter_but_never_to_the_predictor():
    found = estimability(StateSpace(np.diag([0.5, 0.0]), C=[[1.0, 1.0]], Q=np.eye(2), R=[[1.0]], dt=1))
    assert (found.verdict, found.filter_verdict) == ("no", "yes")
    assert np.allclose(found.directions, [[0.0, 1.0]])
    assert found.filter_directions.shape == (0, 2)
    assert (found.variance_reduction[1], found.distance) == (0.0, 0.0)
    assert found.filter_variance_reduction[1] > 0.1


def test_what_is_known_already_is_apart_from_what_is_not_learnt():
    model = StateSpace(
        np.diag([0.5, 0.4, 0.3]),
        C=[[1.0, 0.0, 1.0]],
        Q=np.diag([1.0, 2.0, 0.0]),
        R=[[1.0]],
        dt=1,
        states=["a", "b", "c"],
    )
    found = estimability(model)
    assert np.allclose(found.directions, [[0, 1, 0]])
    assert np.allclose(found.known_directions, [[0, 0, 1]])
    assert found.sentences == ("b is not revealed by y1.", "c is already known: its variance is zero.")
    assert found.variance_reduction[2] == 0
    assert len(found.squared_correlations) == 2


@pytest.mark.parametrize("horizon", [None, 6])
def test_units_and_basis_do_not_matter(horizon):
    model = case(1, feedthrough=False).model
    found = estimability(model, horizon=horizon)
    units, gains = np.diag([1e6, 1.0, 1e-6]), np.diag([1e3, 1e-3])
    scaled = model.in_basis(units)
    scaled = StateSpace(scaled.A, C=gains @ scaled.C, G=scaled.G, Q=scaled.Q, R=gains @ scaled.R @ gains, dt=scaled.dt)
    other = estimability(scaled, horizon=horizon)
    assert np.isclose(other.distance, found.distance, rtol=1e-6)
    assert np.allclose(other.variance_reduction, found.variance_reduction, rtol=1e-8)
    assert np.allclose(other.squared_correlations, found.squared_correlations, rtol=1e-6)
    turned = estimability(model.in_basis(np.random.default_rng(0).normal(size=(3, 3))), horizon=horizon)
    assert np.allclose(turned.squared_correlations, found.squared_correlations, rtol=1e-6)
    assert turned.verdict == found.verdict


def test_a_hidden_direction_moves_with_the_basis():
    T = np.array([[2.0, 1.0], [-1.0, 3.0]])
    found = estimability(example([1.0, -2.0]).in_basis(T))
    g = np.array([1.0, -0.2]) @ np.linalg.inv(T)
    assert np.allclose(np.abs(found.directions[0]), np.abs(g / np.linalg.norm(g)), atol=1e-10)


def test_continuous_time_is_the_limit_of_fast_samples():
    A, C, Q, R = np.array([[0.0, 1.0], [-1.0, -0.4]]), np.array([[1.0, 0.0]]), np.diag([0.0, 0.5]), 0.2
    prior, h = Prior([0.0, 0.0], np.diag([0.3, 0.1])), 1e-3
    found = estimability(StateSpace(A, C=C, Q=Q, R=[[R]], dt=0), horizon=2.0, prior=prior)
    fast = StateSpace(A, C=C, Q=Q, R=[[R / h]], dt=0).discretise(h)
    sampled = estimability(fast, horizon=2000, prior=prior)
    assert np.allclose(found.prior_covariance, sampled.prior_covariance, rtol=1e-9)
    assert np.allclose(found.covariance, sampled.covariance, rtol=2e-3)
    assert np.allclose(found.singular_values, sampled.singular_values * np.sqrt(h), rtol=2e-3)
    long, steady = estimability(StateSpace(A, C=C, Q=Q, R=[[R]], dt=0), horizon=60.0), estimability(
        StateSpace(A, C=C, Q=Q, R=[[R]], dt=0)
    )  # fmt: skip
    assert np.allclose(long.covariance, steady.covariance, rtol=1e-8)
    assert long.verdict == steady.verdict == "yes"


def test_unstable_and_varying_models_have_a_horizon():
    unstable = StateSpace([[1.2, 0.0], [0.0, 0.5]], C=[[1.0, 0.0]], Q=np.eye(2), R=[[1.0]], dt=1)
    found = estimability(unstable, horizon=10)
    assert (found.verdict, found.horizon) == ("no", 10)
    assert np.allclose(found.directions, [[0.0, 1.0]])
    varying = case(0, T=8, varying=True, feedthrough=False).model
    assert estimability(varying).horizon == 8
    rows = StateSpace(np.stack([-np.eye(1), -2 * np.eye(1)]), Q=[[1.0]], R=[[1.0]], dt=0)
    assert estimability(rows, horizon=1.0).estimable
    assert estimability(rows, horizon=1.0).prior_covariance[0, 0] == pytest.approx(
        np.exp(-2) * (1 - np.exp(-1)) / 2 + (1 - np.exp(-2)) / 4, rel=1e-12
    )


def test_one_sample_and_no_noise_are_ordinary():
    model = StateSpace([[0.9]], Q=[[0.0]], R=[[1.0]], dt=1)
    assert estimability(model).sentences == ("x1 is already known: its variance is zero.",)
    found = estimability(model, horizon=1, prior=Prior([0.0], [[2.0]]))
    assert found.estimable
    assert found.variance_reduction[0] == pytest.approx(2 / 3)
    exact = estimability(StateSpace([[0.5]], C=[[1.0], [1.0]], Q=[[1.0]], R=np.zeros((2, 2)), dt=1))
    assert exact.estimable
    assert exact.filter_variance_reduction[0] == pytest.approx(1.0)


def test_a_large_model_hides_one_state_among_a_hundred():
    rng = np.random.default_rng(2)
    n = 100
    A = rng.normal(size=(n, n))
    A *= 0.95 / np.abs(np.linalg.eigvals(A)).max()
    C = rng.normal(size=(1, n))
    assert estimability(StateSpace(A, C=C, Q=np.eye(n), R=[[1.0]], dt=1)).estimable
    A[:, -1] = A[-1] = 0
    A[-1, -1], C[0, -1] = 0.5, 0.0
    found = estimability(StateSpace(A, C=C, Q=np.eye(n), R=[[1.0]], dt=1))
    assert found.verdict == "no"
    assert np.allclose(found.directions, np.eye(n)[-1:], atol=1e-8)


def test_a_change_of_the_size_of_the_distance_hides_a_direction():
    """By modes: the singular vector of [F - λ, M] that belongs to its smallest singular value gives the change."""
    rng = np.random.default_rng(4)
    T = rng.normal(size=(4, 4))
    F = T @ np.diag([0.9, 0.5, -0.3, 0.1]) @ np.linalg.inv(T)
    M = rng.normal(size=(4, 1))
    F, M = F / np.linalg.norm(F), M / np.linalg.norm(M)
    distance = hidden_modes(F, M)[1]
    changes = []
    for λ in np.linalg.eigvals(F).real:
        pencil = np.hstack([F - λ * np.eye(4), M])
        U, σ, Vt = np.linalg.svd(pencil, full_matrices=False)
        change = -σ[-1] * np.outer(U[:, -1], Vt[-1])
        assert reach(F + change[:, :4], M + change[:, 4:]).distance < 1e-12
        changes.append(np.linalg.norm(change, 2))
    assert np.isclose(distance, min(changes), rtol=1e-9)


def test_a_pair_that_one_method_overlooks_is_found_by_the_other():
    rng = np.random.default_rng(0)
    F = rng.normal(size=(60, 60))
    f = np.linalg.eig(F.T)[1][:, 0]
    hidden = np.column_stack([f.real, f.imag])
    M = rng.normal(size=(60, 1))
    M = M - hidden @ np.linalg.lstsq(hidden, M, rcond=None)[0]
    assert np.linalg.matrix_rank(hidden) == reach(F, M).Z.shape[1] == 2
    assert staircase(F, M)[0].shape[1] == 60  # a chain of 58 couplings loses it
    chain = 0.5 * np.eye(4) + np.eye(4, k=1)
    M = np.array([[0.0], [1.0], [0.0], [0.0]])
    assert reach(chain, M).Z.shape[1] == 2
    assert hidden_modes(chain, M)[0].shape[1] == 1  # a Jordan block has one eigenvector


CART = StateSpace(
    [[0, 1, 0, 0], [0, -0.1, -0.981, 0], [0, 0, 0, 1], [0, 0.2, 21.582, 0]], C=[[1.0, 0, 0, 0]], G=[[0], [1], [0], [-2]],
    Q=[[0.01]], R=[[1e-4]], dt=0, states=["x", "v", "theta", "omega"], outputs=["cart"],
)  # fmt: skip


@pytest.mark.parametrize("horizon", [2.0, 8.0])
def test_growth_hides_nothing(horizon):
    """An inverted pendulum: e^(4.6 t) hides the slow states in the covariances themselves, not in the correlations."""
    found = estimability(CART, horizon=horizon)
    assert (found.verdict, len(found.known_directions)) == ("yes", 0)
    assert np.all(np.isfinite(found.squared_correlations))
    assert 0 < found.squared_correlations[0] < 1
    assert found.covariance[2, 2] < 3


@pytest.mark.parametrize("samples", [25, 200])
def test_correlations_under_growth_are_those_of_ninety_digits(samples):
    model = CART.discretise(0.02)
    model = StateSpace(model.A, C=model.C, Q=model.Q, R=[[0.005]], dt=0.02)
    found = estimability(model, horizon=samples, prior=Prior(np.zeros(4), 1e-4 * np.eye(4)))
    A, Q = digits(model.A), digits(model.Q)
    with mp.workdps(90):
        *_, (P, Π) = after(model.A, model.Q, model.C, model.R, 1e-4 * np.eye(4), samples, dps=90)
        P, Π = A.dot(P).dot(A.T) + Q, A.dot(Π).dot(A.T) + Q
    assert np.allclose(found.squared_correlations, canonical(P, Π)[0], rtol=1e-8)
    assert found.verdict == "yes"


@pytest.mark.parametrize("variance", [1e2, 1e14])
def test_a_vague_prior_leaves_the_sigma(variance):
    model = StateSpace([[1.0, 1], [0, 1]], C=[[1.0, 0]], Q=np.diag([0, 1e-6]), R=[[1e-4]], dt=1)
    found = estimability(model, horizon=50, prior=Prior([0, 0], variance * np.eye(2)))
    *_, (P, _) = after(model.A, model.Q, model.C, model.R, variance * np.eye(2), 50)
    exact = model.A @ P.astype(float) @ model.A.T + model.Q
    assert np.allclose(found.covariance, exact, rtol=1e-6)


def test_a_model_in_rows_has_no_sample_after_its_last():
    """Seen once, at the last row: the filter knows it, and the row after that would not exist."""
    model = StateSpace(np.ones((3, 1, 1)), C=np.array([[[0.0]], [[0.0]], [[1.0]]]), R=[[1.0]], dt=1)
    found = estimability(model, prior=Prior([0.0], [[1.0]]))
    assert found.filter_variance_reduction[0] == pytest.approx(0.5)
    blind = StateSpace(np.ones((3, 1, 1)), C=np.zeros((3, 1, 1)), R=[[1.0]], dt=1)
    assert estimability(blind, prior=Prior([0.0], [[1.0]])).filter_verdict == "no"


def test_units_do_not_turn_an_answer_into_a_refusal():
    """A quarter car over 2 s, in metres and in millimetres."""
    ms, mu, ks, cs, kt = 300.0, 40.0, 18e3, 1200.0, 180e3
    A = np.array([[0, 1, 0, 0, 0], [-ks / ms, -cs / ms, ks / ms, cs / ms, 0], [0, 0, 0, 1, 0],
                  [ks / mu, cs / mu, -(ks + kt) / mu, -cs / mu, kt / mu], [0] * 5])  # fmt: skip
    C, G, T = A[1:2], np.eye(5)[:, 4:], np.diag([1e3, 1, 1e3, 1, 1e3])
    found = [
        estimability(
            StateSpace(U @ A @ np.linalg.inv(U), C=C @ np.linalg.inv(U), G=U @ G, Q=[[2e-3]], R=[[2.5e-5]], dt=0),
            horizon=0.2,
        )
        for U in (np.eye(5), T)
    ]
    assert found[0].verdict == found[1].verdict
    assert np.allclose(found[0].variance_reduction, found[1].variance_reduction, rtol=1e-6)


def test_the_figure_shows_each_state_and_each_singular_value():
    figure = estimability(example([1.0, -3.0], states=["alpha", "q"])).plot()
    assert list(figure.data[0].x) == ["alpha", "q"]
    assert len(figure.data[2].y) == 2
    assert figure.data[2].y[0] == 1
    nothing = estimability(StateSpace([[0.5]], R=[[1.0]], dt=1)).plot()
    assert nothing.data[2].y[0] == 1e-17
