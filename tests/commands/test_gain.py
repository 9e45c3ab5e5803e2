"""`estimable gain` and `estimable demo`."""

import html
import re

import numpy as np
import pytest

import estimable as es
from estimable import catalogue, read_model, read_record
from estimable.packaged import path

CALL = ("gain", "flight.csv", "--model", "model.toml")
KEYS = {
    "command", "version", "outcome", "record", "model", "filter", "engine", "samples", "seconds", "notes", "outputs", "inputs",
    "gains", "failure_time_s", "detected_at_s", "changes", "report", "gain_before", "gain_before_sigma", "before_s",
    "gain_after", "gain_after_sigma", "settings",
    "after_s", "findings", "log_likelihood", "nis", "innovation_faults", "gaps", "verdict", "verdict_p", "reasons", "untestable",
    "gain_interval", "detectable_loss", "prepared", "finding", "rows",
}  # fmt: skip


@pytest.fixture(scope="module")
def flight():
    file = read_model(path("f16-model.toml"))
    record = read_record(path("f16-flight.csv"), outputs=file.model.outputs, inputs=file.model.inputs, **file.record)
    algorithm = catalogue.build("unknown-gain", file, walk=0.0, forgetting=1.0)
    return es.assess_gain(algorithm, record, prior=file.prior).result


def test_demo_is_gain_on_the_packaged_flight(run):
    demo = run("demo", "--json")
    gain = run("gain", path("f16-flight.csv"), "--model", path("f16-model.toml"), "--json")
    assert (demo.code, demo.stderr) == (0, "")
    assert demo.json.pop("command") == "demo"
    assert set(demo.json) == KEYS
    assert demo.json.pop("report") == "report.html"
    assert {**demo.json, "command": "gain", "report": None} == gain.json


@pytest.mark.parametrize(("command", "answer"), [
    (("demo",), "after"), (("gain", "flight.csv", "--model", "model.toml"), "after"),
    (("estimate", "flight.csv", "--model", "model.toml", "--filter", "unknown-gain"), "gain"),
])  # fmt: skip
def test_the_answer_comes_first_and_the_files_last(run, command, answer):
    """In 80 columns: findings and table in twelve lines, then the plot and the checks, then what was read."""
    lines = run(*command).stdout.splitlines()
    assert all(len(line) <= 80 for line in lines)
    (row,) = [i for i, line in enumerate(lines) if line.split()[:1] == [answer]]
    assert row < 12
    checks, files = (
        next(i for i, line in enumerate(lines) if re.match(start, line))
        for start in ("Innovation check", r"\S+\.toml, filter")
    )
    assert row < checks < files


def test_demo_and_gain_write_a_page(run, tmp_path):
    run("demo", "--report", "demo.html")
    run(*CALL, "--report", "gain.html", "--set", "walk=0.05", "--json")
    demo, gain = ((tmp_path / name).read_text() for name in ("demo.html", "gain.html"))
    assert "its elevator loses half its effect" in demo
    assert "<pre>estimable demo</pre>" in demo
    assert "estimable gain flight.csv --model model.toml" in gain
    assert "--set walk=0.05 --report report.html" in gain
    assert "walk=0.05)" in gain
    assert "SHA-256" in gain


def test_the_python_of_the_page_gives_the_same(run, tmp_path, flight):
    run("gain", path("f16-flight.csv"), "--model", path("f16-model.toml"), "--report", "gain.html")
    page = (tmp_path / "gain.html").read_text()
    script = html.unescape(re.findall(r"<pre>(import.*?)</pre>", page, flags=re.DOTALL)[0])
    for name in ("f16-flight.csv", "f16-model.toml"):
        (tmp_path / name).write_bytes(path(name).read_bytes())
    names = {}
    exec(script.replace(".show()", ""), names)
    assert names["result"].log_likelihood == pytest.approx(flight.log_likelihood, rel=1e-12)


