"""Identification from records that give the noise of each sample."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import estimable as es
from estimable.frozen import replace

DT = 0.1
PLANT = es.OutputError([-1.2, 0.5], [0.5, 0.3], delay=1, noise_variance=0.04, dt=DT)
IMPULSE = es.OutputError([], [0.5, 0.3, -0.2], noise_variance=0.04, dt=DT)
TIMES = DT * np.arange(400)


def drawn(plant, seed, T=400, u=None):
    """A record in which a sixth of the samples have 20 times the noise of the others, and say so."""
    rng = np.random.default_rng(seed)
    u = rng.normal(size=(T, 1)) if u is None else u
    sigma = np.where(rng.random((T, 1)) < 1 / 6, 2.0, 0.1)
    return es.Record(plant.response(u) + sigma * rng.normal(size=(T, 1)), u, dt=DT, sigma=sigma)


SINES = (np.sin(2 * np.pi * 0.3 * TIMES) + np.sin(2 * np.pi * 0.9 * TIMES))[:, None]
METHODS = {
    "output error": (es.OutputErrorML(2, 1, delay=1), PLANT, None),
    "minimum variance": (es.MinimumVariance(2, 1, delay=1), PLANT, None),
    "recursive": (es.RecursiveOutputError(2, 1, delay=1, noise_variance=1.0), PLANT, None),
    "joint": (es.JointOutputError(2, 1, delay=1, noise_variance=1.0), PLANT, None),
    "impulse response": (es.MarkovParameters(2), IMPULSE, None),
    "phasors": (es.Phasor(2, [0.3, 0.9], settle=5.0), replace(PLANT, b=PLANT.b), SINES),
}


@pytest.mark.parametrize(("method", "plant", "u"), METHODS.values(), ids=METHODS)
def test_samples_count_by_their_own_noise(method, plant, u):
    """Over 20 draws: errors of one sigma; over 5 a small part of those of a fit that takes the noise as equal."""
    z, ratio = [], []
    for seed in range(1000, 1020):
        record = drawn(plant, seed, u=u)
        weighed = es.identify(method, record)
        error = weighed.parameters - plant.parameters
        z.append(error / weighed.sigma)
        if len(z) <= 5:
            equal = es.identify(method, replace(record, sigma=None)).parameters - plant.parameters
            ratio.append(np.linalg.norm(error) / np.linalg.norm(equal))
    assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.4
    assert np.median(ratio) < 0.4


def equal_noise(method, record):
    """The fit with `sigma` = .3 in each row, and that of the same method with .09 as its noise variance."""
    own = replace(record, sigma=np.full(record.y.shape, 0.3))
    return es.identify(method, own), es.identify(
        replace(method, noise_variance=np.array([0.09])), replace(record, sigma=None)
    )


UNKNOWN = replace(drawn(PLANT, 1, T=200), arrived=np.where(np.arange(200) % 3 == 0, np.nan, 1.0)[:, None], sigma=None)


@pytest.mark.parametrize(("method", "record"), [
    (es.OutputErrorML(2, 1, delay=1), drawn(PLANT, 1)), (es.OutputErrorML(2, 1, delay=1, arrival=0.8), UNKNOWN),
    (es.RecursiveOutputError(2, 1, delay=1, noise_variance=5.0), drawn(PLANT, 1)),
    (es.JointOutputError(2, 1, delay=1, noise_variance=5.0), drawn(PLANT, 1)),
], ids=["likelihood", "unknown inputs", "recursive", "joint"])  # fmt: skip
def test_one_sigma_for_all_is_the_noise_variance_of_the_method(method, record):
    found, exact = equal_noise(method, record)
    assert_allclose(found.parameters, exact.parameters, rtol=1e-7)
    assert_allclose(found.covariance, exact.covariance, rtol=1e-6)
    assert_allclose(found.log_likelihood, exact.log_likelihood, rtol=1e-9)


def test_the_likelihood_is_that_of_the_samples():
    """Against a search that knows nothing of the package's, and the likelihood of independent samples."""
    from scipy.optimize import least_squares

    record = drawn(PLANT, 3)
    fit = es.identify(es.OutputErrorML(2, 1, delay=1, initial="rest", level="none"), record)

    def error(θ):
        x = np.zeros(len(record) + 2)
        u = np.concatenate([np.zeros(2), record.u[:, 0]])
        for k in range(2, len(x)):
            x[k] = -θ[0] * x[k - 1] - θ[1] * x[k - 2] + θ[2] * u[k - 1] + θ[3] * u[k - 2]
        return (record.y[:, 0] - x[2:]) / record.sigma[:, 0]

    best = least_squares(error, PLANT.parameters, xtol=1e-13, ftol=1e-13)
    assert_allclose(fit.parameters, best.x, rtol=1e-5)
    assert_allclose(fit.covariance, np.linalg.inv(best.jac.T @ best.jac), rtol=1e-3)
    density = -0.5 * (error(fit.parameters) ** 2 + np.log(2 * np.pi * record.sigma[:, 0] ** 2))
    assert_allclose(fit.log_likelihood, density.sum(), rtol=1e-9)
    noise = next(check for check in fit.validation.checks if check.name == "noise")
    assert noise.passed
    wrong = es.identify(es.OutputErrorML(2, 1, delay=1), replace(record, sigma=record.sigma / 2))
    assert not next(check for check in wrong.validation.checks if check.name == "noise").passed


