"""A record whose angle wraps gives the answers of one that goes on through the turns."""

import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.figures import turning
from numpy.testing import assert_allclose

import estimable as es

T, DT = 120, 0.1
RNG = np.random.default_rng(3)
TURNED = np.cumsum(np.full(T, 0.09)) + 0.05 * RNG.normal(size=T)
LOGGED = np.mod(TURNED + np.pi, 2 * np.pi) - np.pi
PRIOR = es.Prior([0.0, 0.9], np.diag([0.1, 0.1]))
NOISE = {"Q": np.diag([1e-5, 1e-4]), "R": [[0.05**2]], "dt": DT}
DECLARED = {"angles": {"heading": "rad", "yaw": "rad"}}
PLAIN = es.Record(TURNED, dt=DT, outputs=["yaw"], angles={"yaw": None})
WRAPPED = es.Record(LOGGED, dt=DT, outputs=["yaw"])
NAMES = {"states": ["heading", "rate"], "outputs": ["yaw"]}


def linear(**angles):
    return es.StateSpace([[1.0, DT], [0.0, 1.0]], C=[[1.0, 0.0]], **NOISE, **NAMES, **angles)


def damped(x):
    return jnp.array([x[0] + DT * x[1], x[1] - DT * 0.01 * (x[1] ** 3 - 0.7)])


def on_and_on(**angles):
    return es.NonlinearModel(lambda x, u, θ: damped(x), lambda x, u, θ: x[:1], **NOISE, **NAMES, **angles)


def wrapping(**angles):
    """The same model, in whose functions the heading wraps."""

    def f(x, u, θ):
        moved = damped(x)
        return jnp.array([jnp.arctan2(jnp.sin(moved[0]), jnp.cos(moved[0])), moved[1]])

    return es.NonlinearModel(f, lambda x, u, θ: jnp.arctan2(jnp.sin(x[:1]), jnp.cos(x[:1])), **NOISE, **NAMES, **angles)


def assert_same_turn(found, plain, atol=1e-9):
    error = np.array(found.mean - plain.mean)
    error[..., 0] = np.angle(np.exp(1j * error[..., 0]))
    assert_allclose(error, 0.0, atol=atol)
    assert_allclose(found.covariance, plain.covariance, atol=1e-12)
    assert_allclose(found.log_likelihood, plain.log_likelihood, atol=1e-9)
    assert np.all(np.abs(found.mean[..., 0]) <= np.pi)


@pytest.mark.parametrize("kind", [es.ExtendedKalman, es.SecondOrderKalman, es.UnscentedKalman])
@pytest.mark.parametrize("model", [on_and_on, wrapping])
def test_nonlinear_filters(kind, model):
    plain = es.estimate(kind(on_and_on()), PLAIN, prior=PRIOR)
    assert_same_turn(es.estimate(kind(model(**DECLARED)), WRAPPED, prior=PRIOR), plain, atol=1e-9)


@pytest.mark.parametrize("iterations", [1, 5])
def test_smoothing(iterations):
    plain = es.smooth(es.ExtendedKalman(on_and_on()), PLAIN, prior=PRIOR, iterations=iterations)
    found = es.smooth(es.ExtendedKalman(on_and_on(**DECLARED)), WRAPPED, prior=PRIOR, iterations=iterations)
    assert_same_turn(found, plain)


def test_smoothing_by_points():
    plain = es.smooth(es.UnscentedKalman(on_and_on()), PLAIN, prior=PRIOR)
    assert_same_turn(es.smooth(es.UnscentedKalman(on_and_on(**DECLARED)), WRAPPED, prior=PRIOR), plain)


@pytest.mark.parametrize("prior", [PRIOR, es.Prior([0.0, 0.9], np.zeros((2, 2)), diffuse=np.eye(2))])
@pytest.mark.parametrize("run", [es.estimate, es.smooth])
def test_linear_filters(run, prior):
    plain = run(es.Kalman(linear()), PLAIN, prior=prior)
    assert_same_turn(run(es.Kalman(linear(**DECLARED)), WRAPPED, prior=prior), plain)


