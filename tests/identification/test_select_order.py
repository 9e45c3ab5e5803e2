"""Which order: the true one where there are data enough, the same whatever is missing, overruled by another criterion."""

import numpy as np
import pytest
from scipy.signal import lfilter

from estimable import ARX, InputError, Record, select_order, simulate

PLANT = ARX([-1.2, 0.5], [1.0, 0.4], delay=2, noise_variance=0.04, dt=0.5)
RECORD = simulate(PLANT.to_state_space(), np.random.default_rng(0).normal(size=300), seed=0).record


def test_every_criterion_finds_the_order_and_the_delay_of_a_plant():
    found = select_order(RECORD, orders=range(1, 5))
    assert (found.order, found.delay, found.gap) == (2, 2, 2)
    assert found.by("cross_validation") == 2
    assert found.sentence.startswith("BIC recommends order 2; AICc")
    assert len(found.plot().data) == 4


def test_criteria_are_those_of_the_textbook():
    found = select_order(RECORD, orders=[2], delays=[2])
    y, u = RECORD.y[:, 0], RECORD.u[:, 0]
    Φ = np.stack([-y[2:-1], -y[1:-2], u[1:-2], u[:-3]], axis=1)
    e = y[3:] - Φ @ np.linalg.lstsq(Φ, y[3:], rcond=None)[0]
    N, k, D = 297, 4, 297 * np.log(np.mean(e**2))  # the first three rows have no equation
    np.testing.assert_allclose(found.aic, D + 2 * k)
    np.testing.assert_allclose(found.aicc, D + 2 * k * N / (N - k - 1))
    np.testing.assert_allclose(found.bic, D + k * np.log(N))


@pytest.mark.parametrize("share", [0.1, 0.2, 0.3])
def test_missing_samples_leave_the_order(share):
    """A larger order has fewer complete equations: sums over the rows of each chose 3 to 8 in most of such records."""
    found = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        drawn = simulate(PLANT.to_state_space(), rng.normal(size=1500), seed=seed).record
        gone = rng.random(1500) < share
        found.append(select_order(Record(np.where(gone, np.nan, drawn.y[:, 0]), drawn.u, dt=0.5), delays=[2]).order)
    assert found.count(2) >= 11


def test_several_records_with_gaps_count_their_rows_alike_at_every_order():
    rng = np.random.default_rng(3)
    parts = []
    for seed in range(3):
        drawn = simulate(PLANT.to_state_space(), rng.normal(size=600), seed=seed).record
        parts.append(Record(np.where(rng.random(600) < 0.1, np.nan, drawn.y[:, 0]), drawn.u, dt=0.5))
    assert select_order(parts, orders=range(1, 6)).order == 2


def test_an_order_without_equations_and_every_larger_one_is_infinite():
    y = RECORD.y[:60].copy()
    y[::6] = np.nan
    found = select_order(Record(y, RECORD.u[:60], dt=0.5), orders=range(1, 9), delays=[1])
    assert np.isfinite(found.bic[0])
    assert np.isinf(found.bic[np.argmax(np.isinf(found.bic)) :]).all()


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: select_order(RECORD, orders=[]), "`orders` must hold at least one number to try."),
        (lambda: select_order(RECORD, orders=[0]), "`orders` must be an integer of at least 1. Got 0."),
        (lambda: select_order(RECORD, criterion="aci"), "Did you mean 'aic'?"),
        (lambda: select_order(3), "`record` must be a Record, or a list of them. Got 3."),
        (
            lambda: select_order(Record([1.0, 2.0], [1.0, 2.0], dt=1)),
            "the record is too short for order 1: it has 2 samples.",
        ),
    ],
)
def test_what_is_wrong_is_said(call, sentence):
    with pytest.raises(InputError) as caught:
        call()
    assert sentence in str(caught.value)


def test_the_order_of_a_series_without_inputs():
    for seed in range(5):
        y = lfilter([1.0], [1, -1.2, 0.5], np.random.default_rng(seed).normal(size=1000))
        assert select_order(Record(y, dt=1)).order == 2
