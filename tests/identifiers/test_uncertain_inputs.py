"""Maximum likelihood where inputs were not logged, or nobody tells whether they arrived."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import estimable as es
from estimable import BernoulliLink, OutputError, OutputErrorML, Record, identify
from estimable.frozen import replace
from estimable.kernels import uncertain_input_likelihood as kernel
from oracles.uncertain_inputs import joint_log_likelihood

PLANT = OutputError([-0.6], [1.0], noise_variance=0.1, dt=1)


def record(rows=400, seed=1, lost="zero"):
    u = np.random.default_rng(seed).uniform(-np.sqrt(3), np.sqrt(3), rows)
    link = BernoulliLink(0.7, acknowledged=False)
    return es.simulate(PLANT, u, seed=seed, input_link=link, output_link=BernoulliLink(0.8), lost=lost).record


@pytest.mark.parametrize(
    ("a", "b", "delay"), [([-0.6], [[1.0]], 0), ([0.5, 0.3], [[1.0, 0.4], [0.2, -0.5]], 1), ([], [[0.7, 0.2]], 0)]
)
def test_the_likelihood_is_that_of_the_joint_gaussian(a, b, delay):
    rng, m = np.random.default_rng(2), len(b)
    u, W = rng.normal(size=(25, m)), rng.uniform(0.0, 1.0, (25, m)) * (rng.random((25, m)) < 0.5)
    y = rng.normal(size=25)
    y[rng.random(25) < 0.3] = np.nan
    n = max(len(a), len(b[0]) - 1 + delay, 1)
    model = kernel.companion(np.array(a), np.array(b), delay, 0.2)
    s, P, found = np.zeros(n), np.zeros((n, n)), []
    for row in zip(u, W, np.nan_to_num(y), ~np.isnan(y), strict=True):
        s, P, one = kernel.step(model, s, P, *row)
        found.append(one)
    total = sum(one.log_likelihood for one in found)
    assert_allclose(total, joint_log_likelihood(a, b, delay, 0.2, u, W, y), rtol=1e-10)
    assert all(one.V >= 0.2 for one in found)


def test_fates_that_nobody_tells():
    fit = identify(OutputErrorML(1, 0, arrival=0.7), record())
    assert np.all(np.abs(fit.parameters - PLANT.parameters) < 4 * fit.sigma)
    assert np.all(fit.sigma < 0.1)
    assert abs(fit.model.noise_variance[0] - 0.1) < 0.06


def test_inputs_that_nobody_logged_cost_less_than_cutting_the_record():
    u = np.random.default_rng(3).normal(size=400)
    whole = es.simulate(PLANT, u, seed=2).record
    holes = replace(whole, u=np.where(np.arange(400)[:, None] % 5 == 2, np.nan, whole.u))
    fit, best = identify(OutputErrorML(1, 0), holes), identify(OutputErrorML(1, 0), whole)
    assert np.all(np.abs(fit.parameters - PLANT.parameters) < 4 * fit.sigma)
    assert np.all(fit.sigma < 2 * best.sigma)
    assert np.all(fit.sigma > best.sigma)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (
            lambda: identify(OutputErrorML(1, 0), record(30)),
            "it is unknown whether some inputs arrived: give `arrival`",
        ),
        (lambda: identify(OutputErrorML(1, 0, arrival=0.7), record(30, lost="hold")), "the actuator must apply zero"),
        (lambda: identify(OutputErrorML(1, 0), Record([1.0, 2.0], [np.nan, np.nan], dt=1)), "'u1' was never logged"),
        (lambda: OutputErrorML(1, 0, arrival=0.0), "`arrival` must be"),
    ],
)
def test_what_cannot_be_made_up_is_refused(given, sentence):
    with pytest.raises(es.InputError, match=sentence):
        given()
