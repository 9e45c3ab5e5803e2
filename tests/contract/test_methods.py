"""The rules of `rules.py`, for every identifier and controller, and for the toys of docs/adding-a-method.md."""

import re
from pathlib import Path

import numpy as np
import pytest

import estimable as es
import rules
from estimable.results import Names

PAGE = Path(__file__).parents[2] / "docs" / "adding-a-method.md"
RNG = np.random.default_rng(3)
PLANT = es.OutputError([-0.6], [1.0], noise_variance=0.01, dt=1)
RECORDS = [es.simulate(PLANT, RNG.normal(size=(120, 1)), seed=i).record for i in range(2)]
IDENTIFIERS = {
    "coupled-least-squares": es.CoupledLeastSquares(1, 0),
    "ho-kalman": es.HoKalman(1, length=12),
    "instrumental-variables": es.InstrumentalVariables(1, 0),
    "joint-output-error": es.JointOutputError(1, 0, noise_variance=0.01),
    "least-squares": es.LeastSquares(1, 0),
    "markov-parameters": es.MarkovParameters(12),
    "minimum-variance": es.MinimumVariance(1, 0),
    "output-error-ml": es.OutputErrorML(1, 0),
    "prediction-error": es.PredictionError(1, 0, 1),
    "predictor-subspace": es.PredictorSubspace(1),
    "recursive-output-error": es.RecursiveOutputError(1, 0, noise_variance=0.01),
    "subspace": es.Subspace(1),
}
OWN_RECORDS = {"phasor", "adaptive-identification"}  # need sinusoids, and a nonlinear model: tests/identifiers
MODEL = es.StateSpace([[0.9, 0.1], [0.0, 0.7]], [[0.0], [1.0]], Q=0.01 * np.eye(2), R=0.01 * np.eye(2), dt=1)
LAW = es.StateFeedback([[0.2, 0.1]], reference_gain=[[0.3]])
GAIN = es.UnknownGain(MODEL, es.Prior([1.0], [[0.1]]))
CONTROLLERS = {
    "state-feedback": (LAW, es.Kalman(MODEL)),
    "proportional-integral": (
        es.ProportionalIntegral([[0.2, 0.1]], reference_gain=[[0.3]], integral=[[-0.05]], tracked=[[1.0, 0.0]], dt=1.0),
        es.Kalman(MODEL),
    ),
    "gain-reconfiguration": (es.GainReconfiguration(LAW), GAIN),
    "dither": (es.Dither(LAW, amplitude=0.1, period=4, sigma=0.05), GAIN),
}
PRIOR = es.Prior([0.0, 0.0], 0.1 * np.eye(2))


def blocks():
    return re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), flags=re.MULTILINE | re.DOTALL)


def toys():
    """The classes of the page, run as a reader would."""
    names = {}
    for block in blocks():
        exec(compile(block, str(PAGE), "exec"), names)
    return names


def test_every_identifier_is_here():
    known = {entry.name for entry in es.catalogue.IDENTIFIERS}
    assert known == {*IDENTIFIERS, *OWN_RECORDS}
    assert all(
        type(IDENTIFIERS[entry.name]) is entry.cls for entry in es.catalogue.IDENTIFIERS if entry.name in IDENTIFIERS
    )


@pytest.mark.parametrize("name", IDENTIFIERS)
def test_an_identifier_names_what_it_finds_and_finds_it_again(name):
    rules.fits_with_names_for_its_parameters(IDENTIFIERS[name], RECORDS)
    rules.fits_the_same_twice(IDENTIFIERS[name], RECORDS[0])


@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_controller_acts_alike_everywhere(name):
    controller, estimator = CONTROLLERS[name]
    rules.gives_an_input_for_each_actuator(controller, estimator.names, {"input": np.zeros(1)})
    rules.notes_what_it_lacks(controller, Names((), (), ()))
    rules.closes_a_loop_alike_on_every_engine(controller, MODEL, estimator, PRIOR, np.ones(12))


@pytest.fixture(scope="module")
def page():
    return toys()


def test_the_filter_of_the_page_keeps_the_rules(page):
    model, prior = page["model"], es.Prior([0.0], [[1.0]])
    y = RNG.normal(size=(2, 30, 1))
    y[:, ::4] = np.nan
    records = [es.Record(one, dt=1) for one in y]
    toy = page["Leaky"](model, 0.5)
    rules.takes_its_arguments_by_name(toy)
    rules.gives_back_a_state_of_the_same_shapes(toy, prior)
    rules.runs_alike_on_every_engine(toy, records[0], prior)
    rules.runs_online_as_over_a_record(toy, records[0], prior)
    rules.runs_in_a_bank_as_alone(toy, records, prior)
    rules.keeps_the_prior_where_nothing_is_seen(toy, records[0], prior)


