"""The F-16 of the thesis, its errata corrected: published poles, and the final gains it prints."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import Prior, UnknownGain, estimate_bank
from estimable.plants import f16


def test_the_poles_that_the_tables_need():
    assert_allclose(np.sort(np.linalg.eigvals(f16.A)), [-3.0691, 0.6737], atol=5e-5)
    healthy = np.sort_complex(np.linalg.eigvals(f16.closed_loop(1.0)))
    assert_allclose(healthy, [-14.4614 - 15.504j, -14.4614 + 15.504j, -1.4724, -1.0e-4], atol=6e-4)
    failed = np.sort_complex(np.linalg.eigvals(f16.closed_loop(0.08)))
    assert_allclose(failed, [-26.6776, -3.7210, 0.0016 - 0.0071j, 0.0016 + 0.0071j], atol=6e-5)


def test_the_proportional_loop_is_stable_down_to_the_published_gain():
    edge = [np.linalg.eigvals(f16.closed_loop(K, integral=False)).real.max() for K in (0.0803, 0.0806)]
    assert edge[0] > 0 > edge[1]


@pytest.mark.parametrize(("K1", "ours_once", "published"), [(0.8, 0.8388, 0.8413), (0.6, 0.6447, 0.6469),
                         (0.4, 0.4283, 0.4306), (0.2, 0.2072, 0.2116), (0.1, 0.0995, 0.0996)])  # fmt: skip
def test_final_gain_of_the_expanding_filter(K1, ours_once, published):
    """Sillence ch. 5, held elevator, a prior that is wrong: our mean of 20 draws beside an earlier draw and the print."""
    flights = [f16.flight(K1, seed=seed, simulation="held_elevator").record for seed in range(20)]
    algorithm = UnknownGain(f16.short_period(), Prior([0.8], [[0.4]]))
    bank = estimate_bank(algorithm, flights, prior=Prior([-1.4414, -2.4314], np.diag([0.1, 1.0])))
    final = bank.gain[:, -1, 0]
    assert abs(final.mean() - ours_once) < 4 * final.std() + 5e-5
    assert abs(final.mean() - published) < 0.006


def test_the_command_is_the_doublets_through_their_filter():
    t = np.arange(0, 16.5, 0.001)
    q, rows = 0.0, []
    for time in t:
        rows.append(q)
        r = 10.0 if (time % 4.5) < 2.25 else -10.0
        q += 0.001 * 3 * ((r if time < 13.5 else 0.0) - q)
    assert_allclose(f16.pitch_command(t), rows, atol=0.04)


def test_the_pitch_rate_follows_the_command_when_nothing_failed():
    flown = f16.flight(1.0, seed=0)
    late = flown.record.t > 1.5
    assert np.corrcoef(flown.state[late, 1], flown.command[late])[0, 1] > 0.99
