"""Options of any type, ragged lists, dates and numbers that no machine holds get a sentence."""

import numpy as np
import pytest

import estimable as es

MODEL = es.StateSpace([[0.9]], [[1.0]], [[1.0]], Q=[[0.1]], R=[[0.1]], dt=1)
PRIOR = es.Prior([0.0], [[1.0]])
RECORD = es.Record(np.zeros(5), np.zeros(5), dt=1)
DATES = np.array(["2020-01-01", "2020-01-02"], dtype="M8[s]")
RAGGED = [[1.0, 2.0], [3.0]]


class Unprintable:
    """What cannot even be shown."""

    def __repr__(self):
        raise RuntimeError("no")


ODD = [np.eye(2), RAGGED, DATES, 10**400, -(10**400), 1j, "yes", b"no", {}, set(), Unprintable(), float("nan"), object]
FLAGS = {
    "BernoulliLink": lambda value: es.BernoulliLink(0.5, acknowledged=value),
    "GilbertElliottLink": lambda value: es.GilbertElliottLink(0.1, 0.2, acknowledged=value),
    "DelayLink": lambda value: es.DelayLink([0.5], acknowledged=value),
    "Trace": lambda value: es.Trace([[0.0]], acknowledged=value),
    "LeastSquares": lambda value: es.LeastSquares(1, 1, offset=value),
    "Subspace": lambda value: es.Subspace(2, feedthrough=value),
    "MarkovParameters": lambda value: es.MarkovParameters(5, offset=value),
}


@pytest.mark.parametrize("name", FLAGS)
@pytest.mark.parametrize("value", [*ODD, 1, 0.0, None, "True"], ids=lambda value: type(value).__name__)
def test_a_flag_is_true_or_false(name, value):
    with pytest.raises(es.InputError, match=r"must be True or False\. Got "):
        FLAGS[name](value)
    FLAGS[name](True)


CALLS = {
    "engine": lambda value: es.estimate(es.Kalman(MODEL), RECORD, prior=PRIOR, engine=value),
    "keep": lambda value: es.estimate(es.Kalman(MODEL), RECORD, prior=PRIOR, keep=value),
    "on_failure": lambda value: es.estimate(es.Kalman(MODEL), RECORD, prior=PRIOR, on_failure=value),
    "hold": lambda value: es.Record(np.zeros(5), np.zeros(5), dt=1, hold=value),
    "lost": lambda value: es.Record(np.zeros(5), np.zeros(5), dt=1, lost=value),
    "dt": lambda value: es.Record(np.zeros(5), dt=value),
    "t": lambda value: es.Record(np.zeros(5), t=value),
    "y": lambda value: es.Record(value, dt=1),
    "u": lambda value: es.Record(np.zeros(2), value, dt=1),
    "seed": lambda value: es.simulate(MODEL, np.zeros(5), seed=value),
    "steps": lambda value: es.simulate(MODEL, seed=1, steps=value),
    "runs": lambda value: es.simulate_bank(MODEL, np.zeros(5), seed=1, runs=value),
    "inputs of a simulation": lambda value: es.simulate(MODEL, value, seed=1),
    "inputs of a forecast": lambda value: es.forecast(es.estimate(es.Kalman(MODEL), RECORD, prior=PRIOR), value),
    "walk": lambda value: es.UnknownGain(MODEL, es.Prior([1.0], [[1.0]]), walk=value),
    "orders": lambda value: es.LeastSquares(value, 1),
    "order": lambda value: es.Subspace(value),
    "mean": lambda value: es.Prior(value, [[1.0]]),
    "A": lambda value: es.StateSpace(value, R=[[1.0]], dt=1),
    "Q": lambda value: es.StateSpace([[0.9]], Q=value, R=[[1.0]], dt=1),
}


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize("value", ODD, ids=lambda value: type(value).__name__)
def test_odd_arguments_get_a_sentence(name, value):
    takes_arrays = name in ("y", "u", "inputs of a simulation", "inputs of a forecast", "A", "Q")
    if isinstance(value, np.ndarray) and value.shape == (2, 2) and takes_arrays:
        pytest.skip("a matrix is no odd argument there")
    with pytest.raises(es.EstimableError) as raised:
        CALLS[name](value)
    assert 10 < len(str(raised.value)) <= 600


def test_a_seed_is_held_by_64_bits():
    es.simulate(MODEL, np.zeros(5), seed=2**63 - 1)
    with pytest.raises(es.InputError, match=r"`seed` must be at most 9223372036854775807\. Got 9223372036854775808\."):
        es.simulate(MODEL, np.zeros(5), seed=2**63)


def test_rows_of_several_lengths_are_named():
    with pytest.raises(
        es.InputError, match=r"`u` must be an array of real numbers, with rows of one length\. Got \[\[1"
    ):
        es.simulate(MODEL, RAGGED, seed=1)
