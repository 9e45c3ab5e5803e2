"""Every table and figure of the sources has an entry, and what is said to be reproduced can be."""

import json
import math

import numpy as np
import pytest

from estimable import InputError, reproductions
from estimable.commands.show import plain

DONE = [entry.name for entry in reproductions.ENTRIES if entry.compute is not None]
FEW = 4  # draws of the results: enough for a mean and a sigma


def test_every_table_and_figure_of_the_sources_is_listed_once():
    names = [entry.name for entry in reproductions.ENTRIES]
    assert len(set(names)) == len(names)
    assert {f"sillence-table-{i}" for i in range(1, 6)} | {f"sillence-fig-{i}" for i in range(1, 48)} <= set(names)
    fang = {2: 6, 3: 11, 4: 8}
    assert {f"fang-fig-{chapter}-{i}" for chapter, last in fang.items() for i in range(1, last + 1)} <= set(names)
    assert {"fang-table-2-1", "fang-table-2-2", "fang-table-3-1", "fang-table-3-2"} <= set(names)


def test_what_is_not_done_says_why():
    for entry in reproductions.ENTRIES:
        assert entry.status == "done" or entry.status.startswith(("not yet", "a drawing")), entry.name
        assert len(entry.title) < 80


@pytest.mark.parametrize("name", DONE)
def test_rows_are_complete(name, results):
    rows = results(name).rows
    assert rows
    assert len({row.quantity for row in rows}) == len(rows)
    for row in rows:
        assert 0 <= row.draws <= FEW
        assert (row.sigma is None) == (row.draws < 2)
        assert row.draws == 0 or math.isfinite(row.mean)
    json.dumps(plain([row._asdict() for row in rows]), allow_nan=False)


@pytest.mark.parametrize("name", DONE)
def test_the_picture_can_be_drawn(name, results):
    figure = results(name).figure
    if figure is not None:
        drawn = figure()
        assert drawn.data
        titles = {
            axis: layout["title"]["text"] for axis, layout in drawn.layout.to_plotly_json().items() if "axis" in axis
        }
        assert any(titles[axis] for axis in titles if axis.startswith("x"))
        assert all(titles[axis] for axis in titles if axis.startswith("y"))


@pytest.mark.parametrize("name", ["sillence-table-2", "sillence-table-3"])
def test_poles_are_those_of_the_thesis(name, results):
    for row in results(name).rows:
        assert row.mean == pytest.approx(row.published, abs=1.2e-4), row.quantity


def test_signal_to_noise_is_a_constant_from_the_table(results):
    rows = [row for row in results("sillence-table-1").rows if row.quantity.endswith("as printed")]
    assert len(rows) == 5
    assert all(-0.113 < row.mean - row.published < -0.105 for row in rows)


@pytest.mark.parametrize(
    ("name", "draws", "sentence"),
    [
        ("sillence-table-44", 3, "Did you mean 'sillence-table-4'"),
        ("sillence-table-2", 0, "`draws` must be an integer of at least 1"),
        ("sillence-fig-13", 3, "sillence-fig-13 is not reproduced: a drawing"),
    ],
)
def test_wrong_calls(name, draws, sentence):
    with pytest.raises(InputError, match=sentence):
        reproductions.reproduce(name, draws=draws)


def test_the_cost_of_control_grows_as_bass_says(results):
    rows = {row.quantity: row for row in results("bass-rho-bandwidth").rows}
    for name in (
        "power of the bandwidth in the control's rms, both gains driven",
        "bandwidth over natural frequency, n = 2",
    ):
        assert rows[name].mean == pytest.approx(rows[name].published, rel=0.01)
    largest, proven = rows["largest rho"].mean, rows["largest rho, proven bound"].mean
    assert proven <= largest * 1.01
    assert largest == pytest.approx(proven, rel=0.03)
    assert rows["rho of the fastest design, of the largest"].mean < 1
    assert rows["bandwidth over natural frequency, n = 3 (Butterworth, 2 rad/s)"].mean == pytest.approx(np.sqrt(2))


def test_the_numbers_of_bass_s_tracker_reproduce_and_his_claims_do_not(results):
    rows = {row.quantity: row for row in results("bass-alpha-beta").rows}
    names = (
        "alpha",
        "beta",
        "phi",
        "psi",
        "P11 at T = 2 s, densities .6 and .8 (by the printed formula)",
        "pole, modulus",
    )
    for name in names:
        assert rows[name].mean == pytest.approx(rows[name].published, rel=3e-6), name
    for name in ("pole, real part", "pole, imaginary part"):
        assert rows[name].mean == pytest.approx(rows[name].published, abs=6e-4), name
    worse = {name.split()[-1]: row.mean for name, row in rows.items() if name.startswith("P11 over")}
    known = {"0.01": 2.46, "0.1": 1.62, "1": 1.18, "10": 1.054, "100": 1.72, "10000": 82}
    assert worse == pytest.approx(known, rel=6e-3)
    safest = rows["the least possible over all ratios from .01 to 1e4"].mean
    assert 1 < safest < max(worse.values()) / 30
    assert rows["norm of one update, T = 1 s (printed: at most)"].mean > 1.4
