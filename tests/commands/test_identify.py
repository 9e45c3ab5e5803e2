"""`estimable simulate` and `estimable identify`, one after the other."""

from pathlib import Path

import numpy as np
import pytest

from estimable.commands.identify_files import Asked, Files

SIMULATE = ("simulate", "output-error", "--input-arrival", "0.8", "--output-arrival", "0.7", "--seed", "1")


@pytest.fixture
def drawn(run, tmp_path):
    assert run(*SIMULATE, "--rows", "400", "--out", "run.csv").code == 0
    return tmp_path / "run.csv"


def test_a_drawn_record_has_gaps_that_are_read_back(run, drawn):
    lines = drawn.read_text().splitlines()
    assert lines[0] == "time,u,arrived,y"
    assert len(lines) == 401
    told = run(*SIMULATE, "--rows", "400", "--out", "again.csv", "--json").json
    assert 0.7 < told["input_arrival"] < 0.9
    assert (drawn.parent / "again.csv").read_text() == drawn.read_text()


@pytest.mark.parametrize("method", ["recursive-output-error", "output-error-ml"])
def test_what_was_drawn_is_identified(run, drawn, method):
    told = run("identify", "run.csv", "--method", method, "--set", "na=2", "--set", "nb=1", "--json").json
    true = {"a1": 0.523, "a2": 0.349, "b0": 0.440, "b1": 0.762}
    for name, value in true.items():
        assert abs(told["parameters"][name] - value) < 4 * told["sigma"][name]
    assert told["outcome"]["code"] == 0
    assert {check["name"] for check in told["checks"]} >= {"excitation", "stability", "positive-real"}


def test_orders_that_are_not_given_are_chosen(run, drawn):
    answer = run("identify", "run.csv", "--set", "delay=0", width=200)
    assert answer.code == 0
    assert "BIC chooses na = 2, nb = 1, delay = 0" in answer.stdout


def test_bursts_and_other_plants(run):
    answer = run("simulate", "output-error", "--output-arrival", "0.5", "--burst", "5", "--set", "a=[-0.9]", "--set",
                 "b=[1.0]", "--rows", "50", "--json")  # fmt: skip
    assert len(answer.json["rows"]["y"]) == 50


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("simulate", "arx"), "MODEL"),
        (("simulate", "output-error", "--set", "c=1"), "no setting 'c'"),
        (("simulate", "output-error", "--input-arrival", "2"), "`--input-arrival` must be at most 1. Got 2."),
        (("identify", "run.csv", "--method", "arx"), "no identifier 'arx'"),
        (("identify", "none.csv"), "none.csv does not exist"),
        (("identify", "run.csv", "--output", "z"), "z"),
        (("identify", "run.csv", "--set", "na=1", "--set", "nb=1", "--set", "colour=1"), "Its settings are"),
    ],
)
def test_what_is_wrong_is_said(run, drawn, arguments, sentence):
    answer = run(*arguments)
    assert answer.code == 2
    assert sentence in answer.stderr + answer.stdout


def test_without_a_method_all_are_compared(run, drawn):
    told = run("identify", "run.csv", "--inputs", "u", "--outputs", "y", "--json").json
    assert set(told["best"]) == {"method", "order", "fit_percent"}
    assert told["best"]["method"] == told["methods"][0]["method"]
    assert told["methods"][0]["within_noise_of_best"]
    assert len(told["methods"]) >= 3
    shown = run("identify", "run.csv", width=200).stdout
    assert told["outcome"]["sentence"] in shown


def test_a_record_of_noise_has_no_best(run, tmp_path):
    rng = np.random.default_rng(0)
    rows = "\n".join(f"{u:.6f},{y:.6f}" for u, y in rng.normal(size=(120, 2)))
    (tmp_path / "noise.csv").write_text(f"u,y\n{rows}\n")
    told = run("identify", "noise.csv", "--json").json
    assert told["best"] is None
    assert "no linear model explains this record" in told["outcome"]["sentence"]


@pytest.fixture
def level_run(run, tmp_path):
    """A record about levels: the command that identifies it, and what it says."""
    rng = np.random.default_rng(2)
    u, x, rows = rng.normal(size=160), 0.0, []
    for k in range(160):
        x = 0.7 * x + (u[k - 1] if k else 0.0)
        rows.append(f"{u[k] + 5:.6f},{x + 20 + 0.1 * rng.normal():.6f}")
    (tmp_path / "tank.csv").write_text("valve,level\n" + "\n".join(rows) + "\n")
    return ("identify", "tank.csv", "--inputs", "valve", "--outputs", "level", "--dt", "0.5")


def test_what_is_written_goes_straight_into_the_other_commands(run, level_run, tmp_path):
    told = run(*level_run, "--order", "1", "--json").json
    assert told["written"] == {"model": "tank-model.toml", "report": "tank-report.html"}
    assert {one["order"] for one in told["methods"]} == {1}
    assert told["for_a_filter"]["fit_percent"] > 85
    assert set(told["recommended_orders"]) >= {"bic", "aicc", "cross_validation", "singular_value_gap"}
    estimated = run("estimate", "tank.csv", "--model", "tank-model.toml", "--filter", "kalman", "--json").json
    assert estimated["nis"]["consistent"]
    assert run("check", "tank-model.toml", "--json").code == 0
    page = (tmp_path / "tank-report.html").read_text()
    for words in (
        "Does the model simulate held-out data?", "Which order?", "Are the residuals white?", "Poles and zeros",
        "Step response", "frequency [Hz]", "± 2 sigma of the parameters", "Methods compared on the held-out part",
        "estimable identify tank.csv --output level --input valve --dt 0.5 --order 1",
    ):  # fmt: skip
        assert words in page, words


