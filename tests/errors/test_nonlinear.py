"""Every sentence with which a nonlinear model or filter is refused."""

import jax.numpy as jnp
import numpy as np
import pytest

import estimable as es
from estimable import catalogue


def f(x, u, θ):
    return x


def refused(sentence, make):
    with pytest.raises(es.InputError) as error:
        make()
    assert sentence in str(error.value), str(error.value)


def model(**changes):
    given = {"f": f, "h": f, "Q": np.eye(2), "R": np.eye(2), "dt": 1} | changes
    return es.NonlinearModel(given.pop("f"), given.pop("h"), **given)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"f": lambda x, u: x}, "`f` must take three arguments, f(x, u, θ), even if it does not use them. Got f(x, u)."),
        ({"h": 3}, "`h` must be a function h(x, u, θ). Got 3."),
        ({"f": lambda x, u, θ: x[:1]},
         "`f` must return an array (2,): one entry for each state. At x (2,), u (0,), θ (0,) it returns"),
        ({"h": lambda x, u, θ: 1.0 * x[0]}, "`h` must return an array (2,): one entry for each row of `R`."),
        ({"f": lambda x, u, θ: x if x[0] > 0 else -x}, "`f` cannot be traced at x (2,), u (0,), θ (0,): TracerBoolConversion"),
        ({"G": lambda x, u, θ: x, "states": ["a", "b"]},
         "`G` must return an array (2, 2): one row for each state, one column for each noise."),
        ({"G": np.eye(2)}, "`states` must name the states if `G` is given: nothing else determines their number."),
        ({"states": ["a"]},
         "`Q` must be (n, n) = (1, 1) without `G`: noise then enters every state, and `states` names 1. Got (2, 2)."),
        ({"parameters": [1.0]}, "`parameters` must be a mapping of names to numbers, such as {'drag': 0.3}. Got [1.0]."),
        ({"substeps": 0}, "`substeps` must be an integer of at least 1. Got 0."),
        ({"Q": [[1.0, 2.0], [0.0, 1.0]]}, "`Q` must be symmetric"),
        ({"dt": -1.0}, "`dt` must be at least 0 seconds. Got -1."),
    ],
)  # fmt: skip
def test_models_are_refused_in_words(changes, sentence):
    refused(sentence, lambda: model(**changes))


def test_all_faults_of_a_model_come_together():
    with pytest.raises(es.InputError) as error:
        model(f=lambda x: x, h=lambda x, u, θ: x[:1])
    assert len(error.value.faults) == 2


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: es.ExtendedKalman(3), "`model` must be a NonlinearModel or a StateSpace. Got 3."),
        (lambda: es.ExtendedKalman(model(), iterations=0), "`iterations` must be an integer of at least 1. Got 0."),
        (lambda: es.SecondOrderKalman(model(), moments="all"), "`moments` must be one of 'gaussian', 'bias_only', 'truncated'."),
        (lambda: es.SecondOrderKalman(model(), between="points"), "`between` must be one of 'moments', 'map'."),
        (lambda: es.SecondOrderKalman(model(dt=0), between="map"),
         'between = "map" differentiates the trajectory from one sample to the next: give the model `substeps`.'),
        (lambda: es.UnscentedKalman(model(), kappa=-1.0), "`kappa` must be at least 0. Got -1."),
        (lambda: es.ExtendedKalman(model(parameters={"a": 1.0}), parameters=es.Prior([0.0, 0.0], np.eye(2))),
         "`parameters` must be a prior of the model's 1 parameter ('a'). Got 2."),
        (lambda: es.ExtendedKalman(model(parameters={"a": 1.0}), parameters=es.Prior([0.0], [[1.0]]), walk=-1.0),
         "`walk` must be variances per second, at least 0. Got -1.0."),
        (lambda: es.ChangeDetection(es.ExtendedKalman(model())),
         "`algorithm` estimates no parameter: give it `parameters`, so that their jumps can be detected."),
        (lambda: es.ExtendedKalman(es.StateSpace([[1.0]], Q=[[1.0]], R=[[1.0]], S=[[0.5]], dt=1)),
         "the model has cross noise S, which the nonlinear filters do not support: use Kalman(model)."),
    ],
)  # fmt: skip
def test_filters_are_refused_in_words(make, sentence):
    refused(sentence, make)


