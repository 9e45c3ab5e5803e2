"""The figure of an estimate."""

import numpy as np
import pytest

from estimable import InputError, Kalman, Prior, Record, StateSpace, UnknownGain, estimate
from estimable.figures.estimate_plots import plot_estimate
from estimable.tables import standard_deviation

NAMES = {"states": ["level"], "inputs": ["valve"], "outputs": ["gauge"]}
MODEL = StateSpace([[0.9]], [[1.0]], [[1.0]], Q=[[0.1]], R=[[0.2]], dt=0.5, **NAMES)
PRIOR, GAIN = Prior([0.0], [[1.0]]), Prior([1.0], [[0.25]])
Y = [[1.0], [np.nan], [2.5], [2.0]]


def result(rows=4, keep="all", prior=PRIOR, algorithm=None):
    record = Record(Y[:rows], np.ones((rows, 1)), dt=0.5, outputs=["gauge"], inputs=["valve"])
    return estimate(algorithm or UnknownGain(MODEL, GAIN), record, prior=prior, keep=keep)


def titles(figure):
    return [annotation.text for annotation in figure.layout.annotations]


def test_one_row_a_quantity_on_one_time_axis():
    found = result()
    figure = found.plot()
    assert titles(figure) == ["level, ± 2 sigma", "gain, ± 2 sigma", "innovation of gauge, bounds ± 2 sigma"]
    assert figure.layout.xaxis3.title.text == "time (s)"
    assert [figure.layout[axis].matches for axis in ("xaxis", "xaxis2")] == ["x3", "x3"]
    assert len(figure.data) == 9
    assert all(np.array_equal(trace.x, [0.0, 0.5, 1.0, 1.5]) for trace in figure.data)


def test_bands_are_two_sigma_about_the_estimate():
    found = result()
    traces = {trace.name: trace for trace in found.plot().data}
    sigma = np.sqrt(found.covariance[:, 0, 0])
    np.testing.assert_allclose(traces["level"].y, found.mean[:, 0])
    np.testing.assert_allclose(traces["level +2 sigma"].y, found.mean[:, 0] + 2 * sigma)
    np.testing.assert_allclose(traces["level -2 sigma"].y, found.mean[:, 0] - 2 * sigma)
    assert traces["level -2 sigma"].fill == "tonexty"
    assert traces["gain"].yaxis == "y2"


def test_innovations_have_bounds_about_zero_and_a_gap_where_nothing_was_seen():
    found = result()
    traces = {trace.name: trace for trace in found.plot().data}
    sigma = np.sqrt(found.innovation_covariance[:, 0, 0])
    np.testing.assert_allclose(traces["gauge +2 sigma"].y, 2 * sigma)
    np.testing.assert_allclose(traces["gauge -2 sigma"].y, -2 * sigma)
    assert np.isnan(traces["gauge"].y).tolist() == [False, True, False, False]


def test_what_was_not_kept_is_left_out():
    figure = plot_estimate(result(keep="means"))
    assert titles(figure) == ["level", "gain", "innovation of gauge"]
    assert len(figure.data) == 3
    with pytest.raises(InputError, match="no rows to draw"):
        plot_estimate(result(keep="likelihood"))


def test_an_algorithm_without_a_gain_has_no_row_for_it():
    figure = plot_estimate(result(algorithm=Kalman(MODEL)))
    assert titles(figure) == ["level, ± 2 sigma", "innovation of gauge, bounds ± 2 sigma"]


@pytest.mark.parametrize("how", [{"rows": 1}, {"keep": "last"}])
def test_one_row_is_drawn_as_points_with_error_bars(how):
    found = result(**how)
    level = plot_estimate(found).data[0]
    assert level.mode == "markers"
    assert level.y.tolist() == found.mean[-1:, 0].tolist()
    np.testing.assert_allclose(level.error_y.array, 2 * np.sqrt(found.covariance[-1:, 0, 0]))


def test_a_record_without_time_counts_samples():
    found = estimate(Kalman(MODEL), Record([[1.0], [2.0]], [[0.0], [0.0]]), prior=PRIOR)
    figure = plot_estimate(found)
    assert figure.layout.xaxis2.title.text == "sample"
    assert figure.data[0].x.tolist() == [0, 1]


def test_what_nothing_is_known_of_is_a_gap():
    blind = StateSpace(np.diag([0.9, 0.9]), None, [[1.0, 0.0]], Q=np.eye(2), R=[[1.0]], dt=0.5)
    prior = Prior([0.0, 0.0], np.zeros((2, 2)), diffuse=np.eye(2))
    found = estimate(Kalman(blind), Record([[1.0], [2.0]], dt=0.5), prior=prior)
    traces = {trace.name: trace for trace in plot_estimate(found).data}
    assert np.isfinite(traces["x1"].y).all()
    assert np.isnan(traces["x2"].y).all()
    assert np.isnan(traces["x2 +2 sigma"].y).all()


def test_a_figure_is_as_tall_as_its_rows_and_leaves_the_width_to_the_page():
    few, many = plot_estimate(result(algorithm=Kalman(MODEL))), plot_estimate(result())
    assert many.layout.height > few.layout.height > 300
    assert many.layout.width is None
    assert not many.layout.showlegend
    wide = StateSpace(0.9 * np.eye(12), None, None, Q=np.eye(12), R=np.eye(12), dt=0.5)
    found = estimate(Kalman(wide), Record(np.ones((3, 12)), dt=0.5), prior=Prior(np.zeros(12), np.eye(12)))
    figure = plot_estimate(found)
    domains = [figure.layout[f"yaxis{i or ''}"].domain for i in (0, *range(2, 25))]
    assert min(top - bottom for bottom, top in domains) * figure.layout.height > 120


def test_a_vague_prior_does_not_flatten_the_rows():
    record = Record(np.ones((40, 1)), np.ones((40, 1)), dt=0.5, outputs=["gauge"], inputs=["valve"])
    vague = estimate(Kalman(MODEL), record, prior=Prior([0.0], [[1e6]]))
    bottom, top = plot_estimate(vague).layout.yaxis2.range
    assert -10 < bottom < vague.innovation.min() < vague.innovation.max() < top < 10
    assert plot_estimate(result()).layout.yaxis2.range is None  # all of it fits


def test_rounding_leaves_no_variance_below_zero_and_nothing_diffuse():
    sigma = standard_deviation(np.array([[[-1e-18, 0.0], [0.0, 4.0]]]), np.array([[[1.0, 0.0], [0.0, 1e-17]]]))
    assert sigma.tolist() == [[np.inf, 2.0]]
