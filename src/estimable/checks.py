# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnnecessaryIsInstance=false
"""The checks of all arguments. The faults of a call are collected and raised together, in the user's words."""

import logging
import math
import numbers
import os
import unicodedata
from collections.abc import Iterable, Mapping, Sequence, Set
from pathlib import Path
from typing import Any, NoReturn, TypeAlias, TypeGuard

import jax
import numpy as np
from jax.core import Tracer

from .annotations import Numbers
from .errors import InputError
from .phrases import counted, first_index, limited, listed, remedy, short, suggestion

Given: TypeAlias = Numbers | Sequence[Numbers] | Sequence[Sequence[Numbers]] | None  # what an array is made of

log = logging.getLogger("estimable.checks")
ROUNDING = 1e-12  # largest asymmetry or negative eigenvalue of a covariance by rounding, relative to its size
VARIANCE_ROUNDING = 16 * np.finfo(float).eps  # the same for a variance on the diagonal
SINGLE = 8 * float(np.finfo(np.float32).eps)  # both for a covariance that comes in float32
MOST_ROWS = 10**8  # of a simulation or a forecast, and most runs: 0.8 GB for each channel
LARGEST_ORDER = 10_000  # of a model: its matrices then have 1e8 entries
HUGE = 1e150  # largest entry of a covariance: its square is a number
LARGEST = 2**63 - 1  # largest integer, also for a seed
LONGEST_PATH = 300  # characters of a path in a message
LONGEST_NAME = 200  # characters of a channel's name
DIRECTIONS = "\u200e\u200f\u061c" + "".join(map(chr, (*range(0x202A, 0x202F), *range(0x2066, 0x206A))))


