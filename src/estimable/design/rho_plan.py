"""The checked arguments of `rho_synthesis`."""

from collections.abc import Mapping
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from .. import checks
from ..analysis.observability import observability, reachability
from ..annotations import Numbers
from ..errors import AssumptionError
from ..models.constant import check_constant
from ..models.state_space import StateSpace
from ..results import Observability, Reachability
from ..results.designs import BEST
from .families import DesignFamily, joint
from .gains import kalman_gain

NUMBER = 200  # of designs
SLOWEST, TOP = 1 / 30, 300.0  # range of η, times the plant's own speed
FASTEST = 4.0  # η dt, of discrete designs: e^-4 of a motion remains after a sample
ALIKE = ("rho", "control")  # default criteria: robustness and its cost
INDEFINITE = 1e-11  # of the largest entry: eigenvalues this far below zero are rounding


class Plan(NamedTuple):
    """The checked arguments: `control` and `filter` are families or fixed gains."""

    eta: np.ndarray
    control: DesignFamily | np.ndarray
    filter: DesignFamily | np.ndarray
    weights: dict[str, float]
    scaling: np.ndarray


Part: TypeAlias = DesignFamily | Numbers | None  # of a design, as given: a family, or a fixed gain


def read_plan(
    model: StateSpace,
    eta: Numbers | None,
    control: Part,
    filter: Part,
    weights: Mapping[str, float] | None,
    scaling: Numbers | None,
) -> Plan:
    """Check everything together."""
    faults = checks.Faults()
    _read_model(model, faults)
    n, m = model.n, model.m
    sizes = _read_scaling(np.ones(n) if scaling is None else scaling, faults)
    units = np.ones(n) if sizes is None or np.any(sizes <= 0) else sizes
    rates = _read_eta(default_eta(model) if eta is None else eta, faults)
    law = DesignFamily.approach(model, weight=np.diag(units**-2.0)) if control is None else control
    law = _read_part("control", law, (n, m), "m n", faults)
    observer = DesignFamily.approach_of_error(model, weight=np.diag(units**2.0)) if filter is None else filter
    observer = _read_filter(observer, model, faults)
    counted = _read_weights(weights, faults)
    if not faults.sentences and not isinstance(law, DesignFamily) and not isinstance(observer, DesignFamily):
        faults.add("`control` and `filter` are both fixed gains, so that no design depends on `eta`: leave one out.")
    if not faults.sentences:
        _check_families(rates, law, observer, model, faults)
    faults.finish()
    _check_reach(model)
    return Plan(rates, law, observer, counted, units)


def _read_model(model: StateSpace, faults: checks.Faults) -> None:
    """Check that the model is constant and has inputs; the other checks need one."""
    if faults.instance("model", model, StateSpace):
        check_constant(model, faults)
        if model.S is not None:
            faults.add("`model` must have no cross noise S.")
        if model.m == 0:
            faults.add("`model` has no input: give B, StateSpace(A, B, ...).")
    faults.finish()
    for axis, size, noun in (("n", model.n, "state"), ("m", model.m, "input"), ("p", model.p, "output")):
        faults.learn(axis, size, f"the model has {checks.counted(size, noun)}")


def _read_eta(given: Numbers, faults: checks.Faults) -> Any:
    eta = faults.array("eta", given, "N")
    if eta is not None and (len(eta) == 0 or np.any(eta <= 0) or np.any(np.diff(eta) <= 0)):
        faults.add("`eta` must be rates per second, greater than 0 and increasing.")
    return eta


def _read_scaling(given: Numbers, faults: checks.Faults) -> Any:
    scaling = faults.array("scaling", given, "n")
    if scaling is not None and np.any(scaling <= 0):
        faults.add(f"`scaling` must be sizes, greater than 0. Got {scaling.min():g}.")
    return scaling


def _read_part(
    name: str,
    given: Part,
    sizes: tuple[int, int],
    axes: str,
    faults: checks.Faults,
) -> Any:
    """A family of matching sizes, or a fixed gain."""
    if not isinstance(given, DesignFamily):
        return faults.array(name, given, axes)
    if (given.n, given.m) != sizes:
        faults.add(
            f"`{name}` must be a `DesignFamily` with n = {sizes[0]} and m = {sizes[1]}. Got n = {given.n} and m = {given.m}."
        )
    return given


