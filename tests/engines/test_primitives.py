"""The table of primitives against XLA: every row, and what is composed of rows, on special numbers, by every engine."""

import ctypes
import itertools
import shutil
import subprocess
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.figures.every_engine import ENGINES, FIXED, Pack, Rows, by_xla, differing
from benchmarks.figures.random_programs import FLOATS, INTEGERS, TYPES, compositions, failures, kinds
from jax import lax

from estimable.engines.llvm.array_loop import ArrayLoop
from estimable.engines.program import arrays
from estimable.engines.program.primitives import (
    BOOL,
    FLOAT,
    INTEGER,
    PRIMITIVES,
    PYTHON,
    UnsupportedError,
    folded,
    row,
    type_of,
)
from estimable.engines.program.straight_line import lower

RUNS = 9
ROWS = list(PRIMITIVES.values())
COMPOSED = [kind for kind in compositions() if not any("constant" in t for t in kind.arguments)]
ULPS = 512  # of what is composed of rows that are not exact
CONSTANTS = {
    FLOAT: (0.0, -0.0, 1.0, -1.0, 2.0, 1e300, np.inf, -np.inf, np.nan),
    INTEGER: (0, 1, -1, 2, 64, -(2**63), 2**63 - 1),
    BOOL: (False, True),
}
STRUCTURAL = {("mul", 0), ("mul", 1), ("div", 0)}  # a zero here is zero whatever the other factor is


def traced(each):
    """What a program of JAX holds where its lowering holds the row."""
    return lax.abs if (each.name, each.arguments) == ("abs", (INTEGER,)) else each.jax


def side_by_side(numbers, extra):
    """Every pair of the numbers and the pairs after them, with a third number to each."""
    pairs = np.array([*itertools.product(numbers, numbers), *extra], np.asarray(numbers).dtype)
    return np.column_stack([pairs, np.roll(pairs[:, :1], 7)])


