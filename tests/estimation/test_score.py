"""Derivatives of the likelihood: of every filter, on both engines, against differences and against XLA's reverse mode."""

import jax
import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import (
    AlphaBeta,
    Bounded,
    ChangeDetection,
    ExtendedKalman,
    InputError,
    Kalman,
    MovingWindow,
    NonlinearModel,
    Prior,
    Record,
    RunError,
    SecondOrderKalman,
    StateSpace,
    UnknownGain,
    UnknownInput,
    UnscentedKalman,
    estimate,
    load,
    log_likelihood,
    save,
    score,
    simulate,
)
from estimable.frozen import replace

CONTINUOUS = StateSpace(
    [[-0.5, 1.0], [-2.0, -0.8]], [[0.2], [1.0]], [[1.0, 0.0], [0.0, 1.0]], [[0.0], [0.1]], Q=[[0.05, 0.01], [0.01, 0.2]],
    R=np.diag([0.1, 0.2]), dt=0, states=("a", "q"), inputs=("e",), outputs=("y1", "y2"),
)  # fmt: skip
DISCRETE = CONTINUOUS.discretise(0.1)
PRIOR = Prior([0.1, 0.0], np.diag([0.5, 0.3]))
GAIN = Prior([1.0], [[0.25]])
NONLINEAR = NonlinearModel(
    lambda x, u, θ: jax.numpy.array([x[1], -θ[0] * jax.numpy.sin(x[0]) - θ[1] * x[1] + u[0]]), lambda x, u, θ: x,
    Q=0.01 * np.eye(2), R=0.1 * np.eye(2), dt=0, states=("a", "q"), inputs=("e",), outputs=("y1", "y2"),
    parameters={"k": 2.0, "c": 0.4}, substeps=1,
)  # fmt: skip


def record(model=CONTINUOUS, irregular=False, missing=0.2):
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.choice([0.05, 0.1, 0.2], size=80)) if irregular else 0.1 * np.arange(80)
    times = {} if model.dt else {"t": t}
    given = simulate(model, rng.normal(size=(80, 1)), seed=2, **times).record
    y = given.y.copy()
    y[rng.random(y.shape) < missing] = np.nan
    return Record(y, given.u, t=t, inputs=given.inputs, outputs=given.outputs)


LINEAR_NAMES = ["A[a, q]", "A[q, q]", "B[q, e]", "C[y1, a]", "D[y2, e]", "Q[a]", "Q[a, q]", "R[y1]", "x0[a]"]
CASES = {
    "continuous": (Kalman(CONTINUOUS), LINEAR_NAMES),
    "discrete": (Kalman(replace(DISCRETE, S=np.array([[0.0, 0.02], [0.01, 0.0]]))), [*LINEAR_NAMES, "S[a, y2]"]),
    "unknown gain": (UnknownGain(CONTINUOUS, GAIN, walk=0.01), [*LINEAR_NAMES[:3], "gain[gain]", "walk[gain]", "R[y2]"]),
    "unknown input": (UnknownInput(CONTINUOUS, unknown="e"), ["A[a, q]", "Q[a]", "R[y1]"]),
    "extended": (ExtendedKalman(NONLINEAR), ["k", "c", "Q[a]", "R[y1]", "x0[q]"]),
    "second order": (SecondOrderKalman(NONLINEAR, parameters=Prior([2.0, 0.4], 0.1 * np.eye(2))), ["gain[k]", "R[y1]", "x0[a]"]),
    "unscented": (UnscentedKalman(NONLINEAR), ["k", "c", "R[y2]"]),
    "bounded": (Bounded(UnknownGain(CONTINUOUS, GAIN), 0, 2), ["A[a, q]", "gain[gain]"]),
    "moving window": (MovingWindow(Kalman(CONTINUOUS), 8), ["A[a, q]", "R[y1]"]),
    "change detection": (ChangeDetection(UnknownGain(CONTINUOUS, GAIN)), ["A[a, q]", "R[y1]"]),
}  # fmt: skip


