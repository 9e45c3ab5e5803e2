"""Outputs and parameters as one belief: against its covariance written out, and what it reaches over many draws."""

import numpy as np
import pytest
from benchmarks.figures import sparse_outputs
from numpy.testing import assert_allclose
from scipy.stats import chi2

import estimable as es
from estimable import (
    BernoulliLink,
    InputError,
    JointOutputError,
    OutputError,
    Prior,
    Record,
    estimate_bank,
    identify,
    online,
)
from estimable.frozen import replace
from oracles.joint_output_error import joint_recursion

PLANT = OutputError([0.523, 0.349], [0.440, 0.762], noise_variance=0.1, dt=1)  # Fang (2009), §3.5
UNIT = Prior(np.zeros(4), np.eye(4))
FIRST_ORDER = OutputError([-0.6], [1.0], noise_variance=0.1, dt=1)
DRAWS = 200


def lossy(plant=PLANT, rows=200, seed=1, acknowledged=True, **given):
    u = np.random.default_rng(seed).uniform(-np.sqrt(3), np.sqrt(3), rows)
    to = BernoulliLink(0.8, acknowledged=acknowledged)
    return es.simulate(plant, u, seed=seed, input_link=to, output_link=BernoulliLink(0.7), **given).record


def joint(**given):
    return JointOutputError(2, 1, noise_variance=0.1, **{"prior": UNIT, "alarm": 100.0, **given})


def small(**given):
    return JointOutputError(1, 0, noise_variance=0.1, **{"prior": Prior(np.zeros(2), np.eye(2)), **given})


def bank(rows, input_arrival, output_arrival, known=True, noise=0.1):
    """Many draws, of the input too; sent (B, T), applied and measured."""
    rng = np.random.default_rng(7)
    sent = rng.uniform(-np.sqrt(3), np.sqrt(3), (DRAWS, rows))
    came = rng.random((DRAWS, rows)) < input_arrival
    y = np.stack([PLANT.response(row)[:, 0] for row in sent * came]) + rng.normal(0, np.sqrt(noise), (DRAWS, rows))
    y[rng.random((DRAWS, rows)) >= output_arrival] = np.nan
    fates = (came if known else np.full(came.shape, np.nan)).astype(float)
    first = Record(y[0], sent[0], dt=1, arrived=fates[0])
    times = np.broadcast_to(first.t, (DRAWS, rows))
    return es.results.Stacked(
        replace(first, y=y[..., None], u=sent[..., None], t=times, arrived=fates[..., None]), DRAWS
    )


def judged(run):
    """Median relative error, and whether the squared errors are as large as the covariances say (99.9 %)."""
    error, covariance = run.mean[:, -1] - PLANT.parameters, run.covariance[:, -1]
    nees = np.einsum("bi,bij,bj->b", error, np.linalg.inv(covariance), error).mean()
    lower, upper = chi2.ppf([0.0005, 0.9995], error.size) / len(error)
    relative = np.linalg.norm(error, axis=1) / np.linalg.norm(PLANT.parameters)
    return np.median(relative), relative.max(), lower < nees < upper


@pytest.mark.parametrize("prior", [UNIT, Prior(np.zeros(4), 1e6 * np.eye(4))], ids=["fair", "vague"])
@pytest.mark.parametrize(
    ("rows", "input_arrival", "output_arrival", "reached"), [(1000, 0.8, 0.7, 0.026), (5000, 0.4, 0.2, 0.032)]
)
def test_no_draw_locks_and_the_covariance_is_right(rows, input_arrival, output_arrival, reached, prior):
    method = JointOutputError(2, 1, noise_variance=0.1, prior=prior)
    run = estimate_bank(method, bank(rows, input_arrival, output_arrival), prior=None, keep="last")
    median, largest, consistent = judged(run)
    assert median <= reached
    assert largest < 0.15
    assert consistent


def test_it_is_the_belief_written_out():
    record = lossy()
    path = identify(joint(), record).path
    θ, P, x, S = joint_recursion(record.y[:, 0], record.applied()[:, 0], 2, 1, 0.1, np.zeros(4), np.eye(4))
    assert_allclose(path.mean, θ, rtol=1e-9, atol=1e-11)
    assert_allclose(path.covariance, P, rtol=1e-8, atol=1e-12)
    seen = record.seen[:, 0]
    assert_allclose(path.innovation[seen, 0], (record.y[:, 0] - x)[seen], rtol=1e-9, atol=1e-10)
    assert_allclose(path.innovation_covariance[:, 0, 0], S, rtol=1e-9)


