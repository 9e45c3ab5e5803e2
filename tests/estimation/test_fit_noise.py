"""Noise levels found by likelihood: against the likelihood itself, and against what was drawn."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import (
    AssumptionError,
    ExtendedKalman,
    InputError,
    Kalman,
    NonlinearModel,
    Prior,
    Record,
    SecondOrderKalman,
    StateSpace,
    UnknownGain,
    estimate,
    fit_noise,
    load,
    save,
    simulate,
)
from estimable.frozen import replace

PRIOR = Prior([0.0], [[1.0]])
TRUE = StateSpace([[0.9]], Q=[[0.2]], R=[[0.5]], dt=1)
START = Kalman(StateSpace([[0.9]], Q=[[1.0]], R=[[1.0]], dt=1))


def likelihood(Q, R, records):
    tried = Kalman(replace(TRUE, Q=np.array([[Q]]), R=np.array([[R]])))
    return sum(estimate(tried, record, prior=PRIOR, keep="likelihood").log_likelihood for record in records)


def fisher(parameters, records, h=1e-5):
    """Fisher's information of (Q, R) in the innovations of one output, by differences: Σ ∂e ∂e' / s + ∂s ∂s' / 2 s²."""

    def innovations(Q, R):
        tried = Kalman(replace(TRUE, Q=np.array([[Q]]), R=np.array([[R]])))
        ran = [estimate(tried, record, prior=PRIOR) for record in records]
        e = np.concatenate([one.innovation[:, 0] for one in ran])
        return np.stack([e, np.concatenate([one.innovation_covariance[:, 0, 0] for one in ran])])

    slopes = [(innovations(*(parameters + h * a)) - innovations(*(parameters - h * a))) / (2 * h) for a in np.eye(2)]
    s = innovations(*parameters)[1]
    seen = np.isfinite(slopes[0][0])
    e, ds = (np.stack([slope[i][seen] for slope in slopes]) for i in range(2))
    return (e / s[seen]) @ e.T + (ds / (2 * s[seen] ** 2)) @ ds.T


def test_no_noise_levels_nearby_are_more_likely_and_the_errors_are_those_of_the_information(tmp_path):
    y = simulate(TRUE, seed=1, steps=500).record.y.copy()
    y[np.random.default_rng(0).random(y.shape) < 0.2] = np.nan
    records = [Record(y[:300], dt=1), Record(y[300:], dt=1)]
    fit = fit_noise(START, records, prior=PRIOR)
    (Q, R), h = fit.parameters, 1e-3
    best = likelihood(Q, R, records)
    assert_allclose(fit.log_likelihood, best, rtol=1e-12)
    assert_allclose(fit.model.Q, [[Q]], rtol=1e-14)
    for dQ, dR in ((h, 0), (-h, 0), (0, h), (0, -h)):
        assert likelihood(Q + dQ, R + dR, records) < best

    assert_allclose(fit.covariance, np.linalg.inv(fisher(fit.parameters, records)), rtol=1e-6)

    def second(a, b):
        """Second derivative of the likelihood along the unit vectors a and b of (Q, R)."""
        signs = ((1, 1), (1, -1), (-1, 1), (-1, -1))
        return sum(i * j * likelihood(*(fit.parameters + h * (i * a + j * b)), records) for i, j in signs) / (4 * h * h)

    unit = np.eye(2)
    information = -np.array([[second(unit[i], unit[j]) for j in range(2)] for i in range(2)])
    between = np.linalg.eigvals(fit.covariance @ information)  # 1 in the mean over records
    assert np.all((between > 0.6) & (between < 1.6))
    assert fit.names == ("Q[x1]", "R[y1]")
    assert repr(fit).startswith("NoiseFit(Q[x1] = ")
    save(tmp_path / "fit.npz", fit)
    assert load(tmp_path / "fit.npz").names == fit.names