ON_XLA = {
    "continuous",
    "discrete",
    "unknown gain",
    "extended",
}  # the others, some 10 s each to compile: by differences only


def by_difference(algorithm, data, name, h):
    """The slope of the log-likelihood along a named number, by the numbers' own constructor."""
    from estimable import checks
    from estimable.estimation.named_numbers import NamedNumber, Setup, fields_of

    entry = NamedNumber.read(name, fields_of(algorithm, PRIOR), checks.Faults())

    def at(by):
        moved = jax.tree_util.tree_map(np.real, Setup(algorithm, PRIOR).moved([entry], np.array([by])))
        return estimate(moved.algorithm, data, prior=moved.prior, keep="likelihood").log_likelihood

    return (8 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12 * h)


@pytest.mark.parametrize("name", CASES)
def test_the_score_is_the_slope_of_the_likelihood_on_every_engine(name):
    algorithm, numbers = CASES[name]
    data = record(NONLINEAR if algorithm.innermost.model is NONLINEAR else CONTINUOUS)
    found = score(algorithm, data, prior=PRIOR, with_respect_to=numbers)
    assert found.engine == "native"
    assert found.names == tuple(numbers)
    assert_allclose(found.log_likelihood, estimate(algorithm, data, prior=PRIOR).log_likelihood, rtol=1e-12)
    size = np.sqrt(np.diag(found.information))
    if name in ON_XLA:
        xla = score(algorithm, data, prior=PRIOR, with_respect_to=numbers, engine="xla")
        assert_allclose(found.score / size, xla.score / size, rtol=1e-11, atol=1e-11)
        assert_allclose(found.information / np.outer(size, size), xla.information / np.outer(size, size), atol=1e-11)
    differences = [by_difference(algorithm, data, one, 2e-5) for one in numbers]
    assert_allclose(found.score / size, differences / size, atol=1e-6)


def test_the_score_of_irregular_times_and_in_blocks_of_rows(monkeypatch):
    data, numbers = record(irregular=True), [*LINEAR_NAMES]
    whole = score(Kalman(CONTINUOUS), data, prior=PRIOR, with_respect_to=numbers)
    assert whole.engine == "native"
    monkeypatch.setattr("estimable.engines.native.BLOCK", 700)
    blocks = score(Kalman(CONTINUOUS), data, prior=PRIOR, with_respect_to=numbers)
    xla = score(Kalman(CONTINUOUS), data, prior=PRIOR, with_respect_to=numbers, engine="xla")
    for other in (blocks, xla):
        assert_allclose(other.log_likelihood, whole.log_likelihood, rtol=1e-13)
        assert_allclose(other.score, whole.score, rtol=1e-10, atol=1e-10)
        assert_allclose(other.information, whole.information, rtol=1e-10, atol=1e-10)


def test_it_is_the_gradient_of_xla_in_reverse():
    data = record(DISCRETE)
    numbers = ["A[a, q]", "B[q, e]", "R[y1]", "R[y2]", "Q[a]"]
    found = score(Kalman(DISCRETE), data, prior=PRIOR, with_respect_to=numbers)
    slope = jax.grad(lambda a: log_likelihood(a, data, prior=PRIOR))(Kalman(DISCRETE)).model
    exact = [slope.A[0, 1], slope.B[1, 0], slope.R[0, 0], slope.R[1, 1], slope.Q[0, 0]]
    assert_allclose(found.score, exact, rtol=1e-12)


def test_where_nothing_is_missing_the_derivative_settles_with_the_covariance():
    """Long after the filter has settled, against the same without a steady state: XLA's."""
    u = np.sin(0.3 * np.arange(3000))[:, None]
    data = simulate(DISCRETE, u, seed=1).record
    numbers = ["A[a, a]", "A[q, a]", "B[a, e]", "Q[q]", "R[y1]", "x0[q]"]
    found = score(Kalman(DISCRETE), data, prior=PRIOR, with_respect_to=numbers)
    xla = score(Kalman(DISCRETE), data, prior=PRIOR, with_respect_to=numbers, engine="xla")
    size = np.sqrt(np.diag(xla.information))
    assert_allclose(found.score / size, xla.score / size, rtol=1e-12, atol=1e-12)
    assert_allclose(found.information / np.outer(size, size), xla.information / np.outer(size, size), rtol=1e-11)


