"""What is said of a model file that cannot be read or written, and of python-control's systems."""

import sys

import control
import numpy as np
import pytest

from estimable import GainSection, Kalman, Prior, StateSpace, read_model, write_model

MODEL_SECTION = (
    'dt = 1.0\nstates = ["x"]\ninputs = ["u"]\noutputs = ["y"]\nA = [[0.5]]\nB = [[1.0]]\nC = [[1.0]]\nR = [[1.0]]'
)
PRIOR_SECTION = "mean = [0.0]\ncovariance = [[1.0]]"
MODEL = StateSpace([[0.5]], [[1.0]], R=[[1.0]], dt=1, inputs=["u"])
PRIOR = Prior([0.0], [[1.0]])
KEYS = "Its keys are 'dt', 'states', 'inputs', 'outputs', 'angles', 'A', 'B', 'C', 'D', 'Q', 'R', 'G', 'S'."
RECORD_KEYS = (
    "'time', 'dt', 'time_unit', 'time_format', 'zone', 'repeated', 'grid', 'start', 'stop', 'max_gap', 'delay', "
    "'offset', 'hold', 'lost', 'units', 'angles', 'na_values'"
)


@pytest.fixture
def written(tmp_path):
    def write(name="model.toml", text="", **sections):
        body = "".join(f"[{section}]\n{lines}\n" for section, lines in sections.items() if lines is not None)
        path = tmp_path / name
        path.write_text(text + body, encoding="utf-8")
        return path

    return write


def sections(**changed):
    return {"model": MODEL_SECTION, "prior": PRIOR_SECTION} | changed


FILES = {
    "no prior": (sections(prior=None), ["the section [prior] is missing."]),
    "nothing": ({}, ["the section [model] is missing.", "the section [prior] is missing."]),
    "unknown section": (
        sections(priors="a = 1"),
        ["a model file has no section [priors]. Did you mean 'prior'?"],
    ),
    "unknown key": (
        sections(model=MODEL_SECTION + "\nstate = 1"),
        [f"[model] has no key 'state'. {KEYS} Did you mean 'states'?"],
    ),
    "unknown keys": (
        sections(gain="mean = [1.0]\ncovariance = [[1.0]]\nwolk = 1", operating_point="outputz = [1.0]"),
        [
            (
                "[gain] has no key 'wolk'. Its keys are 'mean', 'covariance', 'diffuse', 'walk', 'forgetting', "
                "'directions', 'fixed', 'feedthrough'. Did you mean 'walk'?"
            ),
            (
                "[operating_point] has no key 'outputz'. Its keys are 'states', 'inputs', 'outputs'. Did you "
                "mean 'outputs'?"
            ),
        ],
    ),
    "missing keys": (
        sections(model="dt = 1.0", prior="mean = [0.0]", gain="walk = 1.0"),
        [
            "[model] needs 'states', 'outputs', 'A', 'C', 'R'.",
            "[prior] needs 'covariance'.",
            "[gain] needs 'mean', 'covariance'.",
        ],
    ),
    "faults of all sections": (
        sections(
            model=MODEL_SECTION.replace("R = [[1.0]]", "R = [[-1.0]]"),
            prior="mean = 0.0\ncovariance = [[1.0]]",
            gain="mean = [1.0]\ncovariance = [[-1.0]]",
        ),
        [
            "[model] `R` must be positive semidefinite: its smallest eigenvalue is -1.",
            "[prior] `mean` must be (n,). Got (). A list is needed, as in [1.0].",
            ("[gain] `covariance` must be positive semidefinite: its smallest eigenvalue is -1."),
        ],
    ),
    "date for a step": (
        sections(model=MODEL_SECTION.replace("dt = 1.0", "dt = 2026-01-01")),
        [("[model] `dt` must be a finite number of seconds. Got datetime.date(2026, 1, 1).")],
    ),
    "name for names": (
        sections(model=MODEL_SECTION.replace('["x"]', '"x"')),
        [("[model] `states` must be a list of names. Got the string 'x'. Did you mean ['x']?")],
    ),
    "point": (
        sections(operating_point="states = [1.0, 2.0]"),
        ["[model] `operating_point states` must be (n,) = (1,): `A` is 1 × 1. Got (2,)."],
    ),
    "prior of another size": (
        sections(prior="mean = [0.0, 1.0]\ncovariance = [[1.0, 0.0], [0.0, 1.0]]"),
        ["[prior] must describe n = 1 states: `A` is 1 × 1. Got 2."],
    ),
    "unknown input of no such name": (
        sections(unknown='inputs = ["v", "u"]'),
        ["[unknown] names 'v', which is not an input of the model. Its inputs are 'u'."],
    ),
    "unknown input one text": (
        sections(unknown='inputs = "elevator"'),
        [("`[unknown] inputs` must be a list of names. Got the string 'elevator'. Did you mean ['elevator']?")],
    ),
    "unknown input a number": (
        sections(unknown="inputs = 3"),
        ["`[unknown] inputs` must be a list of names, in order. Got 3."],
    ),
    "record options": (
        sections(record='time = 3\ndt = -1\nhold = "zoh"\nlost = "keep"'),
        [
            "`[record] hold` must be one of 'zero_order', 'first_order'. Got 'zoh'.",
            "`[record] lost` must be one of 'zero', 'hold'. Got 'keep'.",
            "`[record] dt` must be greater than 0 seconds. Got -1.",
            "`[record] time` must be the name of a column. Got 3.",
        ],
    ),
}