class Faults:
    """Collects the faults of one call; sizes learnt from one argument are used to check the next.

    >>> faults = Faults()
    >>> A = faults.array("A", [[1.0, 0.0], [0.0, 1.0]], "n n")
    >>> C = faults.array("C", [[1.0, 0.0, 0.0]], "p n")
    >>> faults.sentences
    ['`C` must be (p, n) = (p, 2): `A` is 2 × 2. Got (1, 3).']
    """

    def __init__(self):
        self.sentences: list[str] = []
        self.sizes: dict[str, int] = {}
        self.sources: dict[str, str] = {}

    def add(self, sentence: str) -> None:
        """Add a fault."""
        self.sentences.append(sentence)

    def finish(self) -> None:
        """Raise all collected faults together."""
        if self.sentences:
            raise InputError(*limited(self.sentences))

    def learn(self, axis: str, size: int, source: str) -> None:
        """Set the size of an axis and its source, for messages."""
        self.sizes.setdefault(axis, size)
        self.sources.setdefault(axis, source)

    def array(self, name: str, value: Given, axes: str, *, leading: str | None = None, nan: bool = False) -> Any:
        """`value` as float64 of shape `axes` ("n m"), with an optional leading axis; None if it is at fault.

        Bools count as 1 and 0; nothing else is converted. Values that JAX is tracing are not checked, but their sizes are
        learnt.
        """
        if isinstance(value, Tracer):
            if value.ndim >= len(axes.split()):
                self._learn_from(name, axes.split(), value.shape[value.ndim - len(axes.split()) :])
            return value
        number_array = self.numbers(name, value, nan=nan)
        if number_array is None:
            return None
        return number_array if self._fits(name, number_array, axes.split(), leading) else None

    def numbers(self, name: str, value: Given, *, nan: bool = False) -> np.ndarray | None:
        """`value` as finite float64 of any shape, with NaN where `nan` allows it; None if it is at fault."""
        if np.ma.is_masked(value):
            hint = f": pass {name}.filled(np.nan), where NaN means unknown" if nan else ""
            self.add(f"`{name}` has masked entries, and a mask is not read{hint}.")
            return None
        try:
            given = np.asarray(value)
            if given.dtype.kind not in "fiub":
                raise ValueError
            with np.errstate(over="ignore"):
                array = given.astype(np.float64)
        except (ValueError, TypeError):
            self.add(f"`{name}` must be an array of real numbers. Got {short(value)}.")
            return None
        if not nan and np.isnan(array).any():
            self.add(f"`{name}` must not hold NaN. First at index {first_index(np.isnan(array))}.")
            return None
        if np.isinf(array).any():
            self.add(f"`{name}` must be finite. First infinite value at index {first_index(np.isinf(array))}.")
            return None
        return array

    def _fits(self, name: str, array: np.ndarray, axes: list[str], leading: str | None) -> bool:
        core = array.shape
        if leading is not None and array.ndim == len(axes) + 1:
            core, rows = array.shape[1:], array.shape[0]
            if rows == 0:
                self.add(f"`{name}` must have at least one row in time. Got {array.shape}.")
                return False
            if self.sizes.get(leading, rows) != rows:
                self.add(f"`{name}` must have {self.sizes[leading]} rows in time: {self.sources[leading]}. Got {rows}.")
                return False
            self.learn(leading, rows, f"`{name}` has {rows}")
        wanted = tuple(self.sizes.get(axis, int(axis) if axis.isdigit() else None) for axis in axes)
        if len(core) == len(axes) and all(w is None or w == g for w, g in zip(wanted, core, strict=True)):
            repeated = {axis: {g for a, g in zip(axes, core, strict=True) if a == axis} for axis in axes}
            if all(len(sizes) == 1 for sizes in repeated.values()):
                self._learn_from(name, axes, core)
                return True
        self.add(self._shape_fault(name, array.shape, axes, wanted, core))
        return False

    def _learn_from(self, name: str, axes: list[str], core: tuple[int, ...]) -> None:
        size = " × ".join(map(str, core))
        shown = f"`{name}` has {counted(int(size), 'entry')}" if len(core) == 1 else f"`{name}` is {size}"
        for axis, size in zip(axes, core, strict=True):
            if not axis.isdigit():
                self.learn(axis, size, shown)

    def _shape_fault(
        self, name: str, shape: tuple[int, ...], axes: list[str], wanted: tuple[int | None, ...], core: tuple[int, ...]
    ) -> str:
        symbols = ", ".join(axes) + ("," if len(axes) == 1 else "")
        sizes = ", ".join(a if w is None else str(w) for a, w in zip(axes, wanted, strict=True))
        sizes += "," if len(axes) == 1 else ""
        because = "; ".join(dict.fromkeys(self.sources[a] for a in axes if a in self.sources))
        known = f" = ({sizes})" if sizes != symbols else ""
        advice = remedy(name, shape, axes, wanted, core)
        return f"`{name}` must be ({symbols}){known}{': ' + because if because else ''}. Got {shape}.{advice}"

    def covariance(self, name: str, value: Given, axes: str, *, leading: str | None = None) -> Any:
        """`value` as a symmetric positive semidefinite float64 matrix (or a stack of them over time)."""
        P = self.array(name, value, axes, leading=leading)
        if P is None or isinstance(P, Tracer) or P.size == 0:
            return P
        turned, n = np.swapaxes(P, -1, -2), P.shape[-1]
        largest = np.abs(P).max(axis=(-1, -2))
        if np.any(largest > HUGE):
            self.add(
                f"`{name}` must have entries of at most {HUGE:g}, so that sums and products of them are numbers. Got "
                f"{np.max(largest):.3g}."
            )
            return None
        size = np.where(largest > 0, largest, 1.0)
        single = getattr(value, "dtype", None) == np.float32
        rounding, on_diagonal = (SINGLE, SINGLE) if single else (ROUNDING, VARIANCE_ROUNDING)
        skew = np.atleast_1d(np.abs(P - turned).max(axis=(-1, -2)))
        if np.any(wrong := skew > rounding * size):
            at = np.argmax(wrong)
            self.add(
                f"`{name}` must be symmetric: {f'at row {at} ' if P.ndim == 3 else ''}it differs from its transpose by "
                f"{skew[at]:.3g}. If that is rounding, pass ({name} + {name}.T) / 2."
            )
            return None
        symmetric = P + (turned - P) / 2
        smallest = np.atleast_1d(np.linalg.eigvalsh(symmetric / size[..., None, None])[..., 0] * size)
        variance = np.atleast_1d(np.diagonal(symmetric, axis1=-2, axis2=-1).min(axis=-1))
        if np.any(wrong := (smallest < -rounding * size * n) | (variance < -on_diagonal * size * n)):
            at = np.argmax(wrong)
            self.add(
                f"`{name}` must be positive semidefinite: {f'at row {at} ' if P.ndim == 3 else ''}its smallest "
                f"eigenvalue is {min(smallest[at], variance[at]):.6g}."
            )
            return None
        if single and np.any(smallest < -ROUNDING * size * n):
            log.warning("`%s` is float32, and indefinite by its rounding: eigenvalues below 0 were set to 0.", name)
            values, vectors = np.linalg.eigh(symmetric)
            return (vectors * np.maximum(values, 0.0)[..., None, :]) @ np.swapaxes(vectors, -1, -2)
        return symmetric

    def positive_definite(self, name: str, matrix: np.ndarray) -> bool:
        """Whether a symmetric matrix, scaled to a unit diagonal, is not singular; else adds a fault."""
        variance = np.diagonal(matrix)
        if np.any(wrong := variance <= 0):
            self.add(
                f"`{name}` must be positive definite: entry {first_index(wrong)} of its diagonal is {variance[wrong][0]:.6g}."
            )
            return False
        smallest = round(np.linalg.eigvalsh(matrix / np.sqrt(variance[:, None] * variance))[0], 15) + 0.0
        if smallest <= ROUNDING * len(matrix):
            self.add(
                f"`{name}` must be positive definite: with a unit diagonal, its smallest eigenvalue is {smallest:.3g}."
            )
            return False
        return True

    def number(
        self,
        name: str,
        value: Numbers | None,
        *,
        lower: float | None = None,
        above: float | None = None,
        upper: float | None = None,
        unit: str = "",
    ) -> Any:
        """`value` as a float between bounds (`lower`, `upper` included; `above` excluded)."""
        if isinstance(value, Tracer):
            return value
        if isinstance(value, np.ndarray | jax.Array) and value.shape == ():
            value = value.item()
        if not _is_finite_number(value):
            self.add(f"`{name}` must be a finite number{unit and ' of ' + unit}. Got {short(value)}.")
            return None
        given = float(value)
        for wrong, words, bound in (
            (lower is not None and given < lower, "at least", lower),
            (above is not None and given <= above, "greater than", above),
            (upper is not None and given > upper, "at most", upper),
        ):
            if wrong:
                self.add(f"`{name}` must be {words} {bound:g}{unit and ' ' + unit}. Got {given:g}.")
                return None
        return given

    def whole(self, name: str, value: Numbers | None, lower: int, upper: int = LARGEST) -> None:
        """`value` must be an integer of at least `lower` and at most `upper`, by default what fits into 64 bits."""
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < lower:
            self.add(f"`{name}` must be an integer of at least {lower}. Got {short(value)}.")
        elif value > upper:
            self.add(f"`{name}` must be at most {upper}. Got {short(value)}.")

    def flag(self, name: str, value: Any) -> None:
        """`value` must be True or False."""
        if not isinstance(value, bool):
            self.add(f"`{name}` must be True or False. Got {short(value)}.")

    def rows(self, name: str, value: Given) -> int | None:
        """Number of rows of a list or an array; None if it has no rows or its rows differ in length."""
        try:
            return len(np.asarray(value))
        except (TypeError, ValueError):
            self.add(f"`{name}` must be an array of real numbers, with rows of one length. Got {short(value)}.")
            return None

    def instance(self, name: str, value: Any, cls: type | tuple[type, ...], hint: str = "") -> bool:
        """Whether `value` is a `cls`, or one of several; else adds a fault."""
        if isinstance(value, cls):
            return True
        classes = [one.__name__ for one in (cls if isinstance(cls, tuple) else (cls,))]
        wanted = " or ".join(f"{'an' if one[0] in 'AEIOU' else 'a'} {one}" for one in classes)
        self.add(f"`{name}` must be {wanted}. Got {short(value)}.{hint}")
        return False

    def function(self, name: str, value: Any, hint: str) -> None:
        """`value` must be callable; `hint` says what it returns."""
        if not callable(value):
            self.add(f"`{name}` must be a function: {hint}. Got {short(value)}.")

    def text(self, name: str, value: Any, hint: str = "") -> None:
        """`value` must be a string."""
        if not isinstance(value, str):
            self.add(f"`{name}` must be a string{hint}. Got {short(value)}.")

    def choice(self, name: str, value: Any, options: Sequence[str]) -> bool:
        """Whether `value` is one of `options`; else adds a fault."""
        if isinstance(value, str) and value in options:
            return True
        words = f"{'one of ' if len(options) > 1 else ''}{listed(options)}"
        self.add(f"`{name}` must be {words}. Got {short(value)}.{suggestion(value, options)}")
        return False

    def printable(self, argument: str, texts: Iterable[str]) -> None:
        """Texts that a terminal, a page and a table can show, of at most `LONGEST_NAME` characters each."""
        for text in texts:
            if found := [character for character in text if _is_hidden(character)]:
                self.add(
                    f"`{argument}` must be plain text. {ascii(text)[:60]} has the character {found[0]!a}, which controls a "
                    "terminal or the direction of writing, or cannot be stored: remove it."
                )
            elif len(text) > LONGEST_NAME:
                self.add(
                    f"`{argument}` must have at most {LONGEST_NAME} characters each. {short(text)} has {len(text):,}."
                )

    def names(self, argument: str, given: Iterable[str] | None, axis: str, default: str) -> tuple[str, ...]:
        """Channel names: as many as the axis is long, each a nonempty string, without repetition."""
        size = self.sizes.get(axis)
        if given is None:
            return tuple(f"{default}{i + 1}" for i in range(size or 0))
        if isinstance(given, str):
            self.add(
                f"`{argument}` must be a list of names. Got the string {short(given)}. Did you mean [{short(given)}]?"
            )
            return ()
        unordered = isinstance(given, Set | Mapping) or getattr(given, "ndim", 1) != 1
        if not isinstance(given, Iterable) or unordered:
            self.add(f"`{argument}` must be a list of names, in order. Got {short(given)}.")
            return ()
        found = tuple(given)
        if not all(isinstance(name, str) and name.strip() for name in found):
            self.add(f"`{argument}` must be nonempty strings. Got {short(found)}.")
            return ()
        found = tuple(str(name) for name in found)
        self.printable(argument, found)
        twice = sorted({name for name in found if found.count(name) > 1})
        if twice:
            self.add(f"`{argument}` names a channel twice: {listed(twice)}.")
        if size is not None and len(found) != size:
            got = f"Got {len(found)}: {listed(found)}."
            names = "1 name" if size == 1 else f"{size} names"
            self.add(f"`{argument}` must hold {axis} = {names}: {self.sources[axis]}. {got}")
        return found


