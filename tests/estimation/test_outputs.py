"""The outputs that estimated states imply, with their covariances, filtered and smoothed, in tables and datasets."""

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import estimable as es

POINT = {"states": [1.0, -1.0], "inputs": [0.5], "outputs": [2.0, 3.0]}
MODEL = es.StateSpace(
    [[0.9, 0.2], [0.0, 0.8]], [[0.0], [1.0]], [[1.0, 0.0], [0.5, 1.0]], [[0.3], [0.0]], Q=0.1 * np.eye(2),
    R=np.array([[0.2, 0.05], [0.05, 0.1]]), dt=1, operating_point=POINT, outputs=["level", "flow"],
)  # fmt: skip
RNG = np.random.default_rng(0)
U = RNG.normal(size=40)
RECORD = es.Record(
    np.where(RNG.random((40, 2)) < 0.3, np.nan, RNG.normal(size=(40, 2)) + [2.0, 3.0]),
    U,
    dt=1,
    outputs=["level", "flow"],
)
PRIOR = es.Prior([1.0, -1.0], np.eye(2))


@pytest.mark.parametrize("run", [es.estimate, es.smooth])
def test_outputs_of_a_kalman_filter_and_its_smoother(run):
    result = run(es.Kalman(MODEL), RECORD, prior=PRIOR)
    assert_allclose(
        result.output,
        (result.mean - POINT["states"]) @ MODEL.C.T + (U[:, None] - 0.5) @ MODEL.D.T + POINT["outputs"],
        rtol=1e-12,
    )
    assert_allclose(result.output_covariance, MODEL.C @ result.covariance @ MODEL.C.T, rtol=1e-12)
    assert_allclose(result.outputs(predictive=True).covariance, result.output_covariance + MODEL.R, rtol=1e-12)
    assert np.isfinite(result.output).all()


def test_outputs_before_the_sample_are_those_of_the_innovations():
    """With an output that is never seen, the filtered output is the predicted one, and its predictive covariance S."""
    record = es.Record(np.where([True, False], np.nan, RECORD.y), U, dt=1, outputs=["level", "flow"])
    result = es.estimate(es.Kalman(MODEL), record, prior=PRIOR)
    again = es.estimate(
        es.Kalman(MODEL), es.Record(np.full((40, 2), np.nan), U, dt=1, outputs=["level", "flow"]), prior=PRIOR
    )
    assert_allclose(again.outputs(predictive=True).covariance, again.innovation_covariance, rtol=1e-12)
    assert np.isfinite(result.output[:, 0]).all()


def test_a_gain_that_enters_directly_joins_its_uncertainty():
    algorithm = es.UnknownGain(MODEL, es.Prior([1.0], [[0.25]]), feedthrough="scaled")
    for run in (es.estimate, es.smooth):
        result = run(algorithm, RECORD, prior=PRIOR)
        d = (U - 0.5)[:, None] * MODEL.D[:, 0]
        J = np.concatenate([np.broadcast_to(MODEL.C, (40, 2, 2)), d[..., None]], axis=2)
        cross = result.extra["state_gain_covariance"]
        P = np.concatenate(
            [
                np.concatenate([result.covariance, cross], axis=2),
                np.concatenate([np.swapaxes(cross, 1, 2), result.gain_covariance], axis=2),
            ],
            axis=1,
        )
        assert_allclose(result.output_covariance, J @ P @ np.swapaxes(J, 1, 2), rtol=1e-10, atol=1e-14)
        x = np.concatenate([result.mean - POINT["states"], result.gain], axis=1)
        assert_allclose(result.output, np.einsum("tpn,tn->tp", J, x) + POINT["outputs"], rtol=1e-12)


def test_outputs_of_models_that_vary_with_the_step_and_with_time():
    t = np.cumsum(RNG.uniform(0.5, 1.5, 40))
    continuous = es.StateSpace([[-0.5]], [[1.0]], Q=[[0.1]], R=[[0.1]], dt=0)
    result = es.estimate(es.Kalman(continuous), es.Record(RECORD.y[:, 0], U, t=t), prior=es.Prior([0.0], [[1.0]]))
    assert_allclose(result.output, result.mean)
    C = RNG.normal(size=(40, 1, 1))
    varying = es.StateSpace([[0.5]], [[1.0]], C, Q=[[0.1]], R=[[0.1]], dt=1)
    result = es.estimate(es.Kalman(varying), es.Record(RECORD.y[:, 0], U, dt=1), prior=es.Prior([0.0], [[1.0]]))
    assert_allclose(result.output, C[:, 0] * result.mean)


def test_outputs_of_a_nonlinear_model_and_its_parameters():
    model = es.NonlinearModel(
        lambda x, u, θ: 0.9 * x,
        lambda x, u, θ: jnp.array([θ[0] * x[0] ** 2]),
        Q=[[0.01]],
        R=[[0.1]],
        dt=1,
        parameters={"k": 2.0},
    )
    record, prior = es.Record(2.0 * 0.9 ** (2 * np.arange(8.0)), dt=1), es.Prior([1.0], [[0.1]])
    result = es.estimate(es.ExtendedKalman(model), record, prior=prior)
    assert_allclose(result.output, 2.0 * result.mean**2)
    assert_allclose(result.output_covariance[:, 0, 0], (4.0 * result.mean[:, 0]) ** 2 * result.covariance[:, 0, 0])


