"""The recursion on incomplete data: against a textbook version, and what it reaches over many draws."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import chi2

import estimable as es
from estimable import BernoulliLink, OutputError, Prior, Record, RecursiveOutputError, estimate_bank, identify, online
from estimable.frozen import replace
from oracles.auxiliary_model import printed_recursion

PLANT = OutputError([0.523, 0.349], [0.440, 0.762], noise_variance=0.1, dt=1)  # Fang (2009), §3.5
OTHERS = {
    "slow": OutputError([-1.5, 0.7], [1.0, 0.5], noise_variance=0.5, dt=1),
    "resonant, not positive real": OutputError([-1.6, 0.9], [0.5, 0.3], noise_variance=1.0, dt=1),
    "in other units": OutputError([0.523, 0.349], [440.0, 762.0], noise_variance=1e5, dt=1),
    "loud": OutputError([0.523, 0.349], [0.440, 0.762], noise_variance=1.0, dt=1),
}
DRAWS = 400


def uniform(rows, seed=0):
    return np.random.default_rng(seed).uniform(-np.sqrt(3), np.sqrt(3), rows)


def lossy(plant, rows, seed=1, u_seed=0, input_arrival=0.8, output_arrival=0.7):
    links = {"input_link": BernoulliLink(input_arrival), "output_link": BernoulliLink(output_arrival)}
    return es.simulate(plant, uniform(rows, u_seed), seed=seed, **links)


def errors(plant, rows, variance, input_arrival, output_arrival):
    """Error (B, d) and reported covariance (B, d, d) of many draws, of the input too."""
    rng = np.random.default_rng(7)
    u = rng.uniform(-np.sqrt(3), np.sqrt(3), (DRAWS, rows)) * (rng.random((DRAWS, rows)) < input_arrival)
    y = np.stack([plant.response(row)[:, 0] for row in u]) + rng.normal(0, np.sqrt(plant.noise_variance), (DRAWS, rows))
    y[rng.random((DRAWS, rows)) >= output_arrival] = np.nan
    first = Record(y[0], u[0], dt=1)
    times = np.broadcast_to(first.t, (DRAWS, rows))
    bank = es.results.Stacked(replace(first, y=y[..., None], u=u[..., None], t=times), DRAWS)
    method = RecursiveOutputError(
        2, 1, noise_variance=plant.noise_variance, prior=Prior(np.zeros(4), variance * np.eye(4))
    )
    run = estimate_bank(method, bank, prior=None, keep="last")
    return run.mean[:, -1] - plant.parameters, run.covariance[:, -1]


def consistent(error, covariance):
    nees = np.einsum("bi,bij,bj->b", error, np.linalg.inv(covariance), error).mean()
    lower, upper = chi2.ppf([0.0005, 0.9995], error.size) / len(error)
    return lower < nees < upper


@pytest.mark.parametrize("variance", [1.0, 1e6])
@pytest.mark.parametrize(
    ("rows", "input_arrival", "output_arrival", "reached"), [(1000, 0.8, 0.7, 0.032), (5000, 0.4, 0.2, 0.036)]
)
def test_a_vague_prior_is_as_good_as_a_fair_one_in_the_examples(rows, input_arrival, output_arrival, reached, variance):
    error, covariance = errors(PLANT, rows, variance, input_arrival, output_arrival)
    relative = np.linalg.norm(error, axis=1) / np.linalg.norm(PLANT.parameters)
    assert np.median(relative) <= reached
    assert np.mean(relative > 0.15) <= 0.01
    assert consistent(error, covariance)


@pytest.mark.parametrize("variance", [1.0, 1e6])
@pytest.mark.parametrize("plant", OTHERS.values(), ids=OTHERS)
def test_its_constants_suit_other_plants_noises_and_units(plant, variance):
    error, covariance = errors(plant, 3000 if plant is OTHERS["loud"] else 1000, variance, 0.8, 0.7)
    assert consistent(error, covariance)


def test_the_printed_recursion_is_that_of_the_source():
    record = lossy(PLANT, 200).record
    method = RecursiveOutputError(2, 1, noise_variance=0.1, method="printed", prior=Prior(np.zeros(4), np.eye(4)))
    path = identify(method, record).path
    θ, z, x = printed_recursion(record.y[:, 0], record.applied()[:, 0], 2, 1, 0.1, np.eye(4))
    assert_allclose(path.mean, θ, rtol=1e-9, atol=1e-12)
    assert_allclose(path.extra["completed"][:, 0], z, rtol=1e-9, atol=1e-12)
    assert_allclose(path.extra["output"][:, 0], x, rtol=1e-9, atol=1e-12)


def test_online_equals_offline():
    record = lossy(PLANT, 60).record
    method = RecursiveOutputError(2, 1, noise_variance=0.1)
    path, running = identify(method, record).path, online(method, prior=None)
    for k in range(60):
        info = running.correct(record.y[k], record.u[k], arrived=record.arrived[k])
        assert_allclose(info.mean, path.mean[k], rtol=1e-10, atol=1e-12)
        running.predict(record.u[k], arrived=record.arrived[k])
    assert running.engine == "native"
    with pytest.raises(es.InputError, match="`u` must be given to correct"):
        running.correct([1.0])


def test_engines_agree():
    record = lossy(PLANT, 300).record
    method = RecursiveOutputError(2, 1, noise_variance=0.1)
    native, xla = (identify(method, record, engine=engine) for engine in ("native", "xla"))
    assert (native.engine, xla.engine) == ("native", "xla")
    assert_allclose(native.parameters, xla.parameters, rtol=1e-9)
    assert_allclose(native.covariance, xla.covariance, rtol=1e-8, atol=1e-14)


def test_outputs_are_identified_as_if_alone_and_lose_packets_one_by_one():
    plant = OutputError(
        [[0.523, 0.349], [-0.7, 0.1]], [[[0.44, 0.762], [0.1, 0.2]], [[1.0, 0.3], [0.2, -0.5]]], delay=1,
        noise_variance=[0.1, 0.2], dt=0.5,
    )  # fmt: skip
    u = np.random.default_rng(0).normal(size=(600, 2))
    links = {"input_link": BernoulliLink([0.8, 0.9]), "output_link": BernoulliLink([0.7, 0.5])}
    record = es.simulate(plant, u, seed=2, lost="hold", **links).record
    both = identify(RecursiveOutputError(2, 1, delay=1, noise_variance=[0.1, 0.2]), record)
    for i, rows in enumerate((slice(0, 6), slice(6, 12))):
        single = replace(record, y=record.y[:, i : i + 1], outputs=record.outputs[i : i + 1])
        alone = identify(RecursiveOutputError(2, 1, delay=1, noise_variance=plant.noise_variance[i]), single)
        assert_allclose(both.parameters[rows], alone.parameters, rtol=1e-10)
        assert_allclose(both.covariance[rows, rows], alone.covariance, rtol=1e-9, atol=1e-14)
    assert np.all(np.abs(both.parameters - plant.parameters) < 4 * both.sigma)


def test_a_row_of_nothing_changes_nothing_but_time():
    record = lossy(PLANT, 50).record
    seen = np.flatnonzero(record.seen[:, 0])
    path = identify(RecursiveOutputError(2, 1, noise_variance=0.1), record).path
    moved = np.flatnonzero(np.any(np.diff(path.mean, axis=0) != 0, axis=1)) + 1
    assert set(moved) <= set(seen)


def test_a_prior_without_doubt_stays():
    known = Prior(PLANT.parameters, np.zeros((4, 4)))
    fit = identify(RecursiveOutputError(2, 1, noise_variance=0.1, prior=known), lossy(PLANT, 100).record)
    assert_allclose(fit.parameters, PLANT.parameters, atol=1e-15)
    assert np.all(fit.covariance == 0)


def test_a_tight_prior_that_is_right_is_kept():
    near = Prior(PLANT.parameters, 1e-6 * np.eye(4))
    fit = identify(RecursiveOutputError(2, 1, noise_variance=0.1, prior=near), lossy(PLANT, 300).record)
    assert np.all(np.abs(fit.parameters - PLANT.parameters) < 4e-3)
    assert np.all(fit.sigma < 1.1e-3)


def test_two_records_are_one_experiment_that_starts_anew():
    record = lossy(PLANT, 800).record
    method = RecursiveOutputError(2, 1, noise_variance=0.1)
    both = identify(method, [record, lossy(PLANT, 800, seed=5, u_seed=3).record])
    alone = identify(method, record)
    assert np.all(both.sigma < alone.sigma)
    assert np.all(np.abs(both.parameters - PLANT.parameters) < 4 * both.sigma)


def test_a_plant_that_jumps_is_followed():
    before, after = lossy(PLANT, 1500).record, OutputError([-0.5, 0.3], [1.0, 0.2], noise_variance=0.1, dt=1)
    jumped = lossy(after, 1500, seed=4, u_seed=2).record
    record = Record(
        np.concatenate([before.y, jumped.y]), np.concatenate([before.u, jumped.u]), dt=1,
        arrived=np.concatenate([before.arrived, jumped.arrived]),
    )  # fmt: skip
    fit = identify(RecursiveOutputError(2, 1, noise_variance=0.1), record)
    assert np.linalg.norm(fit.parameters - after.parameters) < 0.1 * np.linalg.norm(after.parameters)


@pytest.mark.parametrize("rows", [1, 3])
def test_fewer_samples_than_parameters_leave_directions_undetermined_and_say_so(rows):
    fit = identify(RecursiveOutputError(2, 1, noise_variance=0.1), lossy(PLANT, 40).record[:rows])
    assert fit.undetermined.shape[1] >= 4 - rows
    assert not fit.validation.passed
    assert "carry no information about" in fit.validation.sentences[0]
    assert np.all(np.isfinite(fit.parameters))


def test_all_outputs_lost_leaves_the_prior_and_says_so():
    blind = Record(np.full(20, np.nan), uniform(20), dt=1)
    fit = identify(RecursiveOutputError(2, 1, noise_variance=0.1), blind)
    assert np.all(fit.parameters == 0)
    assert fit.undetermined.shape == (4, 4)
    assert "no output was seen" in " ".join(fit.validation.sentences)


def test_a_constant_input_does_not_let_the_covariance_grow_beyond_the_prior():
    still = Record(np.random.default_rng(0).normal(size=3000), np.zeros(3000), dt=1)
    prior = Prior(np.zeros(4), np.eye(4))
    fit = identify(RecursiveOutputError(2, 1, noise_variance=1.0, prior=prior), still)
    assert np.all(np.linalg.eigvalsh(fit.covariance) <= 1 + 1e-9)
    assert fit.undetermined.shape == (4, 4)
