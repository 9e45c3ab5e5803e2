"""What every algorithm of the catalogue must do, none excepted."""

import inspect
from pathlib import Path

import jax
import numpy as np
import pytest
from numpy.testing import assert_allclose

import estimable
from cases import SHORT, file_for
from estimable import (
    Record,
    catalogue,
    estimate,
    estimate_bank,
    load,
    log_likelihood,
    online,
    packaged,
    read_model,
    save,
    stack,
)
from estimable.engines import large, lowering, native, xla
from estimable.estimation.binding import model_of
from estimable.frozen import leaf_fields, replace
from estimable.models.sampled import Clock
from estimable.results import Info, Interval, Sample

FILE = read_model(packaged.path("f16-model.toml"))._replace(unknown=("elevator_deg",))
RNG = np.random.default_rng(0)
ENTRIES = pytest.mark.parametrize("name", [entry.name for entry in catalogue.ENTRIES])
DOCS = Path(__file__).parents[2] / "docs" / "methods"


def build(name, file=FILE):
    """The algorithm on the packaged model, whatever it wraps."""
    return catalogue.build(name, file_for(name, file), **SHORT.get(name, {}))


def record(seed=0, rows=15, missing=0.3):
    rng = np.random.default_rng(seed)
    y = rng.normal(size=(rows, 2))
    y[rng.random((rows, 2)) < missing] = np.nan
    return Record(y, rng.normal(size=(rows, 1)), dt=0.01, hold="first_order",
                  outputs=FILE.model.outputs, inputs=FILE.model.inputs)  # fmt: skip


def rounding(values):
    """What rounding may leave of a run whose largest estimate is that large: it is carried on when estimates fall again."""
    return 1e-12 * max(1.0, np.nanmax(np.abs(values)))


def shapes(tree):
    return [(np.shape(leaf), np.asarray(leaf).dtype) for leaf in jax.tree_util.tree_leaves(tree)]


@ENTRIES
def test_steps_take_their_arguments_by_the_same_names_in_the_same_order(name):
    cls = catalogue.entry(name).cls
    expected = {"init": ["prior"], "correct": ["state", "sample"], "predict": ["state", "interval"],
                "sampled": ["clock"], "at": ["k"]}  # fmt: skip
    for step, arguments in expected.items():
        assert list(inspect.signature(getattr(cls, step)).parameters)[1:] == arguments


@ENTRIES
def test_a_step_gives_back_a_state_of_the_same_shapes(name):
    names, algorithm = build(name).names, build(name).sampled(Clock.every(0.01, "first_order"))
    y, u = np.ones(len(names.outputs)), np.ones(len(names.inputs))

    @jax.jit
    def step(state):
        corrected, info = algorithm.correct(state, Sample(y, np.array([True, False])[: len(y)], 0 * u))
        return algorithm.predict(corrected, Interval(u, u, None, np.asarray(0.01))), info

    state = algorithm.init(FILE.prior)
    after, info = step(state)
    assert type(after) is type(state)
    assert shapes(after) == shapes(state)
    assert isinstance(info, Info)


@ENTRIES
@pytest.mark.parametrize("engine", ["xla", "native"])
def test_new_numbers_do_not_compile_again(name, engine):
    def compiled():
        return xla.scan._cache_size() if engine == "xla" else native.compiled_step.cache_info().misses

    def scaled(factor):  # never by 1: with and without forgetting, windows are gathered differently
        return jax.tree_util.tree_map(lambda leaf: factor * leaf, build(name))

    estimate(scaled(0.9), record(1, rows=17), prior=FILE.prior, engine=engine)
    once = compiled()
    estimate(scaled(0.8), record(2, rows=17), prior=FILE.prior, engine=engine)
    assert compiled() == once


@pytest.mark.parametrize("name", [e.name for e in catalogue.ENTRIES if e.name not in catalogue.NONLINEAR])
def test_a_second_process_traces_nothing(name, tmp_path, monkeypatch):
    """The lowered step is found on the disk; a nonlinear model's functions are the user's, and have no name."""
    monkeypatch.setenv("ESTIMABLE_CACHE", str(tmp_path))
    results = []
    for _ in range(2):
        for cached in (lowering.write_shapes, large._large_step, native.compiled_step):
            cached.cache_clear()
        results.append(estimate(build(name), record(), prior=FILE.prior, engine="native", keep="last"))
        monkeypatch.setattr(lowering, "trace", None)
        monkeypatch.setattr(large, "trace", None)
    assert list(tmp_path.glob("*.json"))
    assert np.array_equal(results[0].mean, results[1].mean)


