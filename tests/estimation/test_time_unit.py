"""A time in a smaller unit than seconds is found by the model's modes; stiff and slow models are not refused."""

import logging

import numpy as np
import pytest

import estimable as es
from estimable.estimation.time_unit import UNITS, too_long

FILE = es.read_model(es.packaged.path("f16-model.toml"))
NAMES = {"outputs": FILE.model.outputs, "inputs": FILE.model.inputs}
ALGORITHM = es.UnknownGain(FILE.model, FILE.gain.prior)


def record(step, rows=11, **given):
    return es.Record(np.zeros((rows, 2)), np.zeros((rows, 1)), **(given or {"t": np.arange(rows) * step}), **NAMES)


@pytest.mark.parametrize(("factor", "unit"), UNITS)
def test_a_smaller_unit_is_named(factor, unit):
    step = 0.01 * factor
    sentence = (
        f"the record's step is {step:g} s, and the model's fastest time constant is 0.289 s: the time is in {unit}, probably. "
        f"Divide it by {factor:g}, or give `dt` in seconds."
    )
    with pytest.raises(es.InputError) as raised:
        es.estimate(ALGORITHM, record(step), prior=FILE.prior)
    assert str(raised.value) == sentence
    with pytest.raises(es.InputError, match=unit):
        es.estimate(ALGORITHM, record(step)[2:7], prior=FILE.prior)


def test_a_step_that_is_given_is_only_warned_of(caplog):
    caplog.set_level(logging.WARNING, "estimable.estimation")
    es.estimate(ALGORITHM, record(10.0, dt=10.0), prior=FILE.prior, on_failure="keep")
    ((message,),) = [[r.getMessage() for r in caplog.records if r.name == "estimable.estimation"]]
    assert "the time is in milliseconds, probably" in message


def drawn(rng):
    """A stiff or slow model, stable but for one mode in ten, and a step that resolves its slowest mode or its fastest."""
    n = rng.integers(1, 6)
    modes = -(10.0 ** rng.uniform(-6, 4, n)) * np.exp(1j * rng.uniform(0, 1.5, n))
    if rng.random() < 0.1:
        modes[0] = 0.3 * np.abs(modes).min()
    slow, fast = np.abs(modes).min(), np.abs(modes).max()
    return modes, 10.0 ** rng.uniform(np.log10(0.001 / fast), np.log10(3 / slow))


def test_stiff_and_slow_models_are_not_refused():
    rng = np.random.default_rng(0)
    assert [too_long(*drawn(rng)) for _ in range(2000)] == 2000 * [""]


def test_a_smaller_unit_is_found_in_most_models_that_their_steps_resolve():
    """Of models whose modes span two decades, sampled at .03 to .3 of the fastest: all microseconds, most milliseconds."""
    rng = np.random.default_rng(1)
    found = {factor: 0 for factor, _ in UNITS}
    for _ in range(500):
        modes = -(10.0 ** rng.uniform(-2, 0, 3))
        step = 10.0 ** rng.uniform(-1.5, -0.5) / np.abs(modes).max()
        for factor, unit in UNITS:
            found[factor] += unit in too_long(modes, factor * step)
    assert found[1e6] > 0.99 * 500
    assert found[1e9] > 0.99 * 500
    assert found[1e3] > 0.25 * 500
