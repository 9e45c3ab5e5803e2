"""`estimable check`."""

import numpy as np
import pytest

from estimable import (
    covariance_analysis,
    estimability,
    gain_information,
    read_model,
    read_record,
    unknown_input_existence,
)
from estimable.packaged import path

HIDING = (
    '[model]\ndt = 1\nstates = ["alpha", "q"]\noutputs = ["rate"]\nA = [[0.7, -0.1], [1.0, 0.0]]\nC = [[1.0, -2.0]]\n'
    "G = [[1.0], [0.0]]\nQ = [[1.0]]\nR = [[0.3]]\n[prior]\nmean = [0.0, 0.0]\ncovariance = [[1.0, 0.0], [0.0, 1.0]]\n"
)
KEYS = {
    "command", "version", "outcome", "model", "dt", "horizon", "states", "inputs", "outputs", "estimable", "answers",
    "known_directions", "singular_values", "squared_correlations", "sigma", "variance_reduction",
    "variance_reduction_with_present", "sentences", "arrival_rate_needed", "gain_sigma",
}  # fmt: skip
QUESTIONS = (
    "estimable", "estimable_with_present", "observable", "detectable", "reachable", "stabilisable", "disturbable",
)  # fmt: skip


@pytest.fixture
def write_model(tmp_path):
    """Write model.toml."""
    return lambda text: (tmp_path / "model.toml").write_text(text)


def test_a_model_that_hides_a_direction(run, write_model):
    write_model(HIDING)
    said = run("check", "model.toml", "--json").json
    assert set(said) == KEYS
    assert (said["estimable"], said["horizon"], said["outcome"]) == (False, None, {"code": 0, "sentence": ""})
    assert said["answers"]["estimable"]["answer"] == "no"
    assert said["answers"]["estimable"]["directions"] == [pytest.approx({"alpha": 0.980581, "q": -0.196116}, abs=1e-6)]
    assert said["answers"]["observable"]["answer"] == "yes"
    assert said["singular_values"] == pytest.approx([0.48148, 0.0], abs=5e-6)
    assert tuple(said["answers"]) == tuple(name for name in QUESTIONS if name not in ("reachable", "stabilisable"))
    people = run("check", "model.toml").stdout
    assert "0.98 alpha - 0.2 q is not revealed by rate." in people
    assert "model.toml: 2 states, 0 inputs, 1 output; step 1 s; in steady state" in people
    assert "reachable by inputs" not in people


def test_it_says_what_the_function_says(run):
    said = run("check", path("f16-model.toml"), "--dt", "0.01", "--json").json
    found = estimability(read_model(path("f16-model.toml")).model.discretise(0.01))
    assert tuple(said["answers"]) == QUESTIONS
    assert said["dt"] == 0.01
    assert list(said["variance_reduction"].values()) == pytest.approx(found.variance_reduction.tolist(), rel=1e-12)
    assert list(said["sigma"].values()) == pytest.approx(
        np.sqrt(np.diagonal(found.prior_covariance)).tolist(), rel=1e-12
    )
    assert said["sentences"] == list(found.sentences)


def test_what_is_left_is_not_said_where_nobody_said_how_often_it_is_measured(run):
    answer = run("check", path("f16-model.toml"), "--json")
    assert answer.json["variance_reduction"] is None
    assert answer.json["squared_correlations"] is None
    people = run("check", path("f16-model.toml"))
    assert "with past outputs" not in people.stdout
    assert "--dt SECONDS" in people.stderr


@pytest.mark.parametrize(("dt", "when", "horizon"), [("1", "after 4 samples", 4), ("0", "after 3.077 s", 4 / 1.3)])
def test_an_unstable_model_is_judged_over_a_horizon(run, write_model, dt, when, horizon):
    write_model(
        HIDING.replace("0.7", "1.3")
        .replace("-0.1]", "0.0]")
        .replace("[1.0, 0.0]]\nC", "[0.0, 0.2]]\nC")
        .replace("dt = 1", f"dt = {dt}")
    )
    said = run("check", "model.toml", "--json").json
    assert said["horizon"] == pytest.approx(horizon)
    assert when in run("check", "model.toml").stdout
    assert run("check", "model.toml", "--horizon", "3", "--json").json["horizon"] == 3


def test_an_unstable_model_says_how_many_samples_it_needs(run, write_model):
    write_model(
        '[model]\ndt = 1\nstates = ["x"]\noutputs = ["y"]\nA = [[1.25]]\nC = [[1.0]]\nQ = [[1.0]]\nR = [[1.0]]\n'
        "[prior]\nmean = [0.0]\ncovariance = [[1.0]]\n"
    )
    assert run("check", "model.toml", "--json").json["arrival_rate_needed"] == pytest.approx([0.36, 0.36])
    people = " ".join(run("check", "model.toml").stdout.split())
    assert "The estimate stays bounded where more than 36 % of the samples arrive" in people


