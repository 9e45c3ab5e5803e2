"""AdaptiveIdentification: where it starts, what the filter makes of it, and what it says."""

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm

import estimable as es
from estimable.analysis.structural_identifiability import hidden_parameters
from estimable.diagnostics import changes
from estimable.identifiers import linear_start

T = 240
TRUE = np.array([0.2, 0.5])
BEGIN = es.Prior([1.5], [[0.1]])


def drain(x, u, θ):
    return x + θ[1] * u - θ[0] * jnp.sqrt(jnp.maximum(x, 1e-6))


def level(x, u, θ):
    return x


def tank(outflow, inflow):
    parameters = {"outflow": outflow, "inflow": inflow}
    return es.NonlinearModel(drain, level, Q=[[1e-6]], R=[[1e-4]], dt=1, inputs=["pump"], outputs=["level"],
                             parameters=parameters)  # fmt: skip


def drawn(seed=0, outflow=TRUE[0], missing=0.0):
    """A record of the tank, whose outflow may be (T,), in a loop of NumPy."""
    rng = np.random.default_rng(seed)
    u = 0.5 + 0.35 * np.repeat(rng.uniform(-1, 1, size=T // 4), 4)
    x, y = 1.5, []
    for outflow_now, now in zip(np.broadcast_to(outflow, T), u, strict=True):
        y.append(x + 0.01 * rng.normal())
        x = x + TRUE[1] * now - outflow_now * np.sqrt(x) + 1e-3 * rng.normal()
    y = np.where(rng.random(T) < missing, np.nan, y)
    return es.Record(y, u, dt=1, inputs=["pump"], outputs=["level"])


@pytest.mark.parametrize("start", ["ho-kalman", "subspace"])
def test_from_a_start_that_is_far_off_the_linear_model_leads_to_the_truth(start):
    fit = es.identify(es.AdaptiveIdentification(tank(0.5, 1.0), BEGIN, start=start), drawn(missing=0.1))
    began = np.sqrt(np.diagonal(fit.extra["start_covariance"]))
    assert np.all(np.abs(fit.extra["start"] - TRUE) < 3 * began)
    assert np.all(np.abs(fit.parameters - TRUE) < 3 * fit.sigma)
    assert np.all(fit.sigma < began / 5)
    assert fit.names == ("outflow", "inflow")
    told = {check.name: check.passed for check in fit.validation.checks}
    assert told.pop("order") is False  # more states than one imitate the root
    assert all(told.values()), fit.validation.sentences


def test_the_path_is_that_of_the_filter_and_the_fit_is_its_end():
    record = drawn()
    fit = es.identify(es.AdaptiveIdentification(tank(0.5, 1.0), BEGIN), record)
    start = es.Prior(fit.extra["start"], fit.extra["start_covariance"])
    path = es.estimate(es.SecondOrderKalman(tank(0.5, 1.0), parameters=start), record, prior=BEGIN)
    assert_allclose(fit.path.gain, path.gain, rtol=1e-12)
    assert_allclose(fit.parameters, path.gain[-1], rtol=1e-12)
    assert_allclose(fit.covariance, path.gain_covariance[-1], rtol=1e-12)


def test_two_records_tell_as_one_after_the_other():
    method = es.AdaptiveIdentification(
        tank(0.5, 1.0), BEGIN, start="none", parameters=es.Prior([0.25, 0.6], 0.01 * np.eye(2))
    )
    first, second = drawn(1), drawn(2)
    both, after = es.identify(method, [first, second]), es.identify(method, first)
    carried = es.Prior(after.parameters, after.covariance)
    again = es.identify(es.AdaptiveIdentification(tank(0.5, 1.0), BEGIN, start="none", parameters=carried), second)
    assert_allclose(both.parameters, again.parameters, rtol=1e-10)
    assert_allclose(both.covariance, again.covariance, rtol=1e-8)


def test_the_likelihood_has_its_peak_where_the_refinement_ends_and_its_curvature_is_the_information():
    record = drawn(3)
    fit = es.identify(es.AdaptiveIdentification(tank(0.5, 1.0), BEGIN, refinement="likelihood"), record)

    def likelihood(θ):
        return es.estimate(es.SecondOrderKalman(tank(*θ)), record, prior=BEGIN, keep="likelihood").log_likelihood

    L = np.linalg.cholesky(fit.covariance)
    peak = likelihood(fit.parameters)
    assert_allclose(peak, fit.log_likelihood, rtol=1e-9)
    for direction in (*L.T, *-L.T):  # one standard deviation away it has fallen by a half
        assert_allclose(peak - likelihood(fit.parameters + direction), 0.5, rtol=0.05)


def test_over_many_records_the_covariance_of_the_parameters_is_that_of_their_errors():
    records = [drawn(seed) for seed in range(60)]
    filter = es.SecondOrderKalman(tank(0.5, 1.0), parameters=es.Prior([0.22, 0.55], np.diag([4e-4, 2.5e-3])))
    bank = es.estimate_bank(filter, records, prior=BEGIN)
    e, P = bank.gain[:, -1] - TRUE, bank.gain_covariance[:, -1]
    nees = np.mean(np.einsum("bi,bi->b", e, np.linalg.solve(P, e[..., None])[..., 0])) / 2
    assert 0.6 < nees < 1.55  # χ² of 120 degrees of freedom, 99.9 %


def test_a_parameter_that_jumps_is_followed_and_told():
    record = drawn(0, np.where(np.arange(T) < 150, 0.2, 0.12))
    prior = es.Prior([0.25, 0.6], np.diag([0.01, 0.04]))
    method = es.AdaptiveIdentification(tank(0.5, 1.0), BEGIN, start="none", parameters=prior, jump=[0.01, 1e-6], onsets=10,
                                       persistence=1.0)  # fmt: skip
    fit = es.identify(method, record)
    [change] = changes(fit.path)
    assert (change.gain, change.onset) == ("outflow", 150)
    assert abs(fit.parameters[0] - 0.12) < 3 * fit.sigma[0] < 0.01
    constant = es.identify(es.AdaptiveIdentification(tank(0.5, 1.0), BEGIN, start="none", parameters=prior), record)
    assert [check.passed for check in constant.validation.checks if check.name == "noise"] == [False]


@pytest.mark.parametrize("hold", ["zero_order", "first_order"])
def test_the_response_of_a_continuous_model_is_that_of_its_samples(hold):
    A, B, C = np.array([[-1.3, 1.0], [-3.5, -1.1]]), np.array([[-0.15], [-24.3]]), np.array([[1.0, 0.5]])
    model, fine, dt = es.StateSpace(A, B, C, R=[[1.0]], dt=0), 400, 0.1
    found = linear_start.response(model, np.arange(5), dt, hold)[0, 0]
    F, G = expm(A * dt / fine), np.linalg.solve(A, (expm(A * dt / fine) - np.eye(2)) @ B)
    x, y = np.zeros((2, 1)), []
    for k in range(-1, 5):  # a pulse at k = 0, held or a triangle from k = -1 to k = 1
        y.append((C @ x).item())
        for i in range(fine):
            share = (i + 0.5) / fine
            now = (share if k == -1 else 1 - share if k == 0 else 0.0) if hold == "first_order" else float(k == 0)
            x = F @ x + G * now
    assert_allclose(found, y[1:], rtol=2e-5, atol=1e-7)


def test_the_tangent_at_rest_is_the_derivative():
    model = tank(0.2, 0.5)
    rest, moves = linear_start.at_rest(model, np.array([1.5]), np.array([0.5]), TRUE)
    assert_allclose(rest, [(0.5 * 0.5 / 0.2) ** 2], rtol=1e-6)
    assert moves < 1e-9
    linear = model.linearised(rest, [0.5])
    assert_allclose(linear.A, [[1 - 0.2 / (2 * np.sqrt(rest[0]))]])
    assert_allclose(linear.operating_point.states, rest)


def refused(error, sentence, make):
    with pytest.raises(error) as told:
        make()
    assert sentence in str(told.value), str(told.value)


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"start": "arx"}, "`start` must be one of 'ho-kalman', 'subspace', 'none'."),
        ({"start": "none"}, '`parameters` must be a Prior where start = "none": no linear model provides their initial values.'),
        ({"accuracy": 0.0}, "`accuracy` must be greater than 0"),
        ({"refinement": "em"}, "`refinement` must be one of 'none', 'likelihood'."),
        ({"walk": -1.0}, "`walk` must be variances per second, at least 0. Got -1.0."),
        ({"jump": -1.0}, "`jump` must be variances of a jump, greater than 0."),
        ({"parameters": es.Prior([1.0], [[1.0]])}, "`parameters` must be a prior of the model's 2 parameters"),
        ({"parameters": es.Prior([1.0, 1.0], np.eye(2), diffuse=[[1.0], [0.0]])}, "`parameters` must not have diffuse"),
        ({"state_prior": es.Prior([1.0, 1.0], np.eye(2))}, "`state_prior` must describe n = 1 states: the model has 'x1'. Got"),
        ({"model": es.StateSpace([[1.0]], R=[[1.0]], dt=1)}, "`model` must be a NonlinearModel."),
        ({"model": es.NonlinearModel(level, level, Q=[[1.0]], R=[[1.0]], dt=1)}, "`model` has no parameters to identify: give"),
    ],
)  # fmt: skip
def test_settings_are_refused_in_words(settings, sentence):
    given = {"model": tank(0.5, 1.0), "state_prior": BEGIN} | settings
    refused(
        es.InputError,
        sentence,
        lambda: es.AdaptiveIdentification(given.pop("model"), given.pop("state_prior"), **given),
    )


