"""Straight lines and machine code against JAX: random programs, every catalogue entry, every way a run can end."""

import math
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from cases import SHORT, case, file_for
from estimable import (
    InputError,
    Kalman,
    Prior,
    Record,
    StateSpace,
    UnknownGain,
    catalogue,
    estimate,
    estimate_bank,
    packaged,
    read_model,
)
from estimable.engines import choice, native
from estimable.engines.llvm import compilation as llvm
from estimable.engines.llvm.compilation import Compiled
from estimable.engines.llvm.scalar_loop import RowArray, ScalarLoop
from estimable.engines.lowering import write_shapes
from estimable.engines.program.primitives import UnsupportedError
from estimable.engines.program.straight_line import lower
from estimable.estimation.binding import select
from estimable.frozen import frozen, replace
from estimable.results import OUTCOMES, Info, Interval, Sample
from oracles.interpreter import interpret

UNARY = {
    "negative": jnp.negative, "abs": jnp.abs, "sqrt": lambda a: jnp.sqrt(jnp.abs(a)), "square": jnp.square,
    "log": lambda a: jnp.log(jnp.abs(a)), "exp": lambda a: jnp.exp(-jnp.abs(a)), "cube": lambda a: a**3,
    "transpose": jnp.transpose, "reverse": lambda a: a[::-1], "row": lambda a: jnp.broadcast_to(a[1], a.shape),
    "sum": lambda a: jnp.broadcast_to(jnp.sum(a, axis=0), a.shape), "largest": lambda a: a - jnp.max(a),
    "where": lambda a: jnp.where(a > 0, a, 2 * a), "set": lambda a: a.at[0, 1].set(3.0), "sign": jnp.sign,
    "finite": lambda a: jnp.where(jnp.isfinite(a), a, 1.0), "first": lambda a: a * (jnp.argmax(a[0]) + 1).astype(float),
    "zero": lambda a: a * 0.0 + 1.0, "diagonal": lambda a: jnp.eye(3) * a, "inverse": lambda a: 1 / (1 + jnp.abs(a)),
    "sin": lambda a: jnp.sin(jnp.tanh(a)), "cos": lambda a: jnp.cos(jnp.arctan(a)), "tan": lambda a: jnp.tan(jnp.tanh(a)),
    "asin": lambda a: jnp.arcsin(jnp.sin(jnp.tanh(a))), "acos": lambda a: jnp.arccos(jnp.tanh(a)),
    "hyperbolic": lambda a: jnp.sinh(jnp.tanh(a)) + jnp.cosh(jnp.tanh(a)),
    "tangent": lambda a: jax.jacfwd(lambda x: x * jnp.exp(-x * x))(a[0]),
    "stack": lambda a: jnp.stack([a[2], a[0], a[1]], axis=1),
    "round": jnp.round, "all": lambda a: jnp.where(jnp.all(a > -1), a, -a),
}  # fmt: skip
BINARY = {
    "add": jnp.add, "subtract": jnp.subtract, "multiply": jnp.multiply, "divide": lambda a, b: a / (1 + b * b),
    "matmul": jnp.matmul, "maximum": jnp.maximum, "minimum": jnp.minimum,
    "logic": lambda a, b: jnp.where((a > b) | (b > 1), a, b),
    "join": lambda a, b: jnp.concatenate([a[:1], b[1:]]), "xor": lambda a, b: jnp.where((a > 0) ^ (b > 0), a, b),
}  # fmt: skip


def random_function(steps):
    """A composition of primitives over 3 × 3 arrays, from a list of (name, which operands)."""

    def function(a, b):
        values = [a, b]
        for name, i, j in steps:
            x, y = values[i % len(values)], values[j % len(values)]
            values.append(UNARY[name](x) if name in UNARY else BINARY[name](x, y))
        return values[-1], jnp.any(values[-1] > values[-2])

    return function


STEPS = st.lists(
    st.tuples(st.sampled_from([*UNARY, *BINARY]), st.integers(0, 8), st.integers(0, 8)), min_size=1, max_size=8
)


