"""What is said of a record, of a cut of one, and of names that do not match."""

import numpy as np
import pytest

from estimable import Kalman, Prior, Record, StateSpace, estimate

Y = [0.0, 1.0, 2.0]
RECORDS = {
    "no row": (dict(y=[]), "the record is empty: `y` has no row."),
    "no column": (dict(y=[[]]), "`y` has no column: a record needs an output."),
    "a number": (dict(y=1.0), "`y` must be (T, p). Got (). A matrix is needed: write nested lists, as in [[1.0]]."),
    "three axes": (dict(y=np.zeros((3, 1, 1))), "`y` must be (T, p). Got (3, 1, 1)."),
    "infinite output": (dict(y=[0.0, np.inf]), "`y` must be finite. First infinite value at index (1, 0)."),
    "short u": (dict(u=[1.0, 2.0]), "`u` must be (T, m) = (3, m): `y` is 3 × 1. Got (2, 1)."),
    "u transposed": (
        dict(u=[[1.0, 2.0, 3.0]]),
        "`u` must be (T, m) = (3, m): `y` is 3 × 1. Got (1, 3). Did you mean `u.T`?",
    ),
    "infinite u": (dict(u=[0.0, 1.0, -np.inf]), "`u` must be finite. First infinite value at index (2, 0)."),
    "step of zero": (dict(dt=0.0), "`dt` must be greater than 0 seconds. Got 0."),
    "negative step": (dict(dt=-0.1), "`dt` must be greater than 0 seconds. Got -0.1."),
    "short t": (dict(t=[0.0, 1.0]), "`t` must be (T,) = (3,): `y` is 3 × 1. Got (2,)."),
    "t a column": (
        dict(t=[[0.0], [1.0], [2.0]]),
        "`t` must be (T,) = (3,): `y` is 3 × 1. Got (3, 1). Did you mean `np.ravel(t)`?",
    ),
    "t back": (
        dict(t=[0.0, 2.0, 1.0]),
        ("`t` must increase. From t[1] to t[2] it goes from 2.0 to 1.0 s: sort the rows by time."),
    ),
    "t repeated": (
        dict(t=[1.5e9, 1.5e9, 1.5e9 + 1]),
        (
            "two rows have the time 1500000000 s, and both have a value of 'y1'. Rows at one instant are merged into one row "
            "only if each channel has one value there: drop one of them, take their mean, or read the file with repeated='first' "
            "or 'last'."
        ),
    ),
    "t NaN": (dict(t=[0.0, np.nan, 2.0]), "`t` must not hold NaN. First at index 1."),
    "t infinite": (dict(t=[0.0, 1.0, np.inf]), "`t` must be finite. First infinite value at index 2."),
    "t texts": (dict(t=["a", "b", "c"]), "`t` must be an array of real numbers. Got ['a', 'b', 'c']."),
    "t dates": (
        dict(t=np.array(["2026-01-01", "2026-01-02", "2026-01-03"], "M8[s]")),
        ("`t` must be seconds, not dates. Did you mean `(t - t[0]) / np.timedelta64(1, 's')`?"),
    ),
    "t and another dt": (
        dict(t=[0.0, 1.0, 2.0], dt=0.5),
        "`dt` = 0.5 s and `t` disagree: the mean step of `t` is 1 s. Give one.",
    ),
    "t irregular and dt": (
        dict(t=[0.0, 1.0, 3.0], dt=1.5),
        "`dt` = 1.5 s and `t` disagree: the mean step of `t` is 1.5 s, not regular. Give one.",
    ),
    "lost": (dict(lost="keep"), "`lost` must be one of 'zero', 'hold'. Got 'keep'."),
    "hold": (
        dict(hold="first"),
        ("`hold` must be one of 'zero_order', 'first_order'. Got 'first'. Did you mean 'first_order'?"),
    ),
    "arrived no number of packets": (
        dict(u=Y, arrived=[1, 0, 2]),
        "`arrived` must be 1 (applied), 0 (lost) or NaN (unknown).",
    ),
    "arrived short": (
        dict(u=Y, arrived=[1, 0]),
        "`arrived` must be (T, m) = (3, 1): `y` is 3 × 1; `u` is 3 × 1. Got (2, 1).",
    ),
    "arrived of two inputs": (
        dict(u=np.zeros((3, 2)), arrived=[1, 0, 1]),
        "`arrived` must be (T, m) = (3, 2): `y` is 3 × 1; `u` is 3 × 2. Got (3, 1).",
    ),
    "arrived without input": (
        dict(arrived=[1, 0, 1]),
        ("`arrived` marks which inputs were applied, but the record has no input: give `u`."),
    ),
    "arrived in between": (
        dict(u=Y, arrived=[1, 0, 1], hold="first_order"),
        ('`arrived` needs hold = "zero_order": an input that arrives in packets is constant between them.'),
    ),
    "outputs": (dict(outputs=["a", "b"]), "`outputs` must hold p = 1 name: `y` is 3 × 1. Got 2: 'a', 'b'."),
    "inputs": (dict(u=Y, inputs="u"), "`inputs` must be a list of names. Got the string 'u'. Did you mean ['u']?"),
    "units no mapping": (
        dict(units=["deg"]),
        ("`units` must be a mapping of names to units, as in {'speed': 'm/s'}. Got ['deg']."),
    ),
    "units no text": (
        dict(units={"y1": 3}),
        ("`units` must be a mapping of names to units, as in {'speed': 'm/s'}. Got {'y1': 3}."),
    ),
    "units of others": (
        dict(outputs=["alpha"], units={"alfa": "deg"}),
        ("`units` names channels that the record does not have: 'alfa'. Did you mean 'alpha'?"),
    ),
}