def test_a_parameter_that_the_tangent_does_not_show_needs_a_prior():
    hidden = es.NonlinearModel(lambda x, u, θ: 0.5 * x + θ[0] * u + θ[1] * (x - 1.0) ** 3, level, Q=[[1e-6]], R=[[1e-4]], dt=1,
                               inputs=["pump"], outputs=["level"], parameters={"slope": 0.9, "cube": 0.0})  # fmt: skip
    u = 0.5 + 0.1 * np.random.default_rng(0).normal(size=(T, 1))
    record = es.Record(es.simulate(hidden, u, seed=0).record.y, u - u.mean() + 0.5 / 0.9, dt=1, inputs=["pump"],
                       outputs=["level"])  # fmt: skip
    sentence = (
        "the linear model of the record does not determine 1.00 cube: at equilibrium the model's response does not "
        "depend on it."
    )
    refused(es.AssumptionError, sentence, lambda: es.identify(es.AdaptiveIdentification(hidden, BEGIN), record))


def test_records_without_the_models_channels_are_refused_in_words():
    record = es.Record(np.ones((30, 1)), np.ones((30, 1)), dt=1, inputs=["valve"], outputs=["level"])
    refused(es.InputError, "'pump'", lambda: es.identify(es.AdaptiveIdentification(tank(0.5, 1.0), BEGIN), record))


def test_parameters_that_only_act_together_have_no_sigma():
    """Only inflow * scale enters: each alone is undetermined, the outflow is not."""
    model = es.NonlinearModel(
        lambda x, u, θ: x + θ[1] * θ[2] * u - θ[0] * jnp.sqrt(jnp.maximum(x, 1e-6)), lambda x, u, θ: x, Q=[[1e-6]], R=[[1e-4]],
        dt=1, inputs=["pump"], outputs=["level"], parameters={"outflow": 0.2, "inflow": 0.5, "scale": 1.0},
    )  # fmt: skip
    hidden = hidden_parameters(model, np.array([1.5]), 0.5 + 0.3 * np.sin(np.arange(40.0))[:, None])
    assert hidden.shape == (3, 1)
    assert np.allclose(hidden[:, 0] / hidden[1, 0], [0.0, 1.0, -2.0], atol=1e-9)  # inflow and scale, by the same ratio
