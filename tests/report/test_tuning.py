"""The page of a rho synthesis shows its curves, its optima and its choice."""

import base64
import json
import re

import numpy as np
import pytest

from estimable import StateSpace, report, rho_synthesis

MASS = StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], Q=np.diag([0.0, 1.0]), R=[[0.1]], dt=0)


@pytest.fixture(scope="module")
def found():
    return rho_synthesis(MASS, eta=np.geomspace(0.1, 100, 9))


def numbers(packed):
    return np.frombuffer(base64.b64decode(packed["bdata"]), "<f4")


def test_every_criterion_has_its_curve_and_its_mark(found):
    made = report.tuning_report(found)
    first, *own = made.charts
    assert len(first.traces) == 2 * len(found.criteria)  # without `external`, with the composite
    assert all(numbers(trace["y"]).min() == pytest.approx(1) for trace in first.traces[:-2:2])
    assert sum(len(chart.traces) for chart in own) == 2 * len(found.criteria)
    rho, mark, *_ = own[1].traces
    np.testing.assert_allclose(numbers(rho["y"]), found.criteria["rho"], rtol=1e-6)
    assert (mark["x"], mark["y"]) == ([found.optima["rho"].bandwidth], [found.optima["rho"].value])
    assert all(chart.layout["shapes"][0]["x0"] == found.bandwidth[found.chosen] for chart in made.charts)
    np.testing.assert_allclose(made.times, found.bandwidth)


def test_the_page_is_over_a_logarithmic_bandwidth(found):
    page = report.page_of(report.tuning_report(found, title="Mass"))
    data = json.loads(re.findall(r'<script type="application/json" id="data">(.*?)</script>', page)[0])
    assert data["logAxis"] is True
    assert data["timeAxis"] == "bandwidth of the loop [rad/s]"
    assert "What each bandwidth costs" in page
    assert 'aria-label="Noise over bandwidth of the loop"' in page


def test_what_lies_at_the_end_of_the_range_is_said():
    narrow = report.tuning_report(rho_synthesis(MASS, eta=[0.5, 1.0, 2.0], weights={"rho": 1.0}))
    said = {verdict.name: (verdict.sentence, verdict.met) for verdict in narrow.verdicts}
    assert said["The range, for margin rho"][0].startswith("margin rho is best at the largest eta of the range")
    assert said["The choice"] == ("the chosen design is at the end of the range of eta", None)
    assert said["The margin"][1] is True


def test_a_loop_without_a_bandwidth_is_no_reason_to_fail():
    plant = StateSpace([[1.0]], [[1.0]], dt=1)
    ringing = rho_synthesis(plant, eta=[0.5, 1.0], filter=[[1.5]])
    assert len(report.tuning_report(ringing).times) == 0