@pytest.mark.parametrize(
    ("where", "sentence"),
    [
        ("page.htm", "--report must end in .html"),
        ("nowhere/page.html", "there is no folder"),
        ("folder.html", "folder.html is a folder"),
    ],
)
def test_a_page_that_cannot_be_written_is_refused(run, tmp_path, where, sentence):
    (tmp_path / "folder.html").mkdir()
    for call in (("demo",), CALL):
        said = run(*call, "--report", where)
        assert said.code == 2
        assert sentence in said.stderr


def test_a_filter_without_a_gain_is_refused(run):
    said = run(*CALL, "--filter", "kalman")
    assert said.code == 2
    assert "kalman does not estimate a gain" in said.stderr


def test_demo_says_what_the_estimate_says(run, flight):
    said = run("demo", "--json").json
    assert said["outcome"] == {"code": 0, "sentence": ""}
    assert (said["samples"], said["seconds"]) == (1201, 12.0)
    [change] = said["changes"]
    assert (said["failure_time_s"], said["detected_at_s"]) == (change["onset_s"], change["detected_at_s"])
    for key, row in (("after", -1), ("before", change["onset"] - 1)):
        low, _, median, _, high = flight.gain_quantiles[row, 0]
        assert said[f"gain_{key}"] == pytest.approx(median, rel=1e-12)
        assert said[f"gain_{key}_sigma"] == pytest.approx((high - low) / 3.919928, rel=1e-6)
    assert said["gain_interval"] == pytest.approx([low if row == -1 else flight.gain_quantiles[-1, 0, 0],
                                                   flight.gain_quantiles[-1, 0, 4]])  # fmt: skip
    assert said["log_likelihood"] == pytest.approx(flight.log_likelihood, rel=1e-12)


def test_the_loss_of_the_demo_is_found_soon_and_as_large_as_it_is(run):
    said = run("demo", "--json").json
    assert abs(said["failure_time_s"] - 4.5) < 0.1  # the truth
    assert 4.5 < said["detected_at_s"] < 5.0
    assert 0.45 < said["gain_after"] < 0.55
    assert said["verdict"] in ("believe", "check")
    assert said["gain_interval"][0] < 0.5 < said["gain_interval"][1]
    assert len(said["changes"]) == 1
    assert abs(said["gain_after"] - 0.5) < 2 * said["gain_after_sigma"]
    assert abs(said["gain_before"] - 1.0) < 2 * said["gain_before_sigma"]


def test_the_check_is_of_the_filter_inside_the_detector_from_change_to_change(run):
    said = run("demo", "--json").json["nis"]
    assert 1.9 < said["mean"] < 2.1
    assert said["lower"] < said["mean"] < said["upper"]
    assert said["consistent"] is True


def test_without_detection_no_change_is_told(run):
    said = run(
        "gain", path("f16-flight.csv"), "--model", path("f16-model.toml"), "--filter", "unknown-gain", "--json"
    ).json
    assert (said["failure_time_s"], said["detected_at_s"], said["changes"]) == (None, None, [])
    assert said["filter"] == "unknown-gain"
    assert 0.46 < said["gain_after"] < 0.50
    assert said["before_s"] == 4.0
    assert said["verdict"] is None


@pytest.mark.parametrize("width", [60, 80])
def test_demo_for_people(run, width):
    answer = run("demo", width=width)
    assert answer.code == 0
    assert all(len(line.rstrip()) <= width for line in answer.stdout.splitlines())
    words = " ".join(answer.stdout.split())
    assert "f16-flight.csv: 1,201 samples over 12 s; outputs alpha_deg, pitch_rate_deg_s; input elevator_deg" in words
    assert "Believe, if B[pitch_rate, elevator_deg] is right: the record agrees." in words
    assert "before 4.5 0.9" in words
    assert "after 12 0.5" in words
    assert "The gain fell from 0.9" in words
    assert "s; detected 0.07 s later" in words
    assert "Innovation check (NIS): 2.0" in words
    assert "The interval includes errors of 10 % in the entries of A and B." in words
    assert "░" in answer.stdout
    under_the_axis = next(i for i, line in enumerate(answer.stdout.splitlines()) if line.lstrip().startswith("s 0"))
    assert under_the_axis > 10
    assert "estimable gain YOUR.csv --model YOUR.toml" in answer.stderr
    assert str(path("f16-model.toml")) in answer.stderr