@pytest.mark.parametrize("name", catalogue.NONLINEAR)
def test_the_gain_of_a_linear_model_file_is_not_passed_over(name):
    file = es.read_model(es.packaged.path("f16-model.toml"))
    sentence = (
        f"{name} does not estimate the gain of a linear model, but the model file has a section [gain]: "
        "use unknown-gain, which"
    )
    refused(sentence, lambda: catalogue.build(name, file))
    assert catalogue.build(name, file._replace(gain=None)).model is file.model


def test_a_wrapper_wraps_what_a_nonlinear_model_bears():
    file = es.results.ModelFile(
        model(parameters={"a": 1.0}), es.Prior([0.0, 0.0], np.eye(2)), es.GainSection(es.Prior([1.0], [[1.0]]))
    )
    built = catalogue.build("change-detection", file, algorithm="second-order-kalman", slots=5, levels=1)
    assert isinstance(built.algorithm, es.SecondOrderKalman)
    assert isinstance(catalogue.build("bounded", file).algorithm, es.ExtendedKalman)
    refused("unknown-gain needs a linear model. This model is nonlinear: use 'extended-kalman'",
            lambda: catalogue.build("bounded", file, algorithm="unknown-gain"))  # fmt: skip


@pytest.mark.parametrize("cls", [es.SecondOrderKalman, es.UnscentedKalman])
def test_a_diffuse_prior_has_no_curved_mean(cls):
    prior = es.Prior([0.0, 0.0], np.eye(2), diffuse=[[1.0], [0.0]])
    sentence = f"`prior` must not have diffuse directions for {cls.__name__}: a nonlinear function"
    refused(sentence, lambda: es.estimate(cls(model()), es.Record(np.ones((2, 2)), dt=1), prior=prior))


def test_a_function_that_is_not_finite_at_the_prior_mean_is_named_with_its_value():
    undefined = model(h=lambda x, u, θ: jnp.log(x))
    record, prior = es.Record(np.ones((2, 2)), dt=1), es.Prior([-1.0, 1.0], np.eye(2))
    refused("`h` is not finite at the prior mean: h([-1, 1], [], []) = [nan, 0].",
            lambda: es.estimate(es.ExtendedKalman(undefined), record, prior=prior))  # fmt: skip


def test_a_noise_input_that_is_not_finite_at_the_prior_mean_is_named():
    undefined = model(G=lambda x, u, θ: jnp.diag(jnp.sqrt(x)), states=["a", "b"])
    record, prior = es.Record(np.ones((2, 2)), dt=1), es.Prior([-1.0, 1.0], np.eye(2))
    refused("`G` is not finite at the prior mean: G([-1, 1], [], []) = [nan, 0, 0, 1].",
            lambda: es.estimate(es.ExtendedKalman(undefined), record, prior=prior))  # fmt: skip


def test_a_prior_of_another_size_is_told_the_states():
    record = es.Record(np.ones((2, 2)), dt=1)
    refused("`prior` must describe n = 2 states: the model has 'x1', 'x2'. Got 1.",
            lambda: es.estimate(es.ExtendedKalman(model()), record, prior=es.Prior([0.0], [[1.0]])))  # fmt: skip


def test_nonlinearity_needs_a_nonlinear_model_and_covariances():
    record = es.Record(np.ones((3, 2)), dt=1)
    result = es.estimate(es.ExtendedKalman(model()), record, prior=es.Prior([0.0, 0.0], np.eye(2)), keep="means")
    with pytest.raises(es.InputError) as error:
        es.diagnostics.nonlinearity(None, result, record)
    assert "`model` must be a NonlinearModel. Got None." in error.value.faults
    assert (
        '`result` must hold the covariances of at least two rows. Make it by estimate(..., keep="all").'
        in error.value.faults
    )
