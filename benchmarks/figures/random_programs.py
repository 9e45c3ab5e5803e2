"""Random programs of floats, integers and bools, by every engine against XLA: `python -m benchmarks.figures.random_programs`.

A program is a row of the table of primitives, or a primitive composed of rows, applied to inputs, constants and other programs.
Layers of vectors of programs share a compilation. Inexact results are rounded to a coarse grid at once, so that every number
must equal XLA's to the last bit, with NaN, infinities and the signs of zeros.
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax

from estimable.engines.program.primitives import BOOL, FLOAT, INTEGER, NARROW, PRIMITIVES

from .every_engine import ENGINES, FIXED, Pack, Rows, by_xla, differing

TYPES = FLOAT, INTEGER, BOOL
LEAVES = {FLOAT: 8, INTEGER: 6, BOOL: 3}
OWN = 2  # inputs added by a pack: a number of the previous row, and one of the algorithm
LAYERS, WIDTH, RUNS, ROWS = 3, 3, 9, 8
HITS = 200
INEXACT = "mul", "div", "from_bits"  # may be contracted or subnormal; and XLA makes a choice of a product with a bool
GRID, OFFSET = 64.0, 1 / np.pi  # no simple number is halfway between two grid points
FLOATS = np.array([np.nan, np.inf, -np.inf, 0.0, -0.0, 1.0, -1.0, 0.5, -1.5, 2.5, 3.0, -8.0, 1e308, -np.finfo(float).max,
                   np.finfo(float).tiny, -np.finfo(float).tiny, 2.0**63, -(2.0**63), 1e18, 4503599627370497.5])  # fmt: skip
INTEGERS = np.array([-(2**63), -(2**63) + 1, -(2**53) - 1, -(2**31), -129, -7, -1, 0, 1, 2, 3, 31, 32, 63, 64, 255, 2**31,
                     2**53 + 1, 2**63 - 1])  # fmt: skip
CONSTANTS = {FLOAT: np.array([1.0, -1.0, 0.5, -2.0, 3.0, 1e300, np.inf, np.nan]), INTEGER: INTEGERS[INTEGERS != 0]}


class Kind(NamedTuple):
    """A kind of program: a function of vectors of these types; `rounded`: whether its result is rounded to the grid."""

    name: str
    arguments: tuple[str, ...]
    result: str
    function: Callable[..., Any]
    rounded: bool = False


class Programs(NamedTuple):
    """Programs of one kind: their arguments, one vector for each, and the place of the first among its type."""

    kind: Kind
    operands: list[np.ndarray]
    first: int


def _bits_of_numbers(x: Any) -> Any:
    """The bits of numbers; not those of a NaN, as its sign depends on the C library."""
    return lax.bitcast_convert_type(jnp.where(x == x, x, 0.0), np.dtype(np.int64))


TRACED = {("bits", (FLOAT,)): _bits_of_numbers, ("abs", (INTEGER,)): lambda x: lax.abs(lax.optimization_barrier(x))}


def kinds() -> list[Kind]:
    """All rows of the table."""
    return [
        Kind(f"{row.name} of {', '.join(row.arguments)}", row.arguments, row.result,
             TRACED.get((row.name, row.arguments), row.jax),
             row.result == FLOAT and (row.ulps > 0 or row.name in INEXACT or row.arguments == (BOOL,)))
        for row in PRIMITIVES.values()
    ]  # fmt: skip


def compositions() -> list[Kind]:
    """Primitives composed of rows, also for narrow integers, and operations with constants."""
    return [*_composed(), *_narrow(), *_with_constants()]


def _composed() -> list[Kind]:
    f, i, b = FLOAT, INTEGER, BOOL
    three = lambda a, b, c: jnp.stack([a, b, c])  # noqa: E731
    return [
        *(Kind(f"integer_pow {y}", (f,), f, lambda a, y=y: lax.integer_pow(a, y), True) for y in (-2, 0, 3, 5)),
        Kind("integer_pow 3 of integers", (i,), i, lambda a: lax.integer_pow(a, 3)),
        Kind("square", (f,), f, lax.square, True), Kind("square of integers", (i,), i, lax.square),
        Kind("rsqrt", (f,), f, lax.rsqrt, True), Kind("logistic", (f,), f, lax.logistic, True),
        Kind("pow of float, integer", (f, i), f, lambda a, k: lax.pow(a, lax.rem(k, 9)), True),
        *(Kind(f"clamp of {t}s", (t, t, t), t, lax.clamp) for t in (f, i)),
        Kind("choice of three", (i, f, f, f), f, lambda k, *cases: lax.select_n(k.astype(np.int32), *cases)),
        *(Kind(f"{name} of three {t}s", (t, t, t), i, lambda *x, op=op: op(three(*x), 0, np.int64))
          for name, op in (("argmax", lax.argmax), ("argmin", lax.argmin)) for t in TYPES),
        *(Kind(f"{name} of three {t}s", (t, t, t), t, lambda *x, op=op: op(three(*x), axis=0))
          for name, op in (("largest", jnp.max), ("least", jnp.min)) for t in (f, i)),
        Kind("sum of three integers", (i, i, i), i, lambda *x: jnp.sum(three(*x), axis=0)),
        Kind("product of three integers", (i, i, i), i, lambda *x: jnp.prod(three(*x), axis=0)),
        *(Kind(f"{name} of three bools", (b, b, b), b, lambda *x, op=op: op(three(*x), axis=0))
          for name, op in (("all", jnp.all), ("any", jnp.any))),
    ]  # fmt: skip


def _narrow() -> list[Kind]:
    """Integers of fewer bits, from and to those of 64."""

    def within(dtype, function):
        return lambda *x: function(*(a.astype(dtype) for a in x)).astype(np.int64)

    binary = {"add": lax.add, "mul": lax.mul, "div": lax.div, "rem": lax.rem, "shift_left": lax.shift_left,
              "shift_right_arithmetic": lax.shift_right_arithmetic, "shift_right_logical": lax.shift_right_logical}  # fmt: skip
    pairs = [Kind(f"{name} in {dtype}", (INTEGER, INTEGER), INTEGER, within(dtype, op))
             for dtype in (np.int8, np.int32, np.uint32) for name, op in binary.items()]  # fmt: skip
    unary = {"neg": lax.neg, "not": lax.bitwise_not, "population_count": lax.population_count}
    single = [Kind(f"{name} in {dtype}", (INTEGER,), INTEGER, within(dtype, op))
              for dtype in (np.int32, np.uint8) for name, op in unary.items()]  # fmt: skip
    return [
        *pairs,
        *single,
        *(Kind(f"float to {dtype}", (FLOAT,), INTEGER, within(dtype, lambda a: a)) for dtype in NARROW),
    ]


def _with_constants() -> list[Kind]:
    """Operations with a constant argument: `function(x, constant)`."""
    operations = {"add": lax.add, "sub": lax.sub, "mul": lax.mul, "div": lax.div, "rem": lax.rem, "max": lax.max,
                  "min": lax.min, "lt": lax.lt, "eq": lax.eq}  # fmt: skip
    return [
        Kind(f"{name} of {t} and constant", (t, f"constant {t}"), BOOL if name in ("lt", "eq") else t, op,
             t == FLOAT and name in ("mul", "div"))
        for t in (FLOAT, INTEGER) for name, op in operations.items()
    ]  # fmt: skip


def coarse(x: Any) -> Any:
    """x rounded to a grid that no error of a few units in the last place crosses, and at most a million."""
    return lax.clamp(-1e6, lax.round(x * GRID + OFFSET, lax.RoundingMethod.TO_NEAREST_EVEN), 1e6) * (1 / GRID)


def grown(rng: np.random.Generator, rows: list[Kind], others: list[Kind], depth: int = LAYERS) -> list[list[Programs]]:
    """Layers of programs: every row in each layer, and the others in turn; a layer takes earlier results and inputs."""
    sizes, layers = {t: LEAVES[t] + OWN for t in TYPES}, []
    for i in range(depth):
        before = dict(sizes)
        layers.append([])
        for kind in [*rows, *others[i::depth]]:
            operands = [_operand(rng, t, before) for t in kind.arguments]
            layers[-1].append(Programs(kind, operands, sizes[kind.result]))
            sizes[kind.result] += WIDTH
    return layers


def _operand(rng: np.random.Generator, type_: str, sizes: dict[str, int]) -> np.ndarray:
    if type_ not in sizes:
        return rng.choice(CONSTANTS[type_.removeprefix("constant ")], WIDTH)
    inputs = rng.integers(LEAVES[type_] + OWN, size=WIDTH)
    return np.where(rng.random(WIDTH) < 0.4, inputs, rng.integers(sizes[type_], size=WIDTH))


class Composition:
    """Layers of programs as one function of the inputs: every program is a result."""

    def __init__(self, layers: list[list[Programs]]):
        self.layers = layers

    def __call__(self, *inputs: Any) -> list[Any]:
        pool = dict(zip(TYPES, inputs, strict=True))
        for layer in self.layers:
            new = {t: [pool[t]] for t in TYPES}
            for kind, operands, _ in layer:
                given = [self.operand(pool, *pair) for pair in zip(kind.arguments, operands, strict=True)]
                result = kind.function(*given)
                new[kind.result].append(coarse(result) if kind.rounded else result)
            pool = {t: jnp.concatenate(new[t]) for t in TYPES}
        return [pool[t][LEAVES[t] + OWN :] for t in TYPES]

    @staticmethod
    def operand(pool: dict[str, Any], type_: str, places: np.ndarray) -> Any:
        if type_ not in pool:
            return jnp.asarray(places)
        return pool[type_].at[places].get(mode="promise_in_bounds")

    def described(self, type_: str, place: int, depth: int = 4) -> str:
        """The text of a program."""
        if place < LEAVES[type_] + OWN:
            return f"{type_}[{place}]"
        kind, operands, first = next(
            some
            for layer in self.layers
            for some in layer
            if some.kind.result == type_ and 0 <= place - some.first < WIDTH
        )
        column = [operand[place - first] for operand in operands]
        given = [repr(p) if t not in TYPES else self.described(t, p, depth - 1) if depth else ".."
                 for t, p in zip(kind.arguments, column, strict=True)]  # fmt: skip
        return f"{kind.name}({', '.join(given)})"


def drawn(rng: np.random.Generator) -> Rows:
    """Inputs: special numbers and others."""
    shape = RUNS, ROWS
    floats = rng.normal(size=(*shape, LEAVES[FLOAT])) * 10.0 ** rng.integers(-2, 3, size=(*shape, LEAVES[FLOAT]))
    integers = rng.integers(-(2**62), 2**62, size=(*shape, LEAVES[INTEGER])) >> rng.integers(
        0, 62, size=(*shape, LEAVES[INTEGER])
    )
    special = rng.random(floats.shape) < 0.4, rng.random(integers.shape) < 0.4
    floats = np.where(special[0], rng.choice(FLOATS, floats.shape), floats)
    integers = np.where(special[1], rng.choice(INTEGERS, integers.shape), integers)
    return Rows(floats, integers, rng.random((*shape, LEAVES[BOOL])) < 0.5)


def failures(seed: int, rows: list[Kind], others: list[Kind], depth: int = LAYERS) -> list[str]:
    """The results of a pack of programs that differ from XLA's, as messages."""
    rng = np.random.default_rng(seed)
    programs, given = Composition(grown(rng, rows, others, depth)), drawn(rng)
    pack, found = Pack(FIXED, programs), []
    expected = by_xla(pack, given)
    for name, run in ENGINES.items():
        for type_, ours, theirs in zip(TYPES, run(pack, given), expected, strict=True):
            bad = differing(np.asarray(ours), np.asarray(theirs))
            for place in np.flatnonzero(bad.any(axis=(0, 1))):
                i, row = np.argwhere(bad[..., place])[0]
                values = [np.asarray(x)[i, row, place].item() for x in (ours, theirs)]
                words = "what is carried or fixed"
                if place < bad.shape[-1] - OWN:
                    words = programs.described(type_, place + LEAVES[type_] + OWN)
                found.append(f"seed {seed}, {name}: {values[0]!r}, by XLA {values[1]!r}: {words} at run {i}, row {row}")
    return found


