"""The reconfigured F-16 against the thesis's setting, recomputed: RMS of the pitch rate about the flight that did not fail."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import estimable as es
from estimable.plants import f16_failure


@pytest.mark.parametrize(("K1", "fixed_after", "fixed_transient", "bound"), [
    (0.6, 0.90, 1.25, 0.30), (0.4, 1.94, 2.68, 0.40), (0.2, 4.4, 6.37, 0.48), (0.1, 6.9, 11.7, 0.58), (0.05, 57.0, 17.2, 0.85),
])  # fmt: skip
def test_the_reconfigured_aircraft_flies_as_if_nothing_had_failed(K1, fixed_after, fixed_transient, bound):
    failed = f16_failure.fly(K1, runs=40, seed=1)
    numbers = failed.numbers
    assert_allclose(numbers["fixed_rms_transient"], fixed_transient, rtol=0.025)
    assert_allclose(numbers["fixed_rms_after"], fixed_after, rtol=0.025)
    assert numbers["adaptive_rms_transient"] <= bound
    assert numbers["adaptive_rms_after"] <= 0.05
    assert numbers["detection_delay_s"] <= 0.08
    assert not failed.adaptive.runs.extra["alarm"][:, failed.t < f16_failure.FAILURE - 1e-9].any()


def test_packets_may_get_lost_on_both_ways():
    links = {"input_link": es.BernoulliLink(0.7), "output_link": es.BernoulliLink(0.7)}
    numbers = f16_failure.fly(0.4, runs=4, seed=1, **links).numbers
    assert np.isfinite(list(numbers.values())).all()
    assert numbers["adaptive_rms_after"] < 0.5 * numbers["fixed_rms_after"]
