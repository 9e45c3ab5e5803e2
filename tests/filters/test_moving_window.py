"""MovingWindow against the algorithm started fresh at every row; its bounds, averages and gates."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cases import case, covariance
from estimable import (
    Bounded,
    Gated,
    Kalman,
    MovingWindow,
    Prior,
    Record,
    Smoothed,
    StateSpace,
    UnknownGain,
    estimate,
    estimate_bank,
    log_likelihood,
    online,
    stack,
)
from estimable.estimation import window_scan, windows
from oracles import textbook

LENGTH = 4
FIELDS = (
    "mean",
    "covariance",
    "innovation",
    "innovation_covariance",
    "gain",
    "gain_covariance",
    "log_likelihood_steps",
)


def restarted(algorithm, record, prior, state_prior):
    """The algorithm run afresh for every row, over that row's window only."""
    n = prior.size
    diffuse = Prior(prior.mean, np.zeros((n, n)), diffuse=np.eye(n))
    for k in range(len(record)):
        full = k >= LENGTH - 1
        begin = (state_prior or diffuse) if full else prior
        yield estimate(algorithm, record[max(0, k - LENGTH + 1) : k + 1], prior=begin)


def problem(cross=False):
    c = case(5, (3, 2, 2), missing=0.2, cross=cross)
    gain = UnknownGain(c.model, Prior([0.7, 0.2], covariance(c.rng, 2)), directions="per_input", walk=0.1)
    return c, gain


