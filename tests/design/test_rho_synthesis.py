"""Families of designs: known bandwidths, every criterion against its own definition, optima, and a loop that is flown."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm, logm, solve_continuous_are, solve_discrete_lyapunov, solve_lyapunov

from estimable import (
    AssumptionError,
    DesignFamily,
    FixedGain,
    InputError,
    Prior,
    StateFeedback,
    StateSpace,
    close_loop,
    kalman_gain,
    rho_margin,
    rho_synthesis,
    stability_radius,
)
from estimable.kernels import courses as kernel
from estimable.kernels.riccati import care

MASS = StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], Q=np.diag([0.0, 1.0]), R=[[0.1]], dt=0)
SAMPLED = MASS.discretise(0.1)
ETA = np.array([0.5, 1.0, 2.0, 4.0, 8.0])
MODELS = pytest.mark.parametrize("model", [MASS, SAMPLED], ids=["continuous", "discrete"])


@pytest.fixture(scope="module")
def found():
    return {model.dt: rho_synthesis(model, eta=ETA, weights={"rho": 1.0}) for model in (MASS, SAMPLED)}


def loop(model, K, F):
    A, B, C = model.A, model.B, model.C
    error = A - F @ C if model.dt == 0 else (np.eye(model.n) - F @ C) @ A
    return np.block([[A - B @ K, B @ K], [np.zeros_like(A), error]])


def test_the_bandwidth_of_the_default_family_grows_as_published():
    family = DesignFamily.approach(MASS)
    for eta, bandwidth in zip(ETA, [0.71, 1, 1.41, 2, 2.83], strict=True):
        Q, S, R = family.at(eta)
        F = care(MASS.A, MASS.B, Q, R, S).F
        assert_allclose(kernel.bandwidth(F[None])[0], bandwidth, atol=0.005)


@MODELS
def test_the_bandwidth_of_the_whole_loop_grows_with_eta(found, model):
    assert np.all(np.diff(found[model.dt].bandwidth) > 0)


@MODELS
def test_each_criterion_is_what_it_says(found, model):
    """Against plain formulas on the chosen loop, whose noises are built here sample by sample."""
    told = found[model.dt]
    i, A = told.chosen, loop(model, told.feedback, told.filter)
    assert_allclose(A, told.closed_loop, atol=1e-12)
    away = A if model.dt == 0 else np.eye(4) - A
    z = 1j * np.geomspace(1e-4, 1e3, 4000) if model.dt == 0 else np.exp(1j * np.linspace(0, np.pi, 4000))
    peak = 1 / np.linalg.svd(z[:, None, None] * np.eye(4) - A, compute_uv=False)[:, -1].min()
    I_FC = np.eye(2) if model.dt == 0 else np.eye(2) - told.filter @ model.C
    W, V = np.vstack([np.eye(2), I_FC]) @ model.G, np.vstack([np.zeros((2, 1)), told.filter])
    Q = W @ model.Q @ W.T + V @ model.R @ V.T
    P = solve_lyapunov(A, -Q) if model.dt == 0 else solve_discrete_lyapunov(A, Q)
    of_u = np.hstack([-told.feedback, told.feedback])
    ω = A if model.dt == 0 else logm(A) / model.dt
    exact = {
        "static_error": np.linalg.norm(np.linalg.inv(away), 2), "resonance": peak, "dispersion": np.sqrt(np.trace(P)),
        "control": np.sqrt((of_u @ P @ of_u.T).item()), "magnification": peak / np.linalg.norm(np.linalg.inv(away), 2),
    }  # fmt: skip
    for name, value in exact.items():
        assert_allclose(told.criteria[name][i], value, rtol=1e-4, err_msg=name)
    assert_allclose(told.bandwidth[i], np.sqrt(np.prod(np.linalg.svd(ω)[1][[0, -1]])), rtol=1e-6)
    margin = rho_margin(A, dt=model.dt)
    assert_allclose(told.margin.margin, margin.margin, rtol=1e-9)
    assert_allclose([told.criteria["rho"][i], told.criteria["sigma"][i]], [margin.margin, margin.sigma], rtol=0.03)


@MODELS
def test_times_and_peaks_are_those_of_a_fine_grid(found, model):
    told = found[model.dt]
    i, A, h = told.chosen, told.closed_loop, 2e-3 if model.dt == 0 else 1.0
    step, M, norms, rows = (expm(A * h) if model.dt == 0 else A), np.eye(4), [], []
    for _ in range(10_000 if model.dt == 0 else 300):
        norms.append(np.linalg.norm(M, 2))
        rows.append(np.linalg.norm(M, axis=1))
        M = step @ M
    settled = (np.max(np.flatnonzero(np.array(norms) > 0.05)) + 1) * (h if model.dt == 0 else model.dt)
    assert_allclose(told.criteria["response_time"][i], settled, rtol=0.02, atol=model.dt)
    assert_allclose(told.criteria["peak_gain"][i], h * np.sum(rows, axis=0).max(), rtol=0.01)


def test_no_force_of_norm_one_passes_the_peak_gain(found):
    """The worst force for a state points along its row of the motion at every sample, backwards in time."""
    told = found[SAMPLED.dt]
    A, peak = told.closed_loop, told.criteria["peak_gain"][told.chosen]
    powers = [np.linalg.matrix_power(A, k) for k in range(300)]
    worst = 0.0
    for i in range(4):
        x = np.zeros(4)
        for M in reversed(powers):
            x = A @ x + M[i] / np.linalg.norm(M[i])
        worst = max(worst, x[i])
    assert worst <= peak * (1 + 1e-6)
    assert_allclose(worst, peak, rtol=1e-3)


@MODELS
def test_an_adversary_never_breaks_the_bound_of_the_chosen_loop(found, model):
    """A perturbation of the largest size allowed that always points along the state, chosen fresh at every step."""
    told = found[model.dt]
    A, κ, h = told.closed_loop, 0.9 * told.margin.margin, model.dt or 0.1
    bound = told.margin.perturbed(κ)
    for x in np.vstack([np.eye(4), np.linalg.svd(expm(A))[2][:1]]):
        for k in range(100):
            assert np.linalg.norm(x) <= bound.at(k * h, x0=1.0) * (1 + 1e-9)
            along = A @ x if model.dt else x
            E = κ * np.outer(along, x) / (np.linalg.norm(along) * np.linalg.norm(x))
            x = (A + E) @ x if model.dt else expm((A + E) * h) @ x


def test_optima_are_where_their_curves_say(found):
    told = found[0]
    assert told.optima["rho"].design == int(np.argmax(told.criteria["rho"]))
    assert told.optima["control"].design == 0
    assert told.chosen == told.optima["composite"].design == told.optima["rho"].design


def test_weights_move_the_choice():
    cheap = rho_synthesis(MASS, eta=ETA, weights={"rho": 1.0, "control": 3.0})
    assert cheap.eta[cheap.chosen] < 8.0
    ratio = cheap.criteria["rho"].max() / cheap.criteria["rho"]
    dear = cheap.criteria["control"] / cheap.criteria["control"].min()
    assert_allclose(cheap.composite, (ratio * dear**3) ** 0.25, rtol=1e-12)
    assert rho_synthesis(MASS, eta=ETA).weights == {"rho": 1.0, "control": 1.0}


@MODELS
def test_a_part_can_stay_fixed(model):
    fixed = rho_synthesis(model, eta=ETA[:2], filter="kalman")
    assert_allclose(fixed.filter, kalman_gain(model).filter, rtol=1e-12)
    law = rho_synthesis(model, eta=ETA[:2], control=[[1.0, 2.0]])
    assert_allclose(law.feedback, [[1.0, 2.0]])


def test_loop_transfer_recovery_is_a_family():
    """Q0 + η² B V B': the filter's gain over η tends to B where the plant has no zeros to the right. Doyle & Stein (1979)."""
    family = DesignFamily(MASS.R, Q0=MASS.Q, Q1=MASS.B @ MASS.B.T)
    told = rho_synthesis(MASS, eta=[100.0], control=[[1.0, 2.0]], filter=family)
    P = solve_continuous_are(MASS.A.T, MASS.C.T, MASS.Q + 1e4 * MASS.B @ MASS.B.T, MASS.R)
    assert_allclose(told.filter, P @ MASS.C.T / 0.1, rtol=1e-8)


@MODELS
def test_the_chosen_gains_fly_as_the_loop_that_was_judged(found, model):
    """Without noise (x, x - x^) moves by `closed_loop`; of a continuous design to the step's accuracy."""
    told, dt = found[model.dt], 0.1 if model.dt else 0.002
    gain = told.filter if model.dt else told.filter_of_sample(dt)
    quiet = StateSpace(model.A, model.B, model.C, Q=np.zeros((2, 2)), R=[[0.0]], dt=model.dt)
    sampled = quiet if model.dt else quiet.discretise(dt)
    flown = close_loop(quiet, StateFeedback(told.feedback), FixedGain(sampled, filter=gain), reference=np.zeros((50, 0)), seed=0,
                       dt=dt, start=[1.0, 0.5], prior=Prior([0.0, 0.0], np.eye(2)), engine="xla")  # fmt: skip
    step = told.closed_loop if model.dt else expm(told.closed_loop * dt)
    both = np.concatenate([flown.state, flown.state - flown.mean], axis=1)
    for k in range(49):
        assert_allclose(step @ both[k], both[k + 1], atol=1e-12 if model.dt else 5e-3 * np.abs(both[k]).max())


