"""Model files: what is written is read back to the last bit, and the files that exist are read as they stand."""

from pathlib import Path

import numpy as np
import pytest

from estimable import (
    Actuator,
    GainSection,
    InputError,
    Kalman,
    Prior,
    Record,
    StateSpace,
    estimate,
    packaged,
    read_model,
    through_actuators,
    write_model,
)
from estimable.commands.run_filter import run_filter
from estimable.models.operating_point import OperatingPoint
from estimable.results import ModelFile

SHARED = Path(__file__).parents[3] / "shared" / "data"


def shared(name):
    if not (SHARED / name).is_file():
        pytest.skip(f"{SHARED / name} is not on this machine")
    return SHARED / name


def same_settings(left, right):
    assert set(left) == set(right)
    for key, value in left.items():
        np.testing.assert_array_equal(np.asarray(value), np.asarray(right[key]))


@pytest.mark.parametrize("dt", [0.0, 1 / 3, 1e-3])
@pytest.mark.parametrize(
    "point", [None, {"states": [0.1, 1 / 3, -2.0], "inputs": [1e-300, 5.0], "outputs": [7.0, 1e300]}]
)
@pytest.mark.parametrize("diffuse", [False, True])
def test_a_model_and_its_prior_are_read_back_to_the_last_bit(full, diffuse_prior, same, tmp_path, dt, point, diffuse):
    model = full(dt=dt, operating_point=point)
    prior = diffuse_prior(r=2) if diffuse else Prior([0.1, 0.2, 0.3], np.zeros((3, 3)))
    write_model(tmp_path / "model.toml", model, prior)
    back = read_model(tmp_path / "model.toml")
    same(back.model, model)
    same(back.prior, prior)
    assert (back.gain, back.unknown, back.record) == (None, (), {})


@pytest.mark.parametrize(
    "model",
    [
        StateSpace([[0.5]], R=[[1.0]], dt=1),
        StateSpace([[0.5, 0.0], [0.1, 0.2]], R=np.eye(2), dt=0),
        StateSpace([[0.1]], [[0.2]], R=[[0.3]], dt=0.1, states=["α"], inputs=['δ "e"\\'], outputs=["q [°/s]\t"]),
    ],
    ids=["no input", "two states", "names"],
)
def test_small_models_and_strange_names_are_read_back(same, tmp_path, model):
    write_model(tmp_path / "model.toml", model, Prior(np.zeros(model.n), np.eye(model.n)))
    same(read_model(str(tmp_path / "model.toml")).model, model)


def test_gain_unknown_and_record_sections_are_read_back(full, same, tmp_path):
    model, prior = full(), Prior([0.0, 0.0, 0.0], np.eye(3))
    settings = {
        "directions": np.random.default_rng(6).normal(size=(2, 3, 2)),
        "fixed": np.full((3, 2), 1 / 3),
        "feedthrough": np.ones((2, 2, 2)),
        "walk": np.array([0.1, 1e-9]),
        "forgetting": np.float64(0.97),
    }
    gain = GainSection(Prior([1.0, 2.0], np.eye(2) / 7, diffuse=[[1.0], [0.0]]), settings)
    record = {"time": "t [s]", "dt": np.float64(0.1), "hold": "zero_order", "lost": "hold"}
    write_model(tmp_path / "model.toml", model, prior, gain=gain, unknown=("input 1",), record=record)
    back = read_model(tmp_path / "model.toml")
    same(back.gain.prior, gain.prior)
    same_settings(back.gain.settings, settings)
    assert back.unknown == ("input 1",)
    assert back.record == record


def test_settings_in_words_and_numbers_are_read_back(full, tmp_path):
    settings = {"directions": "per_input", "feedthrough": "scaled", "walk": np.array(0.02), "forgetting": 1}
    write_model(
        tmp_path / "model.toml",
        full(),
        Prior(np.zeros(3), np.eye(3)),
        gain=GainSection(Prior([1.0, 1.0], np.eye(2)), settings),
    )
    assert read_model(tmp_path / "model.toml").gain.settings == settings