@pytest.mark.parametrize(("given", "sentence"), RECORDS.values(), ids=RECORDS)
def test_a_record_is_refused_with_the_argument_at_fault(refused, given, sentence):
    assert refused(lambda: Record(**({"y": Y} | given))) == [sentence]


def test_every_fault_of_a_record_is_named_at_once(refused):
    found = refused(lambda: Record(Y, [1.0, 2.0], dt=-1, t=[0.0, 2.0, 1.0], lost="no", arrived=[1], outputs=["a", "b"]))
    assert [sentence.split("`")[1] for sentence in found] == ["u", "lost", "arrived", "dt", "t", "outputs"]


CUTS = {
    "a row": (lambda record: record[0], "a record is cut by a slice of consecutive rows, as in record[100:200]."),
    "every second": (
        lambda record: record[::2],
        "a record is cut by a slice of consecutive rows, as in record[100:200].",
    ),
    "backwards": (
        lambda record: record[::-1],
        "a record is cut by a slice of consecutive rows, as in record[100:200].",
    ),
    "seconds": (
        lambda record: record[0.0:1.0],
        "a record is cut by a slice of consecutive rows, as in record[100:200].",
    ),
    "beyond the end": (lambda record: record[3:], "record[3:] holds no row: the record has 3."),
    "nothing": (lambda record: record[2:1], "record[2:1] holds no row: the record has 3."),
    "split at zero": (lambda record: record.split(0), "`fraction` must be greater than 0. Got 0."),
    "split at the end": (lambda record: record.split(1), "`fraction` must leave rows in both parts. 1 of 3 rows is 3."),
    "split near zero": (
        lambda record: record.split(0.01),
        "`fraction` must leave rows in both parts. 0.01 of 3 rows is 0.",
    ),
    "split beyond": (lambda record: record.split(2), "`fraction` must be at most 1. Got 2."),
    "split in two": (lambda record: record.split("half"), "`fraction` must be a finite number. Got 'half'."),
}


@pytest.mark.parametrize(("cut", "sentence"), CUTS.values(), ids=CUTS)
def test_a_cut_of_a_record_is_refused(refused, cut, sentence):
    assert refused(lambda: cut(Record(Y))) == [sentence]


MODEL = StateSpace([[0.5]], [[1.0]], Q=[[0.1]], R=[[1.0]], dt=1, inputs=["elevator"], outputs=["pitch_rate"])
UNMATCHED = {
    "near": (
        dict(outputs=["pitch_rat"], inputs=["elevator"]),
        [("the record has no output named 'pitch_rate': its outputs are 'pitch_rat'. Did you mean 'pitch_rat'?")],
    ),
    "far": (
        dict(outputs=["pitch_rate"], inputs=["rudder"]),
        ["the record has no input named 'elevator': its inputs are 'rudder'."],
    ),
    "both": (
        dict(outputs=["q"], inputs=["de"]),
        [
            "the record has no output named 'pitch_rate': its outputs are 'q'.",
            "the record has no input named 'elevator': its inputs are 'de'.",
        ],
    ),
}


@pytest.mark.parametrize(("names", "sentences"), UNMATCHED.values(), ids=UNMATCHED)
def test_channels_that_do_not_match_are_named(refused, names, sentences):
    record = Record(Y, Y, dt=1, **names)
    assert refused(lambda: estimate(Kalman(MODEL), record, prior=Prior([0.0], [[1.0]]))) == sentences


def test_a_record_without_inputs_is_told_so(refused):
    record = Record(Y, dt=1, outputs=["pitch_rate"])
    assert refused(lambda: estimate(Kalman(MODEL), record, prior=Prior([0.0], [[1.0]]))) == [
        "the record has no input named 'elevator': it has no inputs."
    ]


def test_more_unnamed_channels_than_the_model_has_are_not_guessed(refused):
    record = Record(np.zeros((3, 2)), Y, dt=1)
    (sentence,) = refused(lambda: estimate(Kalman(MODEL), record, prior=Prior([0.0], [[1.0]])))
    assert sentence == "the record has no output named 'pitch_rate': its outputs are 'y1', 'y2'."
