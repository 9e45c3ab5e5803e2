"""How two records are compared."""

import numpy as np
import pytest


@pytest.fixture
def same():
    """Asserts that two records agree in every field, NaN counting as equal to NaN."""

    def check(a, b):
        for name in ("y", "u", "t", "arrived", "held"):
            left, right = getattr(a, name), getattr(b, name)
            assert (left is None) == (right is None), name
            if left is not None:
                np.testing.assert_array_equal(left, right)
        for name in ("dt", "inputs", "outputs", "lost", "hold", "units", "breaks", "origin", "grid", "sources"):
            assert getattr(a, name) == getattr(b, name), name

    return check
