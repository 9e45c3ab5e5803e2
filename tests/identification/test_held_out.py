"""Judgement on whole other records, on the rest of one that is alike, in loops, and of series without inputs."""

import warnings

import numpy as np
import pytest
from benchmarks.figures.closed_loops import closed_loop, sweep
from benchmarks.figures.judged_records import heating, of_loop, series, whole
from scipy.signal import lfilter

import estimable as es
from estimable.identification import judge
from estimable.identification.held_out import divided, not_fitted, with_held_out


def record(seed, rows=500, level=0.0):
    rng = np.random.default_rng(seed)
    u = rng.normal(size=rows)
    y = lfilter([0, 1.0, 0.4], [1, -1.2, 0.5], u) + 0.5 * rng.normal(size=rows)
    return es.Record(y + 3 * level, u + level, dt=0.1)


METHODS = [es.LeastSquares(2, 1, delay=1), es.OutputErrorML(2, 1, delay=1, initial="free")]


def test_whole_records_are_fitted_and_whole_others_are_judged():
    one, other = record(0), record(1, level=5.0)
    found = es.compare(METHODS, one, held_out=other)
    assert len(found.best.fit.validation.residuals[0]) == 500
    assert found.best.name == "OutputErrorML"
    assert found.best.fit_percent > 70  # the other level is no fault
    assert found.task.rows == (50,)
    split = es.compare(METHODS, one)
    assert found.best.fit_percent == pytest.approx(split.best.fit_percent, abs=5)


def test_what_is_held_out_is_not_fitted():
    one = es.compare(METHODS, record(0), held_out=[record(1), record(2)])
    other = es.compare(METHODS, record(0), held_out=record(3))
    assert one.best.fit.parameters.tolist() == other.best.fit.parameters.tolist()


def test_segments_end_where_records_do():
    _, y = np.zeros(0), np.random.default_rng(0).normal(size=(400, 1))
    assert {0, 130, 400} <= {edge for cut in judge._segments(y, [130, 400]) for edge in (cut.start, cut.stop)}


def test_two_halves_of_a_sweep_are_said_to_be_unlike_and_a_second_sweep_judges():
    rows, records = 2000, []
    for seed in range(2):
        rng = np.random.default_rng(seed)
        u = sweep(rng, rows)
        y = lfilter([0, 0.1, 0.08], [1, -1.6, 0.8], u)
        records.append(es.Record(y + 0.15 * np.std(y) * rng.normal(size=rows), u, dt=0.02))
    methods = [es.OutputErrorML(2, 1, delay=1, initial="free"), es.Subspace(2)]
    assert es.compare(methods, records[0]).sentence.startswith("The record cannot be split: 100%")
    found = es.compare(methods, records[0], held_out=records[1])
    assert "cannot be split" not in found.sentence
    assert found.best.fit_percent > 82  # 85 % is the noise


@pytest.mark.parametrize("kind", ["white", "steps", "two manoeuvres"])
def test_parts_that_are_alike_are_not_called_unlike(kind):
    for seed in range(10):
        rng = np.random.default_rng(seed)
        if kind == "white":
            u = rng.normal(size=300)
        elif kind == "steps":
            u = rng.normal(size=20).repeat(30)
        else:
            u = np.zeros(600)
            for k in (100, 420):
                u[k : k + 30], u[k + 30 : k + 50] = 1, -1
        assert not_fitted(divided([es.Record(u, u, dt=1)], 0.5, "mean")) < 0.5


def test_a_manoeuvre_after_a_quiet_first_half_cannot_be_split():
    u = np.zeros(600)
    u[400:430] = 1
    quiet = 1e-3 * np.random.default_rng(0).normal(size=600)
    assert not_fitted(divided([es.Record(u, u + quiet, dt=1)], 0.5, "mean")) > 0.9
    both = with_held_out([es.Record(u, u + quiet, dt=1)], [es.Record(u, u, dt=1)], "none")
    assert not_fitted(both) < 0.1


def test_a_loop_is_identified_by_predictors_and_judged_one_step_ahead():
    loop = closed_loop(1000, 0, noise="process", late=1)
    found = es.compare(None, loop)
    assert found.closed
    assert found.ahead
    assert {one.name for one in found.ranked} == {"PredictionError", "PredictorSubspace"}
    assert "closed loop" in found.sentence
    poles = np.linalg.eigvals(found.best.model.A)
    assert np.min(np.abs(poles - 0.9)) < 0.06