def test_gain_for_people_says_what_to_do_next(run):
    answer = run(*CALL)
    assert answer.code == 0
    assert "estimable estimate flight.csv --model model.toml --filter mixture --out gain.csv" in answer.stderr
    assert "too short to compare before and after" in answer.stdout
    assert "\x1b" not in answer.stdout


def test_a_setting_reaches_the_filter(run):
    faster = run(*CALL, "--set", "walk=[2.0]", "--json").json
    assert faster["gain_after_sigma"] > run(*CALL, "--json").json["gain_after_sigma"]


def test_the_options_of_the_record_replace_those_of_the_model_file(run, write_record):
    write_record(*(f"{k},0.31,0.0,-1.28" for k in range(4)), header="tick,alpha_deg,pitch_rate_deg_s,elevator_deg")
    assert "no column 'time_s'" in run(*CALL).stderr
    assert run(*CALL, "--time", "tick", "--json").json["seconds"] == 3.0
    assert run(*CALL, "--dt", "0.5", "--json").json["seconds"] == 1.5
    assert "`hold` must be one of" in run(*CALL, "--time", "tick", "--hold", "second_order").stderr
    assert "`lost` must be one of" in run(*CALL, "--time", "tick", "--lost", "found").stderr


def test_a_lost_input_does_nothing(run, write_record):
    rows = [f"{0.1 * k:.1f},{0.31},{0.0},{-1.28 + k},{{}}" for k in range(8)]
    header = "time_s,alpha_deg,pitch_rate_deg_s,elevator_deg,got"
    answers = {}
    for got in (1, 0):
        write_record(*(row.format(got) for row in rows), header=header)
        answers[got] = run(*CALL, "--as-given", "--hold", "zero_order", "--arrived", "got", "--json").json
    assert answers[1]["log_likelihood"] != answers[0]["log_likelihood"]
    assert "no column 'gone'" in run(*CALL, "--hold", "zero_order", "--arrived", "gone").stderr


def test_several_gains_have_names(run, change_model):
    change_model("mean = [1.0]\ncovariance = [[0.25]]", "mean = [0.05, -17.5]\ncovariance = [[0.01, 0.0], [0.0, 30.0]]")
    said = run(*CALL, "--set", "directions=every_entry", "--json").json
    assert said["gains"] == ["B_alpha_elevator_deg", "B_pitch_rate_elevator_deg"]
    for key in ("gain_before", "gain_before_sigma", "gain_after", "gain_after_sigma"):
        assert list(said[key]) == said["gains"]
    assert [row["gain"] for row in said["rows"]] == said["gains"]
    people = run(*CALL, "--set", "directions=every_entry").stdout
    assert " %" not in people.split("Innovation")[0]  # an entry of B is no share of the effect
    assert "not compared, because the record is too short." in " ".join(people.split())


@pytest.mark.parametrize("rows", [1, 2])
def test_a_record_of_few_samples(run, write_record, rows):
    write_record(*(f"{k / 100},0.31,0.0,-1.28" for k in range(rows)))
    said = run(*CALL, "--json").json
    assert (said["samples"], said["seconds"]) == (rows, (rows - 1) / 100)
    assert said["gain_after"] == pytest.approx(1.0)
    people = run(*CALL)
    assert people.code == 0
    assert f"{rows} sample{'s' if rows > 1 else ''} over" in people.stdout