def run_natively(program, inputs, lanes=1):
    """One row of a loop that carries nothing."""
    places = [(i, j, int(n)) for i, array in enumerate(program.inputs) for j, n in enumerate(array.ravel()) if n >= 0]
    outputs = tuple(int(n) for array in program.outputs for n in array.ravel())
    compiled = Compiled(
        ScalarLoop(program, (), (), (RowArray(tuple(n for *_, n in places)),), (), (RowArray(outputs),), ()), lanes
    )
    row = np.array([[np.full(lanes, np.ravel(inputs[i])[j]) for i, j, _ in places]]).reshape(1, -1)
    each = np.empty((1, len(outputs), lanes))
    compiled(1, np.zeros(1), np.zeros(1), np.zeros(1), np.ascontiguousarray(row), each)
    assert np.array_equal(each, np.broadcast_to(each[..., :1], each.shape), equal_nan=True)
    return each[0, :, 0]


@given(steps=STEPS, seed=st.integers(0, 10**6))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_random_programs_give_what_jax_gives(steps, seed):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, 3, 3))
    a[0, 0] = rng.choice([a[0, 0], 0.0, 1e-300, 1e200])
    function = random_function(steps)
    with np.errstate(all="ignore"):
        expected = [np.asarray(x, float) for x in function(jnp.asarray(a), jnp.asarray(b))]
    if any(np.isnan(x).any() for x in expected):
        return  # 0 times infinity is 0 in a straight line
    program = lower(function, a, b)
    flat = np.concatenate([np.ravel(x) for x in expected])
    size = 1 + np.max(np.abs(flat[np.isfinite(flat)]), initial=0)
    interpreted = np.concatenate([np.ravel(x) for x in interpret(program, [a, b])]).astype(float)
    for ours in (interpreted, run_natively(program, [a, b])):
        assert_allclose(ours, flat, rtol=1e-9, atol=1e-11 * size)


@pytest.mark.parametrize("lanes", [2, 4, 8])
def test_lanes_run_side_by_side(lanes):
    a, b = np.random.default_rng(0).normal(size=(2, 3, 3))
    program = lower(random_function([("matmul", 0, 1), ("log", 2, 0), ("logic", 3, 0), ("largest", 4, 4)]), a, b)
    assert_allclose(run_natively(program, [a, b], lanes), run_natively(program, [a, b]), rtol=1e-14)


def test_equal_operations_are_one_and_constants_are_folded():
    def function(a):
        return a @ a.T, (2.0 * 3.0) * a + 0.0, 1.0 * a, jnp.zeros(3) * a[0]

    program = lower(function, np.ones((3, 3)))
    names = [operation.name for operation in program.operations]
    assert names.count("mul") == 18 + 9  # a a' is symmetric: 6 of 9 entries, 3 products each
    assert names.count("constant") == 2  # 6 and 0
    product = program.outputs[0]
    assert np.array_equal(product, product.T)


def test_a_function_of_another_meaning_may_be_called_settles():
    @jax.jit
    def settles(truth):
        return ~truth

    program = lower(lambda x: settles(x > 0), 1.0)
    assert interpret(program, [np.array(1.0)])[0].item() is False


def test_what_has_no_straight_line_is_refused():
    with pytest.raises(UnsupportedError, match="the primitive scan"):
        lower(lambda x: jax.lax.fori_loop(0, 9, lambda i, y: y + 1, x), 0.0)
    with pytest.raises(UnsupportedError, match="computed"):
        lower(lambda x, i: jax.lax.dynamic_index_in_dim(x, i), np.ones(3), 1)
    with pytest.raises(UnsupportedError, match="operations"):
        lower(lambda a: a @ a @ a, np.ones((20, 20)))


def both(algorithm, record, prior, **options):
    return (estimate(algorithm, record, prior=prior, engine=engine, **options) for engine in ("native", "xla"))


def assert_same(native, xla, rtol=1e-12):
    assert (native.engine, xla.engine) == ("native", "xla")
    assert native.outcome == xla.outcome
    leaves = zip(jax.tree_util.tree_leaves(native.info), jax.tree_util.tree_leaves(xla.info), strict=True)
    for a, b in leaves:
        assert_allclose(a, b, rtol=rtol, atol=rtol * max(1.0, np.nanmax(np.abs(b), initial=0.0)))
    assert_allclose(native.log_likelihood, xla.log_likelihood, rtol=rtol)


AMPLIFIED = {
    "unknown-input": 1e-9
}  # outputs missing, an input no one measured: innovations grow to 1e9, and rounding with them
FILE = read_model(packaged.path("f16-model.toml"))._replace(unknown=("elevator_deg",))


