"""Several methods on one record: ranked on what none has seen, noise told from difference, nothing crowned for nothing."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import (
    HoKalman,
    InputError,
    Kalman,
    LeastSquares,
    OutputError,
    OutputErrorML,
    Prior,
    Record,
    Subspace,
    compare,
    estimate,
    simulate,
)

HAIR_DRYER = Path(__file__).parents[3] / "shared" / "data" / "hair-dryer.csv"
PLANT = OutputError([-1.2, 0.5], [1.0, 0.4], delay=1, noise_variance=0.5, dt=0.1)


def drawn(rows=600, seed=0, level=0.0):
    u = np.random.default_rng(seed).normal(size=rows)
    record = simulate(PLANT, u, seed=seed).record
    return Record(record.y + 10 * level, u + level, dt=0.1)


@pytest.fixture(scope="module")
def hair_dryer():
    if not HAIR_DRYER.exists():
        pytest.skip("the hair dryer's record is not on this machine")
    return np.loadtxt(HAIR_DRYER, delimiter=",", skiprows=1).T


def test_the_hair_dryer_is_simulated_as_well_as_careful_fits_do(hair_dryer):
    u, y = hair_dryer
    found = compare(None, Record(y, u, dt=0.08))
    assert found.best.fit_percent >= 85.5
    kinds = {"HoKalman", "InstrumentalVariables", "LeastSquares", "OutputErrorML", "PredictionError", "Subspace"}
    assert {one.name for one in found.ranked} == kinds


def test_a_fifth_of_the_outputs_missing_costs_less_than_two_points(hair_dryer):
    u, y = hair_dryer
    gone = (np.random.default_rng(1).random(1000) < 0.2) & (np.arange(1000) < 500)
    methods = [LeastSquares(2, 1, delay=3), OutputErrorML(2, 1, delay=3), Subspace(4), HoKalman(4)]
    fits = [compare(methods, Record(one, u, dt=0.08)).best.fit_percent for one in (y, np.where(gone, np.nan, y))]
    assert fits[0] - fits[1] < 2


def test_the_right_method_wins_and_says_who_is_alike():
    found = compare([LeastSquares(2, 1, delay=1), OutputErrorML(2, 1, delay=1), Subspace(2)], drawn())
    assert found.best.name == "OutputErrorML"
    biased = next(one for one in found.ranked if one.name == "LeastSquares")
    assert not biased.alike
    assert "OutputErrorML of order 2 fits best" in found.sentence


def test_a_twin_is_within_noise():
    found = compare([OutputErrorML(2, 1, delay=1), OutputErrorML(2, 1, delay=1, initial="free")], drawn())
    assert all(one.alike for one in found.ranked)
    assert "Not significantly worse: OutputErrorML." in found.sentence


@pytest.mark.parametrize("seed", range(3))
def test_no_model_of_noise_is_crowned(seed):
    rng = np.random.default_rng(seed)
    found = compare(
        [LeastSquares(2, 1), OutputErrorML(2, 1), Subspace(2)], Record(rng.normal(size=300), rng.normal(size=300), dt=1)
    )
    assert found.best is None
    assert "no linear model explains this record" in found.sentence


def test_levels_are_the_operating_point_of_the_model():
    found = compare([OutputErrorML(2, 1, delay=1)], drawn(level=3.0))
    record = drawn(level=3.0)
    assert_allclose(found.best.model.operating_point.inputs, record.u[:300].mean(axis=0))
    plain = compare([OutputErrorML(2, 1, delay=1)], drawn())
    assert abs(found.best.fit_percent - plain.best.fit_percent) < 1e-6
    model = found.best.model
    states = estimate(Kalman(model), record, prior=Prior(np.zeros(model.n), np.eye(model.n)))
    assert np.nanmean(np.square(states.innovation[300:])) < 0.6


def test_what_is_held_out_does_not_change_the_fit():
    record = drawn()
    y = record.y.copy()
    y[300:] += np.random.default_rng(5).normal(size=(300, 1))
    one, other = (compare([Subspace(2)], Record(outputs, record.u, dt=0.1)) for outputs in (record.y, y))
    assert one.best.fit.parameters.tolist() == other.best.fit.parameters.tolist()


def test_several_records_are_each_split():
    found = compare([OutputErrorML(2, 1, delay=1)], [drawn(300, 1), drawn(200, 2)], split=0.6)
    assert [len(e) for e in found.best.fit.validation.residuals] == [180, 120]


def test_a_method_that_fails_comes_last_with_its_sentence():
    told = []
    found = compare(
        [Subspace(9, horizon=40), OutputErrorML(2, 1, delay=1)], drawn(100), progress=lambda *now: told.append(now)
    )
    assert found.ranked[-1].name == "Subspace"
    assert "too short" in found.ranked[-1].failure
    assert told == [("choosing the dead time", 0, 1), ("Subspace", 0, 2), ("OutputErrorML", 1, 2), ("", 2, 2)]
    assert compare([Subspace(9, horizon=40)], drawn(100)).best is None


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: compare([], drawn(50)), "`methods` must be a list of identifiers, or None. Got []."),
        (lambda: compare(None, 3.0), "`record` must be a Record, or a list of them. Got 3.0."),
        (lambda: compare(None, drawn(50), split=0.0), "`split` must be greater than 0. Got 0."),
        (
            lambda: compare(None, drawn(50), split=1.0),
            "`split` must leave rows in both parts of record 0, which has 50 rows. Got 1.",
        ),
        (
            lambda: compare(None, drawn(50), level="median"),
            "`level` must be one of 'mean', 'trend', 'none'. Got 'median'.",
        ),
        (
            lambda: compare(None, Record([*range(9), *[np.nan] * 9], np.arange(18.0), dt=1)),
            "record 0: an output is not seen in the held-out part: choose another `split`.",
        ),
    ],
)
def test_what_is_wrong_is_said(call, sentence):
    with pytest.raises(InputError) as caught:
        call()
    assert sentence in str(caught.value)


def test_ctrl_c_ranks_what_has_run_and_says_what_has_not():
    u = np.random.default_rng(0).normal(size=200)
    record = simulate(OutputError([-0.5], [1.0], noise_variance=0.01, dt=1), u, seed=0).record
    methods = [OutputErrorML(1, 0), LeastSquares(1, 0), LeastSquares(0, 0)]

    class Interrupted(LeastSquares):
        def __init__(self):
            pass

        def fit(self, records):
            raise KeyboardInterrupt

    tried = [*methods[:2], Interrupted(), methods[2]]
    found = compare(tried, record)
    assert found.sentence.startswith("Interrupted: 'Interrupted', 'LeastSquares' did not run. ")
    assert [one.name for one in found.ranked] == ["OutputErrorML", "LeastSquares"]
    with pytest.raises(KeyboardInterrupt):
        compare(tried[2:], record)
