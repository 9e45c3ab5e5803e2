"""Numbers of an algorithm by name: "A[q, alpha]" of its model, "R[y1]", "walk[gain]", "gain[gain]", "x0[q]", a parameter."""

import re
from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import numpy as np

from .. import checks
from ..annotations import Array
from ..filters.mixture import Mixture
from ..frozen import field_names, replace
from ..models.nonlinear_model import NonlinearModel
from ..models.prior import Prior
from ..models.state_space import StateSpace
from ..protocols import Algorithm, GainAlgorithm, Wrapper

ENTRY = re.compile(r"\s*(\w+)\s*\[([^\]]*)\]\s*")
COVARIANCES = ("Q", "R", "walk")


class Field(NamedTuple):
    """A field with numbers: its owner ("model", "algorithm", "gain" or "prior"), its name there, and the names of its axes."""

    owner: str
    name: str
    axes: tuple[tuple[str, ...], ...]


class NamedNumber(NamedTuple):
    """One number: its name, its field, and where it is in the last axes of that; a covariance has it in two places."""

    name: str
    field: Field
    at: tuple[int, ...]

    @staticmethod
    def read(text: str, fields: dict[str, Field], faults: checks.Faults) -> "NamedNumber | None":
        """The entry that a text names. Reports a fault where there is none."""
        found = ENTRY.fullmatch(text) if isinstance(text, str) else None
        if found is None and isinstance(text, str) and text in fields["parameter"].axes[0]:
            return NamedNumber(text, fields["parameter"], (fields["parameter"].axes[0].index(text),))
        field = fields.get(found[1]) if found else None
        if found is None or field is None or found[1] == "parameter":
            known = checks.listed([name for name in fields if name != "parameter"])
            faults.add(
                f'`with_respect_to` must name entries such as "A[{_example(fields)}]", of {known}. Got {text!r}.'
            )
            return None
        names = [part.strip() for part in found[2].split(",")]
        if len(names) == 1 and len(field.axes) == 2 and field.axes[0] == field.axes[1]:
            names *= 2  # a variance
        if len(names) != len(field.axes):
            faults.add(f"`{text}` must name {checks.counted(len(field.axes), 'channel')}. Got {len(names)}.")
            return None
        return NamedNumber._of_names(text, field, names, faults)

    @staticmethod
    def _of_names(text: str, field: Field, names: Sequence[str], faults: checks.Faults) -> "NamedNumber | None":
        at = []
        for name, axis in zip(names, field.axes, strict=True):
            if name not in axis:
                faults.add(f"`{text}`: {name!r} must be one of {checks.listed(axis)}.{checks.suggestion(name, axis)}")
                return None
            at.append(axis.index(name))
        return NamedNumber(text, field, tuple(at))

    def added(self, array: Array, by: complex) -> Any:
        """The array with a number added to this entry."""
        moved = np.array(array, complex)
        moved[(..., *self.at)] += by
        if self.field.name in COVARIANCES and len(set(self.at)) == 2:
            moved[(..., *self.at[::-1])] += by
        return moved


class Setup(NamedTuple):
    """An algorithm and its prior: all the numbers of a run."""

    algorithm: Algorithm[Any]
    prior: Prior | None

    def moved(self, entries: Sequence[NamedNumber], by: np.ndarray) -> Self:
        """The same with a number added to each entry."""
        algorithm, prior = self
        for entry, one in zip(entries, by, strict=True):
            if one == 0:
                continue
            if entry.field.owner == "prior":
                prior = replace(prior, mean=entry.added(prior.mean, one))  # pyright: ignore[reportOptionalMemberAccess, reportArgumentType]
            else:
                algorithm = with_innermost(algorithm, _added(algorithm.innermost, entry, one))
        return type(self)(algorithm, prior)


def _added(algorithm: Algorithm[Any], entry: NamedNumber, by: complex) -> Any:
    owner, name = entry.field.owner, entry.field.name
    if owner == "algorithm":
        return replace(algorithm, **{name: entry.added(getattr(algorithm, name), by)})
    part = getattr(algorithm, owner)
    return replace(algorithm, **{owner: replace(part, **{name: entry.added(getattr(part, name), by)})})


def with_innermost(algorithm: Algorithm[Any], inner: Algorithm[Any]) -> Any:
    """The same wrappers around another algorithm. Raises `InputError` for a mixture."""
    if isinstance(algorithm, Mixture):
        checks.refuse(
            "a Mixture has several models, whose numbers cannot be changed together: give one of its algorithms."
        )
    if isinstance(algorithm, Wrapper):
        return replace(algorithm, algorithm=with_innermost(algorithm.algorithm, inner))
    return inner


def fields_of(algorithm: Algorithm[Any], prior: Prior | None) -> dict[str, Field]:
    """The fields whose entries have names, by the letter that names them."""
    inner, names = algorithm.innermost, algorithm.names
    model, fields = inner.model, {}
    if isinstance(model, StateSpace):
        x, u, y = model.states, model.inputs, model.outputs
        w = x if model.G is None or np.array_equal(model.G, np.eye(model.n)) else numbered("w", model.Q.shape[-1])
        axes = {"A": (x, x), "B": (x, u), "C": (y, x), "D": (y, u), "Q": (w, w), "R": (y, y), "S": (w, y), "G": (x, w)}
        fields = {name: Field("model", name, axis) for name, axis in axes.items() if getattr(model, name) is not None}
    elif isinstance(model, NonlinearModel):
        q = numbered("w", model.Q.shape[-1])
        w = model.states if model.G is not None and np.array_equal(model.G, np.eye(model.n)) else q
        fields = {"Q": Field("model", "Q", (w, w)), "R": Field("model", "R", (model.outputs, model.outputs))}
    if isinstance(inner, GainAlgorithm) and inner.gain is not None and inner.names.gains:
        gains = inner.names.gains
        named = field_names(type(inner))
        fields["gain"] = Field("gain" if "gain" in named else "parameters", "mean", (gains,))
        if "walk" in named:
            fields["walk"] = Field("algorithm", "walk", (gains, gains))
    if prior is not None:
        fields["x0"] = Field("prior", "mean", (names.states,))
    parameters = model.parameter_names if isinstance(model, NonlinearModel) else ()
    return fields | {"parameter": Field("model", "parameters", (parameters,))}


def numbered(letter: str, count: int) -> tuple[str, ...]:
    """Default names: w1, w2, .."""
    return tuple(f"{letter}{i + 1}" for i in range(count))


def _example(fields: dict[str, Field]) -> str:
    return ", ".join(axis[0] for axis in next(iter(fields.values())).axes if axis)