@pytest.mark.parametrize(
    ("name", "keep"),
    [(entry.name, "all") for entry in catalogue.ENTRIES]
    + [("unknown-gain", keep) for keep in ("means", "last", "likelihood")],
)
def test_every_entry_of_the_catalogue_gives_the_same(name, keep):
    rng = np.random.default_rng(0)
    y = rng.normal(size=(200, 2))
    y[rng.random(y.shape) < 0.3] = np.nan
    record = Record(y, rng.normal(size=(200, 1)), dt=0.01, hold="first_order",
                    inputs=FILE.model.inputs, outputs=FILE.model.outputs)  # fmt: skip
    algorithm = catalogue.build(name, file_for(name, FILE), **SHORT.get(name, {}))
    assert_same(*both(algorithm, record, FILE.prior, keep=keep), rtol=AMPLIFIED.get(name, 1e-12))


@pytest.mark.parametrize("features", [{"cross": True}, {"singular": True}, {"missing": 0.8}], ids=str)
def test_every_feature_of_a_static_model_gives_the_same(features):
    c = case(1, (3, 2, 2), **features)
    diffuse = Prior(c.prior.mean, c.prior.covariance, diffuse=np.eye(3)[:, :2])
    for prior in (c.prior, diffuse):
        assert_same(*both(Kalman(c.model), c.record, prior))
    assert_same(*both(UnknownGain(c.model, Prior([1.0], [[1.0]]), forgetting=0.9), c.record, c.prior))


def interrupted(size=1, length=400):
    """Records of one model, long enough for the covariance to settle, with an output missing late in every second one."""
    c = case(3, (3, 2, 2))
    records = []
    for i in range(size):
        y = np.random.default_rng(i).normal(size=(length, 2))
        y[length - 80, i % 2] = np.nan if i % 2 == 0 else 1.0
        records.append(Record(y, np.ones((length, 2)), dt=c.record.dt))
    return Kalman(replace(c.model, R=np.diag(np.diag(c.model.R)))), records, c.prior


def test_what_repeats_is_left_out_and_taken_up_again():
    algorithm, (record,), prior = interrupted()
    native_, xla = both(algorithm, record, prior)
    assert_same(native_, xla)
    stands = [(P[1:] == P[:-1]).all() for P in (native_.covariance[200:320], native_.covariance[380:])]
    assert stands == [True, True]
    assert not np.array_equal(native_.covariance[320], native_.covariance[319])


def test_what_repeats_is_left_out_in_all_lanes_or_none():
    algorithm, records, prior = interrupted(9)
    assert_same_bank(*both_banks(algorithm, records, prior))


@frozen
class Latch:
    """The sum of the samples after the first, which it knows by a truth that starts as a constant and becomes another."""

    def at(self, k):
        return self

    def init(self, prior):
        return jnp.zeros(()), jnp.array(False)

    def correct(self, state, sample):
        total, begun = state
        total = jnp.where(begun, total + sample.y[0], total)
        return (total, jnp.array(True)), Info(mean=total[None], log_likelihood=total, outcome=jnp.array(0))

    def predict(self, state, interval):
        return state


@pytest.mark.parametrize("engine", ["native", "xla"])
def test_a_truth_of_the_state_may_become_another_constant(engine):
    nothing = np.zeros((3, 0))
    sample = Sample(np.array([[4.0], [1.0], [2.0]]), np.ones((3, 1), bool), nothing)
    interval = Interval(nothing, nothing, None, np.ones(3))
    _, run = choice.scan(engine, Latch(), None, sample, interval, keep="all", select=select)
    assert run.info.mean.ravel().tolist() == [0.0, 1.0, 3.0]


@pytest.mark.parametrize(
    ("model", "y", "code"),
    [
        (StateSpace([[1e200]], R=[[1.0]], dt=1), [1.0, np.nan, np.nan, np.nan], 1),
        (StateSpace([[0.5]], R=[[0.0]], dt=1), [4.0, 2.0, 9.0, 1.0], 2),
        (StateSpace([[0.5]], R=[[0.0]], dt=1), [4.0, 2.0, 1.0, 0.5], 0),
    ],
)
def test_a_run_ends_in_the_same_way(model, y, code):
    prior = Prior([4.0], [[0.0]]) if code != 1 else Prior([1.0], [[1.0]])
    native, xla = both(Kalman(model), Record(y, dt=1), prior, on_failure="keep")
    assert native.outcome == xla.outcome
    assert native.outcome.code == code
    assert code in OUTCOMES


