"""Wrong arguments: made of a right one, or of nothing."""

import contextlib
import dataclasses
import datetime
import decimal
import fractions
import random
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pandas as pd

from estimable import EstimableError

NAMES = [
    "",
    " ",
    "x" * 10_000,
    "a\0b",
    "\ud800",
    "\u202eabc",
    "<script>",
    "y1",
    "é",
    "1",
    "\n",
    "None",
    "../..",
    "/dev/full",
    "-1",
]
NUMBERS = [0, -1, 1, 2, 3, 10**6, -(10**400), 10**400, 2**63, 2**31, 0.0, -0.0, 0.5, -2.5, 1e300, -1e300, 1e-300, 5e-324,
           float("nan"), float("inf"), -float("inf"), True, False, 1j, np.float32(0.1), np.int8(-1), np.uint64(2**63),
           np.bool_(True), np.complex128(1j), decimal.Decimal("0.1"), fractions.Fraction(1, 3)]  # fmt: skip
THINGS = [None, object(), object, print, lambda *a, **k: None, lambda x: x, {}, set(), frozenset({1}), {"a": 1}, (), [], [[]],
          [None], ["a"], [1.0, "a"], [[1.0], [2.0, 3.0]], [[[1.0]]], iter([1.0]), range(3), slice(None), b"ab", bytearray(b"a"),
          Path("."), datetime.datetime(2026, 1, 1), datetime.timedelta(1), pd.NaT, pd.NA, np.datetime64("2026-01-01"), Ellipsis,
          NotImplemented, Exception("x"), pd.Timestamp("2026-01-01", tz="UTC"), random]  # fmt: skip


def any_array(rng: random.Random) -> np.ndarray:
    """An array of some shape and type."""
    shape = rng.choice(
        [(), (0,), (1,), (2,), (3,), (0, 2), (1, 1), (2, 2), (2, 3), (3, 2), (1, 2, 2), (3, 1, 1), (1, 1, 1, 1)]
    )
    return np.asarray(np.random.default_rng(rng.randrange(2**32)).normal(size=shape))


def odd(rng: random.Random, good: Any = None) -> Any:
    """What may be given in the place of `good`."""
    kind = rng.random()
    with contextlib.suppress(TypeError, ValueError, IndexError, AttributeError, OverflowError):
        if kind < 0.5 and good is not None:
            return _changed(rng, good)
        if kind < 0.6:
            return _dressed(rng, any_array(rng))
    return rng.choice([*NUMBERS, *NAMES] if kind < 0.9 else THINGS)


def _changed(rng: random.Random, good: Any) -> Any:
    if isinstance(good, bool) or good is None:
        return rng.choice([1, 0, "True", None, np.bool_(True)])
    if isinstance(good, str):
        return rng.choice(
            [good.upper(), good + "x", good[:-1], good.encode(), [good], (good, good), Path(good), good + "\0"]
        )
    if isinstance(good, int | float):
        return rng.choice([-good, good * 1e9, good / 1e9, good * 1e300, str(good), [good], np.array(good), np.array([good]),
                           good + 0.5, np.float32(good), good + 1j, int(good) * 10**30])  # fmt: skip
    if isinstance(good, dict):
        return rng.choice([{**good, "no such": 1}, {str(k): odd(rng, v) for k, v in good.items()}, list(good), None])
    if isinstance(good, list | tuple | np.ndarray | jnp.ndarray):
        return _dressed(rng, _bent(rng, np.asarray(good, float)))
    if dataclasses.is_dataclass(good) and not isinstance(good, type):
        made = type(good).__module__.startswith("estimable.results")  # nobody writes a result by hand
        things = [[good], (good, good), type(good), {"a": good}]
        return rng.choice(things) if made or rng.random() < 0.2 else _rebuilt(rng, good)
    return rng.choice([None, "x", 1.0, [good]])


def _rebuilt(rng: random.Random, good: Any) -> Any:
    """A record with one odd field; the record itself where its constructor refuses that."""
    fields = {field.name: getattr(good, field.name) for field in dataclasses.fields(good) if field.init}
    name = rng.choice(list(fields))
    with contextlib.suppress(EstimableError):
        return type(good)(**{**fields, name: odd(rng, fields[name])})
    return good


def _bent(rng: random.Random, array: np.ndarray) -> np.ndarray:
    """The numbers with another shape, or other numbers."""
    changes = [
        lambda a: a.T, lambda a: a.ravel(), lambda a: a[None], lambda a: a[..., None], lambda a: a[:-1], lambda a: a[:0],
        lambda a: np.concatenate([a, a]), lambda a: np.concatenate([a, a], axis=-1), lambda a: -a, lambda a: a * 1e300,
        lambda a: a * 1e-300, lambda a: a * 0, lambda a: _with(a, np.nan, rng), lambda a: _with(a, np.inf, rng),
        lambda a: _with(a, 1e300, rng), lambda a: _with(a, -1.0, rng), lambda a: a[0], lambda a: a.sum(),
        lambda a: np.tril(a, -1), lambda a: np.full(a.shape, np.nan), lambda a: a,
    ]  # fmt: skip
    return np.asarray(rng.choice(changes)(array))


def _with(array: np.ndarray, value: float, rng: random.Random) -> np.ndarray:
    changed = np.array(array, float)
    changed.flat[rng.randrange(changed.size)] = value
    return changed


def _dressed(rng: random.Random, array: np.ndarray) -> Any:
    """The same numbers in another container or type."""
    index = pd.Index([0] * len(array)) if array.ndim else None
    dresses = [
        lambda a: a, lambda a: a, lambda a: a.tolist(), lambda a: a.astype(np.float32), lambda a: a.astype(complex),
        lambda a: a.astype(object), lambda a: a.astype(str), lambda a: a.astype("M8[s]"), lambda a: np.ma.array(a, mask=a > 0),
        lambda a: np.ma.array(a), lambda a: jnp.asarray(a), lambda a: np.repeat(a, 2, axis=0)[::2],
        lambda a: np.asfortranarray(a), lambda a: _frozen(a), lambda a: np.zeros(len(a), [("a", float), ("b", int)]),
        lambda a: pd.Series(a.ravel(), index=pd.Index([0] * a.size)), lambda a: pd.DataFrame(a, index=index),
        lambda a: pd.DataFrame(a, index=pd.MultiIndex.from_arrays([range(len(a)), range(len(a))])),
        lambda a: pd.DataFrame(a, index=pd.date_range("2026", periods=len(a), tz="Europe/Berlin"), columns=["a"] * a.shape[1]),
        lambda a: np.where(np.isnan(a), None, a), lambda a: memoryview(np.ascontiguousarray(a)),
        lambda a: np.array([*a, None], object), lambda a: a > 0, lambda a: a.astype(np.int8), lambda a: a.astype(np.float16),
        lambda a: a.astype(np.longdouble),
    ]  # fmt: skip
    with np.errstate(all="ignore"):
        return rng.choice(dresses)(array)


def _frozen(array: np.ndarray) -> np.ndarray:
    array = array.copy()
    array.flags.writeable = False
    return array