@ENTRIES
def test_a_bank_equals_a_loop(name):
    algorithms = [
        build(name),
        jax.tree_util.tree_map(lambda leaf: 0.9 * leaf, build(name)),
    ]
    records = [record(1), record(2)]
    bank = estimate_bank(stack(algorithms), stack(records), prior=FILE.prior)
    for i in range(2):
        alone = estimate(algorithms[i], records[i], prior=FILE.prior)
        for field in leaf_fields(Info):
            if field not in ("extra",) and getattr(alone.info, field) is not None:
                value = getattr(alone.info, field)
                assert_allclose(getattr(bank[i].info, field), value, rtol=1e-10, atol=rounding(value))


@ENTRIES
def test_online_equals_offline_and_resumes(name, tmp_path):
    data, algorithm = record(3), build(name)
    whole = estimate(algorithm, data, prior=FILE.prior)
    running, quick = (online(algorithm, prior=FILE.prior, hold="first_order", engine=e) for e in ("xla", "native"))
    known = [data.inputs.index(name) for name in algorithm.names.inputs]
    measured = [data.outputs.index(name) for name in algorithm.names.outputs]
    for k in range(len(data) - 1):
        if k == 7:
            running.save(tmp_path / "half.npz")
            running = load(tmp_path / "half.npz")
        for run in (running, quick):
            info = run.correct(data.y[k, measured])
            assert_allclose(info.mean, whole.mean[k], rtol=1e-12, atol=rounding(whole.mean))
            run.predict(data.u[k, known], u_end=data.u[k + 1, known] if known else None, dt=0.01)


@ENTRIES
def test_settings_survive_a_file(name, tmp_path):
    algorithm = build(name)
    save(tmp_path / "algorithm.npz", algorithm)
    back = load(tmp_path / "algorithm.npz")
    assert jax.tree_util.tree_structure(back) == jax.tree_util.tree_structure(algorithm)
    assert all(map(np.array_equal, jax.tree_util.tree_leaves(back), jax.tree_util.tree_leaves(algorithm)))


@ENTRIES
def test_gradients_are_finite_with_missing_data(name):
    discrete = FILE._replace(model=FILE.model.discretise(0.01, hold="first_order"))
    algorithm = build(name, discrete)
    y = record(4).y.copy()
    y[3] = np.nan
    data = replace(record(4), y=y)
    slope = model_of(jax.grad(lambda a: log_likelihood(a, data, prior=FILE.prior))(algorithm))
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree_util.tree_leaves(slope))
    assert np.any(slope.R != 0)
    h, R = 1e-6, model_of(algorithm).R
    up, down = (with_R(algorithm, R * (1 + sign * h)) for sign in (1, -1))
    one, other = (estimate(a, data, prior=FILE.prior, keep="likelihood").log_likelihood for a in (up, down))
    difference = (one - other) / (2 * h)
    assert_allclose(np.sum(slope.R * R), difference, rtol=1e-5)


def with_R(algorithm, R):
    """The algorithm with another R in the model, inside whatever wraps it."""
    if hasattr(algorithm, "model"):
        return replace(algorithm, model=replace(algorithm.model, R=R))
    if hasattr(algorithm, "algorithms"):
        first, *rest = algorithm.algorithms
        return replace(algorithm, algorithms=(with_R(first, R), *rest))
    return replace(algorithm, algorithm=with_R(algorithm.algorithm, R))


@ENTRIES
def test_no_sample_seen_leaves_the_prior(name):
    blind = Record(np.full((3, 2), np.nan), np.full((3, 1), FILE.model.operating_point.inputs[0]), dt=0.01,
                   hold="first_order", outputs=FILE.model.outputs, inputs=FILE.model.inputs)  # fmt: skip
    result = estimate(build(name), blind, prior=FILE.prior)
    assert_allclose(result.mean, np.broadcast_to(FILE.prior.mean, (3, 2)), atol=1e-15)
    assert result.log_likelihood == 0.0


@ENTRIES
@pytest.mark.parametrize("keep", ["means", "last", "likelihood"])
def test_keeping_less_changes_nothing_that_is_kept(name, keep):
    whole = estimate(build(name), record(5), prior=FILE.prior)
    less = estimate(build(name), record(5), prior=FILE.prior, keep=keep)
    assert_allclose(less.log_likelihood, whole.log_likelihood, rtol=1e-13)
    assert less.outcome == whole.outcome
    if keep == "means":
        assert_allclose(less.mean, whole.mean, rtol=1e-13)
        assert less.covariance is None
    if keep == "last":
        assert_allclose(less.covariance, whole.covariance[-1:], rtol=1e-12)
    if keep == "likelihood":
        assert less.mean is None


@ENTRIES
def test_is_documented_with_everything_a_user_needs(name):
    entry = catalogue.entry(name)
    text = inspect.getdoc(entry.cls) or ""
    for part in ("Model:", "Assumes", "Settings:", "Cost:", "Reference:", ">>>"):
        assert part in text, f"{entry.cls.__name__} lacks {part}"
    assert entry.cls.__name__ in estimable.__all__
    assert (DOCS / f"{name}.md").is_file()
    assert entry.reference
    assert entry.assumes
