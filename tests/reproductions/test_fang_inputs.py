"""Chapter 2 of Fang (2009): the printed norms lie among ours, and the printed traces are ours."""

import pytest

from estimable import reproductions


@pytest.mark.parametrize("name", ["fang-table-2-1", "fang-table-2-2"])
def test_the_printed_norms_lie_among_ours(name):
    rows = reproductions.reproduce(name, draws=100).rows
    assert len(rows) == 12
    for row in rows:
        assert abs(row.mean - row.published) < 3 * row.sigma, row
    two_norms = [row for row in rows if "2-norm" in row.quantity]
    assert all(abs(row.mean / row.published - 1) < 0.1 for row in two_norms)


@pytest.mark.parametrize("name", ["fang-fig-2-3", "fang-fig-2-5"])
def test_the_printed_traces_are_ours(name):
    fang, exact, own = reproductions.reproduce(name, draws=1).rows
    assert fang.mean == pytest.approx(fang.published, rel=2e-4)
    assert own.mean == pytest.approx(own.published, rel=2e-4)
    assert own.mean < exact.mean < fang.mean


def test_known_levels_are_decided_and_make_the_states_better():
    known = {row.quantity: row for row in reproductions.reproduce("fang-fig-2-6", draws=8).rows}
    unknown = {row.quantity: row for row in reproductions.reproduce("fang-fig-2-2", draws=8).rows}
    assert known["share of samples decided wrongly"].mean == 0
    assert known["RMS error of x1"].mean < 0.5 * unknown["RMS error of x1"].mean
