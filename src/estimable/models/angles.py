"""Which channels and states are angles, and the range in which each is reported."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias, cast

import numpy as np

from .. import checks
from ..annotations import Array
from ..kernels.wrapping import in_range

Angles: TypeAlias = tuple[tuple[str, float, float], ...]  # (name, lower end of the range, period) of each
Unit: TypeAlias = str | float | Sequence[float] | None
Given: TypeAlias = Mapping[str, Unit] | Sequence[str] | Angles | None
UNITS = {"rad": 2 * np.pi, "deg": 360.0}
HINT = "{'yaw': 'rad'}, {'yaw': 'deg'}, {'yaw': period} or {'yaw': (lower, upper)}"


def read(given: Given, names: Iterable[str], what: str, faults: checks.Faults, *, denied: bool = False) -> Angles:
    """The declared angles. A list of names means radians; None or () means none.

    `denied`: the unit None, or "none" in a file, says that a channel is no angle; its period is then 0.
    """
    if given is None or _is_read(given):
        return cast("Angles", given or ())
    if isinstance(given, list | tuple) and all(isinstance(name, str) for name in given):
        given = {str(name): "rad" for name in given}
    if not isinstance(given, Mapping) or not all(isinstance(name, str) for name in given):
        faults.add(f"`angles` must map names to units, as in {HINT}. Got {checks.short(given)}.")
        return ()
    known = tuple(dict.fromkeys(names))
    found = []
    for name, unit in given.items():
        if name not in known:
            near = checks.suggestion(name, known)
            faults.add(f"`angles` names {name!r}, which is not {what}: they are {checks.listed(known)}.{near}")
        elif denied and (unit is None or unit == "none"):
            found.append((name, 0.0, 0.0))
        elif (span := _span(name, unit, faults)) is not None:
            found.append((name, *span))
    return tuple(sorted(found))


def _is_read(given: Given) -> bool:
    return isinstance(given, tuple) and all(isinstance(one, tuple) and len(one) == 3 for one in given)


def _span(name: str, unit: Unit, faults: checks.Faults) -> tuple[float, float] | None:
    """The lower end and the period of a unit, a period, or a range."""
    if isinstance(unit, str) and unit in UNITS:
        return -UNITS[unit] / 2, UNITS[unit]
    try:
        ends = np.asarray(unit, float)
    except (TypeError, ValueError):
        ends = np.zeros(0)
    if ends.shape == ():
        ends = np.array([-ends / 2, ends / 2])
    lower, upper = ends if ends.shape == (2,) else (0.0, np.nan)
    if not np.isfinite(upper - lower) or upper <= lower:
        faults.add(
            f'`angles` of {name!r} must be "rad", "deg", a period greater than 0, or a pair (lower, upper). '
            f"Got {checks.short(unit)}."
        )
        return None
    return float(lower), float(upper - lower)


def periods(angles: Angles, names: Sequence[str]) -> tuple[float, ...] | None:
    """The period of each named quantity, 0 where it is no angle; None where none is."""
    of = {name: period for name, _, period in angles}
    found = tuple(of.get(name, 0.0) for name in names)
    return found if any(found) else None


def ranged(values: Array | None, angles: Angles, names: Sequence[str]) -> Any:
    """Values (.., n) with each angle in its range."""
    period = periods(angles, names)
    if period is None or values is None:
        return values
    lowest = {name: lower for name, lower, _ in angles}
    return in_range(values, np.array([lowest.get(name, 0.0) for name in names]), np.array(period))


def unwrapped(values: np.ndarray, angles: Angles, names: Sequence[str]) -> np.ndarray:
    """A record (.., T, n) without jumps: each known value of an angle is within half a turn of the one before."""
    period = periods(angles, names)
    if period is None:
        return values
    out = np.array(values, float)
    for j in np.flatnonzero(period):
        series = out[..., j].reshape(-1, out.shape[-2])
        for one in series:
            known = ~np.isnan(one)
            one[known] = np.unwrap(one[known], period=period[j])
        out[..., j] = series.reshape(out[..., j].shape)
    return out