def test_automatic_choice_takes_machine_code_where_it_can():
    c = case(0, (2, 1, 1))
    assert estimate(Kalman(c.model), c.record, prior=c.prior).engine == "native"
    varying = case(0, (2, 1, 1), varying=True)
    assert estimate(Kalman(varying.model), varying.record, prior=varying.prior).engine == "native"


VARYING = [case(seed, (2, 1, 1), varying=True) for seed in range(3)]


def test_matrices_that_are_looked_up_by_row_give_the_same():
    algorithms, records = [Kalman(c.model) for c in VARYING], [c.record for c in VARYING]
    for mixture in mixtures(algorithms, records, [c.prior for c in VARYING])[1:3]:
        assert_same_bank(*both_banks(*mixture))


def test_steps_of_different_length_give_the_same():
    rng = np.random.default_rng(0)
    model = StateSpace([[0, 1.0], [-1, -0.2]], [[0], [1.0]], C=[[1, 0.0]], Q=np.diag([0, 0.1]), R=[[0.1]], dt=0)
    record = Record(rng.normal(size=(50, 1)), rng.normal(size=(50, 1)), t=np.cumsum(rng.uniform(0.05, 0.2, 50)))
    for algorithm in (Kalman(model), UnknownGain(model, Prior([1.0], [[1.0]]))):
        assert_same(*both(algorithm, record, Prior([0.0, 0.0], np.eye(2))))


def test_a_second_process_reads_the_object_of_the_first(tmp_path, monkeypatch):
    code = (
        "import estimable as es, numpy as np\n"
        "m = es.StateSpace([[0.5]], R=[[1.0]], dt=1)\n"
        "r = es.estimate(es.Kalman(m), es.Record([1.0, 2.0], dt=1), prior=es.Prior([0.0], [[1.0]]), engine='native')\n"
        "print(repr(r.log_likelihood))"
    )
    monkeypatch.setenv("ESTIMABLE_CACHE", str(tmp_path / "cache"))

    def run():
        return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout

    first = run()
    kept = sorted((tmp_path / "cache").glob("*.o"))  # the start and the step
    written = [path.stat().st_mtime_ns for path in kept]
    assert run() == first
    assert sorted((tmp_path / "cache").glob("*.o")) == kept
    assert [path.stat().st_mtime_ns for path in kept] == written
    assert len(kept) == 2
    for path in kept:
        path.write_bytes(path.read_bytes()[:-100])  # damaged: compiled fresh, not loaded
    assert run() == first


