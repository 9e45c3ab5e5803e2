"""A report is one page that needs nothing else, and shows what the result says."""

import base64
import hashlib
import html
import json
import os
import re

import numpy as np
import pytest

from estimable import (
    InputError,
    Kalman,
    OutputError,
    Prior,
    Record,
    StateSpace,
    UnknownGain,
    estimate,
    excitation,
    report,
    simulate,
    smooth,
)  # fmt: skip
from estimable.report.identification_charts import excitation_chart

MODEL = StateSpace(
    [[0.9, 0.1], [0.0, 0.8]], [[0.0], [1.0]], [[1.0, 0.0], [1.0, 1.0]], Q=0.1 * np.eye(2), R=0.2 * np.eye(2), dt=0.5,
    states=["level", "flow"], outputs=["level_m", "sum"], inputs=["valve"],
)  # fmt: skip
PRIOR = Prior([1.0, 0.0], np.eye(2))
NOISE = np.random.default_rng(5).normal(size=(40, 2))


def record_of(y=NOISE, **how):
    named = {"dt": 0.5, "outputs": MODEL.outputs, "inputs": MODEL.inputs, "units": {"level_m": "m"}}
    return Record(y, np.ones(len(y)), **{**named, **how})


def report_of(record=None, algorithm=None, prior=PRIOR, **how):
    record = record_of() if record is None else record
    algorithm = UnknownGain(MODEL, Prior([1.0], [[0.25]])) if algorithm is None else algorithm
    result = estimate(algorithm, record, prior=prior)
    return result, report.report_of(result, record=record, algorithm=algorithm, prior=prior, **how)


def numbers(packed):
    return np.frombuffer(base64.b64decode(packed["bdata"]), "<f4")


def embedded(page):
    return json.loads(re.findall(r'<script type="application/json" id="data">(.*?)</script>', page)[0])


def text_of(made):
    return " ".join(f"{term} {said}" for section in made.sections for term, said in section.items)


def test_the_diagrams_show_what_the_result_says():
    result, made = report_of()
    gain, level, flow, *innovations = made.charts
    assert [chart.heading for chart in (gain, level, flow)] == ["Gain", "State level [m]", "State flow"]
    assert [chart.heading for chart in innovations] == ["Innovation of level_m [m]", "Innovation of sum"]
    sigma = np.sqrt(result.gain_covariance[:, 0, 0])
    lower, upper, middle = (numbers(trace["y"]) for trace in gain.traces)
    np.testing.assert_allclose(middle, result.gain[:, 0], rtol=1e-6)
    np.testing.assert_allclose(upper - middle, 2 * sigma, rtol=1e-5)
    np.testing.assert_allclose(middle - lower, 2 * sigma, rtol=1e-5)
    measured = level.traces[2]
    assert measured["name"] == "level_m"
    np.testing.assert_allclose(numbers(measured["y"]), NOISE[:, 0], rtol=1e-6)
    assert len(flow.traces) == 3  # `sum` is no measurement of one state
    e, *bounds = (numbers(trace["y"]) for trace in innovations[1].traces)
    np.testing.assert_allclose(e, result.innovation[:, 1], rtol=1e-6)
    np.testing.assert_allclose(bounds[0], 2 * np.sqrt(result.innovation_covariance[:, 1, 1]), rtol=1e-6)
    np.testing.assert_allclose(bounds[1], -bounds[0])


def test_equal_reports_are_equal_pages_that_load_nothing():
    page, again = (report.page_of(report_of(commands=[("Type:", "estimable demo")])[1]) for _ in range(2))
    assert page == again
    ours = re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)
    assert "://" not in ours
    assert "src=" not in ours
    assert "<pre>estimable demo</pre>" in ours
    assert "Plotly.newPlot" in page


def test_the_page_holds_the_times_and_the_diagrams():
    page = report.page_of(report_of()[1])
    data = embedded(page)
    np.testing.assert_allclose(np.frombuffer(base64.b64decode(data["times"]), "<f8"), 0.5 * np.arange(40))
    assert data["timeAxis"] == "time [s]"
    assert len(data["charts"]) == page.count('<div class="chart"') == 5


def test_what_a_user_named_cannot_break_the_page():
    name = "<b>&</script>"
    model = StateSpace([[0.9]], C=[[1.0]], Q=[[0.1]], R=[[0.2]], dt=1, states=[name], outputs=["y"])
    record = Record(NOISE[:, :1], dt=1, outputs=["y"])
    made = report_of(record, Kalman(model), Prior([0.0], [[1.0]]), title=name, lead=(name,))[1]
    page = report.page_of(made)
    assert name not in page
    assert embedded(page)["charts"][0]["traces"][-1]["name"] == name
    assert "&lt;b&gt;&amp;&lt;/script&gt;" in page


def test_names_that_look_like_markup_end_no_script(tmp_path):
    names = ("<!--", "<script")
    model = StateSpace(0.9 * np.eye(2), C=np.eye(2), Q=np.eye(2), R=np.eye(2), dt=0.5, states=names, outputs=names)
    record = Record(NOISE, dt=0.5, outputs=names)
    page = report.page_of(report_of(record, Kalman(model), Prior([0.0, 0.0], np.eye(2)))[1])
    data = page.split('id="data">')[1].split("</script>")[0]
    assert "<" not in data
    assert page.count("<script") == 3


def test_only_the_scripts_of_the_page_may_run():
    page = report.page_of(report_of()[1])
    policy = html.unescape(re.search(r'Content-Security-Policy" content="([^"]*)"', page)[1])
    scripts = re.findall(r"<script>(.*?)</script>", page, flags=re.DOTALL)
    hashes = [base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts]
    assert len(hashes) == 2
    assert policy.startswith(f"default-src 'none'; script-src 'sha256-{hashes[0]}' 'sha256-{hashes[1]}';")


