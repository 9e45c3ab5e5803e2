"""`estimable tune`."""

import html

import numpy as np
import pytest

from estimable import read_model, rho_synthesis
from estimable.commands.tune_report import read_weights
from estimable.design.rho_plan import default_eta

KEYS = {"command", "version", "outcome", "model", "dt", "states", "inputs", "outputs", "weights", "noise", "chosen", "criteria",
        "curves", "report"}  # fmt: skip
FEW = ("--designs", "7")


def test_it_says_what_the_function_says(run):
    said = run("tune", "model.toml", "--dt", "0.01", *FEW, "--json").json
    model = read_model("model.toml").model.discretise(0.01)
    found = rho_synthesis(model, eta=default_eta(model, 7))
    assert set(said) == KEYS
    assert said["outcome"] == {"code": 0, "sentence": ""}
    assert said["chosen"]["design"] == found.chosen
    assert said["chosen"]["feedback"] == pytest.approx(np.asarray(found.feedback))
    assert said["chosen"]["filter"] == pytest.approx(np.asarray(found.filter))
    assert said["chosen"]["margin"]["rho"] == pytest.approx(found.margin.margin)
    assert [row["name"] for row in said["criteria"]] == [*found.criteria, "composite"]
    for row in said["criteria"][:-1]:
        assert row["best"] == pytest.approx(found.optima[row["name"]].value)
        assert row["chosen"] == pytest.approx(found.criteria[row["name"]][found.chosen])
    assert said["curves"]["rho"] == pytest.approx(found.criteria["rho"])
    assert said["report"] is None


def test_people_are_told_the_table_and_the_choice(run):
    answer = run("tune", "model.toml", *FEW)
    assert "model.toml: 2 states, 1 input, 2 outputs; continuous; 7 designs" in " ".join(answer.stdout.split())
    assert "Chosen by rho (1) and control (1): a bandwidth of" in answer.stdout
    assert "feedback elevator_deg:" in answer.stdout
    assert "--dt SECONDS" in answer.stderr
    assert "--report tuning.html" in answer.stderr


def test_weights_and_a_filter_are_used(run):
    fast = run("tune", "model.toml", *FEW, "--weight", "rho=1", "--json").json
    slow = run("tune", "model.toml", *FEW, "--weight", "control=1", "--weight", "rho=0.1", "--json").json
    assert fast["weights"] == {"rho": 1.0}
    assert slow["chosen"]["eta"] < fast["chosen"]["eta"]
    kalman = run("tune", "model.toml", *FEW, "--filter", "kalman", "--json").json
    assert kalman["chosen"]["filter"] != fast["chosen"]["filter"]


def test_the_page_can_be_made_again(run, tmp_path):
    said = run(
        "tune", "model.toml", "--dt", "0.01", *FEW, "--weight", "rho=2", "--report", "tuning.html", "--json"
    ).json
    assert said["report"] == "tuning.html"
    page = (tmp_path / "tuning.html").read_text()
    assert "estimable tune model.toml --dt 0.01 --weight rho=2.0 --designs 7 --report tuning.html" in page
    assert "How fast should the loop of model.toml be?" in page
    script = html.unescape(page.split("<p>In Python:</p><pre>")[1].split("</pre>")[0]).replace(
        "found.plot().show()", ""
    )
    names: dict = {}
    exec(script, names)
    assert names["law"].feedback == pytest.approx(np.array(said["chosen"]["feedback"]), rel=1e-9)
    assert names["filter"].filter == pytest.approx(np.array(said["chosen"]["filter"]), rel=1e-9)
    first = page
    run("tune", "model.toml", "--dt", "0.01", *FEW, "--weight", "rho=2", "--report", "tuning.html", "--json")
    assert (tmp_path / "tuning.html").read_text() == first


def test_what_is_wrong_is_said(run, tmp_path):
    assert (
        "--weight needs name=value, as in --weight rho=1. Got 'rho'."
        in run("tune", "model.toml", "--weight", "rho").stderr
    )
    assert "there is no criterion 'roh'" in run("tune", "model.toml", "--weight", "roh=1").stderr
    assert "`--designs` must be an integer of at least 2" in run("tune", "model.toml", "--designs", "1").stderr
    assert "--report must end in .html" in run("tune", "model.toml", "--report", "tuning.txt").stderr
    refused = run("tune", "nowhere.toml", "--json")
    assert (refused.code, refused.json["error"]) == (2, "InputError")
    (tmp_path / "curved.py").write_text(
        "from estimable import *\nmodel = NonlinearModel(lambda x, u, p: x, lambda x, u, p: x, Q=[[1.0]], R=[[1.0]], dt=1)\n"
        "prior = Prior([0.0], [[1.0]])\n"
    )
    assert "tune needs a linear model. This model is nonlinear." in run("tune", "curved.py").stderr
    (tmp_path / "free.py").write_text(
        "from estimable import *\nmodel = StateSpace([[1.1]], R=[[1.0]], dt=1)\nprior = Prior([0.0], [[1.0]])\n"
    )
    assert "`model` has no input" in run("tune", "free.py").stderr


def test_weights_are_read():
    assert read_weights(["rho=1", "control = 2"]) == {"rho": 1.0, "control": 2.0}


def test_samples_slower_than_the_plant(run):
    """A step of 10 s, by which the plant is at rest: the best loop lets it be, and its poles have no logarithm."""
    said = run("tune", "model.toml", "--dt", "10", *FEW, "--json").json
    assert said["chosen"]["margin"]["rho"] > 0.99
    people = run("tune", "model.toml", "--dt", "10", *FEW, "--report", "slow.html").stdout
    assert said["chosen"]["bandwidth_rad_s"] is None
    assert "a bandwidth too high for this step" in people
    assert "none" in people
