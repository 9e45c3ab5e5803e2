"""A loop that uses late outputs knows at each sample what a filter offline knows of the outputs that have arrived by then."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import estimable as es

MODEL = es.StateSpace([[0.9, 0.2], [-0.1, 0.8]], [[0.5], [1.0]], Q=0.1 * np.eye(2), R=np.diag([0.1, 0.2]), dt=0.5)
PRIOR = es.Prior([0.0, 0.0], np.eye(2))
LAW = es.StateFeedback([[0.2, 0.3]])
DELAYS = np.array([[0, 3, 1], [2, 0, 0], [1, 1, np.inf], [0, 2, 0], [3, 0, 1], [np.inf, 1, 0], [0, 0, 2]])[:, :2]
DELAY = np.tile(DELAYS, (3, 1))


def test_each_sample_uses_what_has_arrived():
    link = es.Trace(DELAY, late="use")
    given = {"reference": np.zeros((20, 0)), "seed": 1, "prior": PRIOR}
    closed = es.close_loop(MODEL, LAW, es.Kalman(MODEL), output_link=link, **given)
    dropped = es.close_loop(MODEL, LAW, es.Kalman(MODEL), output_link=es.Trace(DELAY), **given)
    for k in (0, 1, 4, 9, 19):
        come = DELAY[: k + 1] <= k - np.arange(k + 1)[:, None]
        record = es.Record(np.where(come, closed.output[: k + 1], np.nan), closed.command[: k + 1], dt=0.5)
        offline = es.estimate(es.Kalman(MODEL), record, prior=PRIOR)
        assert_allclose(closed.mean[k], offline.mean[-1], atol=1e-12)
        assert_allclose(closed.info.covariance[k], offline.covariance[-1], atol=1e-12)
    spreads = [np.trace(run.info.covariance, axis1=1, axis2=2).mean() for run in (closed, dropped)]
    assert spreads[0] < 0.97 * spreads[1]


def test_late_outputs_of_a_wrong_kind_are_refused():
    class Own(es.PerfectLink):
        late = "use"

    with pytest.raises(es.InputError, match='late="use" is possible with a DelayLink or a Trace'):
        es.close_loop(MODEL, LAW, es.Kalman(MODEL), reference=np.zeros((3, 0)), seed=1, prior=PRIOR, output_link=Own())