def test_a_continuous_filter_has_a_gain_of_a_sample(found):
    told = found[0]
    sampled = MASS.discretise(0.05)
    Γ = np.array([[0.05, 0.05**2 / 2], [0.0, 0.05]])
    assert_allclose(sampled.A @ told.filter_of_sample(0.05), Γ @ told.filter, rtol=1e-12)


def test_courses_follow_norms_of_any_speeds():
    rng = np.random.default_rng(0)
    A = rng.normal(size=(6, 4, 4)) * np.exp(rng.normal(size=(6, 4, 1)))
    A = A - (np.linalg.eigvals(A).real.max(axis=1) + 0.2)[:, None, None] * np.eye(4)
    course = kernel.courses(A, True)
    ρ = kernel.margins(A, course, True)
    for i in range(6):
        exact = rho_margin(A[i], dt=0)
        assert_allclose([ρ[i], 1 / course.total[i]], [exact.margin, exact.sigma], rtol=0.04)
        assert exact.margin <= stability_radius(A[i], dt=0).margin


def test_norms_of_large_loops_are_found_by_iteration():
    rng = np.random.default_rng(1)
    A = rng.normal(size=(4, 30, 30)) * np.exp(rng.normal(size=(4, 30, 1)))
    A = A - (np.linalg.eigvals(A).real.max(axis=1) + 0.5)[:, None, None] * np.eye(30)
    course = kernel.courses(A, True)
    for i in range(4):
        for k in (3, 40, 80, 150):
            assert_allclose(course.a[i, k], np.linalg.norm(expm(A[i] * course.t[i, k]), 2), rtol=1e-2)


