"""Verdicts alarm as rarely as they say under a right model, and name the right cause under a wrong one."""

import numpy as np
import pytest
from scipy.stats import binom

from estimable import InputError, Kalman, Prior, Record, StateSpace, estimate, estimate_bank, simulate_bank
from estimable.diagnostics import check_innovations, cross_correlation, standardised, whiteness

T, PRIOR = 300, Prior([0.0, 0.0], np.eye(2))
INPUT = np.sign(np.sin(0.31 * np.arange(T)))[:, None] + 0.3 * np.random.default_rng(0).normal(size=(T, 1))


def loop(Q=0.05, R=0.1, gain=1.0, A=((0.9, 0.2), (-0.1, 0.8))):
    B = gain * np.array([[1.0], [0.5]])
    return StateSpace(A, B, [[1.0, 0.0]], Q=Q * np.eye(2), R=[[R]], dt=1, outputs=["position"], inputs=["motor"])


def draw(runs, u=INPUT, seed=5):
    """Records of the true loop, a fifth of the outputs missing; `u` is the input that is written down."""
    y = simulate_bank(loop(), INPUT, seed=seed, runs=runs, prior=PRIOR).items.record.y.copy()
    y[np.random.default_rng(seed).random(y.shape) < 0.2] = np.nan
    return [Record(one, u, dt=1, outputs=["position"], inputs=["motor"]) for one in y]


def judged(model, records, false_alarm=0.01):
    bank = estimate_bank(Kalman(model), records, prior=PRIOR)
    return [check_innovations(bank[i], record, false_alarm=false_alarm) for i, record in enumerate(records)]


def test_a_right_model_alarms_as_rarely_as_is_said():
    runs = 1000
    found = judged(loop(), draw(runs), false_alarm=0.05)
    low, high = binom.ppf([0.001, 0.999], runs, 0.05)
    for kind in ("whiteness", "cross_correlation"):
        alarms = sum(next(iter(getattr(d, kind).values())).p_value < 0.05 for d in found)
        assert low <= alarms <= high, (kind, alarms)
    assert (
        binom.ppf(0.001, runs, 0.02) <= sum(not d.passed for d in found) <= high
    )  # shares of 5 % never add up to more


CAUSES = {
    "Q too small": (loop(Q=0.0025), INPUT, "Q too small relative to R"),
    "Q too large": (loop(Q=1.0), INPUT, "Q probably too large"),
    "R too small": (loop(R=0.02), INPUT, "R of position probably too small"),
    "R too large": (loop(R=0.5), INPUT, "R of position probably too large"),
    "gain": (loop(gain=0.7), INPUT, "the gain of the input is probably wrong"),
    "input not in the model": (loop(gain=0.0), INPUT, "its effect is not in the model"),
    "written down late": (loop(), np.vstack([INPUT[:1], INPUT[:-1]]), "the delay or the hold of the input is probably wrong"),
    "written down early": (loop(), np.vstack([INPUT[1:], INPUT[-1:]]), "the delay or the hold of the input is probably wrong"),
}  # fmt: skip


@pytest.mark.parametrize("cause", CAUSES)
def test_the_right_cause_is_named(cause):
    model, u, words = CAUSES[cause]
    found = judged(model, draw(20, u))
    assert all(not d.passed for d in found)
    named = sum(words in str(d) for d in found)
    assert named >= 14, (named, str(found[0]))


@pytest.mark.parametrize("cause", ["Q too small", "R too small", "Q too large", "R too large"])
def test_an_input_is_not_blamed_for_noise(cause):
    model, u, _ = CAUSES[cause]
    found = judged(model, draw(20, u))
    assert sum("motor" in str(d) for d in found) <= 2


def test_a_missing_mode_shows_at_its_period():
    e = np.random.default_rng(0).normal(size=600) + 0.6 * np.sin(2 * np.pi * np.arange(600) / 12)
    found = whiteness(e, name="speed")
    assert not found.passed
    assert "speed" in found.sentence
    assert abs(found.values[11]) > found.band[11]


def test_what_was_not_seen_is_left_out_pair_by_pair():
    e = np.random.default_rng(1).normal(size=50)
    e[10] = np.nan
    found = whiteness(e, lags=3)
    assert found.pairs.tolist() == [47, 46, 45]
    pairs = [(e[k], e[k + 2]) for k in range(48) if k not in (8, 10)]
    a, b = np.array(pairs).T
    assert found.values[1] == pytest.approx(a @ b / np.sqrt(a @ a * (b @ b)))


def test_units_of_outputs_and_inputs_change_no_verdict():
    record = draw(1)[0]
    result = estimate(Kalman(loop(gain=0.7)), record, prior=PRIOR)
    e = standardised(result.innovation, result.innovation_covariance)[:, 0]
    plain, scaled = (cross_correlation(e, c * record.u[:, 0] + d) for c, d in ((1.0, 0.0), (1e6, 3.0)))
    assert scaled.statistic == pytest.approx(plain.statistic, rel=1e-8)


def test_too_little_to_judge_by_is_said():
    with pytest.raises(InputError, match="too few pairs of samples to judge: at most 4 at a lag"):
        whiteness(np.append(np.full(20, np.nan), np.ones(5)), lags=2)
    with pytest.raises(InputError, match="`lags` must be less than the number of samples, 5"):
        whiteness(np.ones(5), lags=5)
    with pytest.raises(InputError, match="too few samples to judge: 4 for 2 lags"):
        cross_correlation(np.ones(5), np.arange(5.0), lags=1)
    with pytest.raises(InputError, match="the input is constant"):
        cross_correlation(np.ones(50), np.ones(50), lags=1)
    with pytest.raises(InputError, match=r"the same length\. Got 3 and 4"):
        cross_correlation(np.ones(3), np.ones(4))
    record = draw(1)[0]
    blind = estimate(Kalman(loop()), record, prior=PRIOR, keep="means")
    with pytest.raises(InputError, match="no innovations with covariances"):
        check_innovations(blind, record)
    whole = estimate(Kalman(loop()), record, prior=PRIOR)
    with pytest.raises(InputError, match="must be the record of the result, with 300 rows"):
        check_innovations(whole, record[:100])
    with pytest.raises(InputError, match="`false_alarm` must be greater than 0"):
        check_innovations(whole, record, false_alarm=0.0)
