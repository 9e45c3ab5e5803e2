"""The only place that inspects what the user gave. Faults are collected and raised together, in the user's words."""

import difflib
import numbers
from collections.abc import Iterable, Sequence
from typing import Any, NoReturn

import jax
import numpy as np
from jax.core import Tracer

from .errors import InputError

ROUNDING = 1e-12  # how far from symmetric, or below zero, rounding alone may leave a covariance, relative to its size


class Faults:
    """Collects the faults of one call; sizes that were learnt from one argument are used to check the next.

    >>> faults = Faults()
    >>> A = faults.array("A", [[1.0, 0.0], [0.0, 1.0]], "n n")
    >>> C = faults.array("C", [[1.0, 0.0, 0.0]], "p n")
    >>> faults.sentences
    ['`C` must be (p, n) = (1, 2): `A` is 2 × 2. Got (1, 3).']
    """

    def __init__(self):
        self.sentences: list[str] = []
        self.sizes: dict[str, int] = {}
        self.sources: dict[str, str] = {}

    def add(self, sentence: str) -> None:
        """Note a fault."""
        self.sentences.append(sentence)

    def finish(self) -> None:
        """Raise every fault that was noted, together."""
        if self.sentences:
            raise InputError(*self.sentences)

    def learn(self, axis: str, size: int, source: str) -> None:
        """Fix the size of an axis, and say where it comes from."""
        self.sizes.setdefault(axis, size)
        self.sources.setdefault(axis, source)

    def array(self, name: str, value: Any, axes: str, *, leading: str | None = None, nan: bool = False) -> Any:
        """`value` as float64 of shape `axes` ("n m"), with an optional leading axis; NaN where it is not a number array.

        Values that are being traced by JAX pass unchecked.
        """
        if isinstance(value, Tracer):
            return value
        number_array = self._numbers(name, value, nan)
        if number_array is None:
            return None
        return number_array if self._fits(name, number_array, axes.split(), leading) else None

    def _numbers(self, name: str, value: Any, nan: bool) -> np.ndarray | None:
        try:
            given = np.asarray(value)
            if given.dtype.kind not in "fiub":
                raise ValueError
            array = given.astype(np.float64)
        except (ValueError, TypeError):
            self.add(f"`{name}` must be an array of numbers. Got {short(value)}.")
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
            core = array.shape[1:]
            axes_given = array.shape[0]
            if self.sizes.get(leading, axes_given) != axes_given:
                self.add(f"`{name}` has {axes_given} rows in time; {self.sources[leading]}.")
                return False
            self.learn(leading, axes_given, f"`{name}` has {axes_given} rows in time")
        wanted = tuple(self.sizes.get(axis, int(axis) if axis.isdigit() else None) for axis in axes)
        if len(core) == len(axes) and all(w is None or w == g for w, g in zip(wanted, core, strict=True)):
            repeated = {axis: {g for a, g in zip(axes, core, strict=True) if a == axis} for axis in axes}
            if all(len(sizes) == 1 for sizes in repeated.values()):
                self._learn_from(name, array, axes, core)
                return True
        self.add(self._shape_fault(name, array.shape, axes, wanted, core))
        return False

    def _learn_from(self, name: str, array: np.ndarray, axes: list[str], core: tuple[int, ...]) -> None:
        shown = f"`{name}` is {' × '.join(map(str, core))}" if len(core) > 1 else f"`{name}` has {core[0]} entries"
        for axis, size in zip(axes, core, strict=True):
            if not axis.isdigit():
                self.learn(axis, size, shown)

    def _shape_fault(self, name, shape, axes, wanted, core) -> str:
        symbols = ", ".join(axes) + ("," if len(axes) == 1 else "")
        sizes = ", ".join(a if w is None else str(w) for a, w in zip(axes, wanted, strict=True))
        sizes += "," if len(axes) == 1 else ""
        because = "; ".join(dict.fromkeys(self.sources[a] for a in axes if a in self.sources))
        known = f" = ({sizes})" if sizes != symbols else ""
        sentence = f"`{name}` must be ({symbols}){known}{': ' + because if because else ''}. Got {shape}."
        turned = core[::-1]
        if len(core) == 2 and turned != core and all(w is None or w == g for w, g in zip(wanted, turned, strict=True)):
            sentence += f" Did you mean `{name}.T`?"
        elif len(core) < len(axes):
            sentence += f" A {'matrix' if len(axes) == 2 else 'stack of matrices'} is needed: write nested lists, as in [[1.0]]."
        return sentence

    def covariance(self, name: str, value: Any, axes: str, *, leading: str | None = None) -> Any:
        """`value` as a symmetric positive semidefinite float64 matrix (or a stack of them over time)."""
        P = self.array(name, value, axes, leading=leading)
        if P is None or isinstance(P, Tracer) or P.size == 0:
            return P
        turned = np.swapaxes(P, -1, -2)
        size = np.abs(P).max() or 1.0
        skew = np.abs(P - turned).max()
        if skew > ROUNDING * size:
            self.add(
                f"`{name}` must be symmetric: it differs from its transpose by {skew:.3g}. "
                f"If that is rounding, pass ({name} + {name}.T) / 2."
            )
            return None
        smallest = np.linalg.eigvalsh((P + turned) / 2).min()
        if smallest < -ROUNDING * size * P.shape[-1]:
            self.add(f"`{name}` must be positive semidefinite: its smallest eigenvalue is {smallest:.6g}.")
            return None
        return (P + turned) / 2

    def number(self, name: str, value: Any, *, lower: float | None = None, above: float | None = None,
               upper: float | None = None, unit: str = "") -> Any:
        """`value` as a float between bounds (`lower`, `upper` included; `above` excluded)."""
        if isinstance(value, Tracer):
            return value
        if isinstance(value, np.ndarray) and value.shape == ():
            value = value.item()
        if isinstance(value, bool) or not isinstance(value, numbers.Real) or not np.isfinite(float(value)):
            self.add(f"`{name}` must be a finite number{unit and ' of ' + unit}. Got {short(value)}.")
            return None
        given = float(value)
        for wrong, words in (
            (lower is not None and given < lower, f"at least {lower}"),
            (above is not None and given <= above, f"greater than {above}"),
            (upper is not None and given > upper, f"at most {upper}"),
        ):
            if wrong:
                self.add(f"`{name}` must be {words}{unit and ' ' + unit}. Got {given:g}.")
                return None
        return given

    def choice(self, name: str, value: Any, options: Sequence[str]) -> None:
        """`value` must be one of `options`."""
        if value not in options:
            self.add(f"`{name}` must be one of {listed(options)}. Got {short(value)}.{suggestion(value, options)}")

    def names(self, argument: str, given: Iterable[str] | None, axis: str, default: str) -> tuple[str, ...]:
        """Channel names: as many as the axis is long, each one a text, each one once."""
        size = self.sizes.get(axis)
        if given is None:
            return tuple(f"{default}{i + 1}" for i in range(size or 0))
        if isinstance(given, str):
            self.add(f"`{argument}` must be a list of names. Got the text {given!r}: did you mean [{given!r}]?")
            return ()
        found = tuple(given)
        if not all(isinstance(name, str) for name in found):
            self.add(f"`{argument}` must be names (texts). Got {short(found)}.")
            return ()
        twice = sorted({name for name in found if found.count(name) > 1})
        if twice:
            self.add(f"`{argument}` names a channel twice: {listed(twice)}.")
        if size is not None and len(found) != size:
            self.add(f"`{argument}` must hold {axis} = {size} names: {self.sources[axis]}. Got {len(found)}: {listed(found)}.")
        return found


def refuse(*sentences: str) -> NoReturn:
    """Raise one `InputError` with these sentences."""
    raise InputError(*sentences)


def listed(names: Iterable[Any]) -> str:
    """Names as they stand in a sentence."""
    return ", ".join(repr(name) for name in names) or "none"


def suggestion(wrong: Any, options: Iterable[str]) -> str:
    """' Did you mean ...?' where one of the options is near, else nothing."""
    near = difflib.get_close_matches(str(wrong), list(options), n=1, cutoff=0.6)
    return f" Did you mean {near[0]!r}?" if near else ""


def short(value: Any) -> str:
    """What was given, in at most 60 characters."""
    text = f"an array of shape {value.shape} and dtype {value.dtype}" if isinstance(value, np.ndarray) else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def first_index(mask: np.ndarray) -> str:
    """Index of the first true entry, as a user would write it."""
    index = tuple(int(i) for i in np.argwhere(mask)[0])
    return str(index[0]) if len(index) == 1 else str(index)


def is_traced(*values: Any) -> bool:
    """Whether JAX is tracing any of these."""
    return any(isinstance(leaf, Tracer) for leaf in jax.tree_util.tree_leaves(values))
