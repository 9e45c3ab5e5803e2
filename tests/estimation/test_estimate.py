"""What the drivers return."""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

from cases import case
from estimable import Kalman, Prior, Record, StateSpace, UnknownGain, estimate, online


@pytest.fixture(scope="module")
def result():
    c = case(1, (3, 2, 2))
    return estimate(UnknownGain(c.model, Prior([1.0], [[1.0]])), c.record, prior=c.prior)


def test_a_table_has_every_quantity_beside_its_standard_deviation(result):
    table = result.to_pandas()
    assert isinstance(table, pd.DataFrame)
    assert table.index.name == "time"
    assert_allclose(table.index, 0.5 * np.arange(12))
    assert_allclose(table["x2"], result.mean[:, 1])
    assert_allclose(table["x2_sigma"], np.sqrt(result.covariance[:, 1, 1]))
    assert_allclose(table["gain_sigma"], np.sqrt(result.gain_covariance[:, 0, 0]))
    assert_allclose(table["innovation_y1"], result.innovation[:, 0])
    assert_allclose(table["log_likelihood"].sum(), result.log_likelihood)


def test_a_dataset_has_named_dimensions_and_full_covariances(result):
    xarray = pytest.importorskip("xarray", reason="extra xarray is not installed")
    dataset = result.to_xarray()
    assert isinstance(dataset, xarray.Dataset)
    assert dataset["covariance"].dims == ("time", "states", "states_2")
    assert_allclose(dataset["covariance"].sel(states="x1", states_2="x3"), result.covariance[:, 0, 2])
    assert dataset.attrs["log_likelihood"] == result.log_likelihood


def test_a_record_without_time_takes_the_model_s_step():
    model = StateSpace([[0.5]], [[1.0]], Q=[[1.0]], R=[[1.0]], dt=0.2)
    gain = Prior([1.0], [[1.0]])
    timed = estimate(
        UnknownGain(model, gain, walk=1.0), Record([1.0, 2.0], [1.0, 1.0], dt=0.2), prior=Prior([0.0], [[1.0]])
    )
    bare = estimate(UnknownGain(model, gain, walk=1.0), Record([1.0, 2.0], [1.0, 1.0]), prior=Prior([0.0], [[1.0]]))
    assert_allclose(bare.gain_covariance, timed.gain_covariance)
    assert bare.t is None
    assert "x1" in bare.to_pandas()


def test_results_are_in_absolute_units_about_an_operating_point():
    point = {"states": [2.0, -1.0], "inputs": [3.0], "outputs": [10.0]}
    A, B, C, D = [[0.9, 0.1], [0.0, 0.8]], [[1.0], [0.5]], [[1.0, 0.0]], [[0.2]]
    noise = {"Q": np.eye(2), "R": [[0.3]], "dt": 1}
    rng = np.random.default_rng(0)
    y, u = rng.normal(size=(9, 1)), rng.normal(size=(9, 1))
    about = estimate(
        Kalman(StateSpace(A, B, C, D, **noise, operating_point=point)), Record(y + 10, u + 3, dt=1),
        prior=Prior([2.0, -1.0], np.eye(2)),
    )  # fmt: skip
    zero = estimate(Kalman(StateSpace(A, B, C, D, **noise)), Record(y, u, dt=1), prior=Prior([0.0, 0.0], np.eye(2)))
    assert_allclose(about.mean, zero.mean + [2.0, -1.0], rtol=1e-12, atol=1e-12)
    assert_allclose(about.innovation, zero.innovation, rtol=1e-9, atol=1e-12)


def test_two_corrections_at_one_instant_are_one_with_both_sensors():
    both = StateSpace([[0.9]], C=[[1.0], [2.0]], Q=[[0.1]], R=np.diag([0.3, 0.5]), dt=1)
    prior, y = Prior([0.0], [[1.0]]), [0.4, 1.0]
    once = online(Kalman(both), prior=prior).correct(y)
    running = online(Kalman(both), prior=prior)
    running.correct([y[0], np.nan])
    twice = running.correct([np.nan, y[1]])
    assert_allclose(twice.mean, once.mean, rtol=1e-13)
    assert_allclose(twice.covariance, once.covariance, rtol=1e-13)
    running.predict()
    assert_allclose(running.correct([np.nan, np.nan]).mean, 0.9 * once.mean, rtol=1e-13)


def test_units_of_the_record_reach_figures_and_datasets():
    model = StateSpace([[0.5]], C=[[1.0]], Q=[[1.0]], R=[[1.0]], dt=1, outputs=["level"])
    record = Record([1.0, 2.0], dt=1, outputs=["level"], units={"level": "m"})
    measured = estimate(Kalman(model), record, prior=Prior([0.0], [[1.0]]))
    assert measured.to_xarray().attrs["units"] == {"level": "m"}
    titles = [note.text for note in measured.plot().layout.annotations]
    assert any("level [m]" in title for title in titles)