def test_samples_without_a_sigma_share_a_variance_that_is_estimated():
    record = drawn(PLANT, 5, T=1000)
    unsaid = record.sigma < 1.0
    found = es.identify(es.OutputErrorML(2, 1, delay=1), replace(record, sigma=np.where(unsaid, np.nan, record.sigma)))
    known = es.identify(es.OutputErrorML(2, 1, delay=1), record)
    assert np.all(np.abs(found.parameters - known.parameters) < 0.3 * known.sigma)
    assert found.model.noise_variance[0] == pytest.approx(0.01, rel=0.15)
    assert known.model.noise_variance[0] == pytest.approx(np.mean(record.sigma**2), rel=1e-12)
    given = es.OutputErrorML(2, 1, delay=1, noise_variance=0.01)
    same = es.identify(given, replace(record, sigma=np.where(unsaid, np.nan, record.sigma)))
    assert_allclose(same.parameters, known.parameters, rtol=1e-7)


def test_a_nonlinear_model_is_identified_from_weighed_samples():
    import jax.numpy as jnp

    def tank(R):
        return es.NonlinearModel(
            lambda x, u, θ: x + θ[1] * u - θ[0] * jnp.sqrt(jnp.maximum(x, 1e-6)), lambda x, u, θ: x, dt=1, Q=[[1e-6]], R=[[R]],
            inputs=["pump"], parameters={"outflow": 0.2, "inflow": 0.5},
        )  # fmt: skip

    u = 0.5 + 0.2 * np.random.default_rng(0).normal(size=(120, 1))
    prior = es.Prior([1.5], [[0.1]])
    record = es.simulate(tank(1e-4), u, seed=1, prior=es.Prior([1.5], [[0.0]])).record
    found = es.identify(es.AdaptiveIdentification(tank(1.0), prior), replace(record, sigma=np.full((120, 1), 0.01)))
    exact = es.identify(es.AdaptiveIdentification(tank(1e-4), prior), record)
    assert_allclose(found.parameters, exact.parameters, rtol=1e-9)
    assert_allclose(found.sigma, exact.sigma, rtol=1e-9)


REFUSED = {
    es.LeastSquares(2, 1): "its noise is that of the equations, not of single samples",
    es.CoupledLeastSquares(2, 1): "its noise is that of the equations, not of single samples",
    es.PredictionError(2, 1, 1): "its noise is that of the equations, not of single samples",
    es.InstrumentalVariables(2, 1): "its noise is stationary, of any colour",
    es.Subspace(2): "its noise is stationary",
    es.HoKalman(2, weighting="best"): 'its weighting "best" takes the noise as stationary',
    es.MarkovParameters(5, weighting="observer"): 'its weighting "observer" takes the noise as stationary',
}


@pytest.mark.parametrize(("method", "why"), REFUSED.items(), ids=[type(one).__name__ for one in REFUSED])
def test_a_method_without_weights_says_why(method, why):
    with pytest.raises(es.InputError) as raised:
        es.identify(method, drawn(PLANT, 0))
    assert str(raised.value) == (
        f"{type(method).__name__} cannot weigh samples by `sigma` of the record: {why}. Leave `sigma` out, or use OutputErrorML, "
        "which weighs by it."
    )


def test_sigmas_that_do_not_weigh():
    record = drawn(PLANT, 0)
    with pytest.raises(
        es.InputError, match="`sigma` must be greater than 0 in identify: a sample without noise has an infinite"
    ):
        es.identify(es.OutputErrorML(2, 1), replace(record, sigma=0 * record.sigma))
    for method in (es.MinimumVariance(2, 1), es.MarkovParameters(5), es.Phasor(1, [0.5])):
        with pytest.raises(es.InputError, match=r"record 0: `sigma` of output y1 is unknown in row 7\. Give it for"):
            es.identify(method, replace(record, sigma=np.where(np.arange(400) == 7, np.nan, 0.1)[:, None]))


def test_a_comparison_ranks_the_methods_that_weigh():
    record = drawn(PLANT, 2)
    found = es.compare([es.OutputErrorML(2, 1, delay=1), es.Subspace(2), es.MinimumVariance(2, 1, delay=1)], record)
    assert found.best.name in ("OutputErrorML", "MinimumVariance")
    assert "Subspace cannot weigh samples" in found.ranked[-1].failure
    chosen = es.choose_orders(record, na=(1, 2), nb=(0, 1), delay=(1,))
    assert (chosen.best.na, chosen.best.nb) == (2, 1)
    M = es.diagnostics.cramer_rao(PLANT, record)
    assert_allclose(M, es.identify(es.OutputErrorML(2, 1, delay=1), record).covariance, rtol=0.2)