def _is_hidden(character: str) -> bool:
    """Whether it is a control character other than a tab, a mark of the direction of writing, or half of a surrogate pair."""
    control = unicodedata.category(character) in ("Cs", "Cc") and character != "\t"
    return control or character in DIRECTIONS


def require(**arguments: tuple[Any, type | tuple[type, ...]]) -> None:
    """Each argument, given as name=(value, class), must be an instance of its class; all faults are raised together.

    >>> require(model=([[1.0]], Faults))
    Traceback (most recent call last):
    estimable.errors.InputError: `model` must be a Faults. Got [[1.0]].
    """
    faults = Faults()
    for name, (value, cls) in arguments.items():
        faults.instance(name, value, cls)
    faults.finish()


def refuse(*sentences: str) -> NoReturn:
    """Raise one `InputError` with these sentences."""
    raise InputError(*sentences)


def existing_file(path: str | os.PathLike[str]) -> Path:
    """`path` as the path of an existing file; raises `InputError` otherwise."""
    if not isinstance(path, str | os.PathLike):
        refuse(f"`path` must be the name of a file. Got {short(path)}.")
    if not os.path.isfile(path):  # False for a name that is too long, at which Path.is_file raises
        shown = str(path) if len(str(path)) <= LONGEST_PATH else f"{str(path)[:LONGEST_PATH]}..."
        refuse(f"{shown} is not a file." if os.path.exists(path) else f"{shown} does not exist.")
    return Path(path)


def depth(value: Any) -> int:
    """Number of axes of a given array, of nested lists or of a number; -1 for rows of different lengths.

    >>> depth(1.0), depth([[1.0]]), depth([[1.0], [2.0, 3.0]])
    (0, 2, -1)
    """
    try:
        return np.ndim(value)
    except (ValueError, TypeError):
        return -1


def is_traced(*values: Any) -> bool:
    """Whether JAX is tracing any of these values."""
    return any(isinstance(leaf, Tracer) for leaf in jax.tree_util.tree_leaves(values))


def _is_finite_number(value: Numbers | None) -> TypeGuard[float]:
    """Whether it is a real number, finite as a float, and not a boolean."""
    try:
        return isinstance(value, numbers.Real) and not isinstance(value, bool) and math.isfinite(float(value))
    except OverflowError:
        return False
