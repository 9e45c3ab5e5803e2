"""ChangeDetection against likelihoods computed one onset at a time, and on flights."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import norm

from cases import case, covariance
from estimable import (
    ChangeDetection,
    ExtendedKalman,
    NonlinearModel,
    Prior,
    Record,
    SecondOrderKalman,
    StateSpace,
    UnknownGain,
    estimate,
    estimate_bank,
    markov_disturbance,
    packaged,
    read_model,
    read_record,
    simulate,
    simulate_bank,
    stack,
)
from estimable.diagnostics import changes
from estimable.plants import f16
from oracles import textbook
from oracles.augmented import augmented, together

JUMP, SCALES, T = np.array([0.5, 2.0]), np.array([1.0, 0.1]), 12
LABELS = ([0], [1], [0, 1])  # the gains that jump together
HYPOTHESES = [(gains, scale) for gains in LABELS for scale in SCALES]
DENSE = {"slots": 16, "levels": 1}  # every row is an onset
NEVER = 1e100


class Problem:
    """Two gains, cross noise or none, outputs missing: the detector, and its hypotheses written out one by one."""

    def __init__(self, seed, cross):
        c = case(seed, (3, 2, 2), T=T, cross=cross)
        self.record, self.prior = c.record, c.prior
        self.gain = Prior(c.rng.normal(size=2), covariance(c.rng, 2))
        parts = c.rng.normal(size=(2, 3, 2)), c.rng.normal(size=(3, 2)), c.rng.normal(size=(2, 2, 2))
        self.algorithm = UnknownGain(c.model, self.gain, directions=parts[0], fixed=parts[1], feedthrough=parts[2])
        self.model = augmented(c.model, self.gain, *parts, np.zeros((2, 2)), c.record.u)

    def detector(self, seconds):
        return ChangeDetection(
            self.algorithm,
            jump=JUMP,
            scales=SCALES,
            seconds_between_false_alarms=seconds,
            seconds_between_changes=30.0,
            **DENSE,
        )

    def filtered(self, k, onset=None, gains=(), scale=1.0):
        """Mean, covariance and log-likelihood at row k of the model in which these gains jump at row `onset`, or none."""
        Q = np.repeat(self.model.Q[None], T, axis=0)
        for i in gains:
            Q[onset - 1, -2 + i, -2 + i] += scale * JUMP[i]
        S = None if self.model.S is None else np.repeat(self.model.S[None], T, axis=0)
        R = np.repeat(self.model.R[None], T, axis=0)
        model = replace(self.model, Q=Q, R=R, S=S)
        y = self.record.y.copy()
        y[k + 1 :] = np.nan
        means, covariances, total = textbook.kalman(model, together(self.prior, self.gain), y, self.record.u)
        return means[k], covariances[k], total

    def hypotheses(self, k):
        """Weight times likelihood ratio, mean and covariance of every jump, onset by onset."""
        _, _, quiet = self.filtered(k)
        for onset in range(1, k + 1):
            for which in HYPOTHESES:
                mean, P, total = self.filtered(k, onset, *which)
                yield 0.5 / len(HYPOTHESES) * np.exp(total - quiet), mean, P


@pytest.mark.parametrize("cross", [False, True])
def test_the_statistic_sums_the_exact_likelihood_ratios_of_every_onset(cross):
    problem = Problem(3, cross)
    result = estimate(problem.detector(NEVER), problem.record, prior=problem.prior)
    assert not result.extra["alarm"].any()
    assert np.isnan(result.extra["statistic"][0])  # no jump precedes the first sample
    for k in (1, 4, 11):
        total = sum(ratio for ratio, _, _ in problem.hypotheses(k))
        assert_allclose(result.extra["statistic"][k] + np.log(NEVER), np.log(total), rtol=1e-8, atol=1e-9)


def highest_yet(statistic):
    """The last row but one, or an earlier one, at which the statistic is larger than ever before."""
    return next(k for k in range(T - 2, 2, -1) if statistic[k] > np.nanmax(statistic[:k]))


@pytest.mark.parametrize("cross", [False, True])
def test_an_alarm_leaves_the_posterior_given_a_jump(cross):
    problem = Problem(5, cross)
    statistic = estimate(problem.detector(NEVER), problem.record, prior=problem.prior).extra["statistic"]
    k = highest_yet(statistic)
    seconds = NEVER * np.exp(statistic[k]) * 0.999
    result = estimate(problem.detector(seconds), problem.record, prior=problem.prior)
    assert np.flatnonzero(result.extra["alarm"])[0] == k
    ratios, means, covariances = (np.array(part) for part in zip(*problem.hypotheses(k), strict=True))
    π = ratios / ratios.sum()
    mean = π @ means
    P = np.einsum("h,hij->ij", π, covariances + np.einsum("hi,hj->hij", means - mean, means - mean))
    assert_allclose(np.concatenate([result.mean[k], result.gain[k]]), mean, rtol=1e-8)
    assert_allclose(result.covariance[k], P[:3, :3], rtol=1e-7)
    assert_allclose(result.gain_covariance[k], P[3:, 3:], rtol=1e-7)
    assert_allclose(result.extra["state_gain_covariance"][k], P[:3, 3:], rtol=1e-7, atol=1e-9)
    onsets = range(1, k + 1)
    by_onset = π.reshape(-1, len(HYPOTHESES)).sum(axis=1)
    likeliest = onsets[int(np.argmax(by_onset))]
    assert result.extra["onset"][k] == likeliest
    assert_allclose(result.extra["onset_sigma"][k] ** 2, by_onset @ (np.array(onsets) - likeliest) ** 2, rtol=1e-7)
    by_label = π.reshape(-1, len(LABELS), len(SCALES)).sum(axis=(0, 2))
    assert_allclose(result.extra["jumped"][k], by_label[:2] + by_label[2], rtol=1e-7)
    assert_allclose(result.log_likelihood_steps[k], quiet_step(problem, k) + np.log(ratios.sum() / 30), rtol=1e-8)
    first = changes(result)[0]
    assert_allclose(first.onset_sigma_s, 0.5 * first.onset_sigma)  # a row lasts half a second


def quiet_step(problem, k):
    """The log-likelihood of row k without a jump."""
    return problem.filtered(k)[2] - problem.filtered(k - 1)[2]


def test_the_quantiles_between_alarms_are_those_of_the_mixture_of_all_jumps():
    problem, k = Problem(3, False), 11
    result = estimate(problem.detector(NEVER), problem.record, prior=problem.prior)
    quiet, P, _ = problem.filtered(k)
    ratios, means, covariances = (np.array(part) for part in zip(*problem.hypotheses(k), strict=True))
    odds = ratios / 30
    assert_allclose(result.info.jump_probability[k], odds.sum() / (1 + odds.sum()), rtol=1e-7)
    w = np.append(odds, 1.0) / (1 + odds.sum())
    for i in range(2):
        m = np.append(means[:, 3 + i], quiet[3 + i])
        sd = np.sqrt(np.append(covariances[:, 3 + i, 3 + i], P[3 + i, 3 + i]))
        found = result.info.gain_quantiles[k, i]
        assert_allclose(
            norm.cdf((found[:, None] - m) / sd) @ w, [0.025, 0.16, 0.5, 0.84, 0.975], atol=5e-3
        )  # a level as one


def test_an_alarm_is_carried_on_with_the_cross_noise_of_its_sample():
    problem = Problem(5, True)
    statistic = estimate(problem.detector(NEVER), problem.record, prior=problem.prior).extra["statistic"]
    k = highest_yet(statistic)
    result = estimate(problem.detector(NEVER * np.exp(statistic[k]) * 0.999), problem.record, prior=problem.prior)
    ratios, _, _ = (np.array(part) for part in zip(*problem.hypotheses(k), strict=True))
    onsets = [(onset, *which) for onset in range(1, k + 1) for which in HYPOTHESES]
    blind = problem.record.y.copy()
    blind[k + 1] = np.nan
    ahead = estimate(
        problem.detector(NEVER * np.exp(statistic[k]) * 0.999), replace(problem.record, y=blind), prior=problem.prior
    )
    kept, problem.record = problem.record, replace(problem.record, y=blind)
    means = np.array([problem.filtered(k + 1, *which)[0] for which in onsets])
    problem.record = kept
    assert result.extra["alarm"][k]
    assert_allclose(np.concatenate([ahead.mean[k + 1], ahead.gain[k + 1]]), ratios / ratios.sum() @ means, rtol=1e-7)


def test_without_an_alarm_it_is_the_filter_of_a_constant_gain():
    c = case(2, (3, 2, 2))
    algorithm = UnknownGain(c.model, Prior([0.7], [[0.3]]), walk=0.4, forgetting=0.9)
    watched = ChangeDetection(algorithm, seconds_between_false_alarms=NEVER)
    constant = estimate(UnknownGain(c.model, Prior([0.7], [[0.3]])), c.record, prior=c.prior)
    ours = estimate(watched, c.record, prior=c.prior)
    for name in ("mean", "covariance", "gain", "gain_covariance", "innovation", "log_likelihood_steps"):
        assert_allclose(getattr(ours, name), getattr(constant, name), rtol=1e-10, atol=1e-12)


def test_a_walk_between_the_jumps_is_that_of_the_filter():
    c = case(2, (3, 2, 2))
    watched = ChangeDetection(UnknownGain(c.model, Prior([0.7], [[0.3]])), walk=0.4, seconds_between_false_alarms=NEVER)
    walking = estimate(UnknownGain(c.model, Prior([0.7], [[0.3]]), walk=0.4), c.record, prior=c.prior)
    assert_allclose(estimate(watched, c.record, prior=c.prior).gain, walking.gain, rtol=1e-10)


def two_actuators(runs, gains, seed=0):
    """Runs of a loop with process noise and missing outputs, whose two gains are `gains` (T, 2)."""
    model = StateSpace(
        [[0.9, 0.2], [-0.1, 0.8]], [[0.5, 0.0], [0.2, 0.8]], np.eye(2), Q=0.01 * np.eye(2), R=0.02 * np.eye(2), dt=0.1,
        inputs=["left", "right"],
    )  # fmt: skip
    u = np.sign(np.sin(np.outer(np.arange(len(gains)), [0.31, 0.17]) + 0.1))
    drawn = simulate_bank(model, gains * u, seed=seed, runs=runs, prior=Prior(np.zeros(2), np.zeros((2, 2)))).items
    y = drawn.record.y.copy()
    y[np.random.default_rng(seed).random(y.shape) < 0.3] = np.nan
    algorithm = UnknownGain(model, Prior([1.0, 1.0], 0.25 * np.eye(2)), directions="per_input")
    watched = ChangeDetection(algorithm)
    return watched, stack([Record(rows, u, dt=0.1, inputs=["left", "right"]) for rows in y])


PRIOR = Prior(np.zeros(2), 0.01 * np.eye(2))


def test_several_jumps_of_several_gains_are_found_in_order():
    gains = np.ones((300, 2))
    gains[100:, 1], gains[150:, 0], gains[230:, 1] = 0.2, 0.4, 0.9
    watched, records = two_actuators(40, gains)
    bank = estimate_bank(watched, records, prior=PRIOR)
    found = [changes(bank[i]) for i in range(40)]
    right = [run for run in found if [c.gain for c in run] == ["gain_right", "gain_left", "gain_right"]]
    assert len(right) >= 36
    for i, (onset, after) in enumerate(zip((100, 150, 230), (0.2, 0.4, 0.9), strict=True)):
        assert abs(np.median([run[i].onset for run in right]) - onset) <= 1
        assert np.median([run[i].detected_at for run in right]) < onset + 12
        errors = np.array([(run[i].after - after) / run[i].sigma for run in right])
        assert np.mean(errors**2) < 3  # sigma is that of its own constant gain


def test_false_alarms_are_no_more_frequent_than_stated():
    watched, records = two_actuators(200, np.ones((300, 2)), seed=4)
    often = replace(watched, seconds_between_false_alarms=60.0)
    alarms = estimate_bank(often, records, prior=PRIOR).extra["alarm"].sum()
    stated = 200 * 30.0 / 60.0
    assert 0.1 * stated < alarms < stated


def entered_for_good(inside, k):
    """Samples after k until 51 in a row are inside the band."""
    runs = [row for row in range(k, len(inside) - 50) if inside[row : row + 51].all()]
    return (runs[0] - k) / 100 if runs else np.inf


@pytest.mark.parametrize(("after", "seconds"), [(0.8, 0.12), (0.2, 0.19)])
def test_it_finds_the_failure_of_the_f16_sooner_than_a_window_can(after, seconds):
    algorithm = ChangeDetection(UnknownGain(f16.short_period(), Prior([1.0], [[0.25]])))
    flights = stack([f16.flight(after, seed=i).record for i in range(40)])
    bank = estimate_bank(algorithm, flights, prior=Prior([0.0, 0.0], np.diag([0.1, 1.0])))
    assert not bank.extra["alarm"][:, :450].any()
    delays = [(changes(bank[i])[0].detected_at - 450) / 100 for i in range(40)]
    assert np.median(delays) <= 0.10
    inside = np.abs(bank.gain[..., 0] - after) <= 0.2 * after
    assert np.median([entered_for_good(row, 450) for row in inside]) <= seconds
    assert np.sqrt(bank.gain_covariance[:, 550:, 0, 0]).max() < 0.055 / 3
    assert np.abs(bank.gain[:, 550:, 0] - after).std() < 0.055 / 3


def test_it_finds_the_failure_of_the_nonlinear_flight_once_and_nothing_else():
    file = read_model(packaged.path("f16-model.toml"))
    assert file.gain is not None
    record = read_record(
        packaged.path("f16-flight.csv"), outputs=file.model.outputs, inputs=file.model.inputs, **file.record
    )
    model = markov_disturbance(file.model, time_constant=0.3, density=15 * np.diag(file.model.Q))
    algorithm = ChangeDetection(UnknownGain(model, file.gain.prior, **file.gain.settings))
    result = estimate(algorithm, record, prior=file.prior)
    [change] = changes(result)
    assert result.gain_quantiles[-1, 0, 0] < 0.5 < result.gain_quantiles[-1, 0, 4]
    assert 4.45 <= change.onset_s <= 4.6
    assert 4.5 < change.detected_at_s < 5.0
    assert 0.47 < change.after < 0.53
    assert abs(change.before - 1.0) < 0.1


def test_a_diffuse_gain_is_watched_from_when_it_is_known():
    model = StateSpace([[0.5]], [[1.0]], Q=[[0.0]], R=[[0.0001]], dt=1)
    gain = Prior([0.0], [[0.0]], diffuse=[[1.0]])
    u, gains = np.ones(40), np.where(np.arange(40) < 20, 2.0, 1.0)
    x = np.zeros(40)
    for k in range(39):
        x[k + 1] = 0.5 * x[k] + gains[k] * u[k]
    y = x + 0.01 * np.random.default_rng(0).normal(size=40)
    watched = ChangeDetection(UnknownGain(model, gain), jump=1.0)
    [change] = changes(estimate(watched, Record(y, u, dt=1), prior=Prior([0.0], [[0.0]])))
    assert (change.onset, change.detected_at) == (20, 21)
    assert_allclose([change.before, change.after], [2.0, 1.0], atol=0.01)


def test_unequal_steps_weigh_by_their_seconds():
    model = StateSpace([[-0.5]], [[1.0]], Q=[[0.0]], R=[[1.0]], dt=0)
    blind = Record(np.full((4, 1), np.nan), np.zeros(4), t=[0.0, 0.5, 2.0, 2.25])
    watched = ChangeDetection(
        UnknownGain(model, Prior([1.0], [[1.0]])), slots=2, levels=1, seconds_between_false_alarms=100.0
    )
    statistic = estimate(watched, blind, prior=Prior([0.0], [[1.0]])).extra["statistic"]
    assert_allclose(100 * np.exp(statistic), [np.nan, 0.5, 2.0, 1.75])  # the sum over the last two of .5, 1.5, .25


def test_a_result_without_alarms_has_no_list_of_changes(refused):
    c = case(2, (3, 2, 2))
    watched = ChangeDetection(UnknownGain(c.model, Prior([0.7], [[0.3]])), slots=3, levels=1)
    for result in (
        estimate(UnknownGain(c.model, Prior([0.7], [[0.3]])), c.record, prior=c.prior),
        estimate(watched, c.record, prior=c.prior, keep="means"),
    ):
        assert "must be the estimate of a ChangeDetection, with keep = 'all'" in refused(lambda r=result: changes(r))[0]
    bank = estimate_bank(watched, [c.record, c.record], prior=c.prior)
    assert "changes(bank[0])" in refused(lambda: changes(bank))[0]
    assert changes(bank[1]) == changes(estimate(watched, c.record, prior=c.prior))


def test_a_change_says_itself_in_words():
    from estimable.diagnostics import DetectedChange

    timed = DetectedChange("gain", 450, 458, 4.5, 4.58, 1.0, 0.5, 0.012, 1.5, 0.015)
    assert timed.sentence == "gain changed from 1 to 0.5 ± 0.012 at 4.5 ± 0.015 s, detected at 4.58 s."
    assert timed._replace(onset_s=None, detected_at_s=None).sentence == (
        "gain changed from 1 to 0.5 ± 0.012 at row 450 ± 1.5, detected at row 458."
    )


@pytest.mark.parametrize("filter", [ExtendedKalman, SecondOrderKalman])
def test_of_a_model_straight_in_its_parameter_a_nonlinear_filter_finds_what_the_exact_one_does(filter):
    rng = np.random.default_rng(0)
    A, B, C, Q = np.array([[0.9, 0.2], [-0.3, 0.8]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]]), 1e-4 * np.eye(2)
    u, gain = np.sign(rng.normal(size=(60, 1))), np.where(np.arange(60) < 30, 1.0, 0.5)[:, None]
    drawn = simulate(StateSpace(A, B, C, Q=Q, R=[[0.01]], dt=1), gain * u, seed=0)
    record, prior, of_gain = Record(drawn.record.y, u, dt=1), Prior([0.0, 0.0], np.eye(2)), Prior([1.0], [[0.1]])
    straight = StateSpace(A, B, C, Q=Q, R=[[0.01]], dt=1)
    curved = NonlinearModel(lambda x, u, θ: A @ x + θ[0] * (B @ u), lambda x, u, θ: C @ x, Q=Q, R=[[0.01]], dt=1,
                            inputs=["u1"], parameters={"gain": 1.0})  # fmt: skip
    exact, found = (
        estimate(ChangeDetection(a, slots=20, levels=1), record, prior=prior)
        for a in (UnknownGain(straight, of_gain), filter(curved, parameters=of_gain))
    )
    assert exact.extra["alarm"].sum() == 1
    assert found.extra["onset"].tolist() == exact.extra["onset"].tolist()
    assert_allclose(found.extra["statistic"], exact.extra["statistic"], atol=1e-9)
    assert_allclose(found.gain, exact.gain, rtol=1e-10)
