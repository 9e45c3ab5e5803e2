"""The verdict on a model: right ones are believed, each fault has its name, and what no record can tell is listed."""

import importlib

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import (
    Bounded,
    ChangeDetection,
    ExtendedKalman,
    InputError,
    Kalman,
    Prior,
    Record,
    StateSpace,
    UnknownGain,
    estimate,
    simulate,
    trust,
)
from estimable.frozen import replace

A, B = np.array([[-1.0, 0.5], [-2.0, -0.8]]), np.array([[0.0], [3.0]])
MODEL = StateSpace(
    A, B, np.eye(2), Q=0.004 * np.eye(2), R=0.01 * np.eye(2), dt=0, states=("a", "q"), inputs=("e",), outputs=("ya", "yq")
)  # fmt: skip
GAIN, PRIOR, T = Prior([1.0], [[0.25]]), Prior([0.0, 0.0], 0.1 * np.eye(2)), 500
U = np.sign(np.sin(0.13 * np.arange(T)) + 0.2)[:, None]
TIMES = 0.05 * np.arange(T)


def drawn(model=MODEL, seed=0, u=U):
    return simulate(model, u, t=TIMES, seed=seed, prior=PRIOR).record


def judged(record, model=MODEL):
    return trust(UnknownGain(model, GAIN), record, prior=PRIOR)


def test_right_models_are_believed():
    verdicts = [judged(drawn(seed=seed)) for seed in range(60)]
    assert sum(one.word != "believe" for one in verdicts) <= 5  # 1.2 are expected
    p = np.array([list(one.families.values()) for one in verdicts])
    assert np.all(np.mean(p < 0.3, axis=0) < 0.3 + 3 * np.sqrt(0.21 / 60))
    assert verdicts[0].reasons == verdicts[0].suspects == ()


@pytest.mark.parametrize(
    ("name", "changed"),
    [
        ("A[q, a]", {"A": A * [[1, 1], [1.3, 1]]}),
        ("A[q, q]", {"A": A * [[1, 1], [1, 2.0]]}),
        ("A[a, q]", {"A": A * [[1, 1.3], [1, 1]]}),
    ],
)
def test_a_wrong_entry_is_refuted_and_its_size_is_found(name, changed):
    """The record is that of the other model, so the error is the inverse of the change."""
    new = changed["A"]
    [wrong] = (A / new - 1)[new != A]
    found = judged(drawn(), replace(MODEL, **changed))
    assert found.word == "do not use"
    assert found.sentence.startswith("Do not use these numbers: the record contradicts it;")
    first = found.suspects[0]
    assert first.direction.name == name
    assert abs(first.size - wrong) < 0.35 * abs(wrong) + 3 * first.sigma


def test_a_delay_and_offsets_have_names():
    record = drawn()
    late = replace(record, u=np.roll(record.u, 2, axis=0))  # logged .1 s after they acted
    assert judged(late).suspects[0].direction.name == "delay of e"
    assert judged(late).suspects[0].size < -0.03
    biased = replace(record, y=record.y + [0.0, 0.3])
    assert "offset of" in judged(biased).suspects[0].direction.name
    pushed = replace(record, u=record.u + 0.2)
    assert judged(pushed).suspects[0].direction.name == "offset of dq/dt"


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"R": 4 * MODEL.R}, "Q or R is too large"),
        ({"R": MODEL.R / 4}, "Q or R is too small"),
        ({"Q": MODEL.Q / 100}, "depend on earlier ones"),
    ],
)
def test_wrong_noise_is_refuted_on_both_sides(changed, words):
    found = judged(drawn(), replace(MODEL, **changed))
    assert found.word != "believe"
    assert any(words in reason for reason in found.reasons)


def test_the_scale_of_the_input_is_listed_with_what_it_does_to_the_gain():
    """No test can see it: the verdict says by how much the gain moves, as a second run confirms."""
    record = drawn()
    right, wrong = judged(record), judged(record, replace(MODEL, B=1.3 * B))
    assert wrong.word == right.word == "believe"
    assert right.sentence.startswith("Believe, if B[q, e]")
    [scale] = [one for one in right.untestable if one.direction.name == "B[q, e]"]
    assert abs(scale.correlation) > 0.99
    gains = [
        estimate(UnknownGain(replace(MODEL, B=(1 + h) * B), GAIN), record, prior=PRIOR).gain[-1, 0]
        for h in (1e-5, -1e-5)
    ]
    assert_allclose(scale.shift, 0.1 * (gains[0] - gains[1]) / 2e-5, rtol=1e-5)
    assert "an error of 10 % moves gain by -0.1" in scale.sentence


