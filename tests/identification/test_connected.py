"""Records with dropped rows, scattered stamps, breaks and unknown inputs, in every batch identifier."""

import numpy as np
import pandas as pd
import pytest

import estimable as es
from estimable.identification.connected import LONG
from estimable.kernels.missing_series import conditional

PLANT = es.OutputError([-0.8], [0.2], delay=1, noise_variance=0.01, dt=0.1)


def drawn(seed, held=20, T=1000, dropped=0.3):
    """Outputs, inputs held for some rows, and times of the rows that were not dropped."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.normal(size=T // held + 1), held)[:T]
    y = PLANT.response(u[:, None])[:, 0] + 0.1 * rng.normal(size=T)
    left = rng.random(T) >= dropped
    left[0] = True
    return y[left], u[left], 0.1 * np.flatnonzero(left)


def static_gain(model):
    model = model if isinstance(model, es.StateSpace) else model.to_state_space()
    return float((model.C @ np.linalg.solve(np.eye(model.n) - model.A, model.B) + model.D)[0, 0])


def test_rows_that_are_missing_are_inserted():
    y, u, t = drawn(0)
    record = es.Record(y, u, t=t + 5.0, breaks=[100]).on_grid()
    rows = np.rint(t / 0.1).astype(int)
    assert (len(record), record.dt, record.grid, record.breaks) == (rows[-1] + 1, 0.1, 0.1, (rows[100],))
    np.testing.assert_array_equal(record.y[rows, 0], y)
    assert np.isnan(record.y).sum() == len(record) - len(y)
    np.testing.assert_allclose(record.t, 5.0 + 0.1 * np.arange(len(record)))
    for k in np.setdiff1d(np.arange(len(record)), rows):
        before, after = u[rows < k][-1], u[rows > k][0]
        np.testing.assert_equal(record.u[k, 0], before if before == after else np.nan)
    assert "are missing, and the input is unknown in" in record.notes[-1]
    assert record.on_grid() is record


GRIDS = {
    "scattered": ([0.0, 1.0, 2.2, 3.0, 4.0], None, "row 2, 2.2 s, is 0.2 s from a multiple of 1"),
    "two in a row": (
        [0.0, 1.0, 1.01, 2.0, 3.0],
        None,
        "rows 1 and 2 are both at 1.00077 s",
    ),
    "far": ([0.0, 1.0, 2.0, 1e6], None, "between rows 2 and 3 999998 s are missing"),
    "another step": ([0.0, 1.0, 2.0, 3.0], 0.7, "more than 0.1 of a step. Give on_grid(dt) another step"),
}


@pytest.mark.parametrize(("t", "dt", "words"), GRIDS.values(), ids=GRIDS)
def test_stamps_that_are_no_multiples_are_refused(t, dt, words):
    with pytest.raises(es.InputError) as raised:
        es.Record(np.zeros(len(t)), np.zeros(len(t)), t=t).on_grid(dt)
    assert words in str(raised.value)


def test_the_noise_and_the_arrivals_of_the_rows_go_with_them():
    record = es.Record(
        [1.0, 2.0, 3.0], [5.0, 5.0, 5.0], t=[0.0, 1.0, 3.0], sigma=[[0.1], [0.2], [0.3]], arrived=[1, 0, 1]
    ).on_grid()
    np.testing.assert_array_equal(record.sigma.ravel(), [0.1, 0.2, np.nan, 0.3])
    np.testing.assert_array_equal(record.arrived.ravel(), [1.0, 0.0, np.nan, 1.0])


def test_a_record_without_time_has_no_grid():
    with pytest.raises(es.InputError, match="a grid needs times: give the record `t`"):
        es.Record([1.0, 2.0]).on_grid()


def test_dropped_rows_leave_no_bias_and_honest_errors():
    """u held 20 rows, 30 % of rows dropped. The full draws are in benchmarks/figures/dropped_rows.py."""
    θ = np.array([-0.8, 0.2])
    fits = [es.identify(es.OutputErrorML(1, 0, delay=1), es.Record(y, u, t=t)) for y, u, t in map(drawn, range(4))]
    errors = np.array([fit.parameters - θ for fit in fits])
    assert np.all(np.abs(errors.mean(axis=0)) < 0.002 + 3 * errors.std(axis=0) / 2)
    z = errors / np.array([fit.sigma for fit in fits])
    assert np.sqrt(np.mean(z**2)) < 1.6
    (check,) = [one for one in fits[0].validation.checks if one.name == "rows"]
    assert "are missing on a grid of 0.1 s" in check.sentence


METHODS = {
    "LeastSquares": (es.LeastSquares(1, 0, delay=1), 0.15), "Subspace": (es.Subspace(1, draws=0), 0.06),
    "HoKalman": (es.HoKalman(1), 0.1), "MarkovParameters": (es.MarkovParameters(25), 0.1),
    "MinimumVariance": (es.MinimumVariance(1, 0, delay=1), 0.1),
    "InstrumentalVariables": (es.InstrumentalVariables(1, 0, delay=1), 0.1),
    "CoupledLeastSquares": (es.CoupledLeastSquares(1, 0, delay=1), 0.15),
}  # fmt: skip


@pytest.mark.parametrize(("method", "limit"), METHODS.values(), ids=METHODS)
def test_every_batch_identifier_takes_stamps_with_gaps(method, limit):
    y, u, t = drawn(1)
    fit = es.identify(method, es.Record(y, u, t=t))
    assert static_gain(fit.model) == pytest.approx(1.0, abs=limit)


def test_scattered_stamps_are_judged_by_what_they_move():
    rng, T = np.random.default_rng(0), 600
    u = np.repeat(rng.normal(size=T // 20), 20)
    y = PLANT.response(u[:, None])[:, 0]
    for sd, passed in ((0.3, True), (0.001, False)):
        t = 0.1 * np.arange(T) + rng.uniform(-0.008, 0.008, T)
        fit = es.identify(es.LeastSquares(1, 0, delay=1), es.Record(y + sd * rng.normal(size=T), u, t=t))
        (check,) = [one for one in fit.validation.checks if one.name == "stamps"]
        assert check.passed == passed
        assert ("standard deviations are too small" in check.sentence) != passed


def test_a_long_unknown_input_and_a_break_cut_the_record():
    rng, T = np.random.default_rng(2), 900
    u = np.repeat(rng.normal(size=T // 10), 10)
    y = PLANT.response(u[:, None])[:, 0] + 0.1 * rng.normal(size=T)
    jumped = np.concatenate([y[:300], y[600:]])
    lost = np.where((np.arange(T) >= 400) & (np.arange(T) < 400 + 5 * LONG), np.nan, u)
    lost[100] = np.nan  # one unknown input, which the likelihood counts
    for record, method in (
        (es.Record(jumped, np.concatenate([u[:300], u[600:]]), dt=0.1, breaks=[300]), es.LeastSquares(1, 0, delay=1)),
        (
            es.Record(y, u, t=0.1 * np.arange(T) + np.where(np.arange(T) < 450, 0.0, 3600.0)),
            es.LeastSquares(1, 0, delay=1),
        ),
        (es.Record(y, lost, dt=0.1), es.OutputErrorML(1, 0, delay=1)),
    ):
        fit = es.identify(method, record)
        (check,) = [one for one in fit.validation.checks if one.name == "parts"]
        assert check.value == len(fit.validation.residuals) == 2
    assert np.all(np.abs(fit.parameters - PLANT.parameters) < 4 * fit.sigma)


def test_estimates_of_unknown_inputs_are_those_of_a_held_and_of_a_white_input():
    rng = np.random.default_rng(3)
    white, held = rng.normal(size=2000), np.repeat(rng.normal(size=100), 20)
    lost = rng.random(2000) < 0.2
    for u, error in ((white, 1.0), (held, 0.3)):
        mean, variance = conditional(np.where(lost, np.nan, u))
        np.testing.assert_array_equal(mean[~lost], u[~lost])
        assert not variance[~lost].any()
        found = np.sqrt(np.mean((mean - u)[lost] ** 2))
        assert found == pytest.approx(error, abs=0.15)
        assert np.sqrt(variance[lost].mean()) == pytest.approx(found, rel=0.35)


def test_a_comparison_takes_stamps_with_gaps():
    y, u, t = drawn(4, T=400)
    found = es.compare([es.LeastSquares(1, 0, delay=1), es.Subspace(1, draws=0)], es.Record(y, u, t=t))
    assert found.best is not None
    assert found.best.fit_percent > 60


def test_orders_and_dead_times_are_those_of_the_rows_that_were_dropped():
    """Rows that are taken as consecutive would shorten every delay."""
    late = es.OutputError([-0.8], [0.2], delay=9, noise_variance=0.0025, dt=0.1)
    rng = np.random.default_rng(6)
    u = np.repeat(rng.normal(size=300), 4)
    y = late.response(u[:, None])[:, 0] + 0.05 * rng.normal(size=1200)
    left = np.flatnonzero(rng.random(1200) > 0.15)
    record = es.Record(y[left], u[left], t=0.1 * left)
    assert 9 in {es.dead_time(record).delay, *es.dead_time(record).alike}
    assert es.select_order(record, orders=[1, 2], delays=range(8, 11)).delay == 9
    assert es.choose_orders(record, na=[1], nb=[0], delay=[9]).best.fit.parameters[0] == pytest.approx(-0.8, abs=0.05)


def table(y, u, t):
    return pd.DataFrame({"time": t.round(6), "u": u, "y": y})


def test_the_command_reports_rows_that_are_missing_and_ends_with_2_where_nothing_can_be_done(tmp_path, monkeypatch):
    from typer.testing import CliRunner

    from estimable.commands import app

    monkeypatch.chdir(tmp_path)
    y, u, t = drawn(5, T=400)
    table(y, u, t).to_csv("run.csv", index=False)
    table(y[:4], u[:4], t[:4]).to_csv("short.csv", index=False)
    table(y, u, np.cumsum(np.random.default_rng(0).uniform(0.05, 0.15, len(y)))).to_csv("scattered.csv", index=False)
    given = ["--input", "u", "--output", "y", "--method", "least-squares", "--set", "na=1", "--set", "nb=0", "--json"]
    found = CliRunner().invoke(app, ["identify", "run.csv", *given])
    assert found.exit_code == 0
    assert "are missing, and the input is unknown in" in found.stdout
    assert es.read_model("run-model.toml").record == {"time": "time", "grid": 0.1}
    for name, words in (
        ("short", "no method could be fitted to this record"),
        ("scattered", "no multiples of one step"),
    ):
        found = CliRunner().invoke(app, ["identify", f"{name}.csv", "--input", "u", "--output", "y"])
        assert found.exit_code == 2
        assert words in found.stderr
