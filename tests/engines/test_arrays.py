"""Machine code of operations on arrays against JAX: random programs, every rule, every catalogue entry, large models."""

import weakref
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax import lax
from numpy.testing import assert_allclose

from cases import SHORT, file_for
from engines.test_straight_line import (
    AMPLIFIED,
    FILE,
    STEPS,
    assert_same,
    assert_same_bank,
    both,
    both_banks,
    random_function,
)
from estimable import InputError, Kalman, Prior, Record, StateSpace, UnknownGain, catalogue, estimate, online, smooth
from estimable.engines import native
from estimable.engines.batches import DTYPES
from estimable.engines.large import _large_step
from estimable.engines.llvm.array_loop import ArrayLoop
from estimable.engines.llvm.compilation import Compiled
from estimable.engines.program.arrays import lower
from estimable.engines.program.primitives import UnsupportedError
from estimable.kernels import small


def run_natively(function, *inputs):
    """One row of a loop that carries nothing."""
    program = lower(jax.make_jaxpr(lambda *a: jax.tree_util.tree_leaves(function(*a)))(*inputs))
    loop = ArrayLoop(program, None, 0, 0, len(program.outputs))
    compiled = Compiled(loop)
    types = [program.operations[name] for name in program.outputs]
    each = [np.empty((1, *kind.shape), DTYPES[kind.kind]) for kind in types]
    row = [np.ascontiguousarray(array)[None] for array in inputs]
    compiled(1, np.zeros(1), np.empty(loop.bytes + 64, np.uint8), np.zeros(1), *row, *each)
    return [array[0] for array in each]


def assert_as_jax(function, *inputs, rtol=1e-12):
    expected = jax.tree_util.tree_leaves(jax.jit(function)(*inputs))
    for ours, theirs in zip(run_natively(function, *inputs), expected, strict=True):
        size = np.max(np.abs(np.asarray(theirs, float)), initial=1.0, where=np.isfinite(np.asarray(theirs, float)))
        assert_allclose(np.asarray(ours, float), np.asarray(theirs, float), rtol=rtol, atol=rtol * size)


@given(steps=STEPS, seed=st.integers(0, 10**6))
@settings(max_examples=40, deadline=None, derandomize=True)
def test_random_programs_give_what_jax_gives(steps, seed):
    a, b = np.random.default_rng(seed).normal(size=(2, 3, 3))
    function = random_function(steps)
    with np.errstate(all="ignore"):
        assert_as_jax(function, a, b, rtol=1e-9)


def _add(c, x):
    return c + x, c


def _sum(a):
    return lax.scan(_add, jnp.zeros(14), a)


def _undefined(a):
    return jnp.argmax(a, 0), jnp.argmax(a[2]), jnp.sign(a), a.max(1)


A = np.random.default_rng(0).normal(size=(9, 14))
RULES = {
    "reshape": lambda a: (a.reshape(-1), a.T.reshape(14 * 9), (a * 2).reshape(14, 9).sum(0), a.reshape(9, 1, 14)),
    "slices": lambda a: (a[::2, ::-1], a[1:, None, 3], jnp.split(a, [2, 5], axis=0), jnp.stack([a[0], a[1]], axis=1)),
    "products": lambda a: (a @ a.T, a.T @ a, a[:, :9] @ a, a.T @ a[:, :9].T, a @ a[0], a[:, 0] @ a, a.T @ a[:, 1]),
    "reductions": lambda a: (jnp.any(a > 2, axis=1), jnp.all(a > -9), a.max(axis=0), a.min(), jnp.sum(a > 0), a.prod(1)),
    "running sums": lambda a: (jnp.cumsum(a, 0), lax.cumsum(a, axis=1, reverse=True)),
    "largest": lambda a: (jnp.argmax(a, 0), jnp.argmax(a[2])),
    "empty": lambda a: (a[:, :0] @ a[:0], a[:, :0].sum(1), a[:0].sum(0), jnp.concatenate([a[:0], a[:1]]), a[:0] * 2),
    "joined nothing": lambda a: jnp.concatenate([a[:3, :0], a[:2, :0]]).sum(1),
    "whole numbers": lambda a: (jnp.sum(jnp.arange(9) * 2 - 3), jnp.maximum(jnp.arange(9), 4) > 5, -jnp.arange(3)),
    "put": lambda a: (a.at[1].set(0.0), a.at[2:4, 1].set(5.0), a[jnp.array([3, 0, 3])]),
    "scan": lambda a: lax.scan(lambda c, x: (c * 0.5 + x[:3], (c.sum(), x * 2)), jnp.zeros(3), a, reverse=True),
    "swap": lambda a: lax.fori_loop(0, 5, lambda i, c: (c[1], c[0] + a[i]), (a[0], a[1])),
    "choice": lambda a: [lax.cond(a[i, 0] > 0, lambda x: x * 2, lambda x: x.T.reshape(9, 14), a) for i in range(9)],
    "triangle": lambda a: jnp.abs(jnp.linalg.qr(a.T, mode="r")),
    "factor": lambda a: (jnp.linalg.cholesky(a @ a.T), jnp.isnan(jnp.linalg.cholesky(-a @ a.T)[0, 0])),
    "one body twice": lambda a: (_sum(a[:3]), _sum(a), lax.scan(_add, jnp.zeros(14), a, reverse=True)),
    "not a number": lambda a: _undefined(a.at[2, 1].set(jnp.nan)),
    "truths": lambda a: ((a > 0) < (a > 1), (a > 0) >= (a > 1), jnp.maximum(a > 0, a > 1), jnp.min(a > -9, axis=0)),
    "known": lambda a: (a * lax.exp2(2000.0), a * jnp.sin(jnp.inf), jnp.sqrt(-1.0)),
    "kinds": lambda a: ((a > 0).astype(float), (a * 3).astype(int), jnp.sign(a), a**-2, a**0, lax.rsqrt(jnp.abs(a))),
}  # fmt: skip


