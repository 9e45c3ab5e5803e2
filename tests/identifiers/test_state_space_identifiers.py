"""Subspace identification, Ho-Kalman and Markov parameters: exact without noise, other people's numbers, gaps, sentences."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import HoKalman, InputError, MarkovParameters, OutputError, Record, StateSpace, Subspace, identify
from estimable.frozen import replace
from estimable.kernels.banded import whitened
from estimable.kernels.realisation import ho_kalman, markov
from estimable.kernels.subspace_algorithms import factor
from estimable.kernels.subspace_spread import products_factor

HAIR_DRYER = Path(__file__).parents[3] / "shared" / "data" / "hair-dryer.csv"
SINGULAR_VALUES = [69.8841, 14.9963, 3.6675, 1.9677, 0.3, 0.2078, 0.1651, 0.1373, 0.1133, 0.1059]  # SLICOT's IB01AD


def plant(n, m, p, seed=0):
    """A stable system of which every mode is seen."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    A *= 0.85 / np.abs(np.linalg.eigvals(A)).max()
    return A, rng.normal(size=(n, m)), rng.normal(size=(p, n)), rng.normal(size=(p, m))


def record_of(matrices, rows, *, noise=0.0, process=0.0, seed=1, start=0.0):
    A, B, C, D = matrices
    rng = np.random.default_rng(seed)
    u, y, x = rng.normal(size=(rows, B.shape[1])), [], np.full(len(A), start)
    for row in u:
        y.append(C @ x + D @ row + noise * rng.normal(size=len(C)))
        x = A @ x + B @ row + process * rng.normal(size=len(A))
    return Record(np.array(y), u, dt=0.1)


def response(model, length=30):
    return markov(model.A, model.B, model.C, model.D, length)


@pytest.mark.parametrize("n", [1, 2, 7, 20])
@pytest.mark.parametrize(("m", "p"), [(1, 1), (2, 3), (3, 2)])
def test_ho_kalman_recovers_the_transfer_function(n, m, p):
    true = plant(n, m, p)
    found = HoKalman(n).realise(markov(*true, 2 * n + 1), dt=1)
    z = np.exp(1j * np.linspace(0, np.pi, 40))

    def transfer(A, B, C, D):
        return np.stack([C @ np.linalg.solve(one * np.eye(n) - A, B) + D for one in z])

    wanted = transfer(*true)
    error = transfer(found.A, found.B, found.C, found.D) - wanted
    assert np.abs(error).max() <= 1e-10 * np.abs(wanted).max()


def test_ho_kalman_is_balanced():
    r = ho_kalman(markov(*plant(3, 2, 2), 40), 3)
    Γ = np.concatenate([r.C @ np.linalg.matrix_power(r.A, i) for i in range(20)])
    assert_allclose(Γ.T @ Γ, np.diag(r.singular_values[:3]), atol=1e-6 * r.singular_values[0])


@pytest.mark.parametrize("weighting", ["moesp", "n4sid", "cva"])
def test_subspace_is_exact_without_noise_for_any_start(weighting):
    true = plant(4, 2, 2)
    record = record_of(true, 300, start=1.0, noise=1e-9 if weighting == "cva" else 0.0)
    fit = identify(Subspace(4, weighting=weighting), record)
    assert_allclose(response(fit.model), markov(*true, 30), atol=1e-6)
    assert_allclose(fit.validation.fit, 100, atol=1e-4)


def test_subspace_takes_an_unstable_plant_by_its_predictions():
    true = (np.diag([1.02, 0.5]), np.array([[0.1], [1.0]]), np.array([[1.0, 1.0]]), np.array([[0.0]]))
    fit = identify(Subspace(2), record_of(true, 250, noise=1e-3, process=1e-3))
    assert abs(np.abs(np.linalg.eigvals(fit.model.A)).max() - 1.02) < 1e-3
    assert_allclose(response(fit.model, 10), markov(*true, 10), atol=5e-3)


@pytest.mark.parametrize("weighting", ["moesp", "n4sid", "cva"])
def test_subspace_finds_a_noisy_plant_its_noise_and_its_order(weighting):
    true = plant(3, 2, 2, seed=4)
    fit = identify(Subspace(3, weighting=weighting), record_of(true, 4000, noise=0.3, process=0.2))
    assert_allclose(response(fit.model), markov(*true, 30), atol=0.06)
    assert fit.validation.passed, fit.validation.sentences
    values = fit.extra["singular_values"]
    assert values[2] > 3 * values[3]


def test_two_experiments_are_better_than_half_of_them():
    true = plant(3, 2, 2)
    records = [record_of(true, 600, noise=0.3, seed=seed, start=1.0) for seed in (1, 2)]
    errors = [
        np.abs(response(identify(Subspace(3), some).model) - markov(*true, 30)).max() for some in (records, records[:1])
    ]
    assert errors[0] < errors[1]


@pytest.fixture(scope="module")
def hair_dryer():
    if not HAIR_DRYER.exists():
        pytest.skip("the hair dryer's record is not on this machine")
    return np.loadtxt(HAIR_DRYER, delimiter=",", skiprows=1)


