"""The smallest loss that a record would have shown: against the dense Gaussian, and against what the detector does."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import (
    ChangeDetection,
    InputError,
    Kalman,
    Prior,
    Record,
    StateSpace,
    UnknownGain,
    detectable_loss,
    estimate_bank,
    simulate,
)
from estimable.frozen import replace

MODEL = StateSpace([[0.8]], [[0.5]], Q=[[0.02]], R=[[0.05]], dt=0.1, inputs=("u",), outputs=("y",))
PRIOR, GAIN, T = Prior([0.0], [[0.2]]), Prior([1.0], [[0.04]]), 240
U = np.sign(np.sin(0.21 * np.arange(T)))[:, None]
DETECTOR = ChangeDetection(UnknownGain(MODEL, GAIN), jump=0.25)


def record(gain=1.0, seed=0, onset=80):
    u = U * np.where(np.arange(T)[:, None] >= onset, gain, 1.0)
    return replace(simulate(MODEL, u, seed=seed, prior=PRIOR).record, u=U)


def test_the_floor_is_the_information_of_a_dense_gaussian():
    """Σ of all outputs with the gain's prior, r the response of the outputs to a jump at the onset: r' Σ^-1 r."""
    found = detectable_loss(DETECTOR, record(), prior=PRIOR)
    onset = round(found.start / 0.1)
    a, C = 0.8 ** np.arange(T), np.tril(0.8 ** np.abs(np.subtract.outer(np.arange(T), np.arange(T)) - 1.0), -1)
    driven = C @ (0.5 * U[:, 0])
    Σ = 0.2 * np.outer(a, a) + 0.02 * C @ C.T + 0.05 * np.eye(T) + 0.04 * np.outer(driven, driven)
    r = C @ (0.5 * U[:, 0] * (np.arange(T) >= onset))
    assert_allclose(found.floor_sigma, [(r @ np.linalg.solve(Σ, r)) ** -0.5], rtol=1e-6)


def test_the_detector_shows_such_a_loss_as_often_as_it_is_said():
    found = detectable_loss(DETECTOR, record(), prior=PRIOR, power=(0.5, 0.9))
    onset = round(found.start / 0.1)
    for loss, power in zip(found.loss[0], found.power, strict=True):
        records = [record(1 - loss, seed, onset) for seed in range(100)]
        bank = estimate_bank(DETECTOR, records, prior=PRIOR)
        share = np.mean(np.asarray(bank.info.extra["alarm"])[:, onset:].any(axis=1))
        assert abs(share - power) < 3.5 * np.sqrt(power * (1 - power) / 100) + 0.05
    assert found.loss[0, 0] < found.loss[0, 1]
    assert found.loss[0, 0] > 2 * found.floor_sigma[0]
    assert "would have been detected by 23.9 s with probability 90 %" in found.sentences[0]


def test_less_input_shows_less_and_none_shows_nothing():
    whole = detectable_loss(DETECTOR, record(), prior=PRIOR, start=8.0)
    shorter = detectable_loss(DETECTOR, record(), prior=PRIOR, start=8.0, end=10.0)
    assert shorter.loss[0, 1] > whole.loss[0, 1]
    still = Record(np.zeros((T, 1)), np.zeros((T, 1)), dt=0.1, inputs=("u",), outputs=("y",))
    blind = detectable_loss(DETECTOR, still, prior=PRIOR)
    assert np.isinf(blind.loss).all()
    assert np.isinf(blind.floor_sigma).all()
    assert blind.sentences[0].startswith("No loss of gain that began at")


def test_intervals_are_the_losses_that_begin_and_show_within_each():
    """The input moves from 8 to 16 s only. Fewer rows are judged than in a call for one interval, so a loss must be larger."""
    still = replace(record(), u=U * ((np.arange(T) >= 80) & (np.arange(T) < 160))[:, None])
    alone, found = (detectable_loss(DETECTOR, still, prior=PRIOR, every=every) for every in (None, 4.0))
    assert_allclose(found.loss, alone.loss)
    assert_allclose(found.floor_sigma, alone.floor_sigma)
    assert [round(one.start / 4) for one in found.intervals] == [0, 1, 2, 3, 4]
    assert [one.end for one in found.intervals] == pytest.approx([4, 8, 12, 16, 20])
    assert np.isfinite([one.loss[0, 1] for one in found.intervals]).tolist() == [False, False, True, True, False]
    for one in found.intervals[2:4]:
        same = detectable_loss(DETECTOR, still, prior=PRIOR, start=one.start, end=one.end)
        assert_allclose(one.floor_sigma, same.floor_sigma)
        assert (0.98 * same.loss <= one.loss).all()
        assert (one.loss < 1.2 * same.loss).all()
    table = found.to_pandas()
    assert table.columns.tolist() == ["gain", "start", "end", "loss_50", "loss_90", "floor_sigma"]
    assert table.loss_90.tolist() == [one.loss[0, 1] for one in found.intervals]
    assert alone.to_pandas().loss_90.tolist() == [alone.loss[0, 1]]


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: detectable_loss(Kalman(MODEL), record(), prior=PRIOR), "`algorithm` must be a ChangeDetection"),
        (lambda: detectable_loss(DETECTOR, record(), prior=PRIOR, power=(1.0,)), "`power` must be probabilities between 0 and 1"),
        (lambda: detectable_loss(DETECTOR, record(), prior=PRIOR, every=0.1), "`every` must be at least two steps of the record"),
        (lambda: detectable_loss(DETECTOR, record(), prior=PRIOR, every=-1.0), "`every` must be"),
        (lambda: detectable_loss(DETECTOR, record(), prior=PRIOR, start=99.0), "`start` and `end` must be times of the record"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said(call, sentence):
    with pytest.raises(InputError) as caught:
        call()
    assert sentence in str(caught.value)