@pytest.mark.parametrize("name", RULES)
def test_every_rule_gives_what_jax_gives(name):
    assert_as_jax(RULES[name], A)


def test_a_carry_may_be_looked_up_in_the_one_before():
    def step(c, _):
        return c[np.array([2, 0, 1])], c

    def function(a):
        return lax.fori_loop(0, 4, lambda i, c: (c[1][::-1], c[0] * 2, c[0][1:] + c[1][:-1]), (a[0], a[1], a[0][1:]))

    assert_as_jax(function, A)
    program = lower(jax.make_jaxpr(lambda c: (step(c, None)[0], c * 1.0))(np.zeros(3)))
    start = lower(jax.make_jaxpr(lambda: jnp.array([1.0, 2.0, 3.0]))())
    loop = ArrayLoop(program, start, 0, 1, 1)
    each, memory = np.empty((4, 3)), np.empty(4096, np.uint8)
    Compiled(loop)(4, np.zeros(1), memory, np.zeros(1), each)
    assert each.tolist() == [[1, 2, 3], [3, 1, 2], [2, 3, 1], [1, 2, 3]]


@pytest.mark.parametrize("start", [-2, 0, 6, 8, 20])
def test_a_part_at_a_computed_place_stays_inside(start):
    def function(a, i):
        part = lax.dynamic_slice(a, (i[0], jnp.zeros_like(i[0])), (2, 3))
        return part, lax.dynamic_update_slice(a, part * 2, (i[0], i[0]))

    assert_as_jax(function, A, np.array([start]))


@pytest.mark.parametrize(("n", "k"), [(9, 14), (40, 70), (150, 180)])
def test_kernels_of_large_matrices_give_what_jax_gives(n, k):
    N = np.random.default_rng(1).normal(size=(n, k))
    L = np.tril(N[:, :n]) + 5 * np.eye(n)
    assert_as_jax(
        lambda N, L: (small.triangularise(N), small.gram(N), small.solve_lower(L, N[:, :3]), L @ N), N, L, rtol=1e-11
    )


@pytest.mark.parametrize(
    "function",
    [
        lambda a: jnp.sort(a[0]),
        lambda a: lax.while_loop(lambda x: x.sum() < 9, lambda x: x + 1, a),
        lambda a: a.astype(complex),
    ],
)
def test_what_has_no_rule_is_left_to_another_engine(function):
    with pytest.raises(UnsupportedError):
        run_natively(function, A)


@pytest.fixture
def as_arrays(monkeypatch):
    """Every step as operations on arrays, however small."""

    def refuse(*_, **__):
        raise UnsupportedError("too large, as it were")

    monkeypatch.setattr(native, "write", refuse)


@pytest.mark.parametrize("name", [entry.name for entry in catalogue.ENTRIES])
@pytest.mark.usefixtures("as_arrays")
def test_every_entry_of_the_catalogue_gives_the_same_as_arrays(name):
    rng = np.random.default_rng(0)
    y = rng.normal(size=(60, 2))
    y[rng.random(y.shape) < 0.3] = np.nan
    record = Record(y, rng.normal(size=(60, 1)), dt=0.01, hold="first_order",
                    inputs=FILE.model.inputs, outputs=FILE.model.outputs)  # fmt: skip
    short = {"length": 2} if "length" in SHORT.get(name, {}) else SHORT.get(name, {})
    algorithm = catalogue.build(name, file_for(name, FILE), **short)
    assert_same(*both(algorithm, record, FILE.prior, keep="all"), rtol=AMPLIFIED.get(name, 1e-12))