def test_the_hair_dryer_has_the_singular_values_of_slicot(hair_dryer):
    u, y = hair_dryer.T
    fit = identify(Subspace(4, horizon=15), Record(y, u, dt=0.08))
    assert_allclose(fit.extra["singular_values"][:10], SINGULAR_VALUES, atol=6e-5)
    assert fit.validation.fit[0] > 84.319 - 2


def test_a_fifth_of_the_outputs_missing_costs_less_than_two_points(hair_dryer):
    u, y = (hair_dryer - hair_dryer[:500].mean(axis=0)).T
    gaps = np.where(np.random.default_rng(0).random(1000) < 0.2, np.nan, y)
    for method in (Subspace(4), HoKalman(4)):
        models = [identify(method, Record(one[:500], u[:500], dt=0.08)).model for one in (y, gaps)]
        kept = [_held_out(model, u, y) for model in models]
        assert kept[0] - kept[1] < 2


def _held_out(model, u, y):
    from estimable.identifiers.standing import standing

    e, later = standing(model, Record(y, u, dt=0.08), rows=500).simulated[500:, 0], y[500:]
    return 100 * (1 - np.linalg.norm(e) / np.linalg.norm(later - later.mean()))


def test_a_missing_output_channel_leaves_the_fit_finite():
    record = record_of(plant(2, 2, 2), 300, noise=0.1)
    y = record.y.copy()
    y[:150, 0] = np.nan
    fit = identify(Subspace(2), replace(record, y=y))
    assert_allclose(response(fit.model), markov(*plant(2, 2, 2), 30), atol=0.2)


def test_markov_parameters_are_those_of_the_plant_and_their_covariance_is_true():
    fir = OutputError([], [[[1.0, 0.5, 0.2], [0.3, 0.0, -0.4]]], noise_variance=0.04, dt=1)
    errors, claimed = [], []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        u = rng.normal(size=(150, 2))
        y = fir.response(u) + 0.2 * rng.normal(size=(150, 1))
        fit = identify(MarkovParameters(2), Record(y, u, dt=1))
        errors.append(fit.parameters - fir.parameters)
        claimed.append(np.diag(fit.covariance))
    ratio = np.mean(claimed, axis=0) / np.mean(np.square(errors), axis=0)
    assert np.all(np.abs(ratio - 1) < 4.5 * np.sqrt(2 / 60)), ratio
    assert fit.names[:4] == ("M0_y1_u1", "M1_y1_u1", "M2_y1_u1", "M0_y1_u2")


def test_banded_whitening_is_the_dense_one_with_rows_missing():
    r, at = np.array([2.0, 1.0, 0.3]), np.array([0, 1, 3, 4, 7, 8, 9])
    apart = np.abs(at[:, None] - at)
    dense = np.where(apart < 3, r[np.minimum(apart, 2)], 0.0)
    X = np.random.default_rng(0).normal(size=(7, 2))
    assert_allclose(whitened(r, at, X), np.linalg.solve(np.linalg.cholesky(dense), X), rtol=1e-12)


def test_the_best_weights_leave_less_variance_in_every_parameter():
    rng = np.random.default_rng(0)
    u, r = rng.normal(size=400), np.array([1.0, 0.6, 0.3, 0.1])
    best = identify(MarkovParameters(4, weighting="best", noise_covariance=r), Record(rng.normal(size=400), u, dt=1))
    Φ = np.stack([np.concatenate([np.zeros(j), u[: 400 - j]]) for j in range(5)], axis=1)[4:]
    lag = np.abs(np.subtract.outer(np.arange(396), np.arange(396)))
    R = np.where(lag < 4, r[np.minimum(lag, 3)], 0.0)
    H = np.linalg.solve(Φ.T @ Φ, Φ.T)
    ordinary = H @ R @ H.T
    assert_allclose(best.covariance, np.linalg.inv(Φ.T @ np.linalg.solve(R, Φ)), rtol=1e-7)
    assert np.all(np.diag(best.covariance) < np.diag(ordinary))


def test_the_covariance_of_ho_kalman_is_that_of_its_errors():
    true = (np.array([[0.6]]), np.array([[1.0]]), np.array([[1.0]]), np.array([[0.5]]))
    errors, claimed = [], []
    for seed in range(60):
        fit = identify(HoKalman(1, length=12), record_of(true, 200, noise=0.2, seed=seed))
        errors.append(fit.parameters - markov(*true, 2).ravel())
        claimed.append(np.diag(fit.covariance))
    ratio = np.mean(claimed, axis=0) / np.mean(np.square(errors), axis=0)
    assert np.all(np.abs(ratio - 1) < 4.5 * np.sqrt(2 / 60)), ratio


