"""What a record says of each gain, row by row and in one sentence."""

import math

import numpy as np
import pytest

from estimable import InputError, Kalman, Prior, Record, StateSpace, UnknownGain, estimate
from estimable.diagnostics import gain_rows, sentence_of
from estimable.results import DetectableLoss, Estimate, GainRow, Info, Names, Origin, Outcome

MOTORS = tuple(f"gain_motor_{i}" for i in range(1, 5))
PLANT = StateSpace(0.5 * np.eye(4), np.eye(4), R=np.eye(4), dt=1, inputs=[f"motor_{i}" for i in range(1, 5)])
SHARES = UnknownGain(PLANT, Prior(np.ones(4), np.eye(4)), directions="per_input")
ENTRIES = UnknownGain(PLANT, Prior(np.ones(16), np.eye(16)), directions="every_entry")
T, SIGMA = 41, 0.01


def result_of(gain, changes=(), algorithm=SHARES, t=None, sigma=SIGMA):
    """A result whose gains (T, p) have constant sigmas; `changes`: (alarm, onset, gain)."""
    gain = np.asarray(gain, float)
    rows, p = gain.shape
    alarm, onset, jumped = np.zeros(rows, bool), -np.ones(rows, int), np.zeros((rows, p))
    for at, begun, which in changes:
        alarm[at], onset[at], jumped[at, which] = True, begun, 1.0
    extra = {"alarm": alarm, "onset": onset, "onset_sigma": np.ones(rows), "jumped": jumped}
    info = Info(
        gain=gain, gain_covariance=np.broadcast_to(np.diag(np.square(sigma * np.ones(p))), (rows, p, p)), extra=extra
    )
    names = Names(("x",), ("u",), ("y",), MOTORS[:p])
    t = 0.5 * np.arange(rows) if t is None else t
    return Estimate(info, t, 0.0, Outcome(0, None, None, ""), "xla", names, Origin(algorithm, None, None))


def course(*ends, at=28):
    """Gains of 1 that take these values from a row on."""
    return np.where(np.arange(T)[:, None] < at, 1.0, np.array(ends))


def test_one_motor_lost_a_part_and_the_others_did_not():
    rows = gain_rows(result_of(course(1.0, 1.0, 0.72, 1.0), [(30, 28, 2)]))
    assert [row.verdict for row in rows] == ["unchanged", "unchanged", "lost", "unchanged"]
    assert (rows[2].before, rows[2].after, rows[2].changed_at) == (1.0, 0.72, (14.0,))
    assert rows[2].before_sigma == rows[2].after_sigma == pytest.approx(SIGMA)
    assert sentence_of(rows) == "motor 3 lost 28.0 % ± 2.0 % at 14 s; motors 1, 2, 4 unchanged."


@pytest.mark.parametrize(
    ("gains", "changes", "algorithm", "phrase"),
    [
        (course(0.72), [(30, 28, 0)], ENTRIES, "fell from 1.000 to 0.720 ± 0.020 at 14 s"),  # no share of an effect
        (
            0.9 * course(0.72),
            [(30, 28, 0)],
            SHARES,
            "fell from 0.900 to 0.648 ± 0.020 at 14 s",
        ),  # 35 % are lost, not at 14 s
        (course(1.3), [(30, 28, 0)], SHARES, "rose from 1.000 to 1.300 ± 0.020 at 14 s"),
        (course(-1.3), [(30, 28, 0)], SHARES, "changed from 1.000 to -1.300 ± 0.020 at 14 s"),
        (course(1.01), [(30, 28, 0)], SHARES, "jumped at 14 s, by less than 2 sigma: from 1.000 to 1.010 ± 0.020"),
        (course(0.72), [(22, 20, 0), (30, 28, 0)], SHARES, "lost 28.0 % ± 2.0 % at 10, 14 s"),
        (course(0.9), [], SHARES, "moved from 1.000 to 0.900 ± 0.020, without a jump"),
        (0 * course(0.0) + 0.5, [], SHARES, "at 0.500 ± 0.020 throughout"),
        (0 * course(0.0) + 0.5, [], ENTRIES, "unchanged"),
        (np.nan * course(0.0), [], SHARES, "not determined by the record"),
    ],
)
def test_each_course_has_its_phrase(gains, changes, algorithm, phrase):
    [row] = gain_rows(result_of(gains, changes, algorithm))
    assert row.phrase == phrase


def test_a_short_record_is_not_compared_and_a_record_without_times_has_rows():
    [row] = gain_rows(result_of(course(0.9), t=0.01 * np.arange(T)))
    assert row.phrase == "not compared, because the record is too short"
    untimed = result_of(course(0.72), [(30, 28, 0)])
    untimed = Estimate(untimed.info, None, 0.0, untimed.outcome, "xla", untimed.names, untimed.origin)
    assert gain_rows(untimed)[0].phrase == "lost 28.0 % ± 2.0 % at row 28"


@pytest.mark.parametrize(
    ("names", "sentence"),
    [
        (("gain_motor1", "gain_motor2"), "motors 1, 2 unchanged."),
        (("gain_left", "gain_right"), "left, right unchanged."),
        (("gain_left", "gain_motor_2"), "left, motor 2 unchanged."),
        (("gain",), "gain unchanged."),
        (("B_alpha_u", "B_q_u"), "B_alpha_u, B_q_u unchanged."),
    ],
)
def test_gains_are_named_as_a_reader_would(names, sentence):
    rows = [GainRow(name, 1.0, 0.01, 1.0, 0.01, (), True, True, "unchanged") for name in names]
    assert sentence_of(rows) == sentence


def test_what_was_detectable_is_in_the_row_and_others_have_none():
    loss = DetectableLoss(1.0, 20.0, (0.5, 0.9), np.array([[0.1, 0.2], [0.3, np.inf]]), None, None, None, MOTORS[:2])
    rows = gain_rows(result_of(course(1.0, 1.0)), detectable=loss)
    assert [row.detectable for row in rows] == [0.2, np.inf]
    assert all(math.isnan(row.detectable) for row in gain_rows(result_of(course(1.0, 1.0))))


def test_a_result_without_a_gain_has_no_rows():
    model = StateSpace([[0.5]], Q=[[1.0]], R=[[1.0]], dt=1)
    result = estimate(Kalman(model), Record([0.0, 1.0], dt=1), prior=Prior([0.0], [[1.0]]))
    with pytest.raises(InputError, match="must be an estimate with a gain"):
        gain_rows(result)