def test_outputs_of_wrapped_filters_and_unmeasured_inputs():
    gain = es.UnknownGain(MODEL, es.Prior([1.0], [[0.25]]))
    wrapped = es.estimate(es.Bounded(gain, 0.0, 1.0), RECORD, prior=PRIOR)
    inside = es.estimate(gain, RECORD, prior=PRIOR)
    assert_allclose(wrapped.output, inside.output, rtol=1e-12)
    model = es.StateSpace([[0.9]], [[1.0]], Q=[[0.1]], R=[[0.1]], dt=1)
    fixed = es.estimate(es.FixedGain(model, [[0.5]]), es.Record(U, U, dt=1), prior=es.Prior([0.0], [[1.0]]))
    assert_allclose(fixed.output, fixed.mean)
    unknown = es.estimate(es.UnknownInput(model, unknown=["u1"]), es.Record(U, dt=1), prior=es.Prior([0.0], [[1.0]]))
    assert_allclose(unknown.output, unknown.mean)


def test_what_a_diffuse_prior_leaves_open_is_nan():
    record = es.Record([np.nan, 1.0, 2.0], dt=1)
    model = es.StateSpace([[1.0]], Q=[[0.1]], R=[[0.1]], dt=1)
    result = es.estimate(es.Kalman(model), record, prior=es.Prior([0.0], [[0.0]], diffuse=[[1.0]]))
    assert_array_equal(np.isnan(result.output_covariance.ravel()), [True, False, False])


def test_outputs_across_gaps_and_of_angles():
    lost = U.copy()
    lost[20:23] = np.nan
    record = es.Record(RECORD.y, lost, dt=1, outputs=["level", "flow"])
    result = es.estimate(es.Kalman(MODEL), record, prior=PRIOR)
    assert_array_equal(np.isnan(result.output).any(axis=1), np.isnan(lost))  # u enters the level directly
    assert_array_equal(np.isnan(result.output_covariance[:, 0, 0]), np.isnan(lost))
    assert_array_equal(np.isfinite(result.output), np.isfinite(result.outputs(predictive=True).mean))
    turning = es.StateSpace(
        [[1.0]], [[1.0]], Q=[[1e-6]], R=[[1e-4]], dt=1, outputs=["heading"], angles={"heading": "rad"}
    )
    heading = np.mod(0.3 * np.arange(60.0) + np.pi, 2 * np.pi) - np.pi
    record = es.Record(heading, np.full(60, 0.3), dt=1, outputs=["heading"])
    result = es.estimate(es.Kalman(turning), record, prior=es.Prior([0.0], [[0.1]]))
    assert_allclose(np.angle(np.exp(1j * (result.output[:, 0] - heading))), 0.0, atol=0.02)
    assert np.abs(result.output).max() <= np.pi


def test_the_noise_of_a_sample_counts_in_what_is_predicted():
    sigma = np.where(np.arange(40)[:, None] % 2 == 0, [0.5, np.nan], np.nan)
    record = es.Record(np.full((40, 2), np.nan), U, dt=1, outputs=["level", "flow"], sigma=sigma)
    result = es.estimate(es.Kalman(MODEL), record, prior=PRIOR)
    assert_allclose(result.outputs(predictive=True).covariance, result.innovation_covariance, rtol=1e-12)


def test_less_is_known_of_results_with_fewer_rows():
    means, last = (es.estimate(es.Kalman(MODEL), RECORD, prior=PRIOR, keep=keep) for keep in ("means", "last"))
    whole = es.estimate(es.Kalman(MODEL), RECORD, prior=PRIOR)
    assert means.output_covariance is None
    assert_allclose(means.output, whole.output)
    assert_allclose(last.output, whole.output[-1:])
    assert es.estimate(es.Kalman(MODEL), RECORD, prior=PRIOR, keep="likelihood").output is None
    with pytest.raises(es.InputError, match="`predictive` must be a bool"):
        whole.outputs(predictive=1)


@pytest.mark.parametrize(("run", "kind"), [(es.estimate, "filtered"), (es.smooth, "smoothed")])
def test_tables_and_datasets_hold_the_outputs_after_what_they_held_before(run, kind):
    result = run(es.Kalman(MODEL), RECORD, prior=PRIOR)
    table = result.to_pandas()
    assert list(table.columns[:4]) == ["x1", "x1_sigma", "x2", "x2_sigma"]
    names = [f"{name}_{kind}{end}" for name in ("level", "flow") for end in ("", "_sigma")]
    assert list(table.columns[-4:]) == names
    assert_allclose(table[f"flow_{kind}"], result.output[:, 1])
    assert_allclose(table[f"flow_{kind}_sigma"] ** 2, result.output_covariance[:, 1, 1])
    predictive = result.to_pandas(predictive=True)
    assert_allclose(predictive[f"flow_{kind}_sigma"] ** 2, result.output_covariance[:, 1, 1] + 0.1)
    data = result.to_xarray()
    assert data["output"].dims == ("time", "outputs")
    assert_allclose(data["output_covariance"], result.output_covariance)