@pytest.mark.parametrize("weighting", ["moesp", "cva"])
def test_the_covariance_of_subspace_is_that_of_its_errors(weighting):
    true = (np.array([[0.8, 0.2], [-0.3, 0.6]]), np.array([[1.0], [0.5]]), np.array([[1.0, 0.0]]), np.array([[0.3]]))
    records = [record_of(true, 300, noise=0.2, process=0.1, seed=seed) for seed in range(50)]
    found = [response(Subspace(2, weighting=weighting).model([one])[0], 4).ravel() for one in records]
    claimed = [np.diag(Subspace(2, weighting=weighting, draws=60).fit([one]).covariance) for one in records[:4]]
    ratio = np.mean(claimed, axis=0) / np.mean(np.square(found - markov(*true, 4).ravel()), axis=0)
    spread = np.sqrt(2 / 50 + 2 / 240)
    assert np.all(np.abs(ratio - 1) < 3.5 * spread), ratio


def test_a_draw_of_the_spread_has_the_factor_of_the_estimate():
    records = [record_of(plant(2, 2, 1), rows, noise=0.3) for rows in (90, 50)]
    data = [(record.u, record.y) for record in records]
    slow, quick = factor(data, 5), products_factor(data, 5)
    assert_allclose(quick.L @ quick.L.T, slow.L @ slow.L.T, rtol=1e-9, atol=1e-9)
    assert quick.N == slow.N


def test_a_fit_says_the_same_in_every_call_and_nothing_where_it_cannot():
    record = record_of(plant(2, 1, 1), 200, noise=0.1)
    first, again = (identify(Subspace(2, draws=6), record).covariance for _ in range(2))
    assert first.tolist() == again.tolist()
    assert identify(Subspace(2, draws=0), record).covariance is None


STILL, SHORT = Record(np.arange(90.0), np.ones(90), dt=1), Record(np.arange(9.0), np.arange(9.0) ** 2, dt=1)
UNKNOWN = Record(np.arange(90.0), [np.nan, *range(89)], dt=1)
UNSEEN = Record(np.full(90, np.nan), np.arange(90.0) ** 2, dt=1)
TWINS = Record(np.arange(90.0), np.arange(90.0)[:, None] ** 2 * [1, 2], dt=1)


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: Subspace(0), "`order` must be an integer of at least 1. Got 0."),
        (lambda: Subspace(2, weighting="moep"), "Did you mean 'moesp'?"),
        (lambda: Subspace(2, horizon=1), "`horizon` must be an integer of at least 2. Got 1."),
        (lambda: Subspace(2, draws=1), "`draws` must be 0, or at least 2: one draw has no spread."),
        (lambda: Subspace(2, feedthrough=0), "`feedthrough` must be True or False. Got 0."),
        (lambda: identify(Subspace(4, horizon=2), UNSEEN), "output 'y1' was never seen"),
        (lambda: identify(Subspace(1), STILL), "input 'u1' never moves: its effect cannot be distinguished from an offset"),
        (lambda: identify(Subspace(1), TWINS), "inputs 'u1', 'u2' are linearly dependent"),
        (lambda: Subspace(1).fit([UNKNOWN]), "record 0: an input is unknown at index (0, 0)"),
        (lambda: identify(Subspace(4), SHORT), "too short for order 4 with horizon 5: its data matrix has 0 columns"),
        (
            lambda: identify(Subspace(4, horizon=3), Record(np.arange(90.0), np.arange(90.0) ** 2, dt=1)),
            "`horizon` must be at least 5 for order 4 with 1 output. Got 3.",
        ),
        (lambda: HoKalman(2, length=1), "`length` must be an integer of at least 2. Got 1."),
        (lambda: HoKalman(2).realise([1.0, 2.0], dt=1), "order 2 needs the Markov parameters up to M4"),
        (lambda: MarkovParameters(2, weighting="worst"), "`weighting` must be one of 'ordinary', 'best', 'observer'"),
        (lambda: MarkovParameters(2, offset=1), "`offset` must be True or False. Got 1."),
        (
            lambda: MarkovParameters(2, noise_covariance=[1.0]),
            '`noise_covariance` belongs to weighting = "best"',
        ),
        (
            lambda: MarkovParameters(2, weighting="best", noise_covariance=[0.0]),
            "`noise_covariance` must begin with variances greater than 0",
        ),
        (
            lambda: identify(MarkovParameters(1, weighting="best", noise_covariance=[1.0, 0.9]), SHORT),
            "`noise_covariance` is not the autocovariance of any noise",
        ),
        (
            lambda: identify(MarkovParameters(1, weighting="best", noise_covariance=np.ones((3, 1))), SHORT),
            "`noise_covariance` must have a row for each of 1 output. Got 3.",
        ),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said(call, sentence):
    with pytest.raises(InputError) as caught:
        call()
    assert sentence in str(caught.value)


def test_a_fit_is_a_state_space_model_with_the_names_of_the_record():
    record = replace(record_of(plant(2, 1, 1), 200, noise=0.1), inputs=("valve",), outputs=("level",))
    model = identify(Subspace(2), record).model
    assert isinstance(model, StateSpace)
    assert (model.inputs, model.outputs, model.dt) == (("valve",), ("level",), 0.1)