def test_a_record_says_how_well_its_inputs_let_the_gain_be_known(run):
    said = run("check", path("f16-model.toml"), "--record", path("f16-flight.csv"), "--json").json
    file = read_model(path("f16-model.toml"))
    flight = read_record(path("f16-flight.csv"), outputs=file.model.outputs, inputs=file.model.inputs, **file.record)
    expected = gain_information(file.model, flight, state=file.prior, gain=file.gain.prior)
    assert said["gain_sigma"] == {"gain": pytest.approx(float(expected.sigma[0]), rel=1e-12)}
    assert expected.sentences[0] in said["sentences"]


def test_the_step_of_the_model_file_is_used(run, write_model):
    write_model(HIDING.replace("dt = 1", "dt = 0").replace("0.7", "-0.7") + "[record]\ndt = 0.5\n")
    assert run("check", "model.toml", "--json").json["dt"] == 0.5
    assert run("check", "model.toml", "--json", "--dt", "0.1").json["dt"] == 0.1


def test_inputs_that_nobody_measured(run, write_model):
    text = HIDING.replace('outputs = ["rate"]', 'inputs = ["wind"]\nB = [[1.0], [0.0]]\noutputs = ["rate"]')
    write_model(text + '[unknown]\ninputs = ["wind"]\n')
    said = run("check", "model.toml", "--json").json
    model = read_model("model.toml")
    verdict = unknown_input_existence(model.model, unknown=["wind"])
    assert said["answers"]["unknown_inputs"]["answer"] == ("yes" if verdict.exists else "no")
    assert said["sentences"][-1] == verdict.sentence
    assert "unknown inputs determined" in run("check", "model.toml").stdout


def test_a_model_that_varies_is_judged_over_its_rows(run, tmp_path):
    (tmp_path / "model.py").write_text(
        "import numpy as np\nfrom estimable import *\n"
        "model = StateSpace(1.1 * np.ones((4, 1, 1)), Q=[[1.0]], R=[[1.0]], dt=1)\nprior = Prior([0.0], [[1.0]])\n"
    )
    said = run("check", "model.py", "--json").json
    assert (said["horizon"], said["estimable"], said["answers"]["detectable"]["answer"]) == (4, True, None)
    assert "not asked" in run("check", "model.py").stdout


def test_what_is_wrong_is_said(run, write_model):
    write_model(HIDING)
    assert "other.toml does not exist" in run("check", "other.toml").stderr
    assert run("check", "other.toml").code == 2
    assert "--dt is for continuous models: this one has dt = 1 s." in run("check", "model.toml", "--dt", "1").stderr
    refused = run("check", "model.toml", "--horizon", "2.5", "--json")
    assert (refused.code, refused.json["error"]) == (2, "InputError")
    assert refused.json["message"] == "`horizon` must be an integer of at least 1. Got 2.5."


MOVING = (
    '[model]\ndt = 1\nstates = ["pos", "vel"]\noutputs = ["gps", "doppler"]\nA = [[1.0, 1.0], [0.0, 1.0]]\n'
    "C = [[1.0, 0.0], [0.0, 1.0]]\nQ = [[0.0, 0.0], [0.0, 0.01]]\nR = [[1.0, 0.0], [0.0, 4.0]]\n"
    "[prior]\nmean = [0.0, 0.0]\ncovariance = [[100.0, 0.0], [0.0, 1.0]]\n"
)


def test_requirements_are_answered_first(run, write_model):
    write_model(MOVING)
    answer = run(
        "check", "model.toml", "--require", "pos=0.8", "--require", "vel=0.01", "--without", "doppler", "--select", "1"
    )
    first = answer.stdout.splitlines()[0]
    assert first == "Not known as required: vel (improves no further)."
    assert "pos is known to 0.8 after" in answer.stdout
    assert "Without doppler: pos" in answer.stdout
    assert "Choose gps: no other set of this size is better." in answer.stdout
    assert "Would help: " in answer.stdout
    said = run("check", "model.toml", "--require", "pos=0.8", "--strict", "--json")
    assert (said.code, said.json["known"]["met"]) == (0, True)
    model = read_model("model.toml")
    found = covariance_analysis(model.model, prior=model.prior, requirement={"pos": 0.8})
    assert said.json["known"]["quantities"]["pos"]["time_s"] == found.time_to_requirement[0]
    assert (
        said.json["known"]["verdict"] == f"Everything is known as required after {found.time_to_requirement[0]:.4g} s."
    )


def test_strict_fails_where_a_requirement_is_not_met(run, write_model):
    write_model(MOVING)
    assert run("check", "model.toml", "--require", "vel=0.01").code == 0
    assert run("check", "model.toml", "--require", "vel=0.01", "--strict").code == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--require", "speed=1"), "names 'speed', which is not among"),
        (("--require", "vel=fast"), "--require needs name=sigma with a number"),
        (("--require", "vel"), "--require needs name=value, as in --require position=0.1. Got 'vel'."),
        (("--require", "vel=1", "--require", "vel=2"), "--require gives 'vel' twice."),
        (("--without", "radar"), "`sensor` must be"),
    ],
)
def test_wrong_requirements_are_usage_errors(run, write_model, options, message):
    write_model(MOVING)
    answer = run("check", "model.toml", *options, width=200)
    assert answer.code == 2
    assert message in answer.stderr