def test_logarithms_of_matrices_that_cannot_be_diagonalised():
    jordan = np.array([[0.5, 1.0], [0.0, 0.5]])
    ringing = np.array([[-0.5, 0.0], [0.0, 0.3]])
    found = kernel.logarithm(np.array([jordan, ringing]))
    assert_allclose(expm(found[0]), jordan, atol=1e-12)
    assert np.isnan(found[1]).all()


def test_a_loop_that_rings_has_no_bandwidth():
    """A filter that turns its error round at each sample: no continuous motion has such samples."""
    plant = StateSpace([[1.0]], [[1.0]], dt=1)
    told = rho_synthesis(plant, eta=[0.5, 1.0], filter=[[1.5]], weights={"control": 1.0})
    assert np.all(np.isinf(told.bandwidth))


UNSTABLE = StateSpace(np.diag([1.0, -1.0]), [[0.0], [1.0]], [[1.0, 1.0]], dt=0)
UNSEEN = StateSpace(np.diag([1.0, -1.0]), [[1.0], [1.0]], [[0.0, 1.0]], dt=0)


def test_what_has_no_design():
    with pytest.raises(AssumptionError, match="`model` is not stabilisable: no input moves a mode that does not decay"):
        rho_synthesis(UNSTABLE)
    with pytest.raises(AssumptionError, match="`model` is not detectable: no output shows a mode that does not decay"):
        rho_synthesis(UNSEEN)
    with pytest.raises(AssumptionError, match=r"the loop is not stable at eta = 0\.5: the largest real part"):
        rho_synthesis(MASS, eta=ETA, control=[[-1.0, 0.0]])
    with pytest.raises(
        AssumptionError, match=r"there is no design at eta = 1: the Riccati equation has no stabilising"
    ):
        rho_synthesis(MASS, eta=[1.0], control=DesignFamily([[1.0]], Q0=np.zeros((2, 2))))