def test_one_method_writes_them_too_about_the_level_that_was_asked_for(run, level_run, tmp_path):
    answer = run(
        *level_run, "--method", "subspace", "--order", "1", "--level", "mean", "--out", "m.toml", "--report", "r.html"
    )
    assert answer.code == 0
    assert "Wrote m.toml" in answer.stderr
    from estimable import read_model

    model = read_model(tmp_path / "m.toml").model
    np.testing.assert_allclose(model.operating_point.inputs, [5], atol=0.3)
    np.testing.assert_allclose(np.linalg.eigvals(model.A), [0.7], atol=0.03)
    assert (tmp_path / "r.html").stat().st_size > 1e6


def test_what_the_record_does_not_fix_has_no_number(run, tmp_path):
    rows = "\n".join(f"1.0,{y:.6f}" for y in np.random.default_rng(0).normal(size=60))
    (tmp_path / "still.csv").write_text(f"u,y\n{rows}\n")
    given = ("identify", "still.csv", "--method", "least-squares", "--set", "na=0", "--set", "nb=1")
    assert run(*given, "--json").json["sigma"] == {"b0": None, "b1": None}
    assert "not known" in run(*given).stdout


def test_files_that_cannot_be_written_are_refused_before_anything_runs(run, level_run):
    answer = run(*level_run, "--out", "model.csv", "--report", "nowhere/r.html")
    assert answer.code == 2
    assert "--out must end in .toml" in answer.stderr


def test_an_unknown_level_is_refused(run):
    answer = run("identify", "flight.csv", "--method", "least-squares", "--input", "elevator_deg", "--output", "alpha_deg",
                 "--level", "walk=-1")  # fmt: skip
    assert answer.code == 2
    assert "`level` must be one of 'mean', 'trend', 'none'. Got 'walk=-1'." in answer.stderr


def test_an_input_that_was_never_logged_is_named(run, tmp_path):
    (tmp_path / "run.csv").write_text("time,u,y\n" + "\n".join(f"{0.1 * k},,{k % 7}" for k in range(60)) + "\n")
    answer = run("identify", "run.csv")
    assert (answer.code, answer.stderr) == (2, "Error: input 'u' was never logged: leave it out.\n")


def test_a_second_flight_judges_and_the_verdict_comes_first(run, tmp_path):
    for name, seed in (("flight1", 1), ("flight2", 2)):
        rng = np.random.default_rng(seed)
        u, x, rows = rng.normal(size=160), 0.0, []
        for k in range(160):
            rows.append(f"{u[k]:.6f},{x + 0.1 * rng.normal() + 5 * seed:.6f}")
            x = 0.7 * x + u[k]
        (tmp_path / f"{name}.csv").write_text("elevator,rate\n" + "\n".join(rows) + "\n")
    given = (
        "identify",
        "flight1.csv",
        "--held-out",
        "flight2.csv",
        "--input",
        "elevator",
        "--output",
        "rate",
        "--order",
        "1",
    )
    told = run(*given, "--json").json
    assert told["held_out"] == ["flight2.csv"]
    assert told["split"] is None
    assert "explain" in told["verdict"]
    assert told["best"]["fit_percent"] > 85  # the other level is no fault
    assert told["delay"]["samples"] == 1
    assert told["feedback"]["closed"] is False
    assert told["judged"] == "simulation"
    answer = run(*given, width=200)
    assert answer.stdout.splitlines()[0] == told["verdict"]
    assert "ranked on 'flight2.csv'" in answer.stdout
    page = (tmp_path / "flight1-report.html").read_text()
    assert "--held-out flight2.csv" in page
    assert "held_out=others" in page
    assert told["verdict"].rstrip(".") in page


def test_a_closed_loop_is_said_and_may_be_accepted(run, tmp_path):
    from benchmarks.figures.closed_loops import closed_loop

    loop = closed_loop(400, 0, noise="process", late=1)
    rows = "\n".join(f"{u:.6f},{y:.6f}" for u, y in zip(loop.u[:, 0], loop.y[:, 0], strict=True))
    (tmp_path / "loop.csv").write_text(f"u,y\n{rows}\n")
    told = run("identify", "loop.csv", "--order", "1", "--json").json
    assert told["feedback"]["closed"] is True
    assert told["judged"] == "one step ahead"
    assert "it was made in a closed loop" in told["verdict"]
    assert {one["method"] for one in told["methods"]} == {"PredictionError", "PredictorSubspace"}
    assert run("identify", "loop.csv", "--feedback", "perhaps").code == 2


def test_other_parameters_that_fit_as_well_are_in_the_json(run, tmp_path):
    g = np.random.default_rng(0)
    u, x, rows = np.repeat(g.normal(size=300), 2), 0.0, []
    for k in range(600):
        rows.append(f"{u[k]:.6f}," + (f"{x + 0.1 * g.normal():.6f}" if k % 2 == 0 else ""))
        x = 0.8 * x + 0.5 * u[k]
    (tmp_path / "rates.csv").write_text("u,y\n" + "\n".join(rows) + "\n")
    told = run("identify", "rates.csv", "--set", "na=1", "--set", "nb=0", "--set", "delay=1", "--json").json
    assert len(told["rivals"]) == 1
    assert set(told["rivals"][0]) == {"a1", "b0"}
    assert told["verdict"].startswith("The model fails the check")


def test_the_command_of_a_page_quotes_its_names():
    asked = Asked(Path("run 1.csv"), ["rate q"], ["u"], {}, 0.5, None, Files(Path(), Path()), (Path("run 2.csv"),))
    again = "estimable identify 'run 1.csv' --output 'rate q' --input u --held-out 'run 2.csv' --method arx"
    assert asked.again("--method arx") == again
