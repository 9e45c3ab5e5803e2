"""What a lost sensor costs, and what would lower the sigmas."""

from collections.abc import Callable
from typing import Any

import numpy as np

from .. import checks
from ..errors import AssumptionError, InputError
from ..frozen import replace
from ..models.prior import Prior
from ..models.state_space import StateSpace
from ..protocols import Algorithm
from ..results import Remedy
from .answered import AnsweredQuestion

SHARE = 0.05  # of the variance, below which a source is no remedy


def without(found: AnsweredQuestion, sensor: str) -> dict[str, Any]:
    """The arguments of the analysis that one sensor changes when it is lost."""
    faults = checks.Faults()
    faults.choice("sensor", sensor, found.outputs)
    faults.finish()
    kept = [i for i, name in enumerate(found.outputs) if name != sensor]
    arrival = found.question.arrival
    if arrival is not None and np.ndim(arrival) == 2:
        arrival = np.asarray(arrival)[:, kept]
    if not kept:
        checks.refuse(f"{sensor} is the only sensor: without it, sigma is `prior_sigma`.")
    return {"model": _with_model(found.question.model, _selected(_model(found), kept)), "arrival": arrival}


def _model(found: AnsweredQuestion) -> StateSpace:
    model: Any = found.question.model
    return model if isinstance(model, StateSpace) else model.model


def _with_model(algorithm: StateSpace | Algorithm[Any], model: StateSpace) -> Any:
    return model if isinstance(algorithm, StateSpace) else replace(algorithm, model=model)


def _selected(model: StateSpace, kept: list[int]) -> StateSpace:
    R: Any = model.R
    point = model.operating_point
    return replace(
        model,
        C=model.C[..., kept, :],
        D=model.D[..., kept, :],
        R=R[..., kept, :][..., kept],
        S=None if model.S is None else model.S[..., kept],
        outputs=tuple(model.outputs[i] for i in kept),
        operating_point=point and replace(point, outputs=point.outputs[..., kept]),
    )


def remedies(found: AnsweredQuestion, again: Callable[..., Any]) -> tuple[Remedy, ...]:
    """Changes that lower the largest sigma relative to its requirement, the best first."""
    asked = np.isfinite(found.requirement)
    scale = np.where(asked, found.requirement, found.sigma[-1]) if asked.any() else found.sigma[-1]
    considered = asked if asked.any() else np.isfinite(scale) & (scale > 0)
    tried = []
    for change, question in _changes(found, considered):
        try:
            new = again(**question)
        except (InputError, AssumptionError):
            continue
        worst = np.max(new.sigma[-1][considered] / scale[considered], initial=0.0)
        tried.append((float(worst), Remedy(change, new.sigma[-1], new.time_to_requirement)))
    worst = np.max(found.sigma[-1][considered] / scale[considered], initial=0.0)
    return tuple(remedy for value, remedy in sorted(tried, key=lambda one: one[0]) if value < worst * (1 - 1e-3))


def _changes(found: AnsweredQuestion, considered: np.ndarray) -> list[tuple[str, dict[str, Any]]]:
    """Each change, and the changed arguments."""
    model, prior = _model(found), found.question.prior
    budget = found.error_budget
    shares = [budget[name] for name, one in zip(found.names, considered, strict=True) if one]
    changes = []
    for i, sensor in enumerate(model.outputs):
        if any(share > SHARE for each in shares for source, share in each.items() if sensor in source.split(" and ")):
            half = np.ones(model.p)
            half[i] = 0.5
            better = replace(model, R=model.R * half[:, None] * half)
            changes.append((f"half the noise of {sensor}", {"model": _with_model(found.question.model, better)}))
    if any(each.get("prior", 0.0) > SHARE for each in shares) and prior.diffuse is None:
        changes.append(("half the prior sigma", {"prior": Prior(prior.mean, prior.covariance / 4)}))
    if found.question.arrival is None and isinstance(found.question.model, StateSpace) and model.S is None:
        changes += [_new_sensor(found, model, int(i)) for i in np.flatnonzero(considered)]
    return changes


def _new_sensor(found: AnsweredQuestion, model: StateSpace, i: int) -> tuple[str, dict[str, Any]]:
    """A sensor of one quantity, as accurate as required, or as half its sigma."""
    row = np.eye(model.n)[i] if found.question.wanted is None else np.asarray(found.question.wanted[found.names[i]])
    end = found.sigma[-1, i]
    accuracy = found.requirement[i] if np.isfinite(found.requirement[i]) else end / 2 if np.isfinite(end) else 1.0
    p, lead = model.p, model.C.shape[:-2]
    R = np.zeros((*model.R.shape[:-2], p + 1, p + 1))
    R[..., :p, :p], R[..., p, p] = model.R, accuracy**2
    C = np.concatenate([model.C, np.broadcast_to(row, (*lead, 1, model.n))], axis=-2)
    D = np.concatenate([model.D, np.zeros((*model.D.shape[:-2], 1, model.m))], axis=-2)
    name = f"a sensor of {found.names[i]}"
    grown = replace(model, C=C, D=D, R=R, outputs=(*model.outputs, name), operating_point=None)
    what = "density" if model.is_continuous and found.question.dt is None else "sigma"
    return f"{name}, {what} {accuracy:.3g}", {"model": grown}