WRONG = {
    "`model` must be a StateSpace": {"model": 1},
    "`model` has no input": {"model": StateSpace([[-1.0]], dt=0)},
    "must be rates per second, greater than 0 and increasing": {"eta": [2.0, 1.0]},
    r"`control` must be a `DesignFamily` with n = 2 and m = 1\. Got n = 1 and m = 1\.": {
        "control": DesignFamily([[1.0]], Q0=[[1.0]])
    },
    r"`control`: \[\[Q, S\], \[S\.T, R\]\] must be positive semidefinite: at eta = 8": {
        "control": DesignFamily([[1.0]], Q0=np.eye(2), S1=[[1.0], [0.0]])
    },
    "both fixed gains": {"control": [[1.0, 2.0]], "filter": [[1.0], [1.0]]},
    "there is no criterion 'roh'.*Did you mean 'rho'": {"weights": {"roh": 1.0}},
    "must have at least one nonzero weight": {"weights": {"rho": 0.0}},
    "`weights` must be a mapping": {"weights": [1.0]},
    "`scaling` must be sizes, greater than 0": {"scaling": [1.0, 0.0]},
    '`filter` = "kalman" needs `R`': {"model": StateSpace([[0.0]], [[1.0]], dt=0), "filter": "kalman"},
    "`filter` must be 'kalman'": {"filter": "luenberger"},
    "two inputs have the same effect": {"model": StateSpace([[-1.0]], [[1.0, 1.0]], dt=0)},
}


@pytest.mark.parametrize("sentence", WRONG)
def test_wrong_calls(sentence):
    given = {"model": MASS, "eta": ETA, **WRONG[sentence]}
    with pytest.raises(InputError, match=sentence):
        rho_synthesis(given.pop("model"), **given)


def test_wrong_families():
    with pytest.raises(InputError, match="`Q0` or `Q1` must be given"):
        DesignFamily([[1.0]])
    with pytest.raises(InputError, match="`Q1` must be positive semidefinite"):
        DesignFamily([[1.0]], Q1=[[-1.0]])
    with pytest.raises(InputError, match="a discrete filter needs a family with S = 0"):
        rho_synthesis(SAMPLED, eta=ETA, filter=DesignFamily([[1.0]], Q0=np.eye(2), S0=[[0.1], [0.0]]))


def test_the_figure_shows_every_criterion_with_its_optimum(found):
    figure = rho_synthesis(MASS, eta=ETA, weights={"rho": 1.0, "control": 1.0}).plot()
    lines = [trace for trace in figure.data if trace.mode == "lines"]
    marks = [trace for trace in figure.data if trace.mode == "markers"]
    assert len(lines) == len(marks) == len(found[0].criteria)  # without `external`, with the composite
    assert all(min(line.y) >= 1 - 1e-12 for line in lines)
    assert all(mark.y[0] == pytest.approx(min(line.y)) for mark, line in zip(marks, lines, strict=True))


def test_scaling_reaches_the_default_families():
    """A pendulum in degrees with its scaling is the pendulum in radians: the same feedback, margin and filter."""
    A = np.array([[0, 1, 0, 0], [0, -0.1, -0.981, 0], [0, 0, 0, 1], [0, 0.2, 21.582, 0]])
    B, C = np.array([[0], [1.0], [0], [-2.0]]), np.eye(4)[[0, 2]]
    degrees = np.array([1.0, 1.0, 57.3, 57.3])
    radians = rho_synthesis(StateSpace(A, B, C, dt=0), eta=ETA)
    turned = StateSpace(A * degrees[:, None] / degrees, B * degrees[:, None], C / degrees, dt=0)
    found = rho_synthesis(turned, eta=ETA, scaling=degrees)
    assert_allclose(found.feedback * degrees, radians.feedback, rtol=1e-6)
    assert_allclose(found.margin.margin, radians.margin.margin, rtol=1e-6)
