"""Models that fit as well where an output is seen at every n-th row only: their poles differ by n-th roots of 1.

Letters: N the greatest common divisor of the distances between seen rows; poles p with p^N in common act alike on inputs that are
held for N rows.
"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..data.record import Record
from ..frozen import field_names, replace
from ..identifiers.one_output import BOUND, Fitted, Orders
from ..identifiers.output_error_ml import by_output
from ..kernels.impulse_start import Datum
from ..kernels.missing_series import spacing
from ..models.armax import ARMAX
from ..models.arx import ARX
from ..models.output_error import OutputError
from ..models.state_space import StateSpace
from ..protocols import Method
from ..results import Check, Fit

ALIKE = 6.0  # of twice the log-likelihood
APART = 5.0  # standard deviations
HIGHEST = 3  # degree of A up to which rivals are searched
MOST = 128  # rotations
REMEDY = "See a few rows between, or move the input between them"


class _Plant(NamedTuple):
    """A and B (m, nb+1) of one output of a fit."""

    a: np.ndarray
    b: np.ndarray
    delay: int


def with_rivals(fit: Fit, method: Method, records: Sequence[Record]) -> Fit:
    """The fit with other models that explain the outputs equally well, and a failed check where there are some."""
    if fit.validation is None or any(one.dt is None or np.isnan(one.applied()).any() for one in records):
        return fit
    failed, vectors = [], []
    for i, data in enumerate(by_output(records)):
        every = spacing([one.seen for one in data])
        plant = _plant(fit, i) if every > 1 else None
        if plant is None or not len(plant.a):
            continue
        name = records[0].outputs[i]
        if len(plant.a) > HIGHEST or every ** len(plant.a) > MOST:
            failed.append(_unsearched(name, every))
            continue
        found = [one for one in rivals(plant, data, every) if _plausible(method, fit, i, one)]
        if found:
            failed.append(_check(name, every, len(found)))
            vectors += [_vector(fit.model, i, one) for one in found if isinstance(fit.model, OutputError)]
    if not failed:
        return fit
    validation = fit.validation._replace(checks=(*fit.validation.checks, *failed))
    return replace(fit, validation=validation, rivals=np.stack(vectors) if vectors else None)


def rivals(plant: _Plant, data: Sequence[Datum], every: int) -> list[_Plant]:
    """Other models of one output within `ALIKE` of the best, and `APART` from the fit."""
    (a, b, delay), na = plant, len(plant.a)
    task = Fitted(Orders(na, b.shape[1] - 1, delay, max(na, b.shape[1] - 1 + delay), 1), data)
    own = task.search(task.begun(a, BOUND), BOUND)
    at = task.assembled(own, None)
    ends = [task.search(task.begun(rotated, BOUND), BOUND) for rotated in rotations(a, every)]
    best = min(one.cost for one in (own, *ends))
    floor = max(best, 1e-12 * sum(float(np.sum(one.y[one.seen] ** 2)) for one in data))
    inverse, kept = np.linalg.pinv(np.asarray(at.covariance)), [at.parameters]
    for end in sorted(ends, key=lambda one: one.cost):
        θ = task.parameters(end.x)
        far = all((θ - one) @ inverse @ (θ - one) > APART**2 for one in kept)
        if far and len(own.e) * np.log(max(end.cost, floor) / floor) < ALIKE:
            kept.append(θ)
    return [_Plant(θ[:na], θ[na:].reshape(b.shape), delay) for θ in kept[1:]]


def rotations(a: np.ndarray, every: int) -> list[np.ndarray]:
    """The coefficients of A with its poles multiplied by N-th roots of 1, where they stay real; not of A itself."""
    poles, roots = np.roots(np.append(1.0, a)), np.exp(2j * np.pi * np.arange(every) / every)
    found: list[np.ndarray] = [a]
    for turns in itertools.product(roots, repeat=len(poles)):
        turned = np.atleast_1d(np.poly(poles * np.array(turns)))[1:]
        size = 1e-8 * (1 + np.abs(turned).max())
        if np.abs(np.imag(turned)).max() < size and all(np.abs(turned - one).max() > size for one in found):
            found.append(np.real(turned))
    return found[1:]


def _plant(fit: Fit, i: int) -> _Plant | None:
    """The polynomials of output i of a fitted model of any kind; None for a model without them."""
    match fit.model:
        case OutputError() | ARMAX() | ARX():
            return _Plant(np.asarray(fit.model.a[i]), np.asarray(fit.model.b[i]), fit.model.delay)
        case StateSpace() if not fit.model.is_continuous:
            a = np.real(np.atleast_1d(np.poly(np.linalg.eigvals(fit.model.A))))[1:]
            return _Plant(a, np.zeros((fit.model.m, len(a) + 1)), 0)
        case _:
            return None


def _vector(model: OutputError, i: int, plant: _Plant) -> np.ndarray:
    """The parameters of the model with those of a rival in output i."""
    a, b = model.a.copy(), model.b.copy()
    a[i], b[i] = plant.a, plant.b
    return replace(model, a=a, b=b).parameters


def _plausible(method: Method, fit: Fit, i: int, plant: _Plant) -> bool:
    """Whether a prior of the parameters, where the method has one, allows a rival."""
    prior = method.prior if "prior" in field_names(type(method)) else None  # type: ignore[attr-defined]
    if prior is None or not isinstance(fit.model, OutputError):
        return True
    e = _vector(fit.model, i, plant) - prior.mean
    return bool(e @ np.linalg.pinv(prior.covariance) @ e < len(e) + APART**2)


def _check(name: str, every: int, count: int) -> Check:
    number = "1 other model fits" if count == 1 else f"{count} other models fit"
    sentence = (
        f"Rivals: {number} {name} as well, which is seen every {every} rows while the input is held: the parameters and their "
        f"sigma hold for one of them. {REMEDY}, or give a `prior`."
    )
    return Check("rivals", False, float(count), 0.0, sentence)


def _unsearched(name: str, every: int) -> Check:
    sentence = (
        f"Rivals: {name} is seen every {every} rows: other models may fit as well; A has too high a degree to search them. "
        f"{REMEDY}."
    )
    return Check("rivals", False, np.inf, 0.0, sentence)