def test_writing_changes_nothing_that_was_given(full, tmp_path):
    record, settings = {"dt": 0.1, "time": None}, {"walk": np.array([0.1])}
    write_model(
        tmp_path / "model.toml",
        full(),
        Prior(np.zeros(3), np.eye(3)),
        record={"dt": 0.1},
        gain=GainSection(Prior([1.0], [[1.0]]), settings),
    )
    assert record == {"dt": 0.1, "time": None}
    assert isinstance(settings["walk"], np.ndarray)


MINIMAL = """
[model]
dt = 1
states = ["x"]
outputs = ["y"]
A = [[1]]
C = [[2]]
R = [[3]]
[prior]
mean = [0]
covariance = [[4]]
"""


def test_only_the_required_keys_are_required(tmp_path):
    (tmp_path / "model.toml").write_text(MINIMAL)
    file = read_model(tmp_path / "model.toml")
    assert isinstance(file, ModelFile)
    assert (file.model.n, file.model.m, file.model.p, file.model.dt) == (1, 0, 1, 1.0)
    assert file.model.A.dtype == np.float64
    np.testing.assert_array_equal(file.model.Q, [[0.0]])
    assert (file.gain, file.unknown, file.record, file.model.operating_point) == (None, (), {}, None)


F16_A = [[-1.0069, 0.9512], [-11.399, -1.1471]]


def check_f16(file):
    model = file.model
    np.testing.assert_array_equal(model.A, F16_A)
    np.testing.assert_array_equal(model.B, [[0.0520], [-17.500]])
    np.testing.assert_array_equal(model.C, np.eye(2))
    np.testing.assert_array_equal(model.Q, np.diag([1e-3, 0.1]))
    np.testing.assert_array_equal(model.R, np.diag([9e-4, 0.01227664]))
    assert model.is_continuous
    assert model.states == ("alpha", "pitch_rate")
    assert (model.inputs, model.outputs) == (("elevator_deg",), ("alpha_deg", "pitch_rate_deg_s"))
    np.testing.assert_array_equal(model.operating_point.states, [0.3122794, 0.0])
    np.testing.assert_array_equal(model.operating_point.inputs, [-1.2802443])
    np.testing.assert_array_equal(model.operating_point.outputs, [0.3122794, 0.0])
    np.testing.assert_array_equal(file.prior.mean, [0.3122794, 0.0])
    np.testing.assert_array_equal(file.prior.covariance, np.diag([0.1, 1.0]))
    np.testing.assert_array_equal(file.gain.prior.mean, [1.0])
    np.testing.assert_array_equal(file.gain.prior.covariance, [[0.25]])
    assert file.gain.settings == {"walk": 0.02, "directions": "one"}
    record = dict(file.record)
    units = record.pop("units", None)  # which the shared copy of the file may leave out
    assert units in (None, {"alpha_deg": "deg", "pitch_rate_deg_s": "deg/s", "elevator_deg": "deg"})
    assert record == {"time": "time_s", "hold": "first_order"}
    assert file.unknown == ()


def test_the_packaged_model_is_the_f16_of_the_packaged_flight():
    check_f16(read_model(packaged.path("f16-model.toml")))


def test_the_f16_file_is_read_as_it_stands():
    check_f16(read_model(shared("f16-model.toml")))


def test_fangs_example_is_read_as_it_stands():
    file = read_model(shared("fang-example-1.toml"))
    model = file.model
    np.testing.assert_array_equal(model.A, np.diag([0.67, 0.53]))
    np.testing.assert_array_equal(model.B, [[1.0], [0.53]])
    np.testing.assert_array_equal(model.C, [[0.55, 0.11], [0.0, 0.29]])
    np.testing.assert_array_equal(model.D, [[0.40], [0.20]])
    np.testing.assert_array_equal(model.Q, 0.08 * np.eye(2))
    np.testing.assert_array_equal(model.R, 0.08 * np.eye(2))
    assert (model.dt, model.states, model.inputs, model.outputs) == (1.0, ("x1", "x2"), ("u",), ("y1", "y2"))
    np.testing.assert_array_equal(file.prior.covariance, 1e6 * np.eye(2))
    assert (file.unknown, file.gain, file.record) == (("u",), None, {})
    assert model.operating_point is None


