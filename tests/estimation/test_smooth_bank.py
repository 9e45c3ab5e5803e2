"""A bank of smoothers is each of them by itself."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import estimable as es
from cases import case

CASES = [case(seed) for seed in range(3)]
RECORDS = [c.record for c in CASES]


def agrees(bank, algorithms, records, priors):
    for i, (algorithm, record, prior) in enumerate(zip(algorithms, records, priors, strict=True)):
        one = es.smooth(algorithm, record, prior=prior)
        assert_allclose(bank.mean[i], one.mean, atol=1e-11)
        assert_allclose(bank.covariance[i], one.covariance, atol=1e-12)
        assert_allclose(bank.log_likelihood[i], one.log_likelihood, rtol=1e-12)


@pytest.mark.parametrize("make", [es.Kalman, es.ExtendedKalman])
@pytest.mark.parametrize("engine", ["native", "xla"])
def test_many_models_records_and_priors(make, engine):
    algorithms, priors = [make(c.model) for c in CASES], [c.prior for c in CASES]
    bank = es.smooth_bank(algorithms, RECORDS, prior=priors, engine=engine)
    assert bank.engine == engine
    agrees(bank, algorithms, RECORDS, priors)


@pytest.mark.parametrize("features", [{"varying": True}, {"cross": True}, {"singular": True}], ids=str)
def test_one_model_and_many_records(features):
    c = case(0, **features)
    algorithm = es.Kalman(c.model)
    agrees(es.smooth_bank(algorithm, RECORDS, prior=c.prior), [algorithm] * 3, RECORDS, [c.prior] * 3)


def test_many_models_and_one_record():
    algorithms = [es.Kalman(c.model) for c in CASES]
    bank = es.smooth_bank(algorithms, RECORDS[0], prior=CASES[0].prior)
    agrees(bank, algorithms, [RECORDS[0]] * 3, [CASES[0].prior] * 3)


def test_wrong_calls_are_refused_in_words():
    c = CASES[0]
    with pytest.raises(es.InputError, match="FixedGain has none"):
        es.smooth_bank(es.FixedGain(c.model, np.zeros((3, 2))), RECORDS, prior=c.prior)
    with pytest.raises(es.InputError, match="nothing here is stacked"):
        es.smooth_bank(es.Kalman(c.model), c.record, prior=c.prior)
    blind = [es.UnknownInput(c.model, unknown=["u1"]) for c in CASES]
    with pytest.raises(es.InputError, match="smooth_bank takes one UnknownInput and several records"):
        es.smooth_bank(blind, RECORDS, prior=c.prior)
    gain = es.Prior([1.0], [[1.0]])
    forgetful = [es.UnknownGain(c.model, gain, forgetting=λ) for c, λ in zip(CASES, (1.0, 0.98, 1.0), strict=True)]
    with pytest.raises(es.InputError, match=r"forgetting = 0\.98 is not one"):
        es.smooth_bank(forgetful, RECORDS, prior=c.prior)