def test_outputs_that_were_never_seen_leave_the_prior_and_no_check(run, write_record):
    write_record(*(f"{k / 10},,,-1.28" for k in range(60)))
    said = run(*CALL, "--filter", "unknown-gain", "--json").json
    assert said["nis"] is None
    assert said["gain_after"] == pytest.approx(1.0)
    assert said["gain_after_sigma"] == pytest.approx(np.sqrt(0.25 + 0.02 * 5.9))
    words = " ".join(run(*CALL).stdout.split())
    assert "no output with measurement noise was seen" in words
    assert "no change is detected" in words


def test_a_gain_of_which_nothing_is_known_is_null(run, tmp_path, write_record):
    (tmp_path / "model.py").write_text(
        "from estimable import *\n"
        "file = read_model('model.toml')\n"
        "model, prior, record = file.model, file.prior, file.record\n"
        "gain = GainSection(Prior([0.0], [[0.0]], diffuse=[[1.0]]), {'walk': 0.02})\n"
    )
    write_record(*(f"{k / 10},,,{k}" for k in range(60)))
    call = ("gain", "flight.csv", "--model", "model.py")
    said = run(*call, "--json").json
    assert [said[key] for key in ("gain_before", "gain_before_sigma", "gain_after", "gain_after_sigma")] == [None] * 4
    people = run(*call)
    assert people.code == 0
    assert "not known" in people.stdout


def test_a_discrete_model_gives_a_record_without_time_its_step(run, tmp_path):
    (tmp_path / "model.toml").write_text(
        '[model]\ndt = 0.5\nstates = ["x"]\ninputs = ["u"]\noutputs = ["y"]\nA = [[0.9]]\nB = [[1.0]]\nC = [[1.0]]\n'
        "Q = [[0.01]]\nR = [[0.01]]\n[prior]\nmean = [0.0]\ncovariance = [[1.0]]\n"
        "[gain]\nmean = [1.0]\ncovariance = [[1.0]]\n"
    )
    (tmp_path / "flight.csv").write_text("y,u\n0,1\n1,1\n1.9,1\n")
    assert run(*CALL, "--json").json["seconds"] == 1.0


def test_a_change_that_was_found_does_not_count_against_the_model(run, tmp_path):
    """A gain that drops once, under a gain that is constant: the innovations are judged from one change to the next."""
    plant = es.StateSpace([[0.9]], [[1.0]], Q=[[0.01]], R=[[0.04]], dt=0.1, states=["x"], inputs=["u"], outputs=["y"])
    gain = es.GainSection(es.Prior([1.0], [[0.25]]))
    es.write_model(tmp_path / "m.toml", plant, es.Prior([0.0], [[1.0]]), gain=gain, record={"time": "t"})
    rng, x, rows = np.random.default_rng(0), 0.0, []
    u = np.sign(np.sin(0.2 * np.arange(600)))
    for k in range(600):
        y = x + 0.2 * rng.normal() if k % 7 else np.nan
        rows.append((0.1 * k, u[k], y, np.nan))
        x = 0.9 * x + (1.0 if k < 300 else 0.5) * u[k] + 0.1 * rng.normal()
    table = "t,u,y,z\n" + "\n".join(",".join("" if np.isnan(v) else f"{v:.6g}" for v in row) for row in rows)
    (tmp_path / "r.csv").write_text(table)
    said = run("gain", str(tmp_path / "r.csv"), "--model", str(tmp_path / "m.toml"), "--as-given", "--json").json
    assert abs(said["failure_time_s"] - 30) < 1
    assert said["nis"]["consistent"]
    assert said["innovation_faults"] == []
    text = run("gain", str(tmp_path / "r.csv"), "--model", str(tmp_path / "m.toml"), "--as-given").stdout
    assert "14 % of y was not seen." in text
    plain = run(
        "gain", str(tmp_path / "r.csv"), "--model", str(tmp_path / "m.toml"), "--filter", "unknown-gain", "--json"
    ).json
    assert not plain["nis"]["consistent"]  # without the change the same record speaks against the model
