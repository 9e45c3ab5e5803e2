"""Controllers: exact properties, and the published behaviour of the reconfigured loop."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import estimable as es

MODEL = es.StateSpace([[0.8]], [[1.0]], Q=[[0.0]], R=[[0.01]], dt=1)
PRIOR = es.Prior([0.0], [[0.0]])
LAW = es.StateFeedback([[0.3]], reference_gain=[[0.5]])


def fly(plant, controller, estimator, reference, **given):
    return es.close_loop(plant, controller, estimator, reference=reference, seed=2, prior=PRIOR, **given)


def test_a_known_loss_of_gain_is_made_good_exactly():
    """The plant with half its gain under the divided demand is the healthy plant under the law itself."""
    r = np.sin(np.arange(30.0))
    half = es.ControlledPlant(MODEL, events=[es.Failure(0.0, 0.5)])
    estimator = es.UnknownGain(MODEL, es.Prior([0.5], [[0.0]]))
    reconfigured = fly(half, es.GainReconfiguration(LAW), estimator, r)
    healthy = fly(MODEL, LAW, es.Kalman(MODEL), r)
    assert_allclose(reconfigured.state, healthy.state, atol=1e-12)
    assert_allclose(reconfigured.command, 2 * healthy.command, atol=1e-12)
    assert_allclose(reconfigured.control["effect"], 0.5)


def test_what_is_not_known_is_not_acted_on():
    """The divisor of caution 1 minimises E(K/d - 1)², found here by search."""
    K, P = 0.4, 0.09
    law = es.GainReconfiguration(LAW)
    believed = es.results.Info(mean=np.zeros(1), gain=np.array([K]), gain_covariance=np.array([[P]]))
    effect = float(law.act(law.init(), believed, np.ones(1))[2]["effect"][0])
    divisors = np.linspace(0.05, 3.0, 200_001)
    assert_allclose(effect, divisors[np.argmin((K**2 + P) / divisors**2 - 2 * K / divisors)], atol=2e-5)


def test_a_gain_below_the_bound_counts_as_the_bound():
    law = es.GainReconfiguration(LAW, lower=0.1, caution=0.0)
    for K in (-0.5, 0.0, 0.05):
        believed = es.results.Info(mean=np.zeros(1), gain=np.array([K]), gain_covariance=np.zeros((1, 1)))
        _, u, said = law.act(law.init(), believed, np.ones(1))
        assert_allclose([u[0], said["effect"][0]], [5.0, 0.1])


def test_each_actuator_is_divided_by_its_own_gain():
    law = es.GainReconfiguration(es.StateFeedback(np.ones((2, 1)), input_feedback=np.diag([1.0, 2.0])), caution=0.0)
    believed = es.results.Info(mean=-np.ones(1), gain=np.array([0.5, 0.25]), gain_covariance=np.zeros((2, 2)),
                       extra={"input": np.array([1.0, 1.0])})  # fmt: skip
    assert_allclose(law.act(law.init(), believed, np.zeros(0))[1], [2.0 - 1.0, 4.0 - 2.0])


def told(K, P=0.0, n=1):
    K = np.atleast_1d(K)
    return es.results.Info(mean=np.ones(n), gain=K, gain_covariance=P * np.eye(len(K)))


def test_the_work_of_a_lost_actuator_goes_to_the_others():
    """Three inputs, two things that matter: what is asked of both is done, with the least effort, with whatever is left."""
    M = np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 2.0]])
    F = np.array([[0.3], [-0.2], [0.5]])
    law = es.GainReconfiguration(es.StateFeedback(F), allocation=M, caution=0.0)
    for K in ([1.0, 1.0, 1.0], [0.5, 1.0, 0.3], [0.0, 0.8, 1.0], [1.0, 0.6, -0.2]):
        _, u, said = law.act(law.init(), told(K), np.zeros(0))
        left = np.where(np.array(K) > 0.05, K, 0.0)
        assert_allclose(u, np.linalg.pinv(M * left) @ M @ -F[:, 0], atol=1e-12)
        assert_allclose((M * left) @ u, M @ -F[:, 0], atol=1e-12)
        assert_allclose(said["effect"], np.maximum(K, 0.05))
    _, u, _ = law.act(law.init(), told([0.0, 0.0, 0.0]), np.zeros(0))
    assert_allclose(u, 0.0)


def test_one_actuator_that_is_allocated_is_divided():
    law, plain = (es.GainReconfiguration(LAW, **given) for given in ({"allocation": [[-3.0]]}, {}))
    for K, P in ((0.5, 0.0), (0.3, 0.01)):
        assert_allclose(*(one.act(one.init(), told(K, P), np.ones(1))[1] for one in (law, plain)), rtol=1e-12)


def test_a_divisor_moves_no_faster_than_it_may():
    law = es.GainReconfiguration(LAW, rate=0.25, caution=0.0)
    state, inverses = law.init(), []
    for K in (1.0, 0.5, 0.5, 0.5, 0.5, 0.5, 0.8):
        state, u, said = law.act(state, told(K), np.ones(1))
        inverses.append(1 / float(said["effect"][0]))
        assert_allclose(u, 0.2 * inverses[-1])
    assert_allclose(inverses, [1.0, 1.25, 1.5, 1.75, 2.0, 2.0, 1.75])


@pytest.mark.parametrize(("given", "sentence"), [
    ({"allocation": np.ones((1, 2))}, "`allocation` must have a column for each of 1 input"),
    ({"allocation": np.zeros((1, 1))}, "`allocation` must have independent rows"),
    ({"rate": 0.0}, "`rate` must be greater than 0"),
])  # fmt: skip
def test_wrong_guards_are_refused(given, sentence):
    with pytest.raises(es.InputError, match=sentence):
        es.GainReconfiguration(LAW, **given)


def integral(**given):
    return es.ProportionalIntegral([[0.3]], reference_gain=[[0.3]], integral=[[-0.1]], tracked=[[1.0]], dt=1, **given)


def test_the_integral_removes_a_constant_error():
    r = np.ones(150)
    assert abs(fly(MODEL, es.StateFeedback([[0.3]], reference_gain=[[0.3]]), es.Kalman(MODEL), r).mean[-1, 0] - 1) > 0.3
    assert abs(fly(MODEL, integral(), es.Kalman(MODEL), r).mean[-1, 0] - 1) < 1e-3


def test_no_wind_up():
    """Held at its limit for long, the input leaves it soon after the reference turns; unguarded, it stays for long."""
    r = np.where(np.arange(120) < 80, 3.0, 0.0)
    plant = es.ControlledPlant(MODEL, limits=(-0.2, 0.2))
    stuck = {}
    for name, limits in (("guarded", (-0.2, 0.2)), ("unguarded", None)):
        closed = fly(plant, integral(limits=limits), es.Kalman(MODEL), r)
        stuck[name] = int(np.sum(closed.applied[80:, 0] > 0.19))
    assert stuck["guarded"] <= 1
    assert stuck["unguarded"] > 20


@pytest.mark.parametrize(("make", "sentence"), [
    (lambda: es.StateFeedback([[1.0]], reference_gain=[[1.0], [2.0]]), r"`reference_gain` must be \(m, r\)"),
    (lambda: es.StateFeedback([[1.0]], input_feedback=[[1.0, 2.0]]), r"`input_feedback` must be \(m, m\)"),
    (lambda: integral(limits=(1.0, 0.0)), "the first below the second"),
    (lambda: es.GainReconfiguration(LAW, lower=0.0), "`lower` must be greater than 0"),
    (lambda: es.GainReconfiguration(LAW, caution=-1.0), "`caution` must be at least 0"),
    (lambda: es.GainReconfiguration(MODEL), "`controller` must be a controller"),
    (lambda: es.Failure(-1.0, 0.5), "`time` must be at least 0"),
])  # fmt: skip
def test_a_wrong_setting_is_refused_in_one_sentence(make, sentence):
    with pytest.raises(es.InputError, match=sentence):
        make()


def test_gains_that_are_not_one_an_input_are_refused():
    both = es.StateSpace([[0.8]], [[1.0, 1.0, 1.0]], Q=[[0.0]], R=[[0.01]], dt=1)
    law = es.GainReconfiguration(es.StateFeedback(np.ones((3, 1))))
    gains = es.UnknownGain(both, es.Prior([1.0, 1.0], np.eye(2)), directions=np.ones((2, 1, 3)))
    with pytest.raises(es.InputError, match=r"one gain, or one for each of 3 inputs\. The estimator has 2"):
        fly(both, law, gains, np.zeros((5, 0)))


def test_a_dither_starts_when_the_variance_asks_for_it_and_ends_when_it_is_content():
    law = es.Dither(LAW, amplitude=0.2, period=4, sigma=0.1)
    state, added = law.init(), []
    for variance in (0.009, 0.011, 0.009, 0.006, 0.005, 0.004, 0.009, 0.02):
        believed = es.results.Info(mean=np.zeros(1), gain=np.ones(1), gain_covariance=np.array([[variance]]))
        state, u, said = law.act(state, believed, np.ones(1))
        added.append(float(said["dither"][0]))
        assert_allclose(u, 0.5 + said["dither"])
    assert_allclose(added, [0, 0.2, 0.2, -0.2, -0.2, 0, 0, 0.2])


def test_a_dither_sized_for_a_variance_reaches_it_in_level_flight():
    """Nothing is asked of the plant; a walk makes the gain less and less sure, and the dither keeps it as sure as wanted."""
    law = es.Dither.sized(LAW, MODEL, sigma=0.1, seconds=20.0, period=4, dt=1.0)
    sure, unsure = es.Prior([1.0], [[0.0]]), es.Prior([1.0], [[4.0]])
    told = fly(MODEL, law, es.UnknownGain(MODEL, unsure), np.zeros(40))
    assert 0.7 * 0.1 < np.sqrt(told.info.gain_covariance[20, 0, 0]) < 1.1 * 0.1
    assert_allclose(np.abs(told.control["dither"][0]), law.amplitude)
    walking = es.UnknownGain(MODEL, sure, walk=2e-4)
    kept, left = (fly(MODEL, one, walking, np.zeros(200)) for one in (law, LAW))
    assert np.sqrt(kept.info.gain_covariance[100:].max()) < 0.12
    assert np.sqrt(left.info.gain_covariance[-1, 0, 0]) > 0.19
    assert 0 < np.mean(kept.control["dither"] != 0) < 0.9  # and no more than it takes
    assert_allclose(kept.control["dither"][:8], 0.0)


def test_a_dither_goes_inside_a_reconfiguration():
    law = es.GainReconfiguration(es.Dither(LAW, amplitude=0.2, period=2, sigma=0.1), caution=0.0)
    believed = es.results.Info(mean=np.zeros(1), gain=np.array([0.5]), gain_covariance=np.array([[1.0]]))
    assert_allclose(law.act(law.init(), believed, np.ones(1))[1], 0.5 / 0.5 + 0.2)


@pytest.mark.parametrize(("given", "sentence"), [
    ({"controller": 3}, "`controller` must be a controller"),
    ({"amplitude": [1.0, 2.0]}, r"`amplitude` must be \(m,\) = \(1,\): the controller has 1 input"),
    ({"period": 3}, "`period` must be an even number of samples"),
    ({"sigma": 0.0}, "`sigma` must be greater than 0"),
])  # fmt: skip
def test_a_wrong_dither_is_refused(given, sentence):
    with pytest.raises(es.InputError, match=sentence):
        es.Dither(**{"controller": LAW, "amplitude": 0.1, "period": 4, "sigma": 0.1, **given})
    with pytest.raises(es.InputError, match="dithers until a gain is known, but the estimator estimates none"):
        fly(MODEL, es.Dither(LAW, amplitude=0.1, period=4, sigma=0.1), es.Kalman(MODEL), np.zeros(3))
