"""Which order: the true one where there are data enough, the same whatever is missing, overruled by another criterion."""

import numpy as np
import pytest

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
    N, k, D = 300, 4, 300 * np.log(np.mean(e**2))
    np.testing.assert_allclose(found.aic, D + 2 * k)
    np.testing.assert_allclose(found.aicc, D + 2 * k * N / (N - k - 1))
    np.testing.assert_allclose(found.bic, D + k * np.log(N))


def test_a_tenth_missing_leaves_the_order():
    gone = np.random.default_rng(1).random(300) < 0.1
    record = Record(np.where(gone, np.nan, RECORD.y[:, 0]), RECORD.u, dt=0.5)
    assert select_order(record, orders=range(1, 5)).order == 2


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: select_order(RECORD, orders=[]), "`orders` must hold at least one number to try."),
        (lambda: select_order(RECORD, orders=[0]), "`orders` must be an integer of at least 1. Got 0."),
        (lambda: select_order(RECORD, criterion="aci"), "Did you mean 'aic'?"),
        (lambda: select_order(3), "`record` must be a Record, or a list of them. Got 3."),
        (lambda: select_order(Record([1.0, 2.0], dt=1)), "`record` has no input: give `u`."),
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
