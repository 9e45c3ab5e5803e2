"""Thin versions of the figures of the gain: benchmarks/figures has them with enough draws."""

import numpy as np
from benchmarks.figures import jumps_and_drifts, noisy_positions, two_actuators, verdicts


def test_right_models_are_believed_and_wrong_ones_warned_of():
    """Of 24 right flights .5 are warned of on average; 3 or more have a probability of 1 %."""
    cases = {case[0]: case for case in verdicts.cases()}
    right = verdicts.judged(cases["right"], 24, intervals=False)
    assert np.sum(right.p < verdicts.LEVEL) <= 2
    for name in (
        "Q x 15",
        "lasting disturbance, 0.1 s",
        "moderate turbulence",
        "frozen sensor",
        "offset in mid-record",
    ):
        row = verdicts.judged(cases[name], 4, intervals=False)
        wrong = np.abs(row.plain) > verdicts.WRONG
        assert np.all(row.p[wrong] < verdicts.LEVEL), name
        assert np.mean(row.p < verdicts.LEVEL) >= 0.75, name


def test_the_printed_interval_holds_the_gain_at_any_moment():
    assert jumps_and_drifts.cut(48, algorithm=jumps_and_drifts.detector()) >= 0.85  # .95 ± .03


def test_two_actuators_that_fail_together_raise_one_alarm():
    z, alarms, delay = two_actuators.figure(6, two_actuators.CASES["both to .8"])
    assert 1 <= alarms <= 1.5
    assert max(z) < 2
    assert 0 < delay < 2


def test_noise_of_a_position_biases_a_gain_and_the_commands_do_not():
    found = noisy_positions.figure(40, sigmas=(0.5,))
    _, gain, error, _ = found["positions", 0.5]
    assert abs(gain - 0.925) < 4 * error
    _, gain, error, _ = found["commands", 0.5]
    assert abs(gain - 1) < 4 * error