POINT = {"states": [1.0, 2.0], "inputs": [3.0], "outputs": [4.0, 5.0]}
CHAIN = {"A": [[0.0, 1.0], [-1.0, -0.4]], "B": [[0.0], [1.0]], "C": np.eye(2), "Q": 0.1 * np.eye(2), "R": np.eye(2)}
LINEAR = {
    "continuous": es.StateSpace(**CHAIN, dt=0),
    "about a point": es.StateSpace(**CHAIN, dt=0.5, operating_point=POINT),
    "varying": es.StateSpace(**{**CHAIN, "A": np.linspace(0.1, 0.5, 30)[:, None, None] * np.ones((30, 2, 2))}, dt=0.5),
}


@pytest.mark.parametrize("kind", LINEAR)
def test_the_observer_of_the_page_takes_every_linear_model(page, kind):
    model, prior = LINEAR[kind], es.Prior([1.0, 2.5], np.eye(2))
    record = es.Record(RNG.normal(size=(30, 2)), RNG.normal(size=(30, 1)), dt=0.5)
    ours = page["Observer"](model, 0.3 * np.eye(2))
    same = es.FixedGain(model, 0.3 * np.eye(2))
    found, expected = (es.estimate(one, record, prior=prior).mean for one in (ours, same))
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
    rules.runs_alike_on_every_engine(ours, record, prior)


@pytest.mark.parametrize(("kind", "words"), [
    ("continuous", "is continuous"), ("about a point", "has an operating point"), ("varying", "varies in time"),
])  # fmt: skip
def test_a_filter_that_reads_its_model_as_it_is_refuses_what_it_would_get_wrong(page, kind, words):
    record = es.Record(np.zeros((30, 2)), np.zeros((30, 1)), dt=0.5)
    for verb in (
        lambda: es.estimate(page["Leaky"](LINEAR[kind], 0.5), record, prior=es.Prior([0.0, 0.0], np.eye(2))),
        lambda: es.online(page["Leaky"](LINEAR[kind], 0.5), prior=es.Prior([0.0, 0.0], np.eye(2))),
    ):
        with pytest.raises(es.InputError, match=f"Leaky defines no `sampled` or no `at`.* This one {words}"):
            verb()


def test_what_a_filter_does_not_give_is_not_made_up(page):
    toy, record, prior = page["Leaky"](page["model"], 0.5), es.Record([1.0, 2.0], dt=1), es.Prior([0.0], [[1.0]])
    assert all(np.isnan(es.estimate(toy, record, prior=prior, engine=e).log_likelihood) for e in ("xla", "native"))
    with pytest.raises(es.InputError, match="must report the covariance of its innovations: Leaky reports none"):
        es.estimate(es.Gated(toy, 0.99), record, prior=prior)


class Gives(es.Identifier):
    """An identifier that gives what it is made with."""

    def __init__(self, given):
        self.given = given

    def fit(self, records):
        """Whatever it is."""
        return self.given


@pytest.mark.parametrize(("given", "sentence"), [
    (3, r"`fit` of Gives must return an estimable\.results\.Fit\. It returned 3"),
    (es.results.Fit(PLANT, np.zeros(2), np.eye(2), ("a",)), r"`parameters of Gives` must be \(d,\) = \(1,\)"),
    (es.results.Fit(PLANT, np.zeros(1), np.eye(2), ("a",)), r"`covariance of Gives` must be \(d, d\) = \(1, 1\)"),
])  # fmt: skip
def test_what_an_identifier_gives_is_checked(given, sentence):
    with pytest.raises(es.InputError, match=sentence):
        es.identify(Gives(given), RECORDS[0])


def test_a_fit_without_error_has_a_spread_of_zero():
    fit = es.results.Fit(PLANT, np.array([-0.6, 1.0]), np.zeros((2, 2)), ("a1", "b0"))
    spread = es.diagnostics.spread_of(fit)
    assert spread.known
    assert not spread.tangents.A.any()


def test_the_identifier_of_the_page_keeps_the_rules(page):
    u = RNG.normal(size=100)
    record = es.Record(2.0 * u + 0.1 * RNG.normal(size=100), u, dt=1)
    rules.fits_with_names_for_its_parameters(page["MeanOf"](), record)
    rules.fits_the_same_twice(page["MeanOf"](), record)


def test_the_controller_of_the_page_keeps_the_rules(page):
    toy, plant = page["BangBang"](0.5), page["plant"]
    rules.gives_an_input_for_each_actuator(toy, es.Kalman(plant).names)
    rules.notes_what_it_lacks(toy, Names((), (), ()))
    rules.closes_a_loop_alike_on_every_engine(toy, plant, es.Kalman(plant), es.Prior([0.0], [[0.0]]), np.ones(12))


@pytest.mark.parametrize("name", ["Leaky", "MeanOf", "BangBang"])
def test_a_toy_takes_at_most_forty_lines(name):
    block = next(
        b
        for b in re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
        if f"class {name}" in b
    )
    assert block.count("\n") <= 40