def large(n, p, length=300):
    """A model, a prior and a record whose covariance settles, with one output missing late, and one once more."""
    rng = np.random.default_rng(n)
    A = rng.normal(size=(n, n))
    A *= 0.8 / np.abs(np.linalg.eigvals(A)).max()
    model = StateSpace(
        A, rng.normal(size=(n, 1)), C=rng.normal(size=(p, n)), Q=0.1 * np.eye(n), R=0.3 * np.eye(p), dt=1
    )
    y = rng.normal(size=(length, p))
    y[[length * 4 // 5, length - 1], 0] = np.nan
    return model, Prior(np.zeros(n), np.eye(n)), Record(y, rng.normal(size=(length, 1)), dt=1)


@pytest.mark.parametrize("keep", ["all", "last"])
def test_large_models_give_the_same(keep):
    model, prior, record = large(12, 3)
    assert_same(*both(Kalman(model), record, prior, keep=keep), rtol=1e-11)


@pytest.mark.parametrize(("algorithm", "n"), [(Kalman, 140), (lambda m: UnknownGain(m, Prior([1.0], [[1.0]])), 12)])
def test_other_large_models_give_the_same(algorithm, n):
    model, prior, record = large(n, 2, 12)
    assert_same(*both(algorithm(model), record, prior, keep="means"), rtol=1e-9)


def test_large_models_are_smoothed_as_machine_code():
    model, prior, record = large(12, 3, 40)
    ours, xla = (smooth(Kalman(model), record, prior=prior, engine=engine) for engine in ("native", "xla"))
    assert ours.engine == "native"
    assert_allclose(ours.mean, xla.mean, rtol=1e-9, atol=1e-9)
    assert_allclose(ours.covariance, xla.covariance, rtol=1e-9, atol=1e-9)


def test_a_covariance_settles_with_many_outputs():
    model, prior, record = large(12, 10)
    P = estimate(Kalman(model), record, prior=prior, engine="native").covariance
    assert bool((P[150:239] == P[151:240]).all())
    assert not np.array_equal(P[240], P[239])


def test_many_outputs_have_machine_code():
    model, prior, record = large(9, 40, 5)
    assert_same(*both(Kalman(model), record, prior, keep="means"), rtol=1e-11)


def test_what_repeats_is_left_out_of_large_models_and_taken_up_again():
    model, prior, record = large(12, 3)
    P = estimate(Kalman(model), record, prior=prior, engine="native").covariance
    assert bool((P[150:239] == P[151:240]).all())
    assert not np.array_equal(P[240], P[239])
    assert not np.array_equal(P[299], P[298])


@pytest.mark.parametrize("stacked", [(0, 1, 2), (0,), (1,), (2,)])
def test_banks_of_large_models_give_the_same(stacked):
    parts = [(Kalman(m), r, p) for m, p, r in (large(n, 2, 30) for n in (12, 12, 12))]
    algorithms, records, priors = ([part[i] for part in parts] if i in stacked else parts[0][i] for i in range(3))
    assert_same_bank(*both_banks(algorithms, records, priors), rtol=1e-11)


def test_a_large_model_steps_online_as_machine_code():
    model, prior, record = large(12, 3, 40)
    running, result = online(Kalman(model), prior=prior, engine="native"), estimate(Kalman(model), record, prior=prior)
    for k in range(40):
        info = running.correct(record.y[k])
        assert_allclose(info.mean, result.mean[k], rtol=1e-11, atol=1e-12)
        assert_allclose(info.covariance, result.covariance[k], rtol=1e-11, atol=1e-12)
        running.predict(record.u[k])


def test_a_large_result_leaves_no_memory_behind():
    model, prior, record = large(12, 3)
    for _ in range(2):
        result = estimate(Kalman(model), record, prior=prior, engine="native")
        whole = result.covariance
        while whole.base is not None:
            whole = whole.base
        kept = weakref.ref(whole)
        del result, whole
        assert kept() is None


def test_a_large_run_ends_in_the_same_way():
    model = StateSpace(1e200 * np.eye(12), C=np.eye(12)[:1], R=[[1.0]], dt=1)
    y = [1.0, np.nan, np.nan, np.nan]
    ours, xla = both(Kalman(model), Record(y, dt=1), Prior(np.ones(12), np.eye(12)), on_failure="keep")
    assert ours.outcome == xla.outcome
    assert ours.outcome.code == 1


def test_why_a_large_step_has_no_machine_code_is_worked_out_once(tmp_path, monkeypatch):
    monkeypatch.setenv("ESTIMABLE_CACHE", str(tmp_path))
    model, prior, record = large(12, 2, 5)
    tried = []

    def refuse(traced):
        tried.append(traced)
        raise UnsupportedError("no such primitive")

    monkeypatch.setattr("estimable.engines.large.lower", refuse)
    monkeypatch.setattr("estimable.engines.large._large_step", lru_cache(_large_step.__wrapped__))
    for _ in range(2):
        assert estimate(Kalman(model), record, prior=prior).engine == "xla"
    assert len(tried) == 1
    with pytest.raises(InputError, match='"native" cannot run Kalman here: no such primitive'):
        estimate(Kalman(model), record, prior=prior, engine="native")
