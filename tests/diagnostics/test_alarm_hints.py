"""Alarms that coincide with large or fast inputs point to the actuator; those of gains that jump do not."""

import re

import numpy as np
import pytest

from estimable import ChangeDetection, Prior, Record, StateSpace, UnknownGain, estimate_bank, simulate
from estimable.diagnostics import changes
from estimable.diagnostics.alarm_hints import alarm_hints
from estimable.diagnostics.changes import DetectedChange
from estimable.frozen import replace

T, DT = 1600, 0.05
MODEL = StateSpace([[-1.5]], [[1.5]], Q=[[1e-3]], R=[[1e-3]], dt=0, inputs=["valve"], outputs=["level"])
DETECTOR = ChangeDetection(UnknownGain(MODEL, Prior([1.0], [[0.1]])))
START, DRAWS = Prior([0.0], [[0.1]]), 20
HINT = r"\d+ of \d+ losses of the gain coincide with large or fast inputs of valve: check the limits, the rate and the lag .*"


def commands(seed):
    """Small steps, one a second, and every 8 s a large one that lasts 1.5 s."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-0.3, 0.3, size=T // 20), 20)
    for k, row in enumerate(range(100, T - 30, 160)):
        u[row : row + 30] = 1.0 - 2 * (k % 2)
    return u[:, None]


def limited(u):
    """An actuator at its limits."""
    return np.clip(u, -0.5, 0.5)


def slow(u):
    """An actuator that moves 1 a second."""
    at, found = 0.0, np.empty_like(u)
    for k, wanted in enumerate(u[:, 0]):
        at += np.clip(wanted - at, -DT, DT)
        found[k] = at
    return found


def jumping(u):
    """The gain alternates every 10 s: a right model with seven alarms."""
    return u * np.where(np.arange(T) // 200 % 2, 0.6, 1.0)[:, None]


def shifted(u):
    """The log of the input is off."""
    return u + 0.15


def hints(effect):
    """The hints of records of commands that have another effect on the plant."""
    sampled = MODEL.discretise(DT)
    records = [
        replace(simulate(sampled, effect(commands(seed)), seed=seed, prior=START).record, u=commands(seed))
        for seed in range(DRAWS)
    ]
    bank = estimate_bank(DETECTOR, records, prior=START)
    return [hint for i, record in enumerate(records) for hint in alarm_hints(changes(bank[i]), record)]


@pytest.mark.parametrize(("effect", "least"), [(limited, 3), (slow, 8)])
def test_losses_at_limits_and_rates_point_to_the_actuator(effect, least):
    told = hints(effect)
    assert len(told) >= least
    assert all(re.fullmatch(HINT, one) for one in told)


@pytest.mark.parametrize("effect", [jumping, shifted, lambda u: u])
def test_those_of_gains_that_jump_and_of_other_errors_do_not(effect):
    assert hints(effect) == []


def test_few_alarms_a_record_without_times_and_an_input_at_rest_give_no_hint():
    change = DetectedChange("gain", 10, 12, 1.0, 1.2, 1.0, 0.5, 0.01, 0.0, 0.0)
    rows = (10, 25, 40, 55, 70, 85)
    losses = [change._replace(onset=row, detected_at=row + 2) for row in rows]
    rises = [one._replace(onset=one.onset + 7, detected_at=one.onset + 9, before=0.5, after=1.0) for one in losses]
    found = [one for pair in zip(losses, rises, strict=True) for one in pair]
    u = np.zeros(100)
    u[[row + i for row in rows for i in range(2)]] = 1.0
    record = Record(np.zeros(100), u, dt=0.1)
    [hint] = alarm_hints(found, record)
    assert hint.startswith("6 of 6 losses of the gain coincide with large or fast inputs of u1")
    assert alarm_hints(found[:8], record) == ()
    assert alarm_hints(rises, record) == ()  # gains that rise
    assert alarm_hints(found, replace(record, t=None)) == ()
    assert alarm_hints(found, replace(record, u=np.zeros((100, 1)))) == ()
