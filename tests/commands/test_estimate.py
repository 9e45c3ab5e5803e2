"""`estimable estimate`."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from estimable import Kalman, estimate, read_model, read_record, smooth

CALL = ("estimate", "flight.csv", "--model", "model.toml", "--filter")
RULE = "The time column 'time_s' is in s (by its name): 0.18 s at 100 Hz.\n"


def directly():
    file = read_model("model.toml")
    record = read_record("flight.csv", outputs=file.model.outputs, inputs=file.model.inputs, **file.record)
    return estimate(Kalman(file.model), record, prior=file.prior)


def test_the_last_estimates_by_name(run):
    said, result = run(*CALL, "kalman", "--json").json, directly()
    assert said["command"] == "estimate"
    assert said["outcome"] == {"code": 0, "sentence": ""}
    assert said["mean"] == pytest.approx(dict(zip(["alpha", "pitch_rate"], result.mean[-1], strict=True)), rel=1e-12)
    sigma = np.sqrt(np.diag(result.covariance[-1]))
    assert said["mean_sigma"] == pytest.approx(dict(zip(["alpha", "pitch_rate"], sigma, strict=True)), rel=1e-12)
    assert (said["gain"], said["gain_sigma"]) == (None, None)
    assert said["log_likelihood"] == pytest.approx(result.log_likelihood, rel=1e-12)
    assert (said["samples"], said["seconds"], said["engine"]) == (19, 0.18, result.engine)
    assert said["nis"]["degrees"] == 38


def test_a_filter_with_a_gain_says_it_too(run):
    said = run(*CALL, "unknown-gain", "--set", "walk=0.5", "--json").json
    assert list(said["gain"]) == list(said["gain_sigma"]) == ["gain"]


@pytest.mark.parametrize("width", [60, 80])
def test_estimates_for_people(run, width):
    answer = run(*CALL, "unknown-gain", width=width)
    assert (answer.code, answer.stderr) == (0, RULE)
    assert all(len(line.rstrip()) <= width for line in answer.stdout.splitlines())
    for word in ("last sample, t = 0.18 s", "alpha", "pitch_rate", "gain", "sigma", "Log-likelihood: ", "(NIS): "):
        assert word in answer.stdout


def test_the_table_is_that_of_the_result(run, tmp_path):
    answer = run(*CALL, "kalman", "--out", "table.csv")
    assert answer.code == 0
    assert answer.stderr == RULE + "Wrote 19 rows of 13 columns to table.csv.\n"
    table = pd.read_csv(tmp_path / "table.csv", index_col="time")
    pd.testing.assert_frame_equal(table, directly().to_pandas(), check_exact=False, rtol=1e-12)
    assert run(*CALL, "kalman", "--out", "table.csv", "--json").json["out"] == "table.csv"


def test_a_state_of_which_nothing_is_known_is_null(run, change_model, write_record):
    covariance = "covariance = [[0.1, 0.0], [0.0, 1.0]]"
    change_model(covariance, f"{covariance}\ndiffuse = [[0.0], [1.0]]")
    write_record("0.0,0.31,,-1.28", "0.1,,,-1.28")
    said = run(*CALL, "kalman", "--json").json
    assert said["mean_sigma"] == {"alpha": None, "pitch_rate": None}
    assert "not known" in run(*CALL, "kalman").stdout


@pytest.mark.parametrize(
    ("out", "sentence"),
    [
        ("table.txt", "--out must end in .csv. Got 'table.txt'."),
        ("none/table.csv", "--out none/table.csv: there is no folder "),
        ("./flight.csv", "--out flight.csv is the input file itself: give another name."),
        ("folder.csv", "--out folder.csv is a folder."),
    ],
)
def test_a_destination_that_cannot_be(run, tmp_path, out, sentence):
    (tmp_path / "folder.csv").mkdir()
    record = (tmp_path / "flight.csv").read_bytes()
    answer = run(*CALL, "kalman", "--out", out)
    assert answer.code == 2
    assert answer.stderr.startswith(f"Error: {sentence}")
    assert (tmp_path / "flight.csv").read_bytes() == record


def test_a_destination_that_fills_up(run, tmp_path):
    (tmp_path / "full.csv").symlink_to("/dev/full")
    answer = run(*CALL, "kalman", "--out", "full.csv")
    assert (answer.code, answer.stderr) == (2, "Error: --out full.csv could not be written: No space left on device.\n")


TRACK = """[model]
dt = 0.0
states = ["range", "speed"]
outputs = ["range_m"]
A = [[0.0, 1.0], [0.0, 0.0]]
C = [[1.0, 0.0]]
Q = [[0.0, 0.0], [0.0, 0.1]]
R = [[4.0]]