def test_online_and_a_gate_and_the_record_that_declares():
    gated = es.Gated(es.Kalman(linear(**DECLARED)), 0.9999)
    found = es.estimate(gated, WRAPPED, prior=PRIOR)
    assert not found.extra["rejected"].any()
    running = es.online(gated, prior=PRIOR)
    for k in range(T):
        assert_allclose(running.correct(LOGGED[k : k + 1]).mean, found.mean[k], atol=1e-13)
        running.predict()
    record = es.Record(LOGGED, dt=DT, outputs=["yaw"], angles=["yaw"])
    by_record = es.estimate(es.Gated(es.Kalman(linear()), 0.9999), record, prior=PRIOR)
    assert_allclose(np.exp(1j * by_record.mean[:, 0]), np.exp(1j * found.mean[:, 0]), atol=1e-12)


def test_degrees_and_a_range_from_zero():
    model = es.StateSpace(
        [[1.0, DT], [0.0, 1.0]], C=[[1.0, 0.0]], Q=np.diag([1e-5, 1e-4]) * (180 / np.pi) ** 2, R=[[(0.05 * 180 / np.pi) ** 2]],
        dt=DT, **NAMES, angles={"heading": (0.0, 360.0), "yaw": "deg"},
    )  # fmt: skip
    turn = 180 / np.pi
    prior = es.Prior(PRIOR.mean * turn, PRIOR.covariance * turn**2)
    found = es.estimate(es.Kalman(model), es.Record(np.degrees(LOGGED), dt=DT, outputs=["yaw"]), prior=prior)
    plain = es.estimate(es.Kalman(linear()), PLAIN, prior=PRIOR)
    assert_allclose(found.mean[:, 0], np.mod(np.degrees(plain.mean[:, 0]), 360.0), atol=1e-9)
    assert found.mean[:, 0].max() > 350


def test_a_jump_that_nobody_declared_is_pointed_out_before_the_run():
    row = int(np.argmax(np.diff(LOGGED) < -3)) + 1
    with pytest.raises(es.InputError, match=f"yaw jumps by 2 pi at row {row}: declare it as an angle"):
        es.estimate(es.Kalman(linear()), WRAPPED, prior=PRIOR)
    with pytest.raises(es.InputError, match="yaw jumps by 2 pi"):
        es.identify(es.Subspace(1), es.Record(LOGGED, np.ones(T), dt=DT, outputs=["yaw"]))
    accepted = es.Record(LOGGED, dt=DT, outputs=["yaw"], angles={"yaw": None})
    assert es.estimate(es.Kalman(linear()), accepted, prior=PRIOR).outcome.code == 0


def test_a_record_that_declares_goes_on_through_the_turns():
    record = es.Record(LOGGED, LOGGED, dt=DT, outputs=["yaw"], inputs=["bearing"], angles=["yaw", "bearing"])
    assert_allclose(record.continuous().y, TURNED[:, None], atol=1e-12)
    assert_allclose(record.continuous().u, TURNED[:, None], atol=1e-12)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"yow": "rad"}, "`angles` names 'yow'.*Did you mean"),
        ({"yaw": "turns"}, "`angles` of 'yaw' must be"),
        ({"yaw": -1.0}, "`angles` of 'yaw' must be"),
        ({"yaw": (1.0, 1.0)}, "`angles` of 'yaw' must be"),
        ({"yaw": None}, "`angles` of 'yaw' must be"),
        (3.0, "`angles` must map names"),
    ],
)
def test_wrong_declarations(given, sentence):
    with pytest.raises(es.InputError, match=sentence):
        linear(angles=given)


def test_a_model_and_a_record_that_disagree():
    record = es.Record(LOGGED, dt=DT, outputs=["yaw"], angles={"yaw": "deg"})
    with pytest.raises(es.InputError, match="the model says that the period of"):
        es.estimate(es.Kalman(linear(**DECLARED)), record, prior=PRIOR)


def test_files_and_figures(tmp_path):
    model = linear(**DECLARED)
    es.write_model(tmp_path / "model.toml", model, PRIOR)
    assert es.read_model(tmp_path / "model.toml").model.angles == model.angles
    es.save(tmp_path / "model.npz", model)
    assert es.load(tmp_path / "model.npz").angles == model.angles
    found = es.estimate(es.Kalman(model), WRAPPED, prior=PRIOR)
    lines = [trace for trace in found.plot().data if trace.name == "heading"]
    crossings = int(np.sum(np.abs(np.diff(found.mean[:, 0])) > np.pi))
    assert crossings > 0
    assert np.isnan(lines[0].y).sum() == crossings


def test_a_coordinated_turn_is_consistent():
    for _, found, distance in turning.figure(20, filters=(es.ExtendedKalman,)):
        assert found.consistent
        assert distance < 1e-9
