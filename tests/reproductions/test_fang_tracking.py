"""Fang's chapter 4: what was lost is estimated as well as the model is known."""

import numpy as np
import pytest

from estimable import reproductions
from estimable.reproductions import fang_tracking


def test_missing_outputs_are_estimated_and_the_reference_is_followed():
    share, error = reproductions.reproduce("fang-fig-4-5", draws=1).rows
    assert abs(share.mean - 0.15) < 0.2
    assert error.mean < 0.05
    found = fang_tracking.runs(0.85, False, "joint", 1)
    assert fang_tracking.rms(found, 1000, 4999)[0] == pytest.approx(0.05, abs=0.0015)
    assert np.median(found.parameter_error[:, -1]) < 15