def test_scores_of_the_true_model_have_the_covariance_of_the_information():
    """E s = 0 and E s s' = H: 400 draws, so that the sample variance has a standard error of 7 %."""
    numbers = ["A[a, q]", "B[q, e]", "R[y1]"]
    u = np.random.default_rng(0).normal(size=(60, 1))
    drawn = [simulate(DISCRETE, u, seed=seed, prior=PRIOR).record for seed in range(400)]
    found = [score(Kalman(DISCRETE), one, prior=PRIOR, with_respect_to=numbers) for one in drawn]
    whitened = np.linalg.solve(np.linalg.cholesky(np.mean([one.information for one in found], axis=0)),
                               np.stack([one.score for one in found]).T)  # fmt: skip
    assert np.all(np.abs(whitened.mean(axis=1)) < 4 / 20)
    assert_allclose(np.cov(whitened), np.eye(3), atol=0.28)


def test_one_sample_and_no_sample_are_ordinary(tmp_path):
    one = Record([[0.3, np.nan]], [[0.0]], dt=0.1, inputs=["e"])
    found = score(Kalman(CONTINUOUS), one, prior=PRIOR, with_respect_to=["R[y1]", "R[y2]"])
    S = 0.5 + 0.1
    assert_allclose(found.score, [((0.3 - 0.1) ** 2 / S - 1) / (2 * S), 0.0])
    assert_allclose(found.information, np.diag([1 / (2 * S**2), 0.0]), atol=1e-15)
    blind = score(
        Kalman(CONTINUOUS),
        Record([[np.nan, np.nan]], [[0.0]], dt=0.1, inputs=["e"]),
        prior=PRIOR,
        with_respect_to=["R[y1]"],
    )
    assert blind.score == blind.information == blind.log_likelihood == 0
    assert repr(found).startswith("Score(d/d R[y1] = ")
    save(tmp_path / "score.npz", found)
    assert load(tmp_path / "score.npz").names == found.names


@pytest.mark.parametrize(
    ("names", "sentence"),
    [
        ("A[a, q]", r"`with_respect_to` must be a list of names of entries\. Got 'A\[a, q\]'"),
        ([], "must be a list of names of entries"),
        (["A"], r'must name entries such as "A\[a, a\]", of .*\'A\'.* Got \'A\''),
        (["E[a, a]"], r"Got 'E\[a, a\]'"),
        (["A[a]", "A[a, r]"], r"`A\[a, r\]`: 'r' must be one of 'a', 'q'"),
        (["B[q]"], r"`B\[q\]` must name 2 channels\. Got 1\."),
        (["S[a, y1]"], "Got 'S"),
        ([3], "Got 3"),
    ],
)
def test_a_name_that_is_none_is_refused(names, sentence):
    with pytest.raises(InputError, match=sentence):
        score(Kalman(CONTINUOUS), record(), prior=PRIOR, with_respect_to=names)


def test_other_wrong_calls_are_refused():
    with pytest.raises(InputError, match="must report the covariance of its innovations: AlphaBeta reports none"):
        score(
            AlphaBeta(0.5, 0.2),
            Record(np.zeros(5), dt=0.1),
            prior=Prior(np.zeros(2), np.eye(2)),
            with_respect_to=["alpha[1]"],
        )
    with pytest.raises(InputError, match="`engine` must be one of"):
        score(Kalman(CONTINUOUS), record(), prior=PRIOR, with_respect_to=["R[y1]"], engine="gpu")
    unstable = Kalman(StateSpace([[1e200]], [[0.0]], [[1.0]], Q=[[0.0]], R=[[1.0]], dt=1))
    with pytest.raises(RunError):
        score(unstable, Record(np.ones(9), np.zeros(9), dt=1), prior=Prior([1.0], [[1.0]]), with_respect_to=["R[y1]"])