def test_a_gain_that_jumps_is_no_fault_of_the_model():
    weakened = np.where(np.arange(T)[:, None] < 250, 1.0, 0.4) * U
    records = [replace(drawn(seed=seed, u=weakened), u=U) for seed in range(6)]
    detector = ChangeDetection(UnknownGain(MODEL, GAIN), persistence=1.0)
    assert sum(trust(detector, one, prior=PRIOR).word != "believe" for one in records) <= 1
    assert judged(records[0]).word == "do not use"  # of a constant gain


def test_a_limit_that_the_log_does_not_show_has_a_name():
    """The gain takes a part of it: what is left of the effect depends on the size of the input."""
    u = np.sin(0.13 * np.arange(T))[:, None] * (1 + np.sin(0.031 * np.arange(T)))[:, None]
    found = judged(replace(drawn(u=np.clip(u, -0.7, 0.7)), u=u))
    assert found.word == "do not use"
    assert found.suspects[0].direction.name == "limit of e"
    assert "a limit of e (beyond half of its range" in found.sentence


def test_an_offset_that_begins_in_mid_record_has_a_name_though_it_looks_like_a_jump(monkeypatch):
    """The detector takes it for a fall of the gain to about zero: the printed gain is off by many of its standard deviations."""
    record = drawn(u=0.2 * U)
    late = replace(record, u=0.2 * U + 0.6 * (np.arange(T)[:, None] >= 250))
    detector = ChangeDetection(UnknownGain(MODEL, GAIN))
    result = estimate(detector, late, prior=PRIOR)
    assert result.gain_quantiles[-1, 0, 4] < 0.9
    hinting = importlib.import_module("estimable.estimation.trust")
    monkeypatch.setattr(hinting, "alarm_hints", lambda changes, record: (f"{len(changes)} of {len(record)}",))
    found = trust(detector, late, prior=PRIOR, result=result)
    assert found.word == "do not use"
    assert found.reasons[-1] == f"{int(result.extra['alarm'].sum())} of {T}"
    assert found.suspects[0].direction.name.startswith("offset of dq/dt from 12.")
    assert found.suspects[0].direction.kind == "late offset"


def test_where_nothing_can_be_known_no_number_is_to_be_used():
    record = drawn()
    y = record.y.copy()
    y[100:400] = np.nan
    assert "60 % of the rows have no output" in judged(replace(record, y=y)).sentence
    still = drawn(u=np.zeros((T, 1)))
    assert judged(still).word == "do not use"
    assert "the record carries no information about gain: its sigma is that of its prior, 0.5" in judged(still).sentence


def test_a_gap_is_bridged_here_too():
    record = drawn()
    y, u = record.y.copy(), record.u.copy()
    y[200:204], u[200:204] = np.nan, np.nan
    assert judged(replace(record, y=y, u=u)).word == "believe"


def test_other_filters():
    """Without a gain nothing hides; wrappers are judged by what they hold; functions have no entries to test."""
    record = drawn()
    plain = trust(Kalman(MODEL), record, prior=PRIOR)
    assert plain.sentence == "Believe: the record agrees with the model."
    bounded = trust(Bounded(UnknownGain(MODEL, GAIN), 0, 2), record, prior=PRIOR)
    assert bounded.p == judged(record).p
    discrete = MODEL.discretise(0.05)
    even = Record(record.y, U, dt=0.05, inputs=("e",), outputs=("ya", "yq"))
    assert trust(UnknownGain(discrete, GAIN), even, prior=PRIOR).word == "believe"
    with pytest.raises(InputError, match="`algorithm` must be Kalman or UnknownGain, or a wrapper of one of them"):
        trust(ExtendedKalman(MODEL), record, prior=PRIOR)
    with pytest.raises(InputError, match="`level` must be"):
        trust(Kalman(MODEL), record, prior=PRIOR, level=0.0)
