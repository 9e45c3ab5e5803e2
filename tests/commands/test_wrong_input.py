"""One clear sentence for each wrong file or option: exit 2, the same words in JSON, and nothing written."""

import pytest

ROW = "0.00,0.359616,0.060276,-1.280244"
CALL = ("estimate", "flight.csv", "--model", "model.toml", "--filter", "unknown-gain", "--out", "table.csv")


def check_refused(run, tmp_path, says, *arguments):
    """Refused in one sentence that says all of this, the same for people and for machines."""
    plain, machine = run(*(arguments or CALL)), run(*(arguments or CALL), "--json")
    assert (plain.code, plain.stdout) == (2, "")
    assert (machine.code, machine.stderr) == (2, "")
    assert set(machine.json) == {"error", "message"}
    assert machine.json["error"] == "InputError"
    message = machine.json["message"]
    assert plain.stderr == f"Error: {message}\n"
    assert "\n" not in message
    assert all(part in message for part in says), message
    assert not (tmp_path / "table.csv").exists()


@pytest.mark.parametrize(
    ("rows", "header", "says"),
    [
        ([ROW], "time_s,alfa_deg,pitch_rate_deg_s,elevator_deg",
         ["flight.csv", "no column 'alpha_deg'", "'time_s', 'alfa_deg', 'pitch_rate_deg_s'", "mean 'alfa_deg'?"]),
        ([ROW, "0.01,up,0,0"], None, ["flight.csv", "'alpha_deg' must hold numbers", "ow 2 below the header", "'up'"]),
        ([ROW, ",0,0,0"], None, ["flight.csv", "'time_s'", "empty or NaN", "ow 2 below the header"]),
        ([ROW, "0.02,0,0,0", "0.01,0,0,0"], None, ["flight.csv", "must increase", "from 0.02 to 0.01 s"]),
        ([ROW, "0.00,0,0,-1.280244"], None, ["flight.csv", "two rows have the time 0 s", "a value of 'alpha_deg'"]),
        ([], None, ["flight.csv", "no row below the header"]),
    ],
)  # fmt: skip
def test_wrong_records(run, tmp_path, write_record, rows, header, says):
    write_record(*rows, **({} if header is None else {"header": header}))
    check_refused(run, tmp_path, says)


def test_a_record_that_is_empty_or_not_there(run, tmp_path):
    (tmp_path / "flight.csv").write_text("")
    check_refused(run, tmp_path, ["flight.csv", "is empty"])
    (tmp_path / "flight.csv").unlink()
    check_refused(run, tmp_path, ["flight.csv does not exist"])


def test_an_input_that_is_not_known_is_said(run, write_record):
    write_record(*(f"{k / 100},0.31,0.0,{'' if k in (4, 5) else -1.28}" for k in range(10)))
    people, machine = run(*CALL), run(*CALL, "--json")
    assert (people.code, machine.code) == (0, 0)
    words = " ".join(people.stdout.split())
    assert "Gap without a recorded input: rows 3 to 6, 0.03 s from t = 0.03 s: bridged" in words
    assert machine.json["gaps"][0].startswith("rows 3 to 6, 0.03 s from t = 0.03 s: bridged")


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("C = [[1.0, 0.0], [0.0, 1.0]]\n", "", ["model.toml", "[model] needs 'C'"]),
        ("walk = 0.02", "wlak = 0.02", ["model.toml", "[gain] has no key 'wlak'", "Did you mean 'walk'?"]),
        ("[unknown]", "[unkown]", ["model.toml", "no section [unkown]", "Did you mean 'unknown'?"]),
        ("mean = [1.0]\ncovariance = [[0.25]]", "mean = [1.0]", ["model.toml", "[gain] needs 'covariance'"]),
        ("[gain]", "[gain", ["model.toml", "TOML"]),
    ],
)  # fmt: skip
def test_wrong_model_files(run, tmp_path, change_model, old, new, says):
    change_model(old, new)
    check_refused(run, tmp_path, says)


def test_a_model_file_that_is_not_there(run, tmp_path):
    (tmp_path / "model.toml").unlink()
    check_refused(run, tmp_path, ["model.toml does not exist"])


def test_a_model_file_without_a_gain(run, tmp_path):
    text = (tmp_path / "model.toml").read_text()
    (tmp_path / "model.toml").write_text(text.split("[gain]")[0])
    check_refused(run, tmp_path, ["no section [gain]"])
    check_refused(run, tmp_path, ["no section [gain]"], "gain", "flight.csv", "--model", "model.toml")


def test_a_filter_that_is_not_there(run, tmp_path):
    call = ("estimate", "flight.csv", "--model", "model.toml", "--filter", "kalmann")
    check_refused(run, tmp_path, ["'kalmann'", "'unknown-gain'", "Did you mean 'kalman'?"], *call)


@pytest.mark.parametrize(
    ("setting", "says"),
    [
        ("walk", ["--set needs name=value", "'walk'"]),
        ("walk=[0.1", ["--set walk", "'[0.1' is not a number, list or word"]),
        ("wlak=1", ["unknown-gain has no setting 'wlak'", "'directions', 'fixed', 'feedthrough'", "mean 'walk'?"]),
        ("name=1", ["unknown-gain has no setting 'name'"]),
        ("file=1", ["unknown-gain has no setting 'file'"]),
        ("walk=-1", ["`walk`", "Got -1"]),
        ("directions=per_imput", ["`directions` must be one of", "Did you mean 'per_input'?"]),
    ],
)
def test_wrong_settings(run, tmp_path, setting, says):
    check_refused(run, tmp_path, says, *CALL, "--set", setting)


def test_every_wrong_setting_is_named_at_once(run):
    settings = ("--set", "walk", "--set", "a=1", "--set", "a=2")
    answer = run("gain", "flight.csv", "--model", "model.toml", *settings, "--json")
    assert answer.json["message"].splitlines() == [
        "--set needs name=value, as in --set walk=0.02. Got 'walk'.",
        "--set gives 'a' twice.",
    ]


def test_a_run_that_fails_is_another_error(run, tmp_path, write_record):
    text = (tmp_path / "model.toml").read_text()
    for covariance in ("[[9e-4, 0.0], [0.0, 0.01227664]]", "[[0.1, 0.0], [0.0, 1.0]]"):
        assert covariance in text
        text = text.replace(covariance, "[[0.0, 0.0], [0.0, 0.0]]")
    (tmp_path / "model.toml").write_text(text)
    write_record("0.00,5.0,0.0,-1.280244", "0.01,5.0,0.0,-1.280244")
    plain, machine = run(*CALL), run(*CALL, "--json")
    assert (plain.code, plain.stdout) == (1, "")
    assert plain.stderr.startswith("Error: At sample 0 (t = 0 s): ")
    assert (machine.code, machine.json) == (1, {"error": "RunError", "message": plain.stderr[len("Error: ") : -1]})
    assert not (tmp_path / "table.csv").exists()
