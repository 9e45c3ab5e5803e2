"""Steps from Python as machine code: what `estimate` gives, in every order of calls, saved and resumed."""

import pickle

import jax
import numpy as np
import pytest
from numpy.testing import assert_allclose

from cases import case
from estimable import InputError, Kalman, Prior, RunError, StateSpace, UnknownGain, estimate, load, online, save
from estimable.engines.program.primitives import UnsupportedError

FEATURES = ({}, {"cross": True}, {"missing": 0.8}, {"varying": True})


def run(algorithm, c, engine):
    running, infos = online(algorithm, prior=c.prior, engine=engine), []
    for y, u in zip(c.record.y, c.record.u, strict=True):
        infos.append(running.correct(y, u))
        running.predict(u)
    return running, infos


def assert_equal(a, b):
    for x, y in zip(jax.tree_util.tree_leaves(a), jax.tree_util.tree_leaves(b), strict=True):
        assert_allclose(x, y, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("features", FEATURES, ids=str)
def test_machine_code_says_at_each_sample_what_xla_says(features):
    c = case(1, (2, 1, 1), **features)
    for algorithm in (Kalman(c.model), UnknownGain(c.model, Prior([1.0], [[1.0]]))):
        (native, told), (xla, expected) = run(algorithm, c, "native"), run(algorithm, c, "xla")
        for a, b in zip(told, expected, strict=True):
            assert_equal(a, b)
        assert_equal(native.progress.state, xla.progress.state)
        assert native.progress.sample == len(c.record.y)
        whole = estimate(algorithm, c.record, prior=c.prior)
        assert_allclose([info.mean for info in told], whole.mean, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("hold", ["zero_order", "first_order"])
def test_steps_of_a_continuous_model_may_differ_in_length(hold):
    model = StateSpace([[0.0, 1.0], [-2.0, -0.5]], [[0.0], [1.0]], C=[[1.0, 0.0]], Q=0.1 * np.eye(2), R=[[0.1]], dt=0)
    rng, u = np.random.default_rng(0), np.zeros(1)
    native, xla = (online(Kalman(model), prior=PRIOR, engine=engine, hold=hold) for engine in ("native", "xla"))
    for dt in (0.1, None, 0.25, 0.1, 0.1, None):
        y, end = rng.normal(size=1), rng.normal(size=1)
        told, expected = (running.correct(y) for running in (native, xla))
        assert_equal(told, expected)
        for running in (native, xla):
            running.predict(u, u_end=end if hold == "first_order" else None, dt=dt)
        u = end
    assert native.progress.dt == xla.progress.dt == 0.1
    assert_equal(native.progress.state, xla.progress.state)


def test_plain_lists_are_taken_as_they_are_and_others_looked_at():
    lists, arrays = (online(Kalman(MODEL), prior=PRIOR, engine="native") for _ in range(2))
    for y in ([1.0, float("nan")], [1, 2], [True, 2.0], (0.5, 0.5)):
        told, expected = lists.correct(y), arrays.correct(np.asarray(y, float))
        assert_equal(told.whole(), expected.whole())
        lists.predict([0.5])
        arrays.predict(np.array([0.5]))
    for y in ([[1.0, 2.0]], [1.0], [1.0, None], ["1", "2"]):
        with pytest.raises(InputError, match="`y` must"):
            lists.correct(y)
    assert_equal(lists.correct([0.0, 0.0]).whole(), arrays.correct(np.zeros(2)).whole())


MODEL = StateSpace([[0.5, 0.1], [0.0, 0.9]], [[1.0], [0.5]], C=np.eye(2), Q=np.eye(2), R=np.eye(2), dt=1)
CORRELATED = StateSpace(
    [[0.5, 0.1], [0.0, 0.9]], [[1.0], [0.5]], C=np.eye(2), Q=np.eye(2), R=[[1, 0.5], [0.5, 1]], dt=1
)
PRIOR = Prior([0.0, 0.0], np.eye(2))


@pytest.mark.parametrize("model", [MODEL, CORRELATED], ids=["independent", "correlated"])
def test_sensors_may_report_one_after_the_other_and_samples_may_be_passed_over(model):
    two, one = (online(Kalman(model), prior=PRIOR, engine="native") for _ in range(2))
    for running in (two, one):
        running.predict(np.array([1.0]))
    two.correct(np.array([1.0, np.nan]))
    if model is MODEL:  # of correlated noises, what one sensor said of the other's is not carried to a second call
        assert_allclose(two.correct(np.array([np.nan, 2.0])).mean, one.correct(np.array([1.0, 2.0])).mean, rtol=1e-13)
    two.predict(np.array([1.0]))
    assert two.progress.sample == 2


def test_an_info_keeps_what_it_said_and_a_saved_run_resumes(tmp_path):
    running = online(Kalman(MODEL), prior=PRIOR, engine="native")
    first = running.correct(np.array([1.0, 2.0]))
    mean = first.mean.copy()
    running.predict(np.array([1.0]))
    running.correct(np.array([5.0, 5.0]))
    assert np.array_equal(first.mean, mean)
    assert_equal(pickle.loads(pickle.dumps(first)), first.whole())
    with pytest.raises(AttributeError):
        first.mean = mean
    save(tmp_path / "run.npz", running)
    resumed = load(tmp_path / "run.npz")
    for other in (running, resumed):
        other.predict(np.array([2.0]))
    y = np.array([0.0, 1.0])
    assert_equal(running.correct(y), resumed.correct(y))
    assert_equal(running.info, resumed.info)
    assert running.engine == resumed.engine == "native"


def test_what_is_wrong_with_a_plain_array_is_still_said():
    running = online(Kalman(MODEL), prior=PRIOR, engine="native")
    before = running.progress
    with pytest.raises(InputError, match="`y` must be finite"):
        running.correct(np.array([1.0, np.inf]))
    with pytest.raises(InputError, match="`u` must not hold NaN"):
        running.predict(np.array([np.nan]))
    assert running.progress is before
    running.predict(np.array([2.0]))
    with pytest.raises(InputError, match="`u` must not hold NaN"):
        running.predict(np.array([np.nan]))
    assert running.progress.held == [2.0]
    exact = online(Kalman(StateSpace([[1.0]], R=[[0.0]], dt=1)), prior=Prior([0.0], [[0.0]]), engine="native")
    exact.correct(np.array([0.0]))
    exact.predict()
    with pytest.raises(RunError, match=r"At sample 1: .*contradicts"):
        exact.correct(np.array([1.0]))


def test_what_cannot_be_machine_code_online_is_said(monkeypatch):
    def refuse(traced):
        raise UnsupportedError("the primitive sort")

    monkeypatch.setattr("estimable.engines.one_step.lower", refuse)
    large = StateSpace(np.eye(13), R=np.eye(13), dt=1)  # too many operations for scalars
    with pytest.raises(
        InputError, match=r'engine = "native" cannot run Kalman online: the primitive sort. Use "auto" or "xla"\.'
    ):
        online(Kalman(large), prior=Prior(np.zeros(13), np.eye(13)), engine="native")
    assert online(Kalman(large), prior=Prior(np.zeros(13), np.eye(13))).engine == "xla"


def test_where_a_step_takes_other_equations_xla_goes_on(monkeypatch):
    model, rng = StateSpace([[-1.0]], Q=[[1.0]], R=[[0.1]], dt=0), np.random.default_rng(0)
    runs = [online(Kalman(model), prior=Prior([0.0], [[1.0]]), engine=engine) for engine in ("auto", "native", "xla")]
    for k, y in enumerate(rng.normal(size=(4, 1))):
        told = [running.correct(y) for running in runs]
        assert_equal(told[0], told[-1])
        if k == 2:
            assert [running.engine for running in runs] == ["native", "native", "xla"]
            monkeypatch.setattr("estimable.estimation.online_steps._form", lambda tree: None)
            with pytest.raises(
                InputError, match=r"online: a step of 0\.2 s has other equations than the earlier ones\."
            ):
                runs.pop(1).predict(dt=0.2)
        for running in runs:
            running.predict(dt=0.1 if k < 2 else 0.2)
    assert runs[0].engine == "xla"