def test_a_page_that_cannot_be_written_leaves_the_older_one(tmp_path):
    older = tmp_path / "page.html"
    older.write_text("older")
    older.chmod(0o400)
    if os.access(older, os.W_OK):
        older = tmp_path
    with pytest.raises(InputError, match="could not be written"):
        report.write_report(report_of()[1], older)
    assert list(tmp_path.iterdir()) == [tmp_path / "page.html"]


def test_what_is_not_known_is_a_gap_and_said_in_words():
    prior = Prior([0.0, 0.0], np.zeros((2, 2)), diffuse=np.eye(2))
    y = NOISE.copy()
    y[:5] = np.nan
    made = report_of(record_of(y), Kalman(MODEL), prior)[1]
    level = made.charts[0]
    assert np.isnan(numbers(level.traces[-1]["y"])[:5]).all()
    assert np.isfinite(numbers(level.traces[-1]["y"])[6:]).all()
    assert "State level unknown (diffuse)" in text_of(made)
    assert "Output level_m [m] 12.5% not seen" in text_of(made)


def test_a_long_record_is_thinned():
    made = report_of(record_of(np.zeros((13_000, 2))))[1]
    assert len(made.times) <= 6000
    assert len(numbers(made.charts[0].traces[0]["y"])) == len(made.times)
    assert made.times[1] == pytest.approx(1.5)


def test_a_record_without_time_counts_samples():
    made = report_of(record_of(dt=None))[1]
    assert made.time_axis == "time [s]" or made.time_axis == "sample"


def test_what_was_assumed_is_told():
    told = text_of(report_of()[1])
    for words in (
        "UnknownGain Assumes that the model is right except for its input gain",
        "Samples 40 over 19.5 s, every 0.5 s",
        "Input valve held over each sample; measured without error",
        "State level 1 ± 1 (1 sigma)",
        "Gain 1 ± 0.5 (1 sigma)",
        "discrete, dt = 0.5 s",
        "A [0.9, 0.1; 0, 0.8]",
        "engine native",
    ):
        assert words in told, words


def test_verdicts_say_whether_the_innovations_are_what_they_should_be():
    names = ["Size of the innovations (NIS)", "Whiteness of level_m", "Whiteness of sum"]
    made = report_of(record_of(100 * NOISE))[1]
    assert [verdict.name for verdict in made.verdicts] == names  # the input never moves: nothing is asked of it
    assert made.verdicts[0].met is False
    assert "✗ not consistent" in report.page_of(made)
    [unjudged] = report_of(record_of(np.full((40, 2), np.nan)))[1].verdicts
    assert unjudged.met is None


def test_an_input_that_is_left_in_the_innovations_is_told():
    u = np.sign(np.sin(np.arange(400.0)))
    y = NOISE[np.arange(400) % 40] + np.outer(10 * np.append(0, u[:-1]), [1.0, 0.0])
    record = Record(y, u, dt=0.5, outputs=MODEL.outputs, inputs=MODEL.inputs)
    told = {verdict.name: verdict.met for verdict in report_of(record)[1].verdicts}
    assert told["Effect of valve left in level_m"] is False


def test_a_result_of_one_row_is_refused():
    record, algorithm = record_of(), Kalman(MODEL)
    last = estimate(algorithm, record, prior=PRIOR, keep="last")
    with pytest.raises(InputError, match="a report needs every row"):
        report.report_of(last, record=record, algorithm=algorithm, prior=PRIOR)


def test_the_page_is_written(tmp_path):
    report.write_report(report_of(title="Tank")[1], tmp_path / "page.html")
    assert "<title>Tank</title>" in (tmp_path / "page.html").read_text()


def test_how_much_was_told_is_drawn_over_time_with_its_limit():
    plant = OutputError([-0.5], [1.0], noise_variance=0.1, dt=0.5)
    u = np.random.default_rng(0).normal(size=60)
    found = excitation(plant, simulate(plant, u, seed=0).record)
    chart = excitation_chart(found, 0.5 * np.arange(60))
    told = found.eigenvalues > 0
    x, y = (np.frombuffer(base64.b64decode(chart.traces[0][axis]["bdata"]), "<f4") for axis in "xy")
    np.testing.assert_allclose(x, 0.5 * found.samples[told])
    np.testing.assert_allclose(y, found.eigenvalues[told], rtol=1e-6)
    assert chart.layout["shapes"][0]["y0"] == found.check.limit
    assert chart.caption == found.check.sentence


def test_outputs_are_drawn_as_measured_and_as_the_states_imply_them():
    algorithm, record = Kalman(MODEL), record_of(np.where(np.arange(40)[:, None] % 3 == 0, np.nan, NOISE))
    later = smooth(algorithm, record, prior=PRIOR)
    result, made = report_of(record, algorithm, outputs=True, smoothed=later)
    headings = [chart.heading for chart in made.charts]
    assert headings[:4] == ["Output level_m [m]", "Output sum", "State level", "State flow"]
    lower, upper, seen, middle, smoothed = (numbers(trace["y"]) for trace in made.charts[1].traces)
    np.testing.assert_allclose(middle, result.output[:, 1], rtol=1e-5)
    np.testing.assert_allclose(upper - lower, 4 * np.sqrt(result.output_covariance[:, 1, 1]), rtol=1e-4)
    np.testing.assert_allclose(seen, record.y[:, 1], rtol=1e-6)
    np.testing.assert_allclose(smoothed, later.output[:, 1], rtol=1e-5)
    (table,) = made.found
    assert [name for name, _ in table.items] == ["Output level_m [m]", "Output sum", "State level", "State flow"]
    assert table.items[2][1].startswith(f"{result.mean[-1, 0]:.6g} ± ")