def parser() -> argparse.ArgumentParser:
    """The options."""
    options = argparse.ArgumentParser(description=__doc__, prog="python -m benchmarks.figures.random_programs")
    options.add_argument("--programs", type=int, default=20_000, help="at least this many, and each row 200 times")
    options.add_argument("--seed", type=int, default=0, help="of the first pack")
    return options


def main(arguments: list[str] | None = None) -> int:
    """Run packs of programs until there are enough programs."""
    options, start, wrong, hits = parser().parse_args(arguments), time.perf_counter(), [], Counter()
    rows, others = kinds(), compositions()
    pack = {**{kind.name: LAYERS * WIDTH for kind in rows}, **{kind.name: WIDTH for kind in others}}
    packs = max(-(-options.programs // sum(pack.values())), -(-HITS // (LAYERS * WIDTH)))
    for seed in range(options.seed, options.seed + packs):
        wrong += (found := failures(seed, rows, others))
        hits.update(pack)
        print(f"{time.perf_counter() - start:7.0f} s  {sum(hits.values()):7,} programs, {len(wrong)} wrong", *found, sep="\n",
              file=sys.stderr, flush=True)  # fmt: skip
    for name, count in hits.items():
        print(f"{count:5}  {name}")
    counted = f"{sum(hits.values()):,} programs at {RUNS * ROWS} inputs each, {len(ENGINES)} engines"
    print("\n".join(wrong) or f"{counted}: all as XLA.")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