@pytest.mark.parametrize(("given", "sentences"), FILES.values(), ids=FILES)
def test_a_model_file_is_refused_with_its_section(refused, written, given, sentences):
    path = written(**given)
    assert refused(lambda: read_model(path)) == [f"{path}: {sentence}" for sentence in sentences]


def test_a_value_where_a_section_should_be_is_refused(refused, written):
    path = written(text="model = 1\n", prior=PRIOR_SECTION)
    assert refused(lambda: read_model(path)) == [
        f"{path}: 'model' must be a section [model] with keys {KEYS[len('Its keys are ') :]}"
    ]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[model\n", "is not TOML: Expected ']' at the end of a table declaration (at line 1, column 7)."),
        ("t,y\n0,1\n", "is not TOML: Expected '=' after a key in a key/value pair (at line 1, column 2)."),
        ("a = 1\na = 2\n", "is not TOML: Cannot overwrite a value (at line 2, column 6)."),
    ],
)
def test_what_is_not_toml_is_refused_with_its_line(refused, written, text, words):
    path = written(text=text)
    assert refused(lambda: read_model(path)) == [f"{path} {words}"]


def test_a_binary_model_file_is_refused(refused, tmp_path):
    path = tmp_path / "model.toml"
    path.write_bytes(b"\xfb\x00\x01")
    (sentence,) = refused(lambda: read_model(path))
    assert sentence.startswith(f"{path} is not TOML: ")


def test_a_path_must_be_of_a_file_that_is_there(refused, tmp_path):
    assert refused(lambda: read_model(None)) == ["`path` must be the name of a file. Got None."]
    assert refused(lambda: read_model(tmp_path / "none")) == [f"{tmp_path / 'none'} does not exist."]
    assert refused(lambda: read_model(tmp_path)) == [f"{tmp_path} is not a file."]


IMPORTS = "from estimable import GainSection, Prior, StateSpace\n"
GOOD_PYTHON = IMPORTS + "model = StateSpace([[0.5]], [[1.0]], R=[[1.0]], dt=1)\nprior = Prior([0.0], [[1.0]])\n"
PYTHON = {
    "defines nothing": (
        IMPORTS,
        [
            "a Python model file must define `model`, a StateSpace or a NonlinearModel.",
            "a Python model file must define `prior`, a Prior.",
        ],
    ),
    "syntax": ("model = (", ["its Python code failed: SyntaxError: '(' was never closed (model.py, line 1)."]),
    "a mistake": ("model = mode", ["its Python code failed: NameError: name 'mode' is not defined."]),
    "a wrong call": (
        IMPORTS + "model = StateSpace([1.0], dt=1)",
        ["`A` must be (n, n). Got (1,). Did you mean `np.diag(A)`?"],
    ),
    "prior of another size": (
        GOOD_PYTHON + "prior = Prior([0.0, 1.0], [[1.0, 0.0], [0.0, 1.0]])",
        ["[prior] must describe n = 1 states: `A` is 1 × 1. Got 2."],
    ),
    "gain a prior": (GOOD_PYTHON + "gain = prior", ["`gain` must be a GainSection(prior, settings). Got Prior."]),
    "unknown setting": (
        GOOD_PYTHON + "gain = GainSection(prior, {'wolk': 1.0})",
        [
            (
                "[gain] has no key 'wolk'. Its keys are 'walk', 'forgetting', 'directions', 'fixed', "
                "'feedthrough'. Did you mean 'walk'?"
            )
        ],
    ),
    "one unknown, no list": (
        GOOD_PYTHON + "unknown = 'u1'",
        [("`[unknown] inputs` must be a list of names. Got the string 'u1'. Did you mean ['u1']?")],
    ),
    "record no mapping": (
        GOOD_PYTHON + "record = 3",
        [f"[record] must hold {RECORD_KEYS}. Got 3."],
    ),
}


@pytest.mark.parametrize(("text", "sentences"), PYTHON.values(), ids=PYTHON)
def test_a_python_model_file_is_refused(refused, written, text, sentences):
    path = written("model.py", text)
    assert refused(lambda: read_model(path)) == [f"{path}: {sentence}" for sentence in sentences]


def test_a_failure_of_the_users_python_keeps_its_traceback(written):
    path = written("model.py", "model = 1 / 0")
    with pytest.raises(ValueError, match="ZeroDivisionError") as caught:
        read_model(path)
    assert isinstance(caught.value.__cause__, ZeroDivisionError)