def test_a_cache_that_cannot_be_written_is_no_error(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("ESTIMABLE_CACHE", str(tmp_path / "file" / "below"))
    record = Record([[1.0, 2.0, 3.0]], dt=1)
    wide = StateSpace([[0.123456]], C=[[1.0], [2.0], [0.5]], R=np.eye(3), dt=1)
    assert estimate(Kalman(wide), record, prior=Prior([0.0], [[1.0]]), engine="native").outcome.code == 0


def mixtures(algorithms, records, priors):
    """Several of everything, or of one part only."""
    return (
        (algorithms, records, priors),
        (algorithms, records[0], priors[0]),
        (algorithms[0], records, priors[0]),
        (algorithms[0], records[0], priors),
    )


def both_banks(algorithms, records, prior, **options):
    banks = [estimate_bank(algorithms, records, prior=prior, engine=engine, **options) for engine in ("native", "xla")]
    assert [bank.engine for bank in banks] == ["native", "xla"]
    return banks


def assert_same_bank(ours, xla, rtol=1e-12):
    assert (len(ours), ours.outcomes) == (len(xla), xla.outcomes)
    leaves = zip(jax.tree_util.tree_leaves(ours.info), jax.tree_util.tree_leaves(xla.info), strict=True)
    for a, b in leaves:
        assert (a.shape, a.dtype) == (b.shape, b.dtype)
        assert_allclose(a, b, rtol=rtol, atol=rtol * max(1.0, np.nanmax(np.abs(b), initial=0.0)))
    assert_allclose(ours.log_likelihood, xla.log_likelihood, rtol=rtol)


@pytest.mark.parametrize("name", [entry.name for entry in catalogue.ENTRIES])
def test_every_entry_of_the_catalogue_gives_the_same_in_a_bank(name):
    rng = np.random.default_rng(0)
    records = []
    for _ in range(3):
        y = rng.normal(size=(60, 2))
        y[rng.random(y.shape) < 0.3] = np.nan
        records.append(Record(y, rng.normal(size=(60, 1)), dt=0.01, hold="first_order",
                              inputs=FILE.model.inputs, outputs=FILE.model.outputs))  # fmt: skip
    short = {"length": 2} if "length" in SHORT.get(name, {}) else SHORT.get(name, {})
    algorithm = catalogue.build(name, file_for(name, FILE), **short)
    assert_same_bank(*both_banks(algorithm, records, FILE.prior), rtol=AMPLIFIED.get(name, 1e-12))


@pytest.mark.parametrize(
    ("size", "keep", "every"),
    [(1, "all", 1), (3, "last", 4), (8, "last", 1), (3, "means", 1), (9, "likelihood", 1), (19, "all", 4)],
)
def test_banks_give_the_same_whatever_is_stacked(size, keep, every):
    cases = [case(seed, (3, 2, 2)) for seed in range(size)]
    algorithms = [UnknownGain(c.model, Prior([0.5], [[1.0]])) for c in cases]
    records, priors = [c.record for c in cases], [c.prior for c in cases]
    for mixture in mixtures(algorithms, records, priors)[:every]:
        assert_same_bank(*both_banks(*mixture, keep=keep), rtol=1e-10)


def test_the_log_likelihood_of_a_long_record_loses_nothing_in_its_sum():
    record = Record(np.random.default_rng(0).normal(size=(200_000, 1)), dt=1)
    result = estimate(Kalman(StateSpace([[0.5]], Q=[[0.1]], R=[[1.0]], dt=1)), record, prior=Prior([0.0], [[1.0]]))
    assert result.engine == "native"
    assert_allclose(result.log_likelihood, math.fsum(result.log_likelihood_steps), rtol=1e-15)


def test_a_bank_says_which_runs_failed():
    model = StateSpace([[0.5]], R=[[0.0]], dt=1)
    records = [Record([4.0, 2.0, y], dt=1) for y in (1.0, 9.0, 1.0)]
    for engine in ("native", "xla"):
        bank = estimate_bank(Kalman(model), records, prior=Prior([4.0], [[0.0]]), on_failure="keep", engine=engine)
        assert [outcome.code for outcome in bank.outcomes] == [0, 2, 0]
        assert bank.outcomes[1].sample == 2


def test_without_llvm_xla_runs(monkeypatch):
    cases = [case(seed, (2, 1, 1)) for seed in range(3)]
    bank = [Kalman(c.model) for c in cases], [c.record for c in cases]
    assert estimate_bank(*bank, prior=cases[0].prior).engine == "native"
    monkeypatch.setitem(sys.modules, "llvmlite.binding", None)
    llvm._processor.cache_clear()
    native.compiled_step.cache_clear()
    assert estimate_bank(*bank, prior=cases[0].prior).engine == "xla"
    assert estimate(bank[0][0], bank[1][0], prior=cases[0].prior).engine == "xla"
    with pytest.raises(InputError, match='"native" cannot run Kalman here: llvmlite cannot be imported'):
        estimate(bank[0][0], bank[1][0], prior=cases[0].prior, engine="native")
    monkeypatch.undo()
    llvm._processor.cache_clear()
    assert estimate_bank(*bank, prior=cases[0].prior).engine == "native"


def test_why_a_step_cannot_be_written_out_is_worked_out_once():
    large = StateSpace(0.9 * np.eye(9), R=np.eye(9), dt=1)
    record, prior = Record(np.zeros((3, 9)), dt=1), Prior(np.zeros(9), np.eye(9))
    assert estimate(Kalman(large), record, prior=prior).engine == "native"  # as operations on arrays
    misses = write_shapes.cache_info().misses
    assert estimate(Kalman(large), record, prior=prior).engine == "native"
    assert write_shapes.cache_info().misses == misses
