"""Which sensors to buy: the few that know the wanted quantities best."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..models.prior import Prior
from ..models.state_space import StateSpace
from ..results import CovarianceQuestion, SensorSelection
from . import covariance_courses as courses
from .covariance_models import ArrayQuestion, as_dict, ask

METHODS = ("auto", "exact", "greedy")
MOST = 20_000  # sets tried by the exact search
FEW = 20  # candidates up to which "auto" is exact


def sensor_selection(
    model: StateSpace,
    *,
    prior: Prior,
    choose: int,
    wanted: Mapping[str, Numbers] | None = None,
    requirement: Mapping[str, float] | None = None,
    horizon: float | None = None,
    candidates: Sequence[str] | None = None,
    method: str = "auto",
) -> SensorSelection:
    """The `choose` sensors with the smallest largest sigma, relative to the requirements.

    `model` has every sensor that could be chosen as an output. Another sensor never increases a sigma, so a set of sensors is
    bounded from below by all that could still join it: branch and bound is exact, and rarely tries more than some hundred sets.

    - `choose`: the number of sensors, next to those that are not candidates. `candidates`: names of outputs; None: all.
    - `wanted`, `requirement`, `horizon`, `prior`: as in `covariance_analysis`. Without a requirement the sigma of each quantity
      is measured against that with every sensor. The sigma counts at the end of the horizon.
    - `method`: "exact", "greedy" (the best next sensor, then exchanges; without a guarantee), or "auto": exact for up to 20
      candidates.

    Returns a `SensorSelection`. Raises `InputError` for unknown names, a number that does not fit, and noise-free sensors.

    Cost: about 20 products and factorisations of n × n per set that is tried and power of two of the horizon.

    Reference: H. Zhang, R. Ayoub, S. Sundaram, Automatica 78 (2017) 202-210 (no greedy choice has a guarantee).

    >>> model = StateSpace(np.diag([0.9, 0.8]), C=np.eye(2), Q=np.eye(2), R=np.diag([1.0, 0.1]), dt=1, outputs=["a", "b"])
    >>> found = sensor_selection(model, prior=Prior([0.0, 0.0], np.eye(2)), choose=1, requirement={"x1": 1.0})
    >>> found.sensors
    ('a',)
    """
    checks.require(model=(model, StateSpace))
    asked = ask(CovarianceQuestion(model, prior, horizon, wanted=as_dict(wanted), requirement=as_dict(requirement)))
    faults = checks.Faults()
    names = asked.outputs
    if candidates is not None:
        if not isinstance(candidates, list | tuple) or not all(isinstance(name, str) for name in candidates):
            checks.refuse(f"`candidates` must be a list of names of outputs. Got {checks.short(candidates)}.")
        names = tuple(candidates)
    for name in names:
        if name not in asked.outputs:
            faults.add(f"`candidates` names {name!r}, which is not among {checks.listed(asked.outputs)}.")
    faults.whole("choose", choose, 1, max(len(names), 1))
    faults.choice("method", method, METHODS)
    if asked.noise_free or not asked.question.constant:
        faults.add("`model` must be constant, and every sensor must have noise.")
    faults.finish()
    tried = _Tried(asked, [i for i, name in enumerate(asked.outputs) if name not in names])
    pool = [i for i, name in enumerate(asked.outputs) if name in names]
    best, value = _exchanged(tried, *_greedy(tried, pool, choose), pool)
    exact = method == "exact" or (method == "auto" and len(pool) <= FEW)
    if exact:
        best, value, exact = _search(tried, pool, choose, best, value)
    return SensorSelection(
        tuple(asked.outputs[i] for i in sorted(best)), asked.names, tried.sigma(best), tried.sigma(pool), value,
        tried.worst(pool), exact, len(tried.known),
    )  # fmt: skip


class _Tried:
    """The largest relative sigma of each set of sensors, computed once."""

    def __init__(self, asked: ArrayQuestion, always: list[int]):
        self.question, self.always = asked.question, always
        self.h, self.steps = courses.base_step(asked.question, asked.horizon)
        self.known: dict[frozenset[int], np.ndarray] = {}
        asks = np.isfinite(asked.requirement)
        self.scale = np.ones(len(asks))
        whole = self.sigma(range(len(asked.outputs)))
        self.scale = np.where(asks, asked.requirement, np.inf) if asks.any() else np.where(whole > 0, whole, np.inf)

    def sigma(self, sensors: Iterable[int]) -> np.ndarray:
        """The sigma of each quantity at the end."""
        key = frozenset(sensors)
        if key not in self.known:
            rows = sorted({*key, *self.always})
            stage = self.question.first
            part = stage._replace(C=stage.C[rows], V=[V[rows] for V in stage.V if np.any(V[rows])])
            self.known[key] = courses.sigma_after(self.question._replace(first=part), self.h, self.steps)
        return self.known[key]

    def worst(self, sensors: Iterable[int]) -> float:
        """The largest sigma relative to its requirement."""
        with np.errstate(invalid="ignore"):
            return float(np.nan_to_num(self.sigma(sensors) / self.scale, nan=0.0, posinf=np.inf).max())


def _greedy(tried: _Tried, pool: list[int], choose: int) -> tuple[list[int], float]:
    """The best next sensor, again and again."""
    chosen: list[int] = []
    for _ in range(choose):
        chosen.append(min((i for i in pool if i not in chosen), key=lambda i: tried.worst([*chosen, i])))
    return chosen, tried.worst(chosen)


def _exchanged(tried: _Tried, chosen: list[int], value: float, pool: list[int]) -> tuple[list[int], float]:
    """Exchanges of one sensor while they help."""
    swaps = [[*(j for j in chosen if j != out), new] for out in chosen for new in pool if new not in chosen]
    best = min(swaps, key=tried.worst, default=chosen)
    if tried.worst(best) >= value * (1 - 1e-12):
        return chosen, value
    return _exchanged(tried, best, tried.worst(best), pool)


def _search(
    tried: _Tried, pool: list[int], choose: int, best: list[int], value: float
) -> tuple[list[int], float, bool]:
    """Branch and bound: the sensors whose loss costs most are decided first. The last result: whether it was completed."""
    order = sorted(pool, key=lambda i: -tried.worst([j for j in pool if j != i]))
    waiting: list[tuple[list[int], int]] = [([], 0)]
    while waiting:
        chosen, at = waiting.pop()
        rest = order[at:]
        if len(chosen) + len(rest) < choose or tried.worst([*chosen, *rest]) >= value * (1 - 1e-12):
            continue
        if len(tried.known) > MOST:
            return best, value, False
        if len(chosen) == choose:
            if tried.worst(chosen) < value:
                best, value = chosen, tried.worst(chosen)
            continue
        if len(chosen) + len(rest) == choose:
            best, value = [*chosen, *rest], tried.worst([*chosen, *rest])
            continue
        waiting += [(chosen, at + 1), ([*chosen, rest[0]], at + 1)]
    return best, value, True