def test_a_full_covariance_a_scale_and_a_walk_are_found():
    """Two states that share noise; a gain that walks."""
    model = StateSpace([[0.8, 0.0], [0.0, 0.7]], Q=[[0.3, 0.1], [0.1, 0.2]], R=0.05 * np.eye(2), dt=1)
    drawn = simulate(model, seed=3, steps=1500).record
    rough = Kalman(StateSpace(model.A, Q=np.eye(2), R=0.05 * np.eye(2), dt=1))
    full = fit_noise(rough, drawn, prior=Prior([0, 0], np.eye(2)), free={"Q": "full"})
    assert full.names == ("Q[x1]", "Q[x2, x1]", "Q[x2]")
    assert np.all(np.abs(full.parameters - [0.3, 0.1, 0.2]) < 3.5 * full.sigma)
    assert np.all(np.linalg.eigvalsh(full.model.Q) > 0)
    scaled = fit_noise(
        Kalman(replace(model, Q=3 * model.Q)), drawn, prior=Prior([0, 0], np.eye(2)), free={"Q": "scale"}
    )
    assert scaled.names == ("Q scale",)
    assert abs(scaled.parameters[0] - 1 / 3) < 3.5 * scaled.sigma[0]
    rng = np.random.default_rng(0)
    gain, u = 1 + np.cumsum(rng.normal(size=800)) * np.sqrt(0.01), np.sign(rng.normal(size=800))
    x = np.zeros(801)
    for k in range(800):
        x[k + 1] = 0.5 * x[k] + gain[k] * u[k]
    record = Record(x[:800] + 0.3 * rng.normal(size=800), u, dt=1)
    walking = UnknownGain(StateSpace([[0.5]], [[1.0]], R=[[1.0]], dt=1), Prior([1.0], [[0.1]]), walk=1.0)
    walked = fit_noise(walking, record, prior=PRIOR, free=("R", "walk"))
    assert walked.names == ("R[y1]", "walk[gain]")
    assert np.all(np.abs(walked.parameters - [0.09, 0.01]) < 3.5 * walked.sigma)
    assert_allclose(walked.algorithm.walk, [[walked.parameters[1]]])


def test_a_continuous_density_is_found_at_irregular_times():
    model = StateSpace([[-1.0]], Q=[[0.5]], R=[[0.05]], dt=0)
    t = np.cumsum(np.random.default_rng(0).choice([0.1, 0.3, 0.8], size=800))
    record = simulate(model, seed=2, t=t).record
    fit = fit_noise(Kalman(replace(model, Q=np.array([[1.0]]), R=np.array([[1.0]]))), record, prior=PRIOR)
    assert fit.model.is_continuous
    assert np.all(np.abs(fit.parameters - [0.5, 0.05]) < 3.5 * fit.sigma)
    assert_allclose(fit.log_likelihood, estimate(fit.algorithm, record, prior=PRIOR).log_likelihood, rtol=1e-10)


def test_a_variance_that_is_not_there_is_taken_to_zero():
    """Neighbours that pull apart: any process noise would make them alike."""
    y = np.tile([1.0, -1.0], 60) + 0.1 * np.random.default_rng(1).normal(size=120)
    fit = fit_noise(Kalman(StateSpace([[1.0]], Q=[[0.1]], R=[[1.0]], dt=1)), Record(y, dt=1), prior=PRIOR)
    assert fit.at_zero == ("Q[x1]",)
    assert fit.model.Q[0, 0] == 0
    assert fit.sigma[0] == 0
    assert_allclose(fit.parameters[1], 1.0, rtol=0.05)
    assert_allclose(fit.sigma[1], fit.parameters[1] * np.sqrt(2 / 120), rtol=0.05)


def test_what_the_records_cannot_tell_apart_is_refused_with_its_direction():
    """A state without memory: only Q + R is seen, but for the first row, which is missing."""
    model = StateSpace([[0.0]], Q=[[1.0]], R=[[1.0]], dt=1)
    y = np.random.default_rng(0).normal(size=200)
    y[0] = np.nan
    with pytest.raises(
        AssumptionError, match=r"do not distinguish the free entries: along .*log Q\[x1\].*log R\[y1\].*eigenvalue"
    ):
        fit_noise(Kalman(model), Record(y, dt=1), prior=PRIOR)
    blind = Record(np.full(50, np.nan), dt=1)
    with pytest.raises(AssumptionError, match="do not distinguish the free entries"):
        fit_noise(START, blind, prior=PRIOR, free="R")


