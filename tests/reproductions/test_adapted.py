"""The adapted loop of the thesis against an earlier simulation of ours by other code."""

import pytest


def test_adaptation_makes_the_failure_good(results):
    rows = {row.quantity: row.mean for row in results("sillence-fig-43").rows}
    assert rows["RMS of the pitch rate, 4.5 to 6 s, adapted"] == pytest.approx(2.16, rel=0.03)
    assert rows["RMS of the pitch rate, after 6 s, adapted"] == pytest.approx(0.04, abs=0.012)
    assert rows["RMS of the pitch rate, 4.5 to 6 s, fixed law"] == pytest.approx(6.37, rel=0.03)
    assert rows["RMS of the pitch rate, after 6 s, fixed law"] == pytest.approx(4.4, rel=0.03)
    assert rows["smoothed gain, last 2 s, adapted"] == pytest.approx(0.2, abs=0.02)


@pytest.mark.parametrize(
    ("name", "transient", "after"), [("sillence-fig-21", 6.37, 4.4), ("sillence-fig-22", 11.7, 6.9)]
)
def test_the_proportional_law_alone_does_not(name, transient, after, results):
    rows = {row.quantity: row.mean for row in results(name).rows}
    assert rows["RMS of the pitch rate about the flight without a failure, 4.5 to 6 s"] == pytest.approx(
        transient, rel=0.02
    )
    assert rows["RMS of the pitch rate about the flight without a failure, after 6 s"] == pytest.approx(after, rel=0.02)


def test_the_integral_changes_little_in_the_time_of_a_flight(results):
    """Its gain is 1e-4, a thousandth of the others over 16 s."""
    rows = {row.quantity: row.mean for row in results("sillence-fig-17").rows}
    assert rows["RMS of the pitch rate about the flight without a failure, after 6 s"] == pytest.approx(4.4, rel=0.02)
