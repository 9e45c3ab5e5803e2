"""Inputs that move linearly between samples: u[k] enters y[k], in every identifier and in the filters that follow."""

import numpy as np
import pytest

import estimable as es

T = 600
PLANT = es.StateSpace([[-0.5]], [[1.5]], C=[[1.0]], Q=[[0.0]], R=[[4e-4]], dt=0)  # time constant 2 s, gain 3


def drawn(seed, hold="first_order"):
    rng = np.random.default_rng(seed)
    u, model = np.repeat(rng.normal(size=T // 5), 5), PLANT.discretise(0.5, hold="first_order")
    x = np.zeros(T)
    for k in range(T - 1):
        x[k + 1] = model.A[0, 0] * x[k] + model.B[0, 0] * u[k] + model.B_end[0, 0] * u[k + 1]
    return es.Record(x + 0.02 * rng.normal(size=T), u, dt=0.5, hold=hold)


METHODS = {
    "OutputErrorML": es.OutputErrorML(1, 0, delay=1, initial="free"), "LeastSquares": es.LeastSquares(1, 0, delay=1),
    "PredictionError": es.PredictionError(1, 0, 1, delay=1), "Subspace": es.Subspace(1, feedthrough=False, draws=0),
    "InstrumentalVariables": es.InstrumentalVariables(1, 0, delay=1), "HoKalman": es.HoKalman(1),
    "CoupledLeastSquares": es.CoupledLeastSquares(1, 0, delay=1), "MinimumVariance": es.MinimumVariance(1, 0, delay=1),
    "RecursiveOutputError": es.RecursiveOutputError(1, 0, delay=1, noise_variance=4e-4),
}  # fmt: skip


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
def test_a_request_with_a_delay_gets_the_direct_term_and_a_sentence(method):
    fit = es.identify(method, drawn(0))
    model = fit.model if isinstance(fit.model, es.StateSpace) else fit.model.to_state_space(hold="first_order")
    (pole,) = np.linalg.eigvals(model.A)
    gain = float((model.C @ model.B / (1 - pole) + model.D).real[0, 0])
    assert -0.5 / np.log(pole.real) == pytest.approx(2.0, abs=0.05)
    assert gain == pytest.approx(3.0, abs=0.03)
    assert model.D[0, 0] == pytest.approx(PLANT.discretise(0.5, hold="first_order").B_end[0, 0], abs=0.03)
    said = [check.sentence for check in fit.validation.checks if check.name == "hold"]
    assert len(said) == (method.__class__ is not es.HoKalman)
    assert all("the input moves linearly between samples, so that" in sentence for sentence in said)


def test_a_fitted_model_filters_records_of_its_hold():
    fit, record = es.identify(es.OutputErrorML(1, 1, initial="free"), drawn(0)), drawn(1)
    prior = es.Prior([0.0], [[1.0]])
    model = fit.model.to_state_space(hold="first_order")
    found = es.estimate(es.Kalman(model), record, prior=prior)
    held = es.estimate(es.Kalman(fit.model.to_state_space()), drawn(1, "zero_order"), prior=prior)
    np.testing.assert_array_equal(found.innovation, held.innovation)
    assert np.std(found.innovation[100:]) == pytest.approx(0.02, rel=0.15)
    subspace = es.identify(es.Subspace(1, draws=0), drawn(0)).model
    assert np.std(es.estimate(es.Kalman(subspace), record, prior=prior).innovation[100:]) == pytest.approx(
        0.02, rel=0.15
    )
    with pytest.raises(es.InputError, match="`hold` must be one of"):
        fit.model.to_state_space(hold="linear")


def test_a_comparison_and_its_model_take_the_hold():
    found = es.compare([es.LeastSquares(1, 0, delay=1), es.Subspace(1, draws=0)], drawn(2))
    assert found.best.fit_percent > 95
    assert not found.best.model.B_end.any()
    es.estimate(es.Kalman(found.best.model), drawn(3), prior=es.Prior([0.0], [[1.0]]))


def test_a_prior_without_the_direct_term_is_pointed_out():
    prior = es.Prior([0.0, 0.0], np.eye(2))
    fit = es.identify(es.RecursiveOutputError(1, 0, delay=1, noise_variance=4e-4, prior=prior), drawn(0))
    (check,) = [one for one in fit.validation.checks if one.name == "hold"]
    assert not check.passed
    assert "give delay = 0, nb = 1 and a prior with one more coefficient" in check.sentence