@pytest.mark.parametrize("lost", ["zero", "hold"])
def test_it_is_the_belief_written_out_with_inputs_of_unknown_fate(lost):
    record = lossy(FIRST_ORDER, rows=60, lost=lost)
    half = replace(record, arrived=np.where(np.arange(60)[:, None] % 2, record.arrived, np.nan))
    path = identify(small(arrival=0.8, lost=lost), half).path
    θ, P, _, S = joint_recursion(
        record.y[:, 0], record.u[:, 0], 1, 0, 0.1, np.zeros(2), np.eye(2), half.arrived[:, 0], 0.8, lost
    )
    assert_allclose(path.mean, θ, rtol=1e-9, atol=1e-11)
    assert_allclose(path.covariance, P, rtol=1e-8, atol=1e-12)
    assert_allclose(path.innovation_covariance[:, 0, 0], S, rtol=1e-9)


@pytest.mark.parametrize("lost", ["zero", "hold"])
def test_a_second_record_resumes_whatever_the_actuator_does_without_a_packet(lost):
    record = lossy(FIRST_ORDER, rows=60, lost=lost)
    unknown = replace(record, arrived=np.where(np.arange(60)[:, None] % 2, record.arrived, np.nan))
    one, two = (identify(small(arrival=0.8, lost=lost), [unknown] * count) for count in (1, 2))
    assert np.all(two.sigma < one.sigma)
    other = "hold" if lost == "zero" else "zero"
    with pytest.raises(InputError, match=f'`lost` of the record is "{lost}", that of JointOutputError "{other}"'):
        identify(small(arrival=0.8, lost=other), [unknown] * 2)


def test_fates_that_are_told_are_not_guessed():
    record = lossy(FIRST_ORDER, rows=60)
    assert_allclose(identify(small(arrival=0.8), record).parameters, identify(small(), record).parameters, rtol=1e-9)


def test_fates_that_nobody_tells_leave_an_estimate_without_bias():
    method = JointOutputError(2, 1, noise_variance=0.1, prior=UNIT, arrival=0.8)
    run = estimate_bank(method, bank(1000, 0.8, 0.9, known=False), prior=None, keep="last")
    median, largest, consistent = judged(run)
    assert median < 0.04  # with known fates .019; the expected input in their place, as if exact, .13
    assert largest < 0.15
    assert consistent
    error = run.mean[:, -1] - PLANT.parameters
    assert np.all(np.abs(error.mean(axis=0)) < 3.5 * error.std(axis=0) / np.sqrt(DRAWS))


def test_a_plant_that_jumps_is_found_again_within_twenty_samples():
    u = np.random.default_rng(3).uniform(-1.7, 1.7, 400)
    changed = OutputError([-0.5, 0.2], [0.9, -0.3], noise_variance=0.01, dt=1)
    before = OutputError([0.523, 0.349], [0.440, 0.762], noise_variance=0.01, dt=1)
    y = np.concatenate([before.response(u)[:200], changed.response(u)[200:]])[:, 0]
    y += 0.1 * np.random.default_rng(4).normal(size=400)
    path = identify(JointOutputError(2, 1, noise_variance=0.01, prior=UNIT, jump=1.0), Record(y, u, dt=1)).path
    alarms = np.flatnonzero(path.extra["alarm"][:, 0])
    assert len(alarms) >= 1
    assert 200 <= alarms[0] < 210
    assert np.linalg.norm(path.mean[220] - changed.parameters) < 0.3
    assert np.all(np.abs(path.mean[-1] - changed.parameters) < 4 * np.sqrt(np.diagonal(path.covariance[-1])))


def test_online_equals_offline():
    for method, acknowledged in ((small(), True), (small(arrival=0.8), False)):
        record = lossy(FIRST_ORDER, rows=25, acknowledged=acknowledged)
        path, running = identify(method, record).path, online(method, prior=None)
        for k in range(25):
            info = running.correct(record.y[k], record.u[k], arrived=record.arrived[k])
            assert_allclose(info.mean, path.mean[k], rtol=1e-10, atol=1e-12)
            running.predict(record.u[k], arrived=record.arrived[k] if acknowledged else None)


def test_engines_agree():
    native, xla = (identify(small(), lossy(FIRST_ORDER), engine=engine) for engine in ("native", "xla"))
    assert (native.engine, xla.engine) == ("native", "xla")
    assert_allclose(native.parameters, xla.parameters, rtol=1e-9)
    assert_allclose(native.covariance, xla.covariance, rtol=1e-8, atol=1e-14)


def test_outputs_are_identified_as_if_alone():
    plant = OutputError([[0.5], [-0.7]], [[[0.4], [0.1]], [[1.0], [0.2]]], delay=1, noise_variance=[0.1, 0.2], dt=0.5)
    u = np.random.default_rng(0).normal(size=(300, 2))
    record = es.simulate(plant, u, seed=2, output_link=BernoulliLink([0.7, 0.5])).record
    both = identify(JointOutputError(1, 0, delay=1, noise_variance=[0.1, 0.2]), record)
    single = replace(record, y=record.y[:, 1:], outputs=record.outputs[1:])
    alone = identify(JointOutputError(1, 0, delay=1, noise_variance=0.2), single)
    assert_allclose(both.parameters[3:], alone.parameters, rtol=1e-8)
    assert np.all(np.abs(both.parameters - plant.parameters) < 4 * both.sigma)


