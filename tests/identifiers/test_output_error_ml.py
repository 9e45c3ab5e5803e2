"""Maximum likelihood on incomplete records: efficient, exact derivatives, several records, plants in motion."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

import estimable as es
from estimable import (
    BernoulliLink,
    GilbertElliottLink,
    InputError,
    OutputError,
    OutputErrorML,
    Record,
    diagnostics,
    identify,
)
from estimable.frozen import replace
from estimable.kernels import output_error_response as kernel

PLANT = OutputError([0.523, 0.349], [0.440, 0.762], noise_variance=0.1, dt=1)  # Fang (2009), §3.5
DRAWS = 40  # of the 200 that the reproduction has


def uniform(rows, seed=0):
    return np.random.default_rng(seed).uniform(-np.sqrt(3), np.sqrt(3), rows)


def lossy(rows=1000, seed=1, inputs=0.8, outputs=0.7, plant=PLANT):
    links = {"input_link": BernoulliLink(inputs), "output_link": BernoulliLink(outputs)}
    return es.simulate(plant, uniform(rows, seed), seed=seed, **links).record


@pytest.mark.parametrize("link", [lambda rate: BernoulliLink(rate), lambda rate: GilbertElliottLink.of_rate(rate, burst=4)],
                         ids=["independent", "bursts"])  # fmt: skip
def test_it_is_as_good_as_the_information_in_what_arrived(link):
    likely, efficient = [], []
    for i in range(DRAWS):
        record = es.simulate(PLANT, uniform(1000, i), seed=i, input_link=link(0.8), output_link=link(0.7)).record
        likely.append(OutputErrorML(2, 1).fit([record]).parameters - PLANT.parameters)
        efficient.append(diagnostics.efficient_estimate(PLANT, record) - PLANT.parameters)
    assert np.sum(np.square(likely)) / np.sum(np.square(efficient)) <= 1.03


def test_its_derivatives_are_those_of_jax():
    rng = np.random.default_rng(0)
    u, θ, delay = rng.normal(size=(30, 2)), np.array([-0.5, 0.3, 1.0, 0.5, -0.2, 0.7]), 1

    def response(θ):
        def step(past, row):
            x, lags = past
            lags = jnp.concatenate([row[None], lags[:-1]])
            now = -jnp.sum(θ[:2] * x) + jnp.sum(θ[2:].reshape(2, 2) * lags[delay:].T)
            return (jnp.concatenate([now[None], x[:-1]]), lags), now

        return jax.lax.scan(step, (jnp.zeros(2), jnp.zeros((3, 2))), jnp.asarray(u))[1]

    a, b = θ[:2], θ[2:].reshape(2, 2)
    x = kernel.response(a, b, delay, u)
    assert_allclose(x, response(jnp.asarray(θ)), atol=1e-13)
    assert_allclose(kernel.slopes(a, b, delay, u, x), jax.jacfwd(response)(jnp.asarray(θ)), atol=1e-12)


def test_a_lost_output_is_a_deleted_one():
    record = lossy(200)
    gone = np.flatnonzero(~record.seen[:, 0])
    other = replace(record, y=np.where(record.seen, record.y, np.nan))
    assert len(gone) > 20
    assert_allclose(
        OutputErrorML(2, 1).fit([other]).parameters, OutputErrorML(2, 1).fit([record]).parameters, rtol=1e-12
    )


def test_identify_starts_it_from_the_recursion_too_and_ends_in_the_same_place():
    record = lossy()
    assert_allclose(
        identify(OutputErrorML(2, 1), record).parameters, OutputErrorML(2, 1).fit([record]).parameters, rtol=1e-6
    )


def test_it_reports_the_covariance_and_the_noise_that_there_are():
    fit = identify(OutputErrorML(2, 1), lossy(3000))
    assert np.all(np.abs(fit.parameters - PLANT.parameters) < 4 * fit.sigma)
    assert_allclose(fit.covariance, diagnostics.cramer_rao(PLANT, lossy(3000)), rtol=0.4, atol=2e-5)
    assert abs(fit.model.noise_variance[0] - 0.1) < 0.015
    assert fit.validation.passed


def test_two_records_tell_what_both_tell():
    records = [lossy(400, 2), lossy(600, 3)]
    fit = identify(OutputErrorML(2, 1, noise_variance=0.1, level="none", initial="rest"), records)
    M = sum(diagnostics.information(fit.model, record) for record in records)
    assert_allclose(fit.covariance, np.linalg.inv(M), rtol=1e-6)
    assert [e.shape for e in fit.validation.residuals] == [(400, 1), (600, 1)]


def test_a_plant_in_motion_needs_a_free_start():
    slow = OutputError([-1.6, 0.8], [0.4, 0.2], noise_variance=0.01, dt=1)
    cut = es.simulate(slow, uniform(160), seed=3).record[60:]
    free, rest = (
        identify(OutputErrorML(2, 1, noise_variance=0.01, initial=how, level="none"), cut) for how in ("free", "rest")
    )
    wrong = [np.abs(fit.parameters - slow.parameters).max() for fit in (free, rest)]
    assert np.all(np.abs(free.parameters - slow.parameters) < 4 * free.sigma)
    assert wrong[1] > 3 * wrong[0]
    assert free.validation.passed
    assert not rest.validation.passed


def test_data_without_noise_give_the_plant():
    exact = Record(PLANT.response(uniform(60)), uniform(60), dt=1)
    fit = identify(OutputErrorML(2, 1), exact)
    assert_allclose(fit.parameters, PLANT.parameters, atol=1e-8)


def test_several_inputs_and_outputs():
    plant = OutputError(
        [[0.523, 0.349], [-0.7, 0.1]], [[[0.44, 0.762], [0.1, 0.2]], [[1.0, 0.3], [0.2, -0.5]]], delay=1,
        noise_variance=[0.1, 0.2], dt=0.5,
    )  # fmt: skip
    u = np.random.default_rng(0).normal(size=(1500, 2))
    record = es.simulate(plant, u, seed=2, output_link=BernoulliLink([0.7, 0.4])).record
    fit = identify(OutputErrorML(2, 1, delay=1), record)
    assert np.all(np.abs(fit.parameters - plant.parameters) < 4.5 * fit.sigma)


@pytest.mark.parametrize("rows", [1, 3])
def test_orders_larger_than_the_data_leave_directions_undetermined(rows):
    fit = identify(OutputErrorML(2, 1, noise_variance=0.1), lossy(40)[:rows])
    assert fit.undetermined is not None
    assert "carry no information about" in fit.validation.sentences[0]
    assert np.all(np.isfinite(fit.parameters))
    assert np.all(np.isfinite(fit.covariance))


def test_an_input_that_excites_nothing_is_said():
    still = Record(np.random.default_rng(0).normal(size=50), np.zeros(50), dt=1)
    fit = identify(OutputErrorML(1, 0, initial="rest"), still)
    assert fit.undetermined.shape == (2, 2)


def test_information_criteria_find_the_orders():
    found = es.choose_orders(lossy(2000), na=(1, 2, 3), nb=(0, 1), delay=(0, 1))
    assert (found.best.na, found.best.nb, found.best.delay) == (2, 1, 0)
    assert "BIC chooses na = 2, nb = 1, delay = 0" in found.sentence


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: OutputErrorML(-1, 0), "`na` must be an integer"),
        (lambda: OutputErrorML(1, 0, noise_variance=0.0), "`noise_variance` must be greater than 0"),
        (lambda: OutputErrorML(1, 0, initial="moving"), "`initial` must be one of"),
        (lambda: identify(OutputErrorML(1, 0), Record([np.nan, np.nan], [1.0, 2.0], dt=1)), "'y1' was never seen"),
        (
            lambda: identify(OutputErrorML(1, 0, noise_variance=[1.0, 2.0]), Record([1.0], [1.0], dt=1)),
            "one value for each of 1",
        ),
        (lambda: identify(OutputErrorML, Record([1.0], [1.0], dt=1)), "`method` must be an instance, not a class"),
        (lambda: identify(3, Record([1.0], [1.0], dt=1)), "`method` must identify parameters"),
        (lambda: identify(OutputErrorML(1, 0), [1.0]), "`record` must be a Record"),
        (lambda: identify(OutputErrorML(1, 0), Record([1.0, 2.0], dt=1)), "has no input"),
        (lambda: identify(OutputErrorML(1, 0), Record([1.0], [1.0])), "needs a regular step"),
        (
            lambda: identify(OutputErrorML(1, 0), Record([1.0, 2, 3], [1.0, 2, 3], t=[0, 1, 2.4])),
            "the stamps are no multiples of one step",
        ),
        (
            lambda: identify(OutputErrorML(1, 0), [Record([1.0], [1.0], dt=1), Record([1.0], [1.0], dt=2)]),
            "they must be equal",
        ),
        (
            lambda: identify(OutputErrorML(1, 0), [Record([1.0], [1.0], dt=1), Record([1.0], np.ones((1, 2)), dt=1)]),
            "other channels than record 0",
        ),
        (lambda: es.choose_orders(Record([1.0], [1.0], dt=1), criterion="mdl"), "`criterion` must be one of"),
        (lambda: es.choose_orders(Record([1.0], [1.0], dt=1), na=()), "`na` must hold at least one number"),
        (lambda: es.RecursiveOutputError(2, 1, noise_variance=0.0), "must be greater than 0"),
        (lambda: es.RecursiveOutputError(2, 1, noise_variance=1.0, method="best"), "`method` must be one of"),
        (
            lambda: es.RecursiveOutputError(2, 1, noise_variance=1.0, prior=es.Prior([0.0], [[1.0]])),
            "have 4 parameters. Got 1",
        ),
        (
            lambda: es.estimate(
                es.RecursiveOutputError(1, 0, noise_variance=1.0),
                Record([1.0], [1.0], dt=1),
                prior=es.Prior([0.0], [[1.0]]),
            ),
            "`prior` must be None",
        ),
    ],
)
def test_what_is_wrong_is_said(call, sentence):
    with pytest.raises(InputError) as caught:
        call()
    assert sentence in str(caught.value)