def test_a_wrong_call_is_refused_in_words():
    record = simulate(TRUE, seed=1, steps=20).record
    with pytest.raises(InputError, match=r"`free` must name covariances: 'Q', 'R', 'S'\. Got 'q'"):
        fit_noise(START, record, prior=PRIOR, free=("q",))
    with pytest.raises(InputError, match="`free` is empty: name at least one covariance"):
        fit_noise(START, record, prior=PRIOR, free=())
    with pytest.raises(InputError, match="`Q` starts from a variance of zero for 'x1'"):
        fit_noise(Kalman(replace(TRUE, Q=np.zeros((1, 1)))), record, prior=PRIOR, free="Q")
    with pytest.raises(InputError, match="1 bools, one per variance"):
        fit_noise(START, record, prior=PRIOR, free={"Q": [True, False]})
    with pytest.raises(InputError, match="'diagonal', 'scale', 'full'"):
        fit_noise(START, record, prior=PRIOR, free={"Q": "diag"})
    with pytest.raises(InputError, match=r"`record` must be a Record, or a list of them\. Got \[\]\."):
        fit_noise(START, [], prior=PRIOR)
    with pytest.raises(InputError, match="fit_noise needs an algorithm of a model with noises"):
        fit_noise(TRUE, record, prior=PRIOR)
    with pytest.raises(InputError, match=r'cross noise S is fitted together with Q and R: free=\("Q", "R", "S"\)'):
        fit_noise(START, record, prior=PRIOR, free="S")
    with pytest.raises(InputError, match="joint covariance of `Q`, `S` and `R` must be positive definite"):
        fit_noise(Kalman(replace(TRUE, Q=np.zeros((1, 1)))), record, prior=PRIOR, free=("Q", "R", "S"))


def test_cross_noise_is_found_with_both_covariances_where_few_noises_drive_many_states():
    """Of one state, only two of the three show: refused. One noise that drives two states: all show."""
    one = StateSpace([[0.7]], Q=[[0.5]], R=[[0.4]], S=[[0.3]], dt=1)
    with pytest.raises(AssumptionError, match="do not distinguish the free entries"):
        fit_noise(
            Kalman(without_cross_noise(one)), simulate(one, seed=5, steps=300).record, prior=PRIOR, free=("Q", "R", "S")
        )
    two = StateSpace([[0.7, 1.0], [0.0, 0.5]], C=[[1.0, 0.0]], G=[[0.0], [1.0]], Q=[[0.5]], R=[[0.4]], S=[[0.3]], dt=1)
    record = simulate(two, seed=5, steps=5000).record
    fit = fit_noise(Kalman(without_cross_noise(two)), record, prior=Prior([0, 0], np.eye(2)), free=("Q", "R", "S"))
    assert fit.names == ("Q[w1]", "S[w1, y1]", "R[y1]")
    assert np.all(np.abs(fit.parameters - [0.5, 0.3, 0.4]) < 3.5 * fit.sigma)
    assert_allclose(fit.model.S, [[fit.parameters[1]]])


def without_cross_noise(model):
    """The model without cross noise, and with other variances."""
    return replace(model, Q=np.array([[1.0]]), R=np.array([[1.0]]), S=None)


@pytest.mark.parametrize("kind", [ExtendedKalman, SecondOrderKalman])
def test_a_nonlinear_filter_finds_the_noises_of_the_linear_model_it_is_given(kind):
    """Of a linear model, each is the Kalman filter: the same fit."""
    linear = simulate(TRUE, seed=1, steps=300).record
    model = NonlinearModel(
        lambda x, u, θ: 0.9 * x, lambda x, u, θ: x, Q=[[1.0]], R=[[1.0]], dt=1, outputs=["y1"], states=["x1"]
    )
    found, exact = (fit_noise(algorithm, linear, prior=PRIOR) for algorithm in (kind(model), START))
    assert_allclose(found.parameters, exact.parameters, rtol=1e-6)
    assert_allclose(found.covariance, exact.covariance, rtol=1e-6)
    assert found.names == exact.names


def test_a_bar_appears_after_a_while_on_a_terminal_only(monkeypatch, capsys):
    record = simulate(TRUE, seed=1, steps=100).record
    fit_noise(START, record, prior=PRIOR)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    for after, shown in ((0.0, True), (60.0, False)):
        monkeypatch.setattr("estimable.estimation.fit_noise.AFTER", after)
        fit_noise(START, record, prior=PRIOR)
        assert ("steps, at most" in capsys.readouterr().err) == shown
    with pytest.raises(InputError, match="`progress` must be"):
        fit_noise(START, record, prior=PRIOR, progress="yes")


