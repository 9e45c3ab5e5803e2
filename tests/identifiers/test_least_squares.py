"""ARX by least squares: other people's numbers, a textbook loop, gaps, several records, covariances that are true."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import ARX, InputError, LeastSquares, Record, identify, load, save, simulate
from estimable.frozen import replace

HAIR_DRYER = Path(__file__).parents[3] / "shared" / "data" / "hair-dryer.csv"
PLANT = ARX([-1.2, 0.5], [1.0, 0.4], delay=1, noise_variance=0.04, dt=0.5)
TWO = ARX(
    [[-0.7], [0.4]], [[[1.0, 0.3], [0.2, -0.5]], [[0.0, 1.0], [0.6, 0.1]]], noise_variance=[0.1, 0.2], dt=1, offset=[1.0, -2.0]
)  # fmt: skip


def drawn(plant, rows, seed=0):
    u = np.random.default_rng(seed).normal(size=(rows, plant.b.shape[1]))
    return simulate(plant.to_state_space(), u, seed=seed).record


def textbook(record, na, nb, delay):
    """The normal equations, one row after the other; a row with anything missing is not there."""
    d = na + nb + 1
    M, h = np.zeros((d, d)), np.zeros(d)
    y, u = record.y[:, 0], record.u[:, 0]
    for k in range(max(na, nb + delay), len(y)):
        φ = np.array([-y[k - i] for i in range(1, na + 1)] + [u[k - delay - j] for j in range(nb + 1)])
        if np.isfinite(φ).all() and np.isfinite(y[k]):
            M, h = M + np.outer(φ, φ), h + φ * y[k]
    return np.linalg.solve(M, h)


@pytest.fixture(scope="module")
def hair_dryer():
    if not HAIR_DRYER.exists():
        pytest.skip("the hair dryer's record is not on this machine")
    return np.loadtxt(HAIR_DRYER, delimiter=",", skiprows=1)


def test_the_hair_dryer_has_the_parameters_that_others_found(hair_dryer):
    u, y = (hair_dryer - hair_dryer[:300].mean(axis=0)).T
    fit = identify(LeastSquares(2, 1, delay=3), Record(y[:300], u[:300], dt=0.08))
    assert_allclose(fit.parameters, [-1.2737, 0.3935, 0.06662, 0.04448], atol=6e-5)


def test_the_hair_dryer_is_predicted_as_well_as_others_do(hair_dryer):
    u, y = (hair_dryer - hair_dryer[:300].mean(axis=0)).T
    fit = identify(LeastSquares(2, 1, delay=3), Record(y[:300], u[:300], dt=0.08))
    later = y[800:900]
    past = np.stack([-y[799:899], -y[798:898], u[797:897], u[796:896]], axis=1)
    e = later - past @ fit.parameters
    assert (
        abs(100 * (1 - np.linalg.norm(e) / np.linalg.norm(later - later.mean())) - 94.27) < 0.4
    )  # by which mean is taken away


def test_gaps_cost_the_rows_that_need_them_and_no_more():
    record = drawn(PLANT, 200)
    y, u = record.y.copy(), record.u.copy()
    y[[20, 21, 90]], u[140] = np.nan, np.nan
    gaps = replace(record, y=y, u=u)
    assert_allclose(identify(LeastSquares(2, 1, delay=1), gaps).parameters, textbook(gaps, 2, 1, 1), rtol=1e-9)


def test_a_missing_channel_leaves_its_neighbour_as_it_was():
    record = drawn(TWO, 100)
    y = record.y.copy()
    y[10:40, 0] = np.nan
    whole, gaps = (identify(LeastSquares(1, 1, offset=True), one) for one in (record, replace(record, y=y)))
    assert_allclose(gaps.parameters[6:], whole.parameters[6:], rtol=1e-12)
    assert np.abs(gaps.parameters[:6] - whole.parameters[:6]).max() > 1e-4


def test_without_noise_it_is_exact_and_names_what_it_found():
    plant = replace(TWO, noise_variance=np.zeros(2))
    record = drawn(plant, 60)
    fit = identify(LeastSquares(1, 1, offset=True), record)
    assert_allclose(fit.parameters, plant.parameters, atol=1e-9)
    assert fit.names == plant.parameter_names
    assert fit.names[5] == "c_y1"
    assert_allclose(fit.validation.fit, 100, atol=1e-5)


def test_two_records_are_their_equations_together():
    records = [drawn(PLANT, 150, 1), drawn(PLANT, 90, 2)]
    joined = Record(
        *(np.concatenate([getattr(records[0], c), np.full((1, 1), np.nan), getattr(records[1], c)]) for c in "yu"), dt=0.5
    )  # fmt: skip
    both = identify(LeastSquares(2, 1, delay=1), records)
    assert_allclose(both.parameters, identify(LeastSquares(2, 1, delay=1), joined).parameters, rtol=1e-10)
    assert [e.shape for e in both.validation.residuals] == [(150, 1), (90, 1)]


def test_its_covariance_is_that_of_its_errors():
    errors, claimed = [], []
    for seed in range(300):
        fit = _quick(drawn_fast(seed))
        errors.append(fit[0] - PLANT.parameters)
        claimed.append(fit[1])
    ratio = np.mean(claimed, axis=0) / np.mean(np.square(errors), axis=0)
    assert np.all(np.abs(ratio - 1) < 4 * np.sqrt(2 / 300)), ratio


def drawn_fast(seed, rows=400):
    rng = np.random.default_rng(seed)
    u, y, e = rng.normal(size=rows), np.zeros(rows), 0.2 * rng.normal(size=rows)
    for k in range(2, rows):
        y[k] = 1.2 * y[k - 1] - 0.5 * y[k - 2] + u[k - 1] + 0.4 * u[k - 2] + e[k]
    return Record(y, u, dt=0.5)


def _quick(record):
    """Parameters and their variances, without the validation."""
    from estimable.kernels.regression import regress

    rows = LeastSquares(2, 1, delay=1).rows([record], 0)
    found = regress(rows.Φ, rows.y)
    return found.θ, found.variance * np.diag(found.inverse)


def test_residuals_of_the_right_orders_pass_and_of_too_low_ones_do_not():
    record = drawn(PLANT, 1000)
    right, low = identify(LeastSquares(2, 1, delay=1), record), identify(LeastSquares(1, 0, delay=1), record)
    assert right.validation.passed, right.validation.sentences
    failed = {check.name for check in low.validation.checks if not check.passed}
    assert failed == {"whiteness", "input-left"}
    assert right.validation.one_step_fit[0] > low.validation.one_step_fit[0]


def test_the_state_space_form_has_the_same_response_and_level():
    model = TWO.to_state_space()
    u = np.random.default_rng(3).normal(size=(40, 2))
    x = simulate(replace(model, Q=0 * model.Q, R=0 * model.R, S=0 * model.S), u, seed=0).record.y
    level = np.array([1.0 / 0.3, -2.0 / 1.4])
    assert_allclose(x[:1], (level + TWO.plant.response(u))[:1], atol=1e-12)
    assert_allclose(x, level + TWO.plant.response(u), atol=1e-12)


def test_a_constant_input_and_collinear_inputs_are_said():
    y = np.random.default_rng(0).normal(size=80)
    still = identify(LeastSquares(1, 1, offset=True), Record(y, np.ones(80), dt=1))
    assert still.undetermined.shape == (4, 2)
    assert "carry no information about" in still.validation.sentences[0]
    u = np.random.default_rng(1).normal(size=80)
    twins = identify(LeastSquares(1, 0), Record(y, np.stack([u, 2 * u], axis=1), dt=1))
    assert_allclose(np.abs(twins.undetermined.ravel()), [0, 2 / np.sqrt(5), 1 / np.sqrt(5)], atol=1e-9)
    assert np.all(np.isfinite(twins.covariance))


def test_fewer_rows_than_parameters_are_said():
    fit = identify(LeastSquares(2, 1), drawn(PLANT, 4))
    assert fit.undetermined.shape == (4, 2)
    assert not fit.validation.passed


def test_one_row_is_enough_for_a_gain():
    assert identify(LeastSquares(0, 0), Record([2.0], [1.0], dt=1)).parameters.tolist() == [2.0]


def test_what_was_fitted_is_stored(tmp_path):
    fit = identify(LeastSquares(2, 1, delay=1), drawn(PLANT, 50))
    save(tmp_path / "fit.npz", fit)
    again = load(tmp_path / "fit.npz")
    assert again.model.parameters.tolist() == fit.model.parameters.tolist()
    assert again.validation.one_step_fit.tolist() == fit.validation.one_step_fit.tolist()


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: LeastSquares(-1, 0), "`na` must be an integer of at least 0. Got -1."),
        (lambda: LeastSquares(1, 0, offset=1), "`offset` must be True or False. Got 1."),
        (
            lambda: identify(LeastSquares(1, 0), Record(np.full(9, np.nan), np.ones(9), dt=1)),
            "output y1 has no equation without missing values: it needs 2 rows without a gap in y1",
        ),
        (
            lambda: ARX([-1.0], [1.0], noise_variance=1.0, dt=1, offset=[1.0]).to_state_space(),
            "the model has an offset and a pole at 1: its output is a ramp and has no level.",
        ),
        (
            lambda: ARX([-1.0], [1.0], noise_variance=1.0, dt=1, offset=[1.0, 2.0]),
            "`offset` must be (p,) = (1,): `a` has 1 row. Got (2,).",
        ),
        (
            lambda: identify(
                LeastSquares(1, 0), [Record([1.0], [1.0], dt=1), Record([1.0], [1.0], dt=1, outputs=["level"])]
            ),
            "record 1 has other channels than record 0",
        ),
    ],
)
def test_what_is_wrong_is_said(call, sentence):
    with pytest.raises(InputError) as caught:
        call()
    assert sentence in str(caught.value)