@pytest.mark.parametrize("own", [None, Prior(np.ones(3), 2 * np.eye(3))], ids=["diffuse", "proper"])
@pytest.mark.parametrize("cross", [False, True])
def test_every_row_is_the_algorithm_started_anew(own, cross):
    c, gain = problem(cross)
    result = estimate(MovingWindow(gain, LENGTH, state_prior=own), c.record, prior=c.prior)
    for k, alone in enumerate(restarted(gain, c.record, c.prior, own)):
        for name in FIELDS:
            assert_allclose(getattr(result, name)[k], getattr(alone, name)[-1], rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("prior", ["proper", "diffuse"])
def test_online_copies_and_windows_side_by_side_say_the_same(prior):
    c, gain = problem()
    begin = c.prior if prior == "proper" else Prior(np.zeros(3), np.zeros((3, 3)), diffuse=np.eye(3)[:, :2])
    window = MovingWindow(gain, LENGTH)
    whole = estimate(window, c.record, prior=begin)
    running = online(window, prior=begin)
    for k in range(len(c.record)):
        info = running.correct(c.record.y[k], c.record.u[k])
        for name in ("mean", "covariance", "gain", "gain_covariance"):
            assert_allclose(getattr(info, name), getattr(whole, name)[k], rtol=1e-11, atol=1e-12)
        running.predict(c.record.u[k])
    copies = log_likelihood(window, c.record, prior=begin)  # this one runs the copies, so that it has derivatives
    assert_allclose(copies, whole.log_likelihood, rtol=1e-11)


def test_a_window_of_a_known_model_is_the_textbook_filter_on_its_rows():
    c = case(5, (2, 1, 1), missing=0.0)
    own = Prior([1.0, -1.0], 0.5 * np.eye(2))
    result = estimate(MovingWindow(Kalman(c.model), LENGTH, state_prior=own), c.record, prior=c.prior)
    for k in (3, 7, 11):
        rows = slice(k - LENGTH + 1, k + 1)
        means, covariances, _ = textbook.kalman(c.model, own, c.record.y[rows], c.record.u[rows])
        assert_allclose(result.mean[k], means[-1], rtol=1e-10)
        assert_allclose(result.covariance[k], covariances[-1], rtol=1e-10)


def test_a_model_that_varies_in_time_is_windowed_too():
    c = case(6, (3, 2, 2), varying=True)
    window = MovingWindow(Kalman(c.model), LENGTH)
    whole = estimate(window, c.record, prior=c.prior)
    tail = slice(len(c.record) - LENGTH, None)
    late = replace(c.model, A=c.model.A[tail], B=c.model.B[tail], C=c.model.C[tail])
    alone = estimate(Kalman(late), c.record[tail], prior=Prior(c.prior.mean, np.zeros((3, 3)), diffuse=np.eye(3)))
    assert_allclose(whole.mean[-1], alone.mean[-1], rtol=1e-8, atol=1e-9)


def test_a_bank_of_windows_equals_a_loop_whatever_is_stacked():
    c, gain = problem()
    other = replace(c.record, y=c.record.y[::-1].copy())
    priors = [c.prior, Prior(np.ones(3), np.eye(3))]
    for own in (None, Prior(np.ones(3), 2 * np.eye(3))):
        algorithms = [
            MovingWindow(gain, LENGTH, state_prior=own),
            MovingWindow(replace(gain, walk=0.3), LENGTH, state_prior=own),
        ]
        bank = estimate_bank(stack(algorithms), stack([c.record, other]), prior=stack(priors))
        for i, (algorithm, record, prior) in enumerate(zip(algorithms, (c.record, other), priors, strict=True)):
            alone = estimate(algorithm, record, prior=prior)
            assert_allclose(bank[i].gain, alone.gain, rtol=1e-10, atol=1e-11)
            assert_allclose(bank[i].covariance, alone.covariance, rtol=1e-10, atol=1e-11)
    shared = estimate_bank(algorithms[0], stack([c.record, other]), prior=c.prior, keep="means")
    assert_allclose(shared[1].gain, estimate(algorithms[0], other, prior=c.prior).gain, rtol=1e-10, atol=1e-11)
    assert shared.covariance is None


def test_a_window_as_long_as_the_record_is_the_whole_record_at_its_end():
    c, gain = problem()
    own = c.prior
    window = estimate(MovingWindow(gain, len(c.record), state_prior=own), c.record, prior=c.prior)
    assert_allclose(window.gain, estimate(gain, c.record, prior=c.prior).gain, rtol=1e-10)


def test_a_window_of_one_sample_has_forgotten_all_others():
    c = case(2, (1, 1, 1), missing=0.0)
    own = Prior([0.0], [[4.0]])
    ones = estimate(MovingWindow(Kalman(c.model), 1, state_prior=own), c.record, prior=c.prior)
    for k in (0, 5):
        alone = estimate(Kalman(c.model), c.record[k : k + 1], prior=own)
        assert_allclose(ones.mean[k], alone.mean[0], rtol=1e-12)


def independent(outputs, missing, walk=0.1):
    """A record of some blocks, with an output noise that the scan of windows can take, and a filter of three unknowns."""
    c = case(7, (2, 1, outputs), T=41, missing=missing)
    model = replace(c.model, R=np.diag([0.2, 0.5][:outputs]))
    return c, UnknownGain(model, Prior([0.7], [[0.4]]), walk=walk)


def counted(monkeypatch):
    """How many windows are run one by one from here on."""
    again, rerun = [], windows._rerun

    def count(*arguments):
        again.append(arguments[-1].shape[1])
        return rerun(*arguments)

    monkeypatch.setattr(windows, "_rerun", count)
    return again


@pytest.mark.parametrize("own", [None, Prior([1.0, -1.0], 2 * np.eye(2))], ids=["diffuse", "proper"])
@pytest.mark.parametrize(("outputs", "missing"), [(2, 0.0), (1, 0.5)])
def test_the_scan_of_windows_says_what_each_window_says(monkeypatch, outputs, missing, own):
    c, gain = independent(outputs, missing)
    window, again = MovingWindow(gain, 7, state_prior=own), counted(monkeypatch)
    scanned = estimate(window, c.record, prior=c.prior)
    assert scanned.engine == "native"
    left = sum(again)  # windows that stay undetermined: some where half is missing and nothing is known before
    assert left == 0 if own is not None or not missing else 0 < left < 20
    monkeypatch.setattr(window_scan, "fits", lambda algorithm: False)
    alone = estimate(window, c.record, prior=c.prior, engine="native")
    assert sum(again) == left + 41 - 6
    for name in (*FIELDS, "diffuse_covariance"):
        said, expected = getattr(scanned, name), getattr(alone, name)
        if expected is not None:
            assert_allclose(said, expected, rtol=1e-11, atol=1e-12)
    assert_allclose(scanned.log_likelihood, alone.log_likelihood, rtol=1e-11)


def test_the_scan_of_windows_says_what_online_copies_say(monkeypatch):
    c, gain = independent(2, 0.3)
    window, again = MovingWindow(gain, 7), counted(monkeypatch)
    begin = Prior(np.zeros(2), np.zeros((2, 2)), diffuse=np.eye(2)[:, :1])
    whole = estimate(window, c.record, prior=begin)
    assert sum(again) < 5
    running = online(window, prior=begin)
    for k in range(len(c.record)):
        info = running.correct(c.record.y[k], c.record.u[k])
        for name in ("mean", "covariance", "gain", "gain_covariance"):
            assert_allclose(getattr(info, name), getattr(whole, name)[k], rtol=1e-11, atol=1e-12)
        running.predict(c.record.u[k])
    for keep, rows in (("means", slice(None)), ("last", slice(-1, None))):
        some = estimate(window, c.record, prior=begin, keep=keep)
        assert_allclose(some.gain, whole.gain[rows], rtol=1e-12)
        assert_allclose(some.log_likelihood, whole.log_likelihood, rtol=1e-12)
    assert some.covariance is not None


def test_a_scan_of_many_windows_equals_a_loop_over_the_runs(monkeypatch):
    monkeypatch.setattr(window_scan, "AT_ONCE", 2)
    c, gain = independent(2, 0.3)
    _, other = independent(2, 0.3, walk=0.3)
    records = [replace(c.record, y=np.roll(c.record.y, i, axis=0)) for i in range(3)]
    filters, priors = (gain, other, gain), [c.prior, Prior(np.ones(2), np.eye(2)), c.prior]
    algorithms = [MovingWindow(one, 7) for one in filters]
    bank = estimate_bank(stack(algorithms), stack(records), prior=stack(priors))
    for i, (algorithm, record, prior) in enumerate(zip(algorithms, records, priors, strict=True)):
        alone = estimate(algorithm, record, prior=prior)
        for name in FIELDS:
            assert_allclose(getattr(bank[i], name), getattr(alone, name), rtol=1e-11, atol=1e-12)


def test_xla_scans_the_windows_of_many_runs_as_machine_code_does(monkeypatch):
    monkeypatch.setattr(window_scan, "AT_ONCE", 2)
    model, rng = StateSpace([[0.9]], C=[[1.0]], Q=[[0.1]], R=[[1.0]], dt=1), np.random.default_rng(0)
    y = np.where(rng.random((5, 11, 1)) < 0.2, np.nan, rng.normal(size=(5, 11, 1)))
    window, records = MovingWindow(Kalman(model), 3), stack([Record(run, dt=1) for run in y])
    native, xla = (
        estimate_bank(window, records, prior=Prior([0.0], [[1.0]]), engine=engine) for engine in ("native", "xla")
    )
    for field in ("mean", "covariance", "innovation", "log_likelihood"):
        assert_allclose(getattr(xla, field), getattr(native, field), rtol=1e-10, atol=1e-12)
    assert xla.engine == "xla"


def test_bounds_clip_the_reported_gain_and_nothing_else():
    c, gain = problem()
    free, bounded = (estimate(a, c.record, prior=c.prior) for a in (gain, Bounded(gain, [0.5, 0.0], 0.6)))
    assert_allclose(bounded.gain, np.clip(free.gain, [0.5, 0.0], 0.6))
    assert (bounded.gain != free.gain).any()
    for name in ("mean", "covariance", "gain_covariance", "log_likelihood_steps"):
        assert_allclose(getattr(bounded, name), getattr(free, name), rtol=1e-12)


def test_the_average_is_the_recursion_of_the_thesis_from_the_prior_mean():
    c, gain = problem()
    free, calm = (estimate(a, c.record, prior=c.prior) for a in (gain, Smoothed(gain, [0.9, 0.0])))
    average = np.array([0.7, 0.2])
    for k in range(len(c.record)):
        average = np.array([0.9, 0.0]) * average + np.array([0.1, 1.0]) * free.gain[k]  # (85)
        assert_allclose(calm.gain[k], average, rtol=1e-12)
    assert_allclose(calm.gain_covariance, free.gain_covariance, rtol=1e-12)


def test_the_chain_of_the_thesis_is_its_parts_one_after_the_other():
    c, gain = problem()
    window = MovingWindow(gain, LENGTH)
    chain = estimate(Smoothed(Bounded(window, 0.0, 1.0), 0.7), c.record, prior=c.prior)
    raw, average = estimate(window, c.record, prior=c.prior).gain, np.array([0.7, 0.2])
    for k in range(len(c.record)):
        average = 0.7 * average + 0.3 * np.clip(raw[k], 0.0, 1.0)
        assert_allclose(chain.gain[k], average, rtol=1e-10, atol=1e-12)
    assert chain.engine == "native"


def test_a_gate_is_the_filter_with_the_incredible_samples_deleted():
    c = case(3, (3, 2, 2), missing=0.1)
    gated = estimate(Gated(Kalman(c.model), 0.5), c.record, prior=c.prior)
    rejected = gated.extra["rejected"]
    assert 3 < rejected.sum() < 15
    kept = replace(c.record, y=np.where(rejected, np.nan, c.record.y))
    plain = estimate(Kalman(c.model), kept, prior=c.prior)
    assert_allclose(gated.mean, plain.mean, rtol=1e-12)
    assert_allclose(gated.log_likelihood, plain.log_likelihood, rtol=1e-12)
    all_seen = estimate(Kalman(c.model), c.record, prior=c.prior)
    assert_allclose(  # at the first row, where both know the same
        rejected[0], all_seen.innovation[0] ** 2 > 0.454936423 * np.diag(all_seen.innovation_covariance[0])
    )


def test_a_gate_loses_as_many_good_samples_as_stated():
    model = StateSpace([[0.9]], C=[[1.0], [1.0]], Q=[[0.1]], R=np.eye(2), dt=1)
    rng, x, y = np.random.default_rng(0), 0.0, np.zeros((5000, 2))
    for k in range(5000):
        y[k], x = x + rng.normal(size=2), 0.9 * x + np.sqrt(0.1) * rng.normal()
    gated = estimate(Gated(Kalman(model), 0.98), Record(y, dt=1), prior=Prior([0.0], [[0.0]]))
    lost = gated.extra["rejected"].mean(axis=0)
    assert (np.abs(lost - 0.02) < 4 * np.sqrt(0.02 / 5000)).all()


def test_a_gate_lets_pass_what_was_predicted_from_nothing():
    model = StateSpace([[1.0]], C=[[1.0]], Q=[[0.0]], R=[[1.0]], dt=1)
    diffuse = Prior([0.0], [[0.0]], diffuse=[[1.0]])
    gated = estimate(Gated(Kalman(model), 0.9), Record([1e6, 1e6], dt=1), prior=diffuse)
    assert not gated.extra["rejected"].any()
    assert_allclose(gated.mean, 1e6)
