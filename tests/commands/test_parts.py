"""The pure functions behind the commands."""

import math

import numpy as np
import pytest

from estimable import InputError, Prior, StateSpace, UnknownGain
from estimable.commands.gain_summary import gain_summary
from estimable.commands.innovation_checks import innovation_check
from estimable.commands.run_filter import record_options
from estimable.commands.settings import read_settings
from estimable.commands.show import plain
from estimable.commands.terminal_plot import ASCII, UNICODE, plot, ticks
from estimable.phrases import spread_of
from estimable.results import Estimate, Info, Names, Outcome


def result_of(gain, variance, t, **info):
    gain = np.asarray(gain, float).reshape(len(gain), -1)
    names = Names(("x",), ("u",), ("y",), tuple(f"g{i}" for i in range(gain.shape[1])))
    covariance = np.asarray(variance, float)[:, None, None] * np.eye(gain.shape[1])
    info = Info(gain=gain, gain_covariance=covariance, **info)
    return Estimate(info, t, 0.0, Outcome(0, None, None, ""), "xla", names)


def test_the_gains_are_those_of_a_third_and_of_the_end_with_their_own_sigma():
    t = 5.0 + np.arange(0, 13) * 1.0  # from 5 to 17 s: a third at 9 s
    summary = gain_summary(result_of(np.arange(13.0), 0.01 * np.arange(1, 14), t))
    assert (summary.before.time, summary.after.time) == (9.0, 17.0)
    assert (summary.before.mean.tolist(), summary.after.mean.tolist()) == ([4.0], [12.0])
    assert summary.before.sigma == pytest.approx([math.sqrt(0.05)])
    assert summary.after.sigma == pytest.approx([math.sqrt(0.13)])
    assert not summary.overlap


def test_of_a_distribution_that_is_no_gaussian_the_median_and_the_interval_count():
    quantiles = np.array([0.0, 0.4, 0.5, 0.6, 3.919928])[None, None] * np.ones((13, 1, 1))
    summary = gain_summary(result_of(np.ones(13), np.ones(13), np.arange(13.0), gain_quantiles=quantiles))
    assert summary.after.mean.tolist() == [0.5]
    assert summary.after.sigma == pytest.approx([1.0], rel=1e-6)


def test_between_samples_the_last_one_before_counts():
    summary = gain_summary(result_of([1.0, 2.0, 3.0], [1.0, 4.0, 9.0], np.array([0.0, 10.0, 90.0])))
    assert (summary.before.mean[0], summary.before.sigma[0]) == (2.0, 2.0)
    assert (summary.after.mean[0], summary.after.sigma[0]) == (3.0, 3.0)


@pytest.mark.parametrize("t", [None, np.array([7.0])])
def test_one_sample_is_before_and_after(t):
    summary = gain_summary(result_of([0.8], [0.04], t))
    assert (summary.before.mean[0], summary.after.mean[0]) == (0.8, 0.8)
    assert summary.overlap
    assert summary.findings == ("The gain: the record is too short to compare before and after.",)


@pytest.mark.parametrize(
    ("before", "after", "sigma", "finding"),
    [
        (1.0, 0.5, 0.1, "The gain fell from 1.00 to 0.50; chance alone explains up to 0.28 (2 sigma)."),
        (-1.0, -1.5, 0.1, "The gain rose from -1.00 to -1.50; chance alone explains up to 0.28 (2 sigma)."),
        (1.0, -1.5, 0.1, "The gain changed from 1.00 to -1.50; chance alone explains up to 0.28 (2 sigma)."),
        (17.502, 17.498, 5e-4, "The gain fell from 17.5020 to 17.4980; chance alone explains up to 0.0014 (2 sigma)."),
        (
            1.0,
            0.9,
            0.1,
            "The gain: no change is detected: 1.00 at 4 s and 0.90 at 12 s differ by less than 2 sigma (0.28).",
        ),
    ],
)
def test_what_is_found_of_one_gain(before, after, sigma, finding):
    t = np.arange(13.0)
    summary = gain_summary(result_of(np.where(t < 5, before, after), np.full(13, sigma**2), t))
    assert summary.findings == (finding,)


