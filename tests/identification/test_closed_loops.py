"""Records of closed loops: the test of feedback, what it says, and methods that it does no harm."""

import numpy as np
import pytest
from benchmarks.figures.closed_loops import INPUTS, SECOND, SLOW, alarms, closed_loop, found, open_loop

import estimable as es
from estimable.diagnostics import feedback
from estimable.kernels.closed_loop_subspace import ssarx, windows


@pytest.mark.parametrize("kind", INPUTS)
def test_open_loop_records_raise_no_alarm(kind):
    """`python -m benchmarks.figures.closed_loops`: at most .01 in any cell of 200 draws."""
    for plant, noise, direct in (
        (SLOW, "sensor", False),
        (SECOND, "process", False),
        ((SLOW[0][1:], SLOW[1]), "sensor", True),
    ):
        records = [open_loop(kind, 400, seed, plant=plant, noise=noise) for seed in range(15)]
        assert alarms(records, direct) <= 1 / 15


@pytest.mark.parametrize(("settings", "T"), [({"k": 0.4}, 200), ({"noise": "process", "held": 20, "late": 1}, 200)])
def test_feedback_is_seen(settings, T):
    assert alarms([closed_loop(T, seed, **settings) for seed in range(30)], False) >= 0.9


def test_feedback_within_the_row_and_a_direct_effect_are_not_told_apart():
    closed = feedback(closed_loop(1000, 0))
    assert closed.unclear
    assert 'feedback="closed"' in closed.sentence
    direct = open_loop("AR(.95)", 1000, 0, plant=(SLOW[0][1:], SLOW[1]), noise="process")
    assert feedback(direct).unclear or not feedback(direct).closed
    white = feedback(open_loop("white", 1000, 0, plant=(SLOW[0][1:], SLOW[1]), noise="process"))
    assert not white.unclear  # a loop would colour it


def test_several_records_inputs_and_outputs_are_tested_together():
    rng, records = np.random.default_rng(0), []
    for seed in range(3):
        one = closed_loop(400, seed, noise="process", late=1)
        records.append(
            es.Record(
                np.column_stack([rng.normal(size=400), one.y]), np.column_stack([rng.normal(size=400), one.u]), dt=1
            )
        )
    assert feedback(records).closed
    assert not feedback([es.Record(one.y[:, :1], one.u[:, :1], dt=1) for one in records]).closed


def test_gaps_are_left_out_and_too_few_rows_are_no_verdict():
    record = closed_loop(2000, 1, noise="process", late=1)
    gone = np.random.default_rng(0).random(2000) < 0.1
    assert feedback(es.Record(np.where(gone, np.nan, record.y[:, 0]), record.u, dt=1)).closed
    short = feedback(record[:12])
    assert short.earlier is None
    assert "too short" in short.sentence


def test_a_record_without_noise_or_with_an_exact_input_is_no_alarm():
    k = np.arange(500)
    u = np.sin(0.3 * k)
    assert not feedback(es.Record(u + np.random.default_rng(0).normal(size=500), u, dt=1), direct=False).closed
    assert not feedback(es.Record(np.r_[0, u[:-1]], u, dt=1), direct=False).closed


@pytest.mark.parametrize(("k", "a"), [(0.4, 0.9), (0.7, 1.1)])
@pytest.mark.parametrize("noise", ["sensor", "process"])
def test_poles_found_in_a_loop_are_not_biased(k, a, noise):
    for method in (
        es.PredictionError(1, 0, 1, delay=1),
        es.PredictorSubspace(1),
        es.PredictorSubspace(1, weighting="pbsid"),
    ):
        bias, _, z = found(method, k, a, noise, 3)
        assert abs(bias[0]) < (0.015 if noise == "sensor" else 0.05)  # 3 standard deviations of such a mean
        assert z < 3


@pytest.mark.parametrize("weighting", ["ssarx", "pbsid"])
@pytest.mark.parametrize(("n", "m", "p"), [(2, 1, 1), (3, 2, 2)])
def test_subspaces_of_the_predictor_are_exact_without_noise(weighting, n, m, p):
    rng = np.random.default_rng(n)
    A = rng.normal(size=(n, n))
    A *= 0.8 / np.abs(np.linalg.eigvals(A)).max()
    B, C = rng.normal(size=(n, m)), rng.normal(size=(p, n))
    u, x, y = rng.normal(size=(800, m)), np.zeros(n), []
    for row in u:
        y.append(C @ x)
        x = A @ x + B @ row
    fit = es.identify(
        es.PredictorSubspace(n, weighting=weighting, past=n + 1, blocks=0), es.Record(np.array(y), u, dt=1)
    )
    np.testing.assert_allclose(
        np.sort_complex(np.linalg.eigvals(fit.model.A)), np.sort_complex(np.linalg.eigvals(A)), atol=1e-6
    )


def test_blocks_left_out_sum_to_the_whole():
    record = closed_loop(600, 0)
    sizes = windows([(record.u, record.y)], 5, 3, 6)
    gram = sum(one.T @ one for one in sizes.R)
    np.testing.assert_allclose(sizes.whole.T @ sizes.whole, gram, rtol=1e-9, atol=1e-9)
    rest = sizes.each_left_out()[2]
    np.testing.assert_allclose(rest.T @ rest, gram - sizes.R[2].T @ sizes.R[2], rtol=1e-9, atol=1e-8)
    assert ssarx(sizes.whole, sizes, 1).A.shape == (1, 1)


def test_a_method_that_feedback_biases_says_so():
    record = closed_loop(2000, 0, noise="process", late=1)
    for method in (
        es.Subspace(1),
        es.HoKalman(1),
        es.InstrumentalVariables(1, 0, delay=1),
        es.OutputErrorML(1, 0, delay=1),
    ):
        check = next(one for one in es.identify(method, record).validation.checks if one.name == "feedback")
        assert not check.passed
        assert "use PredictionError or PredictorSubspace" in check.sentence
    assert all(
        one.name != "feedback" for one in es.identify(es.PredictionError(1, 0, 1, delay=1), record).validation.checks
    )


def test_output_error_holds_in_a_loop_where_its_residuals_are_white():
    fit = es.identify(es.OutputErrorML(1, 0, delay=1), closed_loop(2000, 0))
    check = next(one for one in fit.validation.checks if one.name == "feedback")
    assert check.passed
    assert abs(fit.parameters[0] + 0.9) < 4 * fit.sigma[0]


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: es.PredictorSubspace(0), "`order` must be"),
        (lambda: es.PredictorSubspace(1, weighting="moesp"), "`weighting` must be one of 'ssarx', 'pbsid'. Got 'moesp'."),
        (lambda: es.PredictorSubspace(1, blocks=1), "`blocks` must be 0, or at least 2: one block has no spread."),
        (lambda: es.identify(es.PredictorSubspace(3), closed_loop(40, 0)), "the record is too short, or has too many gaps"),
        (lambda: feedback(es.Record([1.0, 2.0], dt=1)), "`record` has no input, so there is no feedback to test: give `u`."),
        (lambda: feedback(closed_loop(40, 0), direct=1), "`direct` must be"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said(call, sentence):
    with pytest.raises(es.InputError) as caught:
        call()
    assert sentence in str(caught.value)
