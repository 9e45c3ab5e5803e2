"""What is said of wrong windows, bounds, averages, gates and detectors."""

import numpy as np
import pytest

from cases import case
from estimable import (
    AlphaBeta,
    Bounded,
    ChangeDetection,
    Gated,
    Kalman,
    MovingWindow,
    Prior,
    Smoothed,
    UnknownGain,
    catalogue,
    estimate,
    packaged,
    read_model,
)

C = case(1, (3, 2, 2))
GAIN = UnknownGain(C.model, Prior([1.0], [[0.5]]))
TWO = UnknownGain(C.model, Prior([1.0, 1.0], np.eye(2)), directions="per_input")

SENTENCES = [
    (lambda: MovingWindow(GAIN, 0), "`length` must be an integer of at least 1. Got 0."),
    (
        lambda: MovingWindow(GAIN, 1),
        "`length` must be at least 2: a window of 1 sample holds 2 numbers, which cannot determine 3 states and 1 gain. "
        "Give a longer window, or a `state_prior`.",
    ),
    (
        lambda: MovingWindow(Kalman(C.model), 1),
        "`length` must be at least 2: a window of 1 sample holds 2 numbers, which cannot determine 3 states. "
        "Give a longer window, or a `state_prior`.",
    ),
    (lambda: MovingWindow(GAIN, 5, state_prior=Prior([0.0], [[1.0]])), "`state_prior` must describe n = 3 states. Got 1."),
    (lambda: MovingWindow(GAIN, 5, state_prior=3.0), "`state_prior` must be a Prior. Got 3.0. None means diffuse."),
    (
        lambda: estimate(MovingWindow(GAIN, 30), C.record, prior=C.prior),
        "the window has 30 samples, but the record only 12: no window is ever full.",
    ),
    (
        lambda: estimate(Smoothed(MovingWindow(GAIN, 13), 0.9), C.record, prior=C.prior),
        "the window has 13 samples, but the record only 12: no window is ever full.",
    ),
    (
        lambda: MovingWindow(Kalman, 5),
        "`algorithm` must be made of a model: write Kalman(model), not Kalman.",
    ),
    (
        lambda: Bounded(Kalman(C.model), 0, 1),
        "`algorithm` must estimate a gain for Bounded to act on: Kalman has none. Wrap an UnknownGain.",
    ),
    (
        lambda: Smoothed(MovingWindow(Kalman(C.model), 5), 0.9),
        "`algorithm` must estimate a gain for Smoothed to act on: Kalman has none. Wrap an UnknownGain.",
    ),
    (lambda: Bounded(GAIN, 1.0, 0.0), "`lower` must not be above `upper`. Got [1.0] and [0.0]."),
    (
        lambda: Bounded(TWO, [0.0], 1.0),
        "`lower` must be (gains,) = (2,): the algorithm has 2 gains. Got (1,).",
    ),
    (
        lambda: Smoothed(GAIN, 1),
        "`weight` must be at least 0 and below 1. Got 1. With 1 the estimate would never move.",
    ),
    (lambda: Smoothed(GAIN, -0.1), "`weight` must be at least 0 and below 1. Got -0.1."),
    (
        lambda: Gated(GAIN, 1),
        "`probability` must be below 1: a gate that every good sample passes rejects nothing. Got 1.",
    ),
    (lambda: Gated(GAIN, 1.5), "`probability` must be below 1. Got 1.5."),
    (
        lambda: Gated(AlphaBeta(0.5, 0.2), 0.9),
        "`algorithm` must report the covariance of its innovations: give AlphaBeta `sigma_a2` and `sigma_s2`.",
    ),
    (lambda: Gated(GAIN, 0), "`probability` must be greater than 0. Got 0."),
    (
        lambda: ChangeDetection(Kalman(C.model)),
        "`algorithm` must be an UnknownGain, or an ExtendedKalman or SecondOrderKalman with parameters. Got "
        "Kalman(model=StateSpace(A=array([[-0.37...... "
        "A jump can be detected only in a gain that the algorithm estimates.",
    ),
    (
        lambda: ChangeDetection(UnknownGain(C.model, Prior([1.0], [[0.0]]))),
        "`jump` must be variances of a jump, greater than 0. The prior of the gain has [0.0].",
    ),
    (lambda: ChangeDetection(GAIN, jump=-1.0), "`jump` must be variances of a jump, greater than 0. Got [-1.0]."),
    (lambda: ChangeDetection(GAIN, jump=[1.0, 2.0]), "`jump` must be (gains,) = (1,): `gain` is a prior of 1 gain. Got (2,)."),
    (lambda: ChangeDetection(GAIN, slots=1), "`slots` must be an integer of at least 2. Got 1."),
    (
        lambda: ChangeDetection(GAIN, seconds_between_false_alarms=0),
        "`seconds_between_false_alarms` must be greater than 0. Got 0.",
    ),
    (lambda: ChangeDetection(GAIN, persistence=0.5), "`persistence` must be at least 1. Got 0.5."),
    (lambda: ChangeDetection(GAIN, walk=-1.0), "`walk` must be variances per second, at least 0. Got -1.0."),
]  # fmt: skip


@pytest.mark.parametrize(("call", "sentence"), SENTENCES, ids=[str(i) for i in range(len(SENTENCES))])
def test_the_sentence(refused, call, sentence):
    said = refused(call)
    assert len(said) == 1
    if "Kalman(model=" not in sentence:  # how a model is shown is no matter of this test
        assert said[0] == sentence
    else:
        assert said[0].startswith(sentence[:60])
        assert said[0].endswith(sentence[-55:])


def test_several_faults_are_told_together(refused):
    assert len(refused(lambda: ChangeDetection(GAIN, slots=0, persistence=0.0, seconds_between_false_alarms=-1.0))) == 3


def test_settings_of_a_wrapper_and_of_what_it_wraps_are_told_apart(refused):
    file = read_model(packaged.path("f16-model.toml"))
    window = catalogue.build("moving-window", file, length=7, walk=0.0)
    assert (window.length, window.algorithm.walk.item()) == (7, 0.0)
    assert isinstance(catalogue.build("moving-window", file, algorithm="kalman").algorithm, Kalman)
    chain = catalogue.build("smoothed", file, algorithm="bounded", weight=0.5, lower=0.05)
    assert (chain.weight.item(), chain.algorithm.lower.item(), chain.algorithm.upper.item()) == (0.5, 0.05, 1.0)
    assert "has no setting 'lenght'" in refused(lambda: catalogue.build("moving-window", file, lenght=3))[0]
    assert refused(lambda: catalogue.build("gated", file, algorithm="smoothed"))[0].startswith(
        "`algorithm` must be one of"
    )