def test_nothing_seen_leaves_what_was_believed_and_finite_numbers():
    record = Record(np.full(3000, np.nan), np.ones(3000), dt=1)
    path = identify(joint(), record).path
    assert_allclose(path.mean[-1], 0.0, atol=1e-12)
    assert_allclose(path.covariance[-1], np.eye(4), atol=1e-9)
    assert np.all(np.isfinite(path.extra["output"]))


def test_a_prior_without_doubt_stays():
    known = Prior(PLANT.parameters, np.zeros((4, 4)))
    fit = identify(joint(prior=known), lossy())
    assert_allclose(fit.parameters, PLANT.parameters, atol=1e-15)
    assert np.all(fit.covariance == 0)


def test_two_records_are_one_experiment_that_starts_anew():
    both = identify(small(), [lossy(FIRST_ORDER), lossy(FIRST_ORDER, seed=5)])
    assert np.all(both.sigma < identify(small(), lossy(FIRST_ORDER)).sigma)
    assert np.all(np.abs(both.parameters - FIRST_ORDER.parameters) < 4 * both.sigma)


def test_a_constant_alone_and_no_past_output():
    record = Record([2.0, np.nan, 2.2], [1.0, 1.0, 1.0], dt=1)
    fit = identify(JointOutputError(0, 0, noise_variance=0.5, prior=Prior([0.0], [[2.0]])), record)
    assert_allclose(fit.parameters, [(4.2 / 0.5) / (1 / 2 + 2 / 0.5)])


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"arrival": 1.2}, "`arrival` must be rates, greater than 0 and at most 1"),
        ({"jump": -1.0}, "`jump` must be"),
        ({"lost": "keep"}, "`lost` must be"),
        ({"prior": Prior([0.0], [[1.0]])}, "`prior` must describe θ"),
    ],
)
def test_wrong_settings_are_refused(given, sentence):
    with pytest.raises(es.InputError, match=sentence):
        joint(**given)


def test_the_actuator_without_packets_must_be_the_same():
    with pytest.raises(es.InputError, match=r'`lost` of the record is "hold"'):
        identify(joint(arrival=0.8), lossy(rows=60, lost="hold"))


def test_it_is_saved_and_goes_on(tmp_path):
    record, running = lossy(FIRST_ORDER, rows=25), online(small(), prior=None)
    for k in range(24):
        running.correct(record.y[k], record.u[k], arrived=record.arrived[k])
        running.predict(record.u[k], arrived=record.arrived[k])
    running.save(tmp_path / "run.npz")
    resumed = es.load(tmp_path / "run.npz")
    told = [one.correct(record.y[24], record.u[24], arrived=record.arrived[24]) for one in (running, resumed)]
    assert_allclose(told[0].mean, told[1].mean, rtol=0, atol=0)


@pytest.mark.parametrize("every", [2, 5, 0], ids=["every 2nd", "every 5th", "random 10 %"])
def test_sparse_outputs_are_learnt_from_without_a_prior(every):
    errors, z, passed = zip(*(sparse_outputs.found(seed, "poles -.26+-.53i", every) for seed in range(4)), strict=True)
    assert np.median(errors) < 0.05
    assert max(z) < 4
    assert all(passed)


def test_the_weights_are_those_of_the_members_likelihoods():
    """The mixture against its members run one by one: each with its own prior."""
    record = lossy(FIRST_ORDER, rows=40)
    whole = identify(JointOutputError(1, 0, noise_variance=0.1, alarm=100.0), record)
    mean, P = JointOutputError(1, 0, noise_variance=0.1)._members()
    alone = [
        identify(JointOutputError(1, 0, noise_variance=0.1, alarm=100.0, prior=Prior(m, C)), record)
        for m, C in zip(np.asarray(mean[0]), np.asarray(P[0]), strict=True)
    ]
    logs = np.array([one.log_likelihood for one in alone])
    w = np.exp(logs - logs.max()) / np.exp(logs - logs.max()).sum()
    θ = np.array([one.parameters for one in alone])
    assert_allclose(whole.parameters, w @ θ, rtol=0.02, atol=0.01)


def test_few_rows_are_said_not_to_suffice():
    record, r = sparse_outputs.drawn(0, "poles -.26+-.53i", 0, rows=1000)
    fit = identify(JointOutputError(2, 1, noise_variance=r), record)
    (check,) = (one for one in fit.validation.checks if one.name == "belief")
    assert not fit.validation.passed
    assert "rows were seen for 4 parameters" in check.sentence
    assert "use OutputErrorML" in check.sentence