CONTINUOUS = StateSpace([[-0.5]], [[1.0]], R=[[1.0]], dt=0)
WRITING = {
    "not a model": ((Kalman(MODEL), PRIOR), {}, ["`model` must be a StateSpace. Got Kalman."]),
    "neither": (
        (None, None),
        {},
        ["`model` must be a StateSpace. Got NoneType.", "`prior` must be a Prior. Got NoneType."],
    ),
    "varies": (
        (StateSpace(np.ones((2, 1, 1)), R=[[1.0]], dt=1), PRIOR),
        {},
        [("a model file holds a constant model without `B_end`: use save(path, model) for this one.")],
    ),
    "B_end": (
        (CONTINUOUS.discretise(0.1, hold="first_order"), PRIOR),
        {},
        [("a model file holds a constant model without `B_end`: use save(path, model) for this one.")],
    ),
    "no R": (
        (StateSpace([[0.5]], dt=1), PRIOR),
        {},
        ["a model file needs `R`, the covariance of the measurement noise."],
    ),
    "prior of another size": (
        (MODEL, Prior([0.0, 0.0], np.eye(2))),
        {},
        ["[prior] must describe n = 1 states: `A` is 1 × 1. Got 2."],
    ),
    "gain a prior": ((MODEL, PRIOR), dict(gain=PRIOR), ["`gain` must be a GainSection(prior, settings). Got Prior."]),
    "unknown setting": (
        (MODEL, PRIOR),
        dict(gain=GainSection(PRIOR, {"wolk": 1})),
        [
            (
                "[gain] has no key 'wolk'. Its keys are 'walk', 'forgetting', 'directions', 'fixed', "
                "'feedthrough'. Did you mean 'walk'?"
            )
        ],
    ),
    "unknown input": (
        (MODEL, PRIOR),
        dict(unknown=("v",)),
        ["[unknown] names 'v', which is not an input of the model. Its inputs are 'u'."],
    ),
    "unknown record option": (
        (MODEL, PRIOR),
        dict(record={"step": 1}),
        [f"[record] has no key 'step'. Its keys are {RECORD_KEYS}. Did you mean 'stop'?"],
    ),
}


@pytest.mark.parametrize(("things", "more", "sentences"), WRITING.values(), ids=WRITING)
def test_what_has_no_place_in_a_model_file_is_refused_before_it_is_written(refused, tmp_path, things, more, sentences):
    path = tmp_path / "model.toml"
    assert refused(lambda: write_model(path, *things, **more)) == sentences
    assert not path.exists()


def test_a_file_that_cannot_be_written_is_refused(refused, tmp_path):
    path = tmp_path / "none" / "file"
    (sentence,) = refused(lambda: write_model(path, MODEL, PRIOR))
    assert sentence.startswith(f"{path} could not be written: ")
    assert "No such file or directory" in sentence


SYSTEMS = {
    "nothing": (
        lambda: None,
        "`system` must be a control.StateSpace. Convert it with control.ss(system). Got NoneType.",
    ),
    "transfer function": (
        lambda: control.tf([1.0], [1.0, 1.0]),
        ("`system` must be a control.StateSpace. Convert it with control.ss(system). Got TransferFunction."),
    ),
    "no dt": (
        lambda: control.ss([[1.0]], [[1.0]], [[1.0]], [[0.0]], None),
        ("the system's dt is None: give it a sampling time in seconds, or 0 for continuous time."),
    ),
    "dt not said": (
        lambda: control.ss([[1.0]], [[1.0]], [[1.0]], [[0.0]], True),
        ("the system's dt is True: give it a sampling time in seconds, or 0 for continuous time."),
    ),
    "a gain alone": (
        lambda: control.ss([], [], [], [[1.0]], 0.1),
        "`A` must be at least 1 × 1: a model needs a state.",
    ),
}


@pytest.mark.parametrize(("system", "sentence"), SYSTEMS.values(), ids=SYSTEMS)
def test_a_system_of_python_control_is_refused(refused, system, sentence):
    assert refused(lambda: StateSpace.from_control(system())) == [sentence]


def test_noises_added_to_a_system_are_checked(refused):
    system = control.ss([[1.0]], [[1.0]], [[1.0]], [[0.0]], 0.1)
    assert refused(lambda: StateSpace.from_control(system, Q=[[-1.0]], R=[1.0])) == [
        "`Q` must be positive semidefinite: its smallest eigenvalue is -1.",
        "`R` must be (p, p) = (1, 1): `C` is 1 × 1. Got (1,). Did you mean `np.diag(R)`?",
    ]


def test_what_python_control_has_no_place_for_is_refused(refused):
    assert refused(lambda: StateSpace(np.ones((2, 1, 1)), dt=1).to_control()) == [
        "python-control has no time-varying models. These matrices vary in time: 'A'.",
        "python-control needs a model with an input. This model has none.",
    ]
    assert refused(lambda: CONTINUOUS.discretise(0.1, hold="first_order").to_control()) == [
        "python-control has no first-order hold, so `B_end` would be lost. Convert the continuous model instead."
    ]


def test_without_python_control_it_says_what_to_install(refused, monkeypatch):
    monkeypatch.setitem(sys.modules, "control", None)
    assert refused(MODEL.to_control) == ["python-control is not installed: pip install 'estimable[control]'."]