[prior]
mean = [10.0, 1.0]
covariance = [[4.0, 0.0], [0.0, 1.0]]

[record]
time = "t"
"""


def test_constant_gains(run, tmp_path):
    (tmp_path / "track.toml").write_text(TRACK)
    (tmp_path / "track.csv").write_text("t,range_m\n0,10\n2,14\n3,\n5,17\n")
    call = ("estimate", "track.csv", "--model", "track.toml", "--json", "--filter")
    said = run(*call, "alpha-beta", "--set", "alpha=0.5", "--set", "beta=0.3").json
    # by hand: r = 12 + .5 2 and v = 1 + .15 2 at 2 s; r = 13 + 3.9 + .5 .1 and v = 1.3 + .1 .1, three seconds later
    assert said["mean"] == pytest.approx({"range": 16.95, "speed": 1.31})
    assert run(*call, "alpha-beta", "--set", "alpha=kalata").code == 0
    fixed = run(*call, "fixed-gain", "--set", "filter=[[0.5], [0.15]]").json
    assert fixed["mean"]["speed"] == pytest.approx(1.315)
    gated = run(*call, "gated", "--set", "algorithm=alpha-beta", "--set", "alpha=0.5", "--set", "beta=0.3").json
    assert gated["mean"] == pytest.approx(said["mean"])
    bare = run(*call, "alpha-beta")
    assert bare.code == 2
    assert (
        "alpha-beta needs a value of 'alpha', which has no default. On the command line: --set alpha=.."
        in bare.stderr + bare.stdout
    )


NONLINEAR = """
import jax.numpy as jnp
import numpy as np

import estimable as es


def drain(x, u, θ):
    return x + θ[1] * u - θ[0] * jnp.sqrt(jnp.maximum(x, 1e-6))


model = es.NonlinearModel(drain, lambda x, u, θ: x, Q=[[1e-6]], R=[[1e-4]], dt=1, inputs=["pump"], outputs=["level"],
                          parameters={"outflow": 0.2, "inflow": 0.5})
