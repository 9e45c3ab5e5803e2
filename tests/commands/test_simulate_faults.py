"""`estimable simulate f16 --fault`: a record, and the truth behind it."""

import json

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

import estimable as es
from estimable.plants import worlds


def test_the_record_and_the_truth_are_those_of_the_flight(run, tmp_path):
    out = tmp_path / "F.csv"
    told = run("simulate", "f16", "--fault", "stuck:elevator@4.5", "--fault", "effectiveness:elevator@3=0.7",
               "--fault", "dropout:alpha@5-6", "--seed", "1", "--out", str(out), "--json")  # fmt: skip
    assert told.code == 0
    assert [event["event"] for event in told.json["events"]] == ["Failure", "Stuck", "SensorFault"]
    record, truth = pd.read_csv(out), json.loads((tmp_path / "F.truth.json").read_text())
    events = [es.Stuck(4.5, "elevator_deg"), es.Failure(3.0, 0.7, "elevator_deg"),
              es.SensorFault(5.0, "alpha_deg", "dropout", until=6.0)]  # fmt: skip
    closed = worlds.world("f16", events).fly(seed=1)
    assert_allclose(record["elevator_deg"], closed.input[:, 0], rtol=1e-12)
    assert_allclose(record["elevator_deg_command"], closed.applied[:, 0], rtol=1e-12)
    assert_allclose(record["alpha_deg"], closed.output[:, 0], rtol=1e-12)
    assert record["alpha_deg"].isna().sum() == 100
    assert_allclose(truth["states"]["pitch_rate"], closed.state[:, 1], rtol=1e-12)
    assert truth["events"][1] == {"event": "Stuck", "time": 4.5, "input": "elevator_deg", "at": None}
    assert len(np.unique(truth["inputs"]["elevator_deg"][451:])) == 1


def test_a_motor_of_the_quadrotor_loses_effect(run, tmp_path):
    out = tmp_path / "quad.csv"
    given = ("--fault", "effectiveness:motor3@14.2=0.7", "--turbulence", "light", "--seed", "1", "--out", str(out))
    assert run("simulate", "multirotor", *given).code == 0
    record, true = pd.read_csv(out), json.loads((tmp_path / "quad.truth.json").read_text())
    roll, height = (np.array(true["states"][name]) for name in ("roll", "height"))
    assert np.abs(height[:3500]).max() < 0.2
    assert np.abs(np.abs(roll[[700, 1200, 3500]]) - np.radians(10)).max() < 0.02
    before, after = record["motor3"][3000:3500].mean(), record["motor3"][4500:].mean()
    assert abs(after / before - 1 / 0.7) < 0.1  # the law asks for what is lost
    assert "--plant applies only to f16" in run("simulate", "multirotor", "--plant", "jsbsim").stderr


def test_turbulence_moves_the_aircraft_and_is_among_the_true_states(run, tmp_path):
    out = tmp_path / "T.csv"
    assert run("simulate", "f16", "--turbulence", "severe", "--seed", "2", "--out", str(out)).code == 0
    true = json.loads((tmp_path / "T.truth.json").read_text())["states"]
    still = worlds.world("f16").fly(seed=2)
    assert 0.2 < np.std(true["alpha"] - still.state[:, 0]) < 3.0
    gust = np.degrees(np.array(true["gust_w"]) / worlds.AIRSPEED)
    felt = pd.read_csv(out)["alpha_deg"] - true["alpha"] - gust
    assert abs(np.std(felt) - 0.03) < 0.003


def test_the_f16_of_jsbsim_flies_in_turbulence_with_a_fault(run, tmp_path):
    pytest.importorskip("jsbsim", reason="needs the extra flight (jsbsim)")
    out = tmp_path / "J.csv"
    given = (
        "--plant",
        "jsbsim",
        "--turbulence",
        "moderate",
        "--fault",
        "stuck:elevator@9",
        "--seed",
        "1",
        "--out",
        str(out),
    )
    assert run("simulate", "f16", *given).code == 0
    true = json.loads((tmp_path / "J.truth.json").read_text())
    gust = np.degrees(np.array(true["states"]["gust_w"]) / worlds.AIRSPEED)
    felt = pd.read_csv(out)["alpha_deg"] - true["states"]["alpha"] - gust
    assert abs(np.std(felt) - 0.03) < 0.003
    assert 0.2 < np.std(gust) < 1.0
    assert len(np.unique(true["inputs"]["elevator_deg"][901:])) == 1


@pytest.mark.parametrize(("arguments", "sentences"), [
    (("--turbulence", "awful"), ("`--turbulence` must be one of 'none', 'light', 'moderate', 'severe'",)),
    (("--fault", "stuk:elevator@4.5", "--fault", "bias:pitch@3"), ("no kind 'stuk'", "Did you mean 'stuck'", "needs a value")),
    (("--fault", "stuck:motor3@4.5"), ("has no input 'motor3'. Its inputs are 'elevator_deg'",)),
    (("--fault", "stuck:elevator@-1",), ("`time` must be at least 0 seconds",)),
    (("--fault", "stuck:elevator@20",), ("Stuck begins at 20 s, but the flight ends at 16.5 s",)),
    (("--fault", "rate:elevator@1=0"), ("`rate` must be greater than 0",)),
    (("--fault", "stuck"), ("must be KIND:CHANNEL@TIME",)),
    (("--fault", "offset:elevator@1=one"), ("the value must be a number",)),
    (("--fault", "stuck:elevator@1-2"), ("lasts until the end of the run",)),
    (("--fault", "stuck:elevator@1", "--runs", "3", "--loss", "0.5"), ("--runs does not apply", "--loss does not apply")),
])  # fmt: skip
def test_wrong_faults_are_a_sentence_each(run, arguments, sentences):
    shown = run("simulate", "f16", *arguments)
    assert shown.code == 2
    for sentence in sentences:
        assert sentence in shown.stderr


def test_a_record_takes_no_fault(run):
    assert "--fault applies only to f16" in run("simulate", "output-error", "--fault", "stuck:u@1").stderr
