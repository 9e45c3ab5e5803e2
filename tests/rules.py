"""What any filter, identifier and controller must do, whoever wrote it: each rule is one function."""

import inspect

import jax
import numpy as np
from numpy.testing import assert_allclose

from estimable import close_loop, estimate, estimate_bank, identify, online, stack
from estimable.checks import Faults
from estimable.models.sampled import Clock
from estimable.results import Fit, Info, Interval, Names, Sample

STEPS = {
    "init": ["prior"], "correct": ["state", "sample"], "predict": ["state", "interval"], "sampled": ["clock"], "at": ["k"],
}  # fmt: skip


def shapes(tree):
    return [(np.shape(leaf), np.asarray(leaf).dtype) for leaf in jax.tree_util.tree_leaves(tree)]


def takes_its_arguments_by_name(algorithm):
    for step, arguments in STEPS.items():
        assert list(inspect.signature(getattr(type(algorithm), step)).parameters)[1:] == arguments


def gives_back_a_state_of_the_same_shapes(algorithm, prior, hold="zero_order"):
    names, ready = algorithm.names, algorithm.sampled(Clock.every(0.01, hold))
    y, u = np.ones(len(names.outputs)), np.ones(len(names.inputs))

    @jax.jit
    def step(state):
        corrected, info = ready.correct(state, Sample(y, np.array([True, False, True])[: len(y)], 0 * u))
        return ready.predict(corrected, Interval(u, u, None, np.asarray(0.01))), info

    state = ready.init(prior)
    after, info = step(state)
    assert type(after) is type(state)
    assert shapes(after) == shapes(state)
    assert isinstance(info, Info)


def runs_alike_on_every_engine(algorithm, record, prior):
    reference, taken = (estimate(algorithm, record, prior=prior, engine=engine) for engine in ("xla", "auto"))
    assert_allclose(taken.mean, reference.mean, rtol=1e-11, atol=1e-12)
    assert_allclose(taken.log_likelihood, reference.log_likelihood, rtol=1e-11)


def runs_online_as_over_a_record(algorithm, record, prior):
    whole, running = estimate(algorithm, record, prior=prior), online(algorithm, prior=prior)
    for k in range(len(record) - 1):
        assert_allclose(running.correct(record.y[k]).mean, whole.mean[k], rtol=1e-11, atol=1e-12)
        running.predict(record.u[k] if record.inputs else None)


def runs_in_a_bank_as_alone(algorithm, records, prior):
    bank = estimate_bank(algorithm, stack(records), prior=prior)
    for i, record in enumerate(records):
        assert_allclose(bank[i].mean, estimate(algorithm, record, prior=prior).mean, rtol=1e-10, atol=1e-12)


def keeps_the_prior_where_nothing_is_seen(algorithm, record, prior):
    """Of a model at rest: where nothing is seen, nothing but the model moves the state."""
    from estimable.frozen import replace

    blind = estimate(algorithm, replace(record, y=np.full(record.y.shape, np.nan)), prior=prior)
    assert np.isfinite(blind.mean).all()
    assert blind.log_likelihood == 0.0 or (blind.info.log_likelihood is None and np.isnan(blind.log_likelihood))


def fits_with_names_for_its_parameters(method, records):
    fit = identify(method, records)
    assert isinstance(fit, Fit)
    d = len(fit.names)
    assert np.shape(fit.parameters) == (d,)
    assert len(set(fit.names)) == d
    if fit.covariance is not None:
        assert np.shape(fit.covariance) == (d, d)
        assert_allclose(fit.covariance, np.asarray(fit.covariance).T, rtol=1e-9, atol=1e-300)
        scale = np.sqrt(np.maximum(np.diagonal(fit.covariance), 1e-300))
        assert np.linalg.eigvalsh(fit.covariance / np.outer(scale, scale)).min() > -1e-9
    return fit


def fits_the_same_twice(method, records):
    first, second = identify(method, records), identify(method, records)
    assert np.array_equal(first.parameters, second.parameters)


def gives_an_input_for_each_actuator(controller, names: Names, extra=None):
    """Eagerly and compiled alike; what is remembered keeps its shapes."""
    n, gains = len(names.states), len(names.gains)
    said = Info(
        mean=np.linspace(0.1, 0.5, n), covariance=np.eye(n), gain=np.full(gains, 0.8) if gains else None,
        gain_covariance=0.01 * np.eye(gains) if gains else None, extra=extra or {},
    )  # fmt: skip
    reference = np.ones(controller.references)
    state = jax.tree_util.tree_map(np.asarray, controller.init())
    after, u, words = controller.act(state, said, reference)
    compiled = jax.jit(lambda state: controller.act(state, said, reference)[:2])(state)
    assert shapes(after) == shapes(state)
    assert np.shape(u) == (controller.size,)
    assert_allclose(compiled[1], u, rtol=1e-12, atol=1e-15)
    assert all(isinstance(name, str) for name in words)


def notes_what_it_lacks(controller, names: Names):
    """A wrong estimator is a fault in words, not an exception."""
    faults = Faults()
    controller.check(names, faults)
    assert all(isinstance(sentence, str) for sentence in faults.sentences)


def closes_a_loop_alike_on_every_engine(controller, plant, estimator, prior, reference):
    flown = [
        close_loop(plant, controller, estimator, reference=reference, seed=1, prior=prior, engine=engine)
        for engine in ("xla", "auto")
    ]
    assert_allclose(flown[1].state, flown[0].state, rtol=1e-10, atol=1e-12)
    assert np.isfinite(flown[0].command).all()