prior = es.Prior([1.5], [[0.1]])
gain = es.GainSection(es.Prior([0.25, 0.6], np.diag([0.01, 0.04])))
"""


@pytest.mark.parametrize(
    ("name", "whole"), [("second-order", "second-order-kalman"), ("change-detection", "change-detection")]
)
def test_a_nonlinear_model_and_its_parameters(run, name, whole):
    Path("tank.py").write_text(NONLINEAR)
    rng, x, rows = np.random.default_rng(0), 1.5, []
    for _ in range(60):
        u = 0.5 + 0.3 * rng.uniform(-1, 1)
        rows.append((x + 0.01 * rng.normal(), u))
        x = x + 0.5 * u - 0.2 * np.sqrt(x)
    pd.DataFrame(rows, columns=["level", "pump"]).to_csv("tank.csv", index=False)
    settings = ("--set", "slots=5", "--set", "levels=2") if name == "change-detection" else ()
    said = run("estimate", "tank.csv", "--model", "tank.py", "--filter", name, *settings, "--json").json
    assert said["filter"] == whole
    for gain, true in (("outflow", 0.2), ("inflow", 0.5)):
        assert abs(said["gain"][gain] - true) < 4 * said["gain_sigma"][gain] < 0.1


def test_a_record_in_microseconds_is_read_with_its_unit_on_a_grid(run, tmp_path, change_model):
    change_model('time = "time_s"', 'time = "clock"')
    rows = [line.split(",") for line in (tmp_path / "flight.csv").read_text().splitlines()]
    place = rows[0].index("time_s")
    for k, row in enumerate(rows):
        row[place] = "clock" if k == 0 else str(round(float(row[place]) * 1e6))
    (tmp_path / "flight.csv").write_text("\n".join(map(",".join, rows)) + "\n")
    refused = run(*CALL, "kalman")
    assert refused.code == 2
    assert "say time_unit='us', 'ms' or 's'" in refused.stderr
    answer = run(*CALL, "kalman", "--time-unit", "us", "--grid", "0.02", "--start", "0", "--json")
    assert answer.code == 0
    notes = answer.json["notes"]
    assert notes[0] == "The time column 'clock' is in us (time_unit='us'): 0.18 s at 100 Hz."
    assert notes[1].startswith("The rows are a grid of 0.02 s: 10 rows.")
    assert answer.json["samples"] == 10
    assert run(*CALL, "kalman", "--time-unit", "us", "--grid", "0").stderr == (
        "Error: flight.csv: `grid` must be greater than 0 seconds. Got 0.\n"
    )


def test_stamps_are_moved_by_options(run):
    late = ("--grid", 0.01, "--delay", "alpha_deg=0.01", "--delay", "pitch_rate_deg_s=0.01")
    other = ("--grid", 0.01, "--offset", "alpha_deg=-0.01", "--offset", "pitch_rate_deg_s=-0.01")
    said = [run(*CALL, "kalman", *options, "--json").json for options in (late, other)]
    assert said[0]["mean"] == said[1]["mean"] != run(*CALL, "kalman", "--json").json["mean"]
    answer = run(*CALL, "kalman", "--grid", 0.01, "--offset", "alpha_deg", "--offset", "=2")
    assert (answer.code, answer.stderr.count("--offset needs NAME=SECONDS, as in --offset gps=0.2. Got")) == (2, 2)
    assert "give `grid` in seconds" in run(*CALL, "kalman", "--delay", "alpha_deg=0.01").stderr


def test_a_page_shows_the_outputs_as_measured_and_as_estimated(run, tmp_path):
    answer = run(*CALL, "kalman", "--smooth", "--report", "page.html", "--out", "table.csv")
    assert answer.code == 0
    assert answer.stderr == RULE + "Wrote 19 rows of 21 columns to table.csv.\nWrote page.html: open it in a browser.\n"
    page = (tmp_path / "page.html").read_text()
    again = "estimable estimate flight.csv --model model.toml --filter kalman --smooth"
    parts = ("Output alpha_deg", "State alpha", "Innovation of alpha_deg", "At the last sample, t = 0.18 s", "smoothed")
    for said in (*parts, "measured alpha_deg", again):
        assert said in page
    file = read_model("model.toml")
    record = read_record("flight.csv", outputs=file.model.outputs, inputs=file.model.inputs, **file.record)
    exact = smooth(Kalman(file.model), record, prior=file.prior)
    table = pd.read_csv(tmp_path / "table.csv", index_col="time")
    np.testing.assert_allclose(table["smoothed_alpha"], exact.mean[:, 0], rtol=1e-12)
    np.testing.assert_allclose(table["alpha_deg_smoothed_sigma"], np.sqrt(exact.output_covariance[:, 0, 0]), rtol=1e-9)
    np.testing.assert_allclose(table["alpha_deg_filtered"], directly().output[:, 0], rtol=1e-12)
    assert run(*CALL, "kalman", "--report", "page.html", "--json").json["report"] == "page.html"


def test_a_filter_that_cannot_be_smoothed_says_so(run):
    answer = run(*CALL, "change-detection", "--smooth")
    assert answer.code == 2
    assert "ChangeDetection" in answer.stderr


def test_a_page_of_a_nonlinear_model(run, tmp_path):
    (tmp_path / "model.py").write_text(
        "import numpy as np\nimport estimable as es\n"
        "model = es.NonlinearModel(lambda x, u, θ: -x + u, lambda x, u, θ: x, Q=[[0.1]], R=[[0.01]], dt=0,\n"
        "    outputs=['alpha_deg'], inputs=['elevator_deg'], states=['alpha'])\n"
        "prior = es.Prior([0.0], [[1.0]])\nrecord = {'time': 'time_s'}\n"
    )
    answer = run(
        "estimate", "flight.csv", "--model", "model.py", "--filter", "extended-kalman", "--report", "page.html"
    )
    assert answer.code == 0
    page = (tmp_path / "page.html").read_text()
    assert "nonlinear, continuous, integrated over each step" in page
    assert "Output alpha_deg" in page