def test_rows_of_which_nothing_is_known_do_not_count():
    t = np.arange(13.0)
    early, always = np.where(t < 4, 1.0, 0.0)[:, None, None], np.ones((13, 1, 1))
    gain = np.where(t < 4, 99.0, 1.0)
    summary = gain_summary(result_of(gain, np.ones(13), t, extra={"gain_diffuse_covariance": early}))
    assert summary.before.mean.tolist() == [1.0]
    unknown = gain_summary(result_of(gain, np.ones(13), t, extra={"gain_diffuse_covariance": always}))
    assert np.isnan(unknown.after.mean[0])
    assert np.isinf(unknown.after.sigma[0])
    assert unknown.findings == ("The gain: the record does not determine it.",)


def test_what_is_lost_is_said_of_shares_only():
    model = StateSpace([[0.5]], [[1.0]], R=[[1.0]], dt=1)
    gain = Prior([1.0], [[1.0]])
    assert UnknownGain(model, gain).gain_is_effectiveness
    assert UnknownGain(model, gain, directions="per_input").gain_is_effectiveness
    assert not UnknownGain(model, gain, directions="every_entry").gain_is_effectiveness
    assert not UnknownGain(model, gain, directions=[[[2.0]]]).gain_is_effectiveness
    assert not UnknownGain(model, gain, fixed=[[1.0]]).gain_is_effectiveness


def test_innovations_predicted_from_nothing_are_no_evidence():
    innovation = np.array([[1000.0], [1.0], [-1.0], [np.nan]])
    variance = np.array([np.nan, 1.0, 1.0, np.nan])[:, None, None]  # NaN where it was infinite
    times = (np.ones(4), np.ones(4), np.arange(4.0))
    finite = result_of(*times, innovation=innovation, innovation_covariance=np.ones((4, 1, 1)))
    assert innovation_check(finite).mean == pytest.approx(1e6 / 3, rel=1e-4)
    check = innovation_check(result_of(*times, innovation=innovation, innovation_covariance=variance))
    assert check.mean == pytest.approx(1.0)
    assert check.degrees == 2


def test_no_innovation_is_no_check():
    t = np.arange(2.0)
    assert innovation_check(result_of(np.ones(2), np.ones(2), t)) is None
    seen = {"innovation": np.full((2, 1), np.nan), "innovation_covariance": np.ones((2, 1, 1))}
    assert innovation_check(result_of(np.ones(2), np.ones(2), t, **seen)) is None
    exact = {"innovation": np.zeros((2, 1)), "innovation_covariance": np.zeros((2, 1, 1))}
    assert innovation_check(result_of(np.ones(2), np.ones(2), t, **exact)) is None


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1", 1), ("1e-3", 1e-3), (".5", 0.5), ("-2.", -2.0), ("1_000", 1000), ("true", True), ("null", None),
        ("per_input", "per_input"), ('"two words"', "two words"), ("'one'", "one"), ("[1, 2.5]", [1, 2.5]),
        ("[[1.0], [2]]", [[1.0], [2]]),
    ],
)  # fmt: skip
def test_values_of_settings(text, value):
    read = read_settings([f" x = {text} "])["x"]
    assert read == value
    assert type(read) is type(value)


@pytest.mark.parametrize("text", ["1\ny = 2", "[1", "two words", "", "{", "a=b"])
def test_values_that_are_none(text):
    with pytest.raises(InputError, match="is not a number, list or word"):
        read_settings([f"x={text}"])