PYTHON = """
import numpy as np
from estimable import GainSection, Prior, StateSpace
model = StateSpace(np.eye(2), [[1.0], [0.0]], R=np.eye(2), dt=0.5, inputs=["u"], operating_point={"states": [1.0, 2.0]})
prior = Prior([0.0, 0.0], np.eye(2))
"""


def test_a_python_file_defines_a_model_and_a_prior(tmp_path):
    path = tmp_path / "model.py"
    path.write_text(PYTHON)
    file = read_model(path)
    assert (file.model.dt, file.model.inputs, file.prior.size) == (0.5, ("u",), 2)
    assert isinstance(file.model.operating_point, OperatingPoint)
    assert (file.gain, file.unknown, file.record) == (None, (), {})


def test_a_python_file_may_define_the_other_sections(tmp_path):
    path = tmp_path / "model.py"
    path.write_text(
        PYTHON + ("gain = GainSection(prior, {'walk': 0.1})\nunknown = ['u']\nrecord = {'hold': 'first_order'}\n")
    )
    file = read_model(path)
    assert file.gain.settings == {"walk": 0.1}
    assert file.unknown == ("u",)
    assert file.record == {"hold": "first_order"}


ACTUATORS = {
    "u1": Actuator(np.inf, rate=0.1),
    "u2": Actuator(1 / 3, limits=(-1.0, 2.0), delay=0.05, operating_point=0.5),
}


def test_actuators_are_read_back_and_their_faults_named(full, same, tmp_path):
    path, prior = tmp_path / "model.toml", Prior([0.1, 0.2, 0.3], np.zeros((3, 3)))
    model = full(dt=0.1)
    known = dict(zip(model.inputs, ACTUATORS.values(), strict=False))
    write_model(path, model, prior, actuators=known)
    back = read_model(path).actuators
    assert list(back) == list(known)
    for name, actuator in known.items():
        same(back[name], actuator)
    text = path.read_text().replace("rate = 0.1", "rate = 0.0\nspeed = 1.0").replace("bandwidth = inf\n", "")
    path.write_text(text)
    with pytest.raises(InputError, match=r"has no key 'speed'(.|\n)*needs bandwidth"):
        read_model(path)
    path.write_text(
        text.replace("speed = 1.0", "bandwidth = 1.0").replace(f"actuators.{model.inputs[0]}", "actuators.rudder")
    )
    with pytest.raises(InputError, match="`rate` must be greater than 0"):
        read_model(path)
    with pytest.raises(InputError, match="names the input 'rudder'"):
        write_model(path, model, prior, actuators={"rudder": ACTUATORS["u1"]})


def test_a_record_of_commands_is_filtered_through_the_actuators_of_the_model_file(tmp_path):
    model = StateSpace([[0.9]], [[0.5]], Q=[[0.01]], R=[[0.1]], dt=0.1, inputs=["valve"], outputs=["level"])
    side, u = {"valve": Actuator(4.0, limits=(-0.5, 0.5))}, np.sign(np.sin(np.arange(60.0) / 5))
    write_model(tmp_path / "tank.toml", model, Prior([0.0], [[1.0]]), actuators=side)
    record = Record(np.cumsum(u) / 10, u, dt=0.1, inputs=["valve"], outputs=["level"])
    np.savetxt(tmp_path / "tank.csv", np.c_[record.u, record.y], delimiter=",", header="valve,level", comments="")
    run = run_filter("kalman", tmp_path / "tank.csv", tmp_path / "tank.toml")
    expected = estimate(Kalman(model), through_actuators(record, side), prior=Prior([0.0], [[1.0]]))
    np.testing.assert_allclose(run.result.mean, expected.mean, rtol=1e-12)
    assert run.commanded
