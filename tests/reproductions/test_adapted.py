"""The adapted loop of the thesis against an earlier simulation of ours by other code."""

import pytest


def test_adaptation_makes_the_failure_good(results):
    rows = {row.quantity: row.mean for row in results("sillence-fig-43").rows}
    assert rows["RMS of the pitch rate, 4.5 to 6 s, adapted"] == pytest.approx(2.16, rel=0.03)
    assert rows["RMS of the pitch rate, after 6 s, adapted"] == pytest.approx(0.04, abs=0.012)
    assert rows["RMS of the pitch rate, 4.5 to 6 s, fixed law"] == pytest.approx(6.37, rel=0.03)
    assert rows["RMS of the pitch rate, after 6 s, fixed law"] == pytest.approx(4.4, rel=0.03)
    assert rows["smoothed gain, last 2 s, adapted"] == pytest.approx(0.2, abs=0.02)