def _read_filter(given: Part, model: StateSpace, faults: checks.Faults) -> Any:
    if isinstance(given, str):
        faults.choice("filter", given, ("kalman",))
        return kalman_gain(model).filter if given == "kalman" and model.R is not None else _without_noise(given, faults)
    return _read_part("filter", given, (model.n, model.p), "n p", faults)


def _without_noise(given: str, faults: checks.Faults) -> None:
    if given == "kalman":
        faults.add('`filter` = "kalman" needs `R` and Q in the model: StateSpace(..., Q=..., R=...).')


def _read_weights(given: Mapping[str, float] | None, faults: checks.Faults) -> dict[str, float]:
    """Weights of known criteria, not all zero."""
    if given is None:
        return dict.fromkeys(ALIKE, 1.0)
    if not isinstance(given, Mapping):
        faults.add(f"`weights` must be a mapping {{criterion: weight}}. Got {checks.short(given)}.")
        return {}
    for name in given:
        if name not in BEST:
            near = checks.suggestion(name, BEST)
            faults.add(f"`weights`: there is no criterion {name!r}. The criteria are {checks.listed(BEST)}.{near}")
    read = {name: faults.number(f"weights[{name!r}]", value, lower=0.0) for name, value in given.items()}
    if all(value == 0 for value in read.values()):
        faults.add("`weights` must have at least one nonzero weight.")
    return read


def _check_families(
    eta: np.ndarray,
    control: DesignFamily | np.ndarray,
    filter: DesignFamily | np.ndarray,
    model: StateSpace,
    faults: checks.Faults,
) -> None:
    """Check that weights are jointly positive semidefinite, and R positive definite."""
    for name, family in (("control", control), ("filter", filter)):
        if not isinstance(family, DesignFamily):
            continue
        smallest = [joint(*family.at(η)) for η in eta]
        if min(smallest) < -INDEFINITE:
            at = int(np.argmin(smallest))
            faults.add(
                f"`{name}`: [[Q, S], [S.T, R]] must be positive semidefinite: at eta = {eta[at]:g} its smallest eigenvalue is "
                f"{smallest[at]:.3g} of its largest entry. Families by `DesignFamily.factored` always are."
            )
            continue
        if (
            name == "filter"
            and not model.is_continuous
            and not family.next_output
            and (np.any(family.S0) or np.any(family.S1))
        ):
            faults.add(
                "`filter`: a discrete filter needs a family with S = 0, or with next_output = True (S of the next output)."
            )
        if np.linalg.matrix_rank(family.R, hermitian=True) < family.m and (model.is_continuous or name == "filter"):
            what = "two inputs have the same effect" if name == "control" else "two outputs are dependent"
            faults.add(
                f"`{name}`: R must be positive definite. It is singular where {what}: give a DesignFamily with another R."
            )


def _check_reach(model: StateSpace) -> None:
    reached, seen = reachability(model), observability(model)
    if not reached.stabilisable:
        raise AssumptionError(
            f"`model` is not stabilisable: no input moves a mode that does not decay. {_joined(reached)}"
        )
    if not seen.detectable:
        raise AssumptionError(f"`model` is not detectable: no output shows a mode that does not decay. {_joined(seen)}")


def _joined(found: Reachability | Observability) -> str:
    return " ".join(found.sentences)


def default_eta(model: StateSpace, number: int = NUMBER) -> Any:
    """`number` values around the geometric mean of the plant's own speeds."""
    z = np.linalg.eigvals(model.A)
    if not model.is_continuous:
        z = np.log(z[np.abs(z) > 1e-12].astype(complex)) / model.dt
    speeds = np.abs(z)
    speeds = speeds[speeds > 1e-6 * (speeds.max(initial=0.0) or 1.0)]
    middle = float(np.exp(np.log(speeds).mean())) if len(speeds) else (1.0 if model.is_continuous else 0.1 / model.dt)
    top = TOP * middle if model.is_continuous else min(TOP * middle, max(FASTEST / model.dt, 3 * middle))
    return np.geomspace(min(SLOWEST * middle, top / 100), top, number)