def test_a_time_column_replaces_a_step_and_the_reverse():
    assert record_options({"dt": 0.1, "lost": "hold"}, {"time": "t"}) == {"lost": "hold", "time": "t"}
    assert record_options({"time": "t"}, {"dt": 0.1}) == {"dt": 0.1}
    assert record_options({"time": "t"}, {"time": None, "lost": "zero"}) == {"time": "t", "lost": "zero"}


def test_json_has_no_nan():
    found = plain({"a": [np.float64("nan"), -math.inf, 1.5], "b": ("x", None, 2)})
    assert found == {"a": [None, None, 1.5], "b": ["x", None, 2]}


@pytest.mark.parametrize(
    ("value", "spread", "text"),
    [(0.4926, 0.2191, "0.49 ± 0.22"), (-17.49, 3.2, "-17.5 ± 3.2"), (1234.4, 55.0, "1234 ± 55"),
     (0.0, 0.0, "0.0000 ± 0.0000"), (1.0, math.inf, "not known"), (math.nan, 1.0, "not known")],
)  # fmt: skip
def test_a_value_has_the_digits_that_its_spread_leaves(value, spread, text):
    assert spread_of(value, spread) == text


@pytest.mark.parametrize(
    ("low", "high", "count"), [(0.0, 12.0, 6), (-0.3, 2.1, 4), (1e-7, 3e-7, 3), (-5e4, 9e4, 5), (16.99, 17.01, 3)]
)
def test_ticks_are_round_distinct_and_inside(low, high, count):
    found = ticks(low, high, count)
    assert 2 <= len(found) <= count + 2
    assert len(set(found.values())) == len(found)
    assert all(low - 1e-9 * (high - low) <= value <= high + 1e-9 * (high - low) for value in found)
    assert all(float(label) == pytest.approx(value, abs=1e-9 * (high - low)) for value, label in found.items())


@pytest.mark.parametrize("ink", [UNICODE, ASCII])
@pytest.mark.parametrize("width", [30, 60, 100])
def test_a_plot_fits_and_shows_a_curve_in_its_band(ink, width):
    t = np.linspace(0, 10, 200)
    lines = plot(t, t / 10, np.full(200, 0.1), width=width, height=8, marks={"start": (0.0, 4.0)}, ink=ink)
    assert len(lines) == 11
    assert max(map(len, lines)) <= width
    assert sum(line.count(ink.band) for line in lines[:8]) > width / 2
    assert "start" in lines[-1]
    assert lines[-2].split()[0] == "s"
    if ink is ASCII:
        assert "".join(lines).isascii()
        columns = [line.find("*") for line in lines[:8] if "*" in line]
        assert len(columns) >= 6
        assert columns == sorted(set(columns), reverse=True)  # a rising line


def test_a_step_is_drawn_as_a_connected_line():
    t = np.linspace(0, 1, 50)
    lines = plot(t, np.where(t < 0.5, 0.0, 1.0), np.zeros(50), width=40, height=9, ink=ASCII)
    assert all("*" in line for line in lines[:9])


@pytest.mark.parametrize(
    ("middle", "sigma"),
    [([1.0], [0.5]), ([1.0], [0.0]), ([1.0, 1.0], [np.inf, 0.5]), ([0.0, 0.0], [np.inf, np.inf]),
     ([0.0, 0.0], [0.0, 0.0]), ([1e300, -1e300], [1.0, 1.0])],
)  # fmt: skip
def test_a_plot_of_little_is_still_a_plot(middle, sigma):
    lines = plot(np.arange(len(middle)) * 1.0, np.array(middle), np.array(sigma), width=50, ink=ASCII)
    assert len(lines) == 14


def test_a_vague_prior_does_not_flatten_the_plot():
    sigma = np.where(np.arange(100) < 5, 1000.0, 0.1)
    lines = plot(np.arange(100.0), np.ones(100), sigma, width=60, ink=ASCII)[:12]
    labels = [float(line.split("+")[0]) for line in lines if "+" in line]
    assert len(labels) >= 2
    assert all(0.5 < label < 1.5 for label in labels)
