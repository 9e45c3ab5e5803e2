"""The signal-to-noise ratio of the source, for any plant."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import InputError, noise_at, signal_to_noise


def test_it_is_the_ratio_of_a_sinusoid_to_its_noise():
    t = np.linspace(0, 200 * np.pi, 20_001)[:-1]
    power = np.mean((3 * np.sin(t)) ** 2)
    assert_allclose(signal_to_noise([3.0], [0.2]), 10 * np.log10(power / 0.2**2), rtol=1e-9)


@pytest.mark.parametrize("ratio", [-3.0, 23.29, 60.0])
def test_noise_for_a_ratio_has_that_ratio_and_the_same_proportions(ratio):
    largest, sigma, weight = [6.0, 11.0], [0.03, 0.1108], [1.0, 0.7]
    found = noise_at(ratio, largest, sigma, weight=weight)
    assert_allclose(signal_to_noise(largest, found, weight=weight), ratio, rtol=1e-12)
    assert_allclose(found / sigma, found[0] / sigma[0])


def test_each_fault_has_a_sentence():
    for call, words in (
        (lambda: signal_to_noise([1.0, 2.0], [1.0]), "`sigma` must be (p,)"),
        (lambda: signal_to_noise([1.0], [0.0]), "`sigma` must be at least 0, and above 0 for at least one output"),
        (lambda: signal_to_noise([-1.0], [1.0]), "`largest` must be at least 0"),
        (lambda: signal_to_noise([1.0], [1.0], weight=[0.0]), "`weight` must be"),
        (lambda: noise_at(np.nan, [1.0], [1.0]), "`ratio`"),
    ):
        with pytest.raises(InputError, match=words.replace("(", r"\(").replace(")", r"\)")):
            call()
