"""The dead time: exact whatever the input and the noise, and never a bare number where the record does not show it."""

import numpy as np
import pytest
from scipy.signal import lfilter

from estimable import InputError, Record, compare, dead_time


def late(delay, seed, held=1, noise=0.3, rows=1500, missing=0.0):
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.normal(size=rows // held), held)
    x = lfilter(np.r_[np.zeros(delay), 0.3, 0.2], [1, -1.2, 0.5], u)
    y = x + noise * np.std(x) * rng.normal(size=rows)
    y[rng.random(rows) < missing] = np.nan
    return Record(y, u, dt=0.1)


@pytest.mark.parametrize("held", [1, 5, 20])
def test_it_is_exact(held):
    delays = np.random.default_rng(held).integers(0, 90, size=10)
    found = [dead_time(late(int(delay), seed, held)) for seed, delay in enumerate(delays)]
    assert sum(one.delay == delay for one, delay in zip(found, delays, strict=True)) >= 9
    assert all(delay in one.alike for one, delay in zip(found, delays, strict=True))
    assert found[0].sentence.startswith(f"The dead time is {delays[0]} samples")


def test_where_a_third_is_missing_the_set_holds_it():
    found = [dead_time(late(17, seed, missing=0.3, noise=0.1)) for seed in range(8)]
    assert sum(17 in one.alike for one in found) >= 7
    assert sum(one.delay == 17 for one in found) >= 7


def test_two_inputs_and_two_outputs_share_one():
    parts = [late(8, seed) for seed in range(2)]
    both = Record(np.column_stack([p.y for p in parts]), np.column_stack([p.u for p in parts]), dt=0.1)
    assert dead_time(both).delay == 8


def test_no_effect_and_the_edge_of_the_search_are_said():
    rng = np.random.default_rng(0)
    found = dead_time(Record(rng.normal(size=1000), rng.normal(size=1000), dt=1))
    assert found.delay is None
    assert found.sentence.startswith("No effect of the input is seen within 100 samples")
    beyond = dead_time(late(120, 1, held=20))
    assert beyond.at_edge
    assert beyond.sentence.endswith("is at the edge of the search: try delays above 100.")
    assert dead_time(late(120, 1, held=20), most=150).delay == 120


def test_compare_finds_a_late_plant():
    assert compare(None, late(50, 0, noise=0.1)).best.fit_percent > 80


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: dead_time(3), "`record` must be a Record, or a list of them. Got 3."),
        (lambda: dead_time(Record([1.0, 2.0], dt=1)), "`record` has no input: give `u`."),
        (lambda: dead_time(late(3, 0), most=0), "`most` must be an integer of at least 1"),
    ],
)
def test_what_is_wrong_is_said(call, sentence):
    with pytest.raises(InputError) as caught:
        call()
    assert sentence in str(caught.value)


def test_a_sweep_is_not_matched_at_a_late_delay():
    """Lags of noisy outputs matched one at a delay of 10 or 11, and excluded the right one."""
    t = np.arange(2000) / 2000
    u = np.sin(0.006 * 2000 / np.log(66) * np.exp(t * np.log(66)))
    x = lfilter([0, 0.004, 0.0038], [1, -1.90, 0.92], u)
    noise = np.random.default_rng(0).normal(size=2000)
    found = dead_time(Record(x + 0.15 * np.std(x) * noise, u, dt=0.02))
    assert 1 in {found.delay, *found.alike}
