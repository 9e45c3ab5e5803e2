"""Measurements as recorders leave them: masks, None, several rows at one instant, and values that no sensor gives."""

import logging

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_array_equal

import estimable as es

NAN = np.nan
MODEL = es.StateSpace([[0.9]], [[1.0]], C=[[1.0], [1.0]], Q=[[0.1]], R=np.eye(2), dt=1, outputs=["gps", "odo"])
PRIOR = es.Prior([0.0], [[1.0]])


@pytest.fixture
def said(caplog):
    caplog.set_level(logging.WARNING, "estimable.data")
    return lambda: [record.getMessage() for record in caplog.records if record.name == "estimable.data"]


@pytest.mark.parametrize("y", [
    np.ma.array([1.0, 2.0, 3.0], mask=[False, True, False]),
    np.ma.array([[1.0], [2.0], [3.0]], mask=[[False], [True], [False]]),
    np.ma.array([1, 2, 3], mask=[False, True, False]),
    [1.0, None, 3.0], [[1.0], [None], [3.0]], np.array([1.0, None, 3.0], object), [1, pd.NA, 3], [1.0, NAN, 3.0],
])  # fmt: skip
def test_what_is_masked_or_none_is_not_seen(y):
    assert_array_equal(es.Record(y, dt=1).y, [[1.0], [NAN], [3.0]])


def test_a_mask_of_nothing_and_one_of_everything():
    assert_array_equal(es.Record(np.ma.array([1.0, 2.0]), dt=1).y, [[1.0], [2.0]])
    assert np.isnan(es.Record(np.ma.masked_all((3, 2)), dt=1).y).all()
    assert np.isnan(es.Record([None, None], dt=1).y).all()


def test_texts_among_outputs_are_refused():
    with pytest.raises(es.InputError, match="`y` must be an array of real numbers"):
        es.Record(["a", None], dt=1)


def frame(**columns):
    return pd.DataFrame({"time": [0, 1.0, 1.0, 2.5], **columns})


def test_two_sensors_at_one_instant_are_one_row(said):
    record = es.Record.from_pandas(
        frame(gps=[1.0, NAN, 1.1, NAN], odo=[NAN, 1.0, NAN, 1.2], u=[0.0, 2.0, 2.0, NAN]), outputs=["gps", "odo"], inputs=["u"],
        time="time",
    )  # fmt: skip
    assert_array_equal(record.t, [0.0, 1.0, 2.5])
    assert_array_equal(record.y, [[1.0, NAN], [1.1, 1.0], [NAN, 1.2]])
    assert_array_equal(record.u, [[0.0], [2.0], [NAN]])
    assert said() == ["1 instant with several rows, the first at t = 1 s: each is merged into one row."]


@pytest.mark.parametrize("seed", range(5))
def test_merging_undoes_a_log_that_has_a_row_for_each_sensor(seed, said):
    rng = np.random.default_rng(seed)
    T, p, m = 40, 3, 2
    whole = es.Record(
        np.where(rng.random((T, p)) < 0.3, NAN, rng.normal(size=(T, p))), rng.normal(size=(T, m)),
        t=np.cumsum(rng.random(T) + 0.1), arrived=rng.integers(0, 2, (T, m)),
    )  # fmt: skip
    each = np.repeat(np.arange(T), p)
    y = np.where(np.tile(np.eye(p, dtype=bool), (T, 1)), whole.y[each], NAN)
    u, arrived = whole.u[each], whole.arrived[each]
    u[rng.random(u.shape) < 0.3] = NAN
    for k in range(T):  # at least one row of each instant has each input
        u[p * k] = whole.u[k]
    merged = es.Record(y, u, t=whole.t[each], arrived=arrived)
    for name in ("y", "u", "t", "arrived"):
        np.testing.assert_allclose(getattr(merged, name), getattr(whole, name), rtol=1e-15)
    assert len(said()) == 1


@pytest.mark.parametrize(("columns", "channel"), [
    ({"gps": [1.0, 1.2, 1.1, NAN], "odo": [NAN, 1.0, NAN, 1.2], "u": [0.0, 2.0, 2.0, 0.0]}, "gps"),
    ({"gps": [1.0, NAN, 1.1, NAN], "odo": [NAN, 1.0, NAN, 1.2], "u": [0.0, 2.0, 3.0, 0.0]}, "u"),
])  # fmt: skip
def test_two_values_of_one_channel_at_one_instant_are_refused(columns, channel):
    with pytest.raises(es.InputError, match=f"two rows have the time 1 s, and both have a value of '{channel}'"):
        es.Record.from_pandas(frame(**columns), outputs=["gps", "odo"], inputs=["u"], time="time")


def test_a_wild_value_counts_as_not_seen_and_is_named(said):
    y = np.ones((6, 2))
    clean = y.copy()
    y[3, 1], clean[3, 1] = 1e300, NAN
    u = np.zeros(6)
    for engine in ("xla", "native"):
        found, expected = (
            es.estimate(es.Kalman(MODEL), es.Record(one, u, dt=1, outputs=["gps", "odo"]), prior=PRIOR, engine=engine)
            for one in (y, clean)
        )
        assert found.outcome.code == 0
        assert_array_equal(found.mean, expected.mean)
    assert said()[0] == "y[3] of 'odo' is 1e+300, too large for a filter: it counts as missing."
    y[4] = -1e200
    es.estimate_bank(
        es.Kalman(MODEL), [es.Record(one, u, dt=1, outputs=["gps", "odo"]) for one in (clean, y)], prior=PRIOR
    )
    assert said()[-1] == (
        "y[3] of 'odo' in run 1 is 1e+300, too large for a filter: it counts as missing, and 2 more values too."
    )


@pytest.mark.parametrize("engine", ["xla", "native"])
def test_online_a_wild_value_counts_as_not_seen_and_the_first_is_named(said, engine):
    wild, clean = (es.online(es.Kalman(MODEL), prior=PRIOR, engine=engine) for _ in range(2))
    for k in range(6):
        y = np.array([1.0, {3: 1e300, 4: -1e200}.get(k, 1.0)])
        found = wild.correct(y), clean.correct(np.where(np.abs(y) > 1e100, NAN, y))
        for name in ("mean", "covariance", "innovation", "log_likelihood"):
            assert_array_equal(*(getattr(info, name) for info in found))
        for running in (wild, clean):
            running.predict([0.0])
    assert wild.engine == engine
    assert said() == ["y[3] of 'odo' is 1e+300, too large for a filter: it counts as missing."]


def test_periods_are_times():
    table = pd.DataFrame({"y": [1.0, 2.0, 3.0]}, index=pd.period_range("2026-01-01", periods=3, freq="s"))
    assert_array_equal(es.Record.from_pandas(table, outputs=["y"]).t, [0.0, 1.0, 2.0])
    column = table.reset_index(names="when")
    assert_array_equal(es.Record.from_pandas(column, outputs=["y"], time="when").t, [0.0, 1.0, 2.0])


@pytest.mark.parametrize("given", [{"dt": 0.1}, {"t": [0.0, 0.1, 0.2]}, {"t": [0.0, 0.1, 0.3]}, {}])
def test_a_record_of_any_time_is_saved_and_loaded(given, tmp_path):
    record = es.Record([1.0, 2.0, 3.0], **given)
    es.save(tmp_path / "record.npz", {"whole": record, "part": record[1:]})
    found = es.load(tmp_path / "record.npz")
    assert (found["whole"].timed, found["part"].timed) == (record.timed, record.timed)
    assert_array_equal(found["whole"].y, record.y)