def test_single_covariances_are_free_in_blocks():
    """Three noises, of which the first two share a covariance: the others stay as they were, and no trial is indefinite."""
    Q = np.array([[0.3, 0.1, 0.0], [0.1, 0.2, 0.0], [0.0, 0.0, 0.05]])
    model = StateSpace(np.diag([0.8, 0.7, 0.5]), Q=Q, R=0.02 * np.eye(3), dt=1)
    drawn, prior = simulate(model, seed=5, steps=800).record, Prior(np.zeros(3), np.eye(3))
    block = np.zeros((3, 3), bool)
    block[:2, :2] = True
    start = np.diag([1.0, 1.0, 0.05])
    fit = fit_noise(Kalman(replace(model, Q=start)), drawn, prior=prior, free={"Q": block})
    assert fit.names == ("Q[x1]", "Q[x2, x1]", "Q[x2]")
    assert np.all(np.abs(fit.parameters - [0.3, 0.1, 0.2]) < 3.5 * fit.sigma)
    assert_allclose(fit.model.Q[2], start[2], rtol=0, atol=0)
    assert fit.converged
    assert fit.sentence == ""
    for mask, begin, sentence in (
        (
            [[True, True, False], [False, True, False], [False, False, False]],
            start,
            r"must be blocks: where the covariance",
        ),
        (block, Q + 0.01, r"`Q` has covariances other than 0 outside the free blocks"),
        (np.ones((2, 2), bool), start, r"3 bools, one per variance, or a symmetric \(3, 3\) array of bools"),
    ):
        with pytest.raises(InputError, match=sentence):
            fit_noise(Kalman(replace(model, Q=begin)), drawn, prior=prior, free={"Q": mask})


def test_a_covariance_that_varies_in_time_is_fitted_up_to_factors():
    """The variance of each row is known but for a factor: that of the constant case, where the rows are alike."""
    T = 600
    shape = 1 + 0.5 * np.sin(np.arange(T))[:, None, None]
    true = StateSpace([[0.9]], Q=0.2 * shape, R=[[0.5]], dt=1)
    drawn = simulate(true, seed=1, steps=T).record
    fit = fit_noise(Kalman(replace(true, Q=shape, R=np.eye(1))), drawn, prior=PRIOR)
    assert fit.names == ("Q scale[x1]", "R[y1]")
    assert np.all(np.abs(fit.parameters - [0.2, 0.5]) < 3.5 * fit.sigma)
    assert_allclose(fit.model.Q, fit.parameters[0] * shape, rtol=1e-12)
    alike = fit_noise(Kalman(replace(true, Q=np.ones((T, 1, 1)), R=np.eye(1))), drawn, prior=PRIOR, free={"Q": "scale"})
    constant = fit_noise(Kalman(replace(TRUE, Q=np.eye(1), R=np.eye(1))), drawn, prior=PRIOR, free={"Q": "scale"})
    assert_allclose(alike.parameters, constant.parameters, rtol=1e-6)
    with pytest.raises(InputError, match=r'`Q` varies in time: free\["Q"\] must be "scale", "diagonal" or bools'):
        fit_noise(Kalman(true), drawn, prior=PRIOR, free={"Q": "full"})


def test_a_search_that_ends_below_the_maximum_says_so(monkeypatch):
    """With two steps the search cannot get there: the result begins with the sentence."""
    from estimable.estimation import climb

    monkeypatch.setattr(climb, "MOST", 2)
    drawn = simulate(TRUE, seed=1, steps=300).record
    far = Kalman(replace(TRUE, Q=np.array([[5.0]]), R=np.array([[0.05]])))
    fit = fit_noise(far, drawn, prior=PRIOR)
    assert not fit.converged
    assert fit.sentence.startswith("The search stopped after 2 steps below the maximum of the likelihood: do not use")
    assert repr(fit).startswith("NoiseFit(The search stopped")
    farther = Kalman(replace(TRUE, Q=np.array([[1e4]]), R=np.array([[1e-4]])))
    with pytest.raises(AssumptionError, match=r"search stopped after 2 steps below the maximum"):
        fit_noise(farther, drawn, prior=PRIOR)