def test_methods_that_feedback_biases_are_refused_in_a_loop_unless_it_is_accepted():
    loop, methods = closed_loop(600, 0, noise="process", late=1), [es.HoKalman(1), es.PredictionError(1, 0, 1, delay=1)]
    refused = es.compare(methods, loop)
    assert refused.ranked[-1].failure.startswith("the record was made in a closed loop")
    assert 'feedback="accepted"' in refused.ranked[-1].failure
    assert es.compare(methods, loop, feedback="accepted").ranked[-1].failure == ""


def test_an_unstable_plant_in_a_loop_is_explained_one_step_ahead():
    found = es.compare([es.PredictionError(1, 0, 1, delay=1)], closed_loop(800, 0, k=0.7, a=1.1), feedback="closed")
    assert found.best is not None
    assert "one step ahead" in found.sentence


@pytest.mark.parametrize("seed", range(3))
def test_a_series_is_judged_one_step_ahead(seed):
    y = lfilter([1.0, 0.5], [1, -0.8], np.random.default_rng(seed).normal(size=600))
    found = es.compare(None, es.Record(y, dt=1))
    assert found.best is not None
    assert {one.name for one in found.ranked} == {"LeastSquares", "PredictionError", "PredictorSubspace"}
    right = 100 * (1 - 1 / np.std(y))
    assert abs(found.best.fit_percent - right) < 6
    assert found.feedback is None


def test_a_series_of_white_noise_is_explained_by_nothing():
    methods, wrong = [es.LeastSquares(1, 0), es.PredictionError(1, 0, 1)], 0
    for seed in range(10):
        noise = np.random.default_rng(seed).normal(size=300)
        wrong += es.compare(methods, es.Record(noise, dt=1)).best is not None
    assert wrong == 0


def test_equal_models_are_alike_on_whole_records_and_another_input_explains_nothing():
    """`python -m benchmarks.figures.judged_records`."""
    right, alike, wrong = np.mean([whole(seed, 300, 1) for seed in range(4)], axis=0)
    assert (right, wrong) == (1, 0)
    assert alike >= 0.5
    assert series(0, "ARMA(2, 1)")[0]


def test_a_slow_plant_that_starts_away_from_rest_is_simulated_from_a_stable_model():
    found = es.compare([es.OutputErrorML(2, 1, delay=1), es.Subspace(2)], heating(2))
    assert found.best.name == "OutputErrorML"
    assert found.best.fit_percent > 55  # the noise leaves 64 %
    assert np.abs(np.linalg.eigvals(found.best.model.A)).max() < 1


@pytest.mark.parametrize("n", [2, 3, 4])
def test_loops_about_plants_of_higher_order(n):
    for weighting in ("ssarx", "pbsid"):
        off, gain = of_loop(0, n, weighting)
        assert off < 0.04
        assert abs(gain) < 3


def test_no_warning_of_an_overflow_reaches_the_user():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rng = np.random.default_rng(0)
        u = rng.choice([-1.0, 1.0], size=200).repeat(2)
        y = np.r_[0, np.cumsum(0.1 * u)[:-1]] + 0.05 * rng.normal(size=400)
        es.compare([es.HoKalman(1), es.InstrumentalVariables(2, 2, delay=1)], es.Record(y, u, dt=1))


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: es.compare(METHODS, record(0, 50), held_out=3), "`held_out` must be a Record, or a list of them. Got 3."),
        (lambda: es.compare(METHODS, record(0, 50), held_out=record(1, 50), split=0.3), "leave one of them out."),
        (lambda: es.compare(METHODS, record(0, 50), held_out=record(0, 50)), "record 0 of `held_out` is also in `record`"),
        (
            lambda: es.compare(METHODS, record(0, 50), held_out=es.Record(np.ones(50), dt=1)),
            "record 0 of `held_out` must have the inputs 'u1' and outputs 'y1' of `record`.",
        ),
        (lambda: es.compare(METHODS, record(0, 50), feedback="yes"), "`feedback` must be one of"),
        (lambda: es.identify(es.Subspace(1), es.Record(np.ones(50), dt=1)), "or use LeastSquares, PredictionError"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said(call, sentence):
    with pytest.raises(es.InputError) as caught:
        call()
    assert sentence in str(caught.value)