@cache
def special():
    """Every pair of special numbers of each type, and ordinary ones."""
    rng = np.random.default_rng(0)
    ordinary = rng.normal(size=(80, 2)) * 10.0 ** rng.integers(-6, 7, size=(80, 2))
    floats = side_by_side(FLOATS, ordinary)
    integers = side_by_side(INTEGERS, rng.integers(-70, 70, size=(40, 2)))
    bools = side_by_side([False, True], [])
    count = -(-len(floats) // RUNS)
    return Rows(*(np.resize(x, (RUNS * count, 3)).reshape(RUNS, count, 3) for x in (floats, integers, bools)))


def applied(function, types, inputs):
    """The function at the first inputs of each type."""
    columns = {t: iter(range(3)) for t in TYPES}
    return function(*(inputs[TYPES.index(t)][..., next(columns[t])] for t in types))


def of_each_type(results):
    """(type, scalar) as three vectors."""
    return [jnp.stack([x for type_, x in results if type_ == t]) for t in TYPES]


def every_row(*inputs):
    return of_each_type(
        [(each.result, applied(traced(each), each.arguments, inputs)) for each in ROWS]
        + [(each.result, applied(each.function, each.arguments, inputs)) for each in COMPOSED]
    )


def with_constants():
    """(row, which argument is constant, the constant) of every row of two arguments of one type."""
    return [
        (each, place, constant)
        for each in ROWS
        if len(each.arguments) == 2
        for place in (0, 1)
        for constant in CONSTANTS[each.arguments[place]]
    ]


def every_constant(*inputs):
    def partly(each, place, constant):
        other = inputs[TYPES.index(each.arguments[1 - place])][..., 0]
        given = [jnp.asarray(constant), other]
        return traced(each)(*(given if place == 0 else given[::-1]))

    return of_each_type([(each.result, partly(each, place, constant)) for each, place, constant in with_constants()])


@cache
def run(function, engine):
    """What an engine gives at the special numbers."""
    by = by_xla if engine == "xla" else ENGINES[engine]
    return [np.asarray(x) for x in by(Pack(FIXED, function), special())]


def ordered(items, result):
    """The items in the order of their results: floats, integers, bools."""
    return [[item for item in items if result(item) == t] for t in TYPES]


def inputs_at(index, types):
    columns = {t: iter(range(3)) for t in TYPES}
    return tuple(special()[TYPES.index(t)][index][next(columns[t])].item() for t in types)


@pytest.mark.parametrize("engine", ENGINES)
def test_every_row_gives_what_xla_gives(engine):
    everything = ordered([*ROWS, *COMPOSED], lambda each: each.result)
    for items, ours, theirs in zip(everything, run(every_row, engine), run(every_row, "xla"), strict=True):
        for place, item in enumerate(items):
            ulps = item.ulps if item in ROWS else ULPS * item.rounded
            bad = np.argwhere(differing(ours[..., place], theirs[..., place], ulps))
            wrong = [
                (inputs_at(tuple(i), item.arguments), ours[..., place][tuple(i)], theirs[..., place][tuple(i)])
                for i in bad[:3]
            ]
            assert not wrong, (item.name, item.arguments, wrong)
        assert not differing(ours[..., len(items) :], theirs[..., len(items) :]).any()  # carried, and of the algorithm


@pytest.mark.parametrize("engine", ENGINES)
def test_a_constant_argument_changes_nothing_but_products_with_zero(engine):
    items = ordered(with_constants(), lambda item: item[0].result)
    for some, ours, theirs in zip(items, run(every_constant, engine), run(every_constant, "xla"), strict=True):
        for column, (each, place, constant) in enumerate(some):
            ours_here, theirs_here = ours[..., column], theirs[..., column]
            structural = each.arguments[0] == FLOAT and (each.name, place) in STRUCTURAL and engine != "arrays"
            if constant == 0 and structural:
                assert not ours_here.any()
                continue
            ulps = max(each.ulps, each.name == "div")  # XLA multiplies by the inverse of a constant
            bad = differing(ours_here, theirs_here, ulps)
            assert not bad.any(), (each.name, each.arguments, place, constant, ours_here[bad][:3], theirs_here[bad][:3])


@pytest.mark.parametrize("each", ROWS, ids=lambda each: f"{each.name}-{'-'.join(each.arguments)}")
def test_a_row_is_what_jax_names_so_and_folds_to_what_it_computes(each):
    examples = [np.zeros((), PYTHON[t]) for t in each.arguments]
    if each.name != "settles":  # a name given to a function, not a primitive
        program = lower(traced(each), *examples)
        assert each.name in {operation.name for operation in program.operations}
        assert program.operations[int(program.outputs[0])].type == each.result
    items = ordered([*ROWS, *COMPOSED], lambda item: item.result)[TYPES.index(each.result)]
    theirs, count = run(every_row, "xla")[TYPES.index(each.result)][..., items.index(each)], 0
    for index in np.ndindex(theirs.shape):
        value = folded(each, list(inputs_at(index, each.arguments)))
        if value is not None:
            count += 1
            wrong = differing(np.asarray(value), theirs[index], each.ulps).any()
            assert not wrong, (inputs_at(index, each.arguments), value, theirs[index])
    assert count > (0 if each.name == "acosh" else 2)


def test_what_is_known_is_computed_as_if_it_were_not():
    def known(x):
        floats = [lax.pow(-8.0, 1 / 3), jnp.sqrt(-1.0), lax.exp2(2000.0), lax.log(0.0), jnp.float64(0.0) * jnp.nan]
        integers = [lax.div(7, 2), lax.rem(-7, 4), 6 & 3, 1 << 70, jnp.asarray(7).astype(np.int8) * np.int8(100)]
        return jnp.stack([jnp.asarray(v, float) for v in (*floats, *integers, x * jnp.nan * 0.0)]) + 0 * x

    expected = jax.jit(known)(1.0)
    pack = Pack(FIXED, lambda floats, integers, bools: (known(floats[0]), integers, bools))
    for name, by in ENGINES.items():
        ours = np.asarray(by(pack, Rows(np.ones((2, 2, 1)), np.ones((2, 2, 1), int), np.ones((2, 2, 1), bool))).floats)
        assert np.array_equal(ours[0, 0, :11], expected, equal_nan=True), name


def test_the_magnitude_of_a_product_that_wraps_is_not_the_product():
    pack = Pack(FIXED, lambda floats, integers, bools: (floats, lax.abs(integers * integers), bools))
    given = Rows(np.ones((2, 2, 1)), np.full((2, 2, 1), 3037000500), np.ones((2, 2, 1), bool))
    for name, by in ENGINES.items():
        assert by(pack, given).integers[0, 0, 0] == 9223372036709301616, name


REFUSED = {
    "the next float": (lambda x: jnp.nextafter(x, 1.0), "the primitive nextafter"),
    "another function": (lambda x: lax.erf_inv(x), "the primitive erf_inv"),
    "float32": (lambda x: x.astype(np.float32) * 2, "numbers of the kind float32"),
    "complex numbers": (lambda x: lax.complex(x, x), "numbers of the kind complex128"),
    "uint64": (lambda x: x.astype(np.uint64), "numbers of the kind uint64"),
    "leading zeros": (lambda x: lax.clz(x.astype(int)), "the primitive clz"),
    "a row of other types": (lambda x: lax.erf(x) + lax.lgamma(x), "the primitive lgamma"),
    "printing": (lambda x: jax.debug.print("{}", x) or x, "side effects"),
}


def scalars_of(function):
    lower(function, 1.0)


def arrays_of(function):
    program = arrays.lower(jax.make_jaxpr(function)(1.0))
    ArrayLoop(program, None, 0, 0, len(program.outputs)).assembly()


@pytest.mark.parametrize("name", REFUSED)
@pytest.mark.parametrize("form", [scalars_of, arrays_of])
def test_what_has_no_row_is_refused_by_name(name, form):
    function, message = REFUSED[name]
    with pytest.raises(UnsupportedError, match=message):
        form(function)


def test_a_row_of_other_types_is_refused_with_them():
    with pytest.raises(UnsupportedError, match="the primitive and of float and float"):
        row("and", (FLOAT, FLOAT))
    with pytest.raises(UnsupportedError, match="numbers of the kind float16"):
        type_of(np.dtype(np.float16))


def test_what_is_gathered_outside_is_refused():
    with pytest.raises(UnsupportedError, match="gather at an index outside the array"):
        lower(lambda x: x.at[np.array([0, 5])].get(mode="fill"), np.ones(3))


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_the_spelling_in_c_gives_what_xla_gives(tmp_path):
    words = {FLOAT: "double", INTEGER: "int64_t", BOOL: "_Bool"}
    lines = ["#include <math.h>", "#include <stdint.h>"]
    for i, each in enumerate(ROWS):
        given = ", ".join(f"{words[t]} {letter}" for t, letter in zip(each.arguments, "abc", strict=False))
        lines.append(f"{words[each.result]} f{i}({given}) {{ return {each.c.format(a='a', b='b', c='c')}; }}")
    (tmp_path / "rows.c").write_text("\n".join(lines) + "\n")
    flags = ["-std=c99", "-pedantic", "-O2", "-ffp-contract=off", "-Wall", "-Werror", "-shared", "-fPIC"]
    subprocess.run(["cc", *flags, "rows.c", "-o", "rows.so", "-lm"], check=True, cwd=tmp_path)
    library = ctypes.CDLL(str(tmp_path / "rows.so"))
    kinds_in_c = {FLOAT: ctypes.c_double, INTEGER: ctypes.c_int64, BOOL: ctypes.c_bool}
    everything = ordered([*ROWS, *COMPOSED], lambda each: each.result)
    for i, each in enumerate(ROWS):
        function = getattr(library, f"f{i}")
        function.restype, function.argtypes = kinds_in_c[each.result], [kinds_in_c[t] for t in each.arguments]
        place = TYPES.index(each.result)
        theirs = run(every_row, "xla")[place][..., everything[place].index(each)]
        ours = np.array([function(*inputs_at(index, each.arguments)) for index in np.ndindex(theirs.shape)])
        bad = differing(ours.reshape(theirs.shape), theirs, each.ulps)
        assert not bad.any(), (each.name, each.arguments, ours.reshape(theirs.shape)[bad][:3], theirs[bad][:3])


def test_random_programs_of_floats_integers_and_bools_give_what_xla_gives():
    assert failures(0, kinds()[::4], compositions()[::4], depth=2) == []


@pytest.mark.parametrize("engine", ENGINES)
def test_the_last_row_keeps_every_type(engine):
    def function(floats, integers, bools):
        narrow = (integers * 3).astype(np.int32)
        return floats * 2, jnp.concatenate([integers + 1, narrow.astype(int)]), ~bools

    given = Rows(np.ones((3, 4, 2)), np.full((3, 4, 2), 2**62 + 3), np.ones((3, 4, 1), bool))
    pack = Pack(FIXED, function)
    ours, expected = (by(pack, given, keep="last") for by in (ENGINES[engine], by_xla))
    for a, b in zip(ours, expected, strict=True):
        assert (a.dtype, a.tolist()) == (b.dtype, b.tolist())
