"""A thin version of `python -m benchmarks.figures.known`, which has the models of every kind."""

import numpy as np
import pytest
from benchmarks.figures.known import errors, inexact, turned


@pytest.mark.parametrize("seed", range(6))
def test_sigma_is_that_of_eighty_digits(seed):
    """The largest over 200 models was 1e-12."""
    assert max(errors(seed)) < 5e-12


def test_units_turn_no_verdict_and_times_are_exact():
    assert np.sum([turned(seed)[:2] for seed in range(6, 12)]) == 0
    assert sum(inexact(seed)[0] for seed in range(12, 16)) == 0
