"""Tests of what an output-error fit takes for granted about the link and the plant, one assumption at a time."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .. import checks
from ..data.record import Record
from ..frozen import replace
from ..kernels import scores as kernel
from ..kernels.impulse_start import Datum
from ..kernels.missing_series import spacing
from ..results import Check
from .one_output import Fitted, OneOutput, powers, sizes

LIMIT = 3.5  # standard deviations: of 13 tests one fails in .006 of the right fits
ARRIVAL = 4.0  # standard deviations between the given rate and the estimated one
FEWEST = 50  # seen rows
FOURTH = 300  # seen rows for tests of squared residuals: their weights are estimated
STEP = 1e-4  # of a standard deviation of θ, for the derivative of the estimated rate

SENTENCES = {
    "offset": 'a constant is left: use level="estimated"',
    "trend": 'a trend is left: use level="trend"',
    "drift": "the gain changes along the record: fit parts of it, or use RecursiveOutputError, which follows it",
    "held": 'lost inputs appear to be held: say lost="hold" in the Record',
    "zero": 'lost inputs appear to be zero: say lost="zero" in the Record',
    "applied": "some inputs called lost appear to be applied: make their `arrived` NaN and give `arrival`",
    "late": "the input appears to act a sample later: raise `delay`, or lose no input stamps",
    "square of u": "the effect of the input is not linear: give its square as an input, or use a NonlinearModel",
    "cube of u": "the effect of the input saturates: give the input that was applied, or use a NonlinearModel",
    "square of x": "the plant is not linear: use a smaller amplitude, or a NonlinearModel with AdaptiveIdentification",
    "cube of x": "the output saturates: use a smaller amplitude, or a NonlinearModel with AdaptiveIdentification",
    "loss with x": "which samples are lost depends on the output: log at the sensor, or use a smaller amplitude",
    "loss with |x|": "which samples are lost depends on their size: log at the sensor, or use a smaller amplitude",
    "stale": "some samples repeat the one before: make the repeated ones NaN",
    "lost inputs": "some inputs appear to be lost: give `arrived`, or make it NaN and give `arrival`",
}


def score_checks(ends: Sequence[OneOutput], records: Sequence[Record], arrival: float | None = None) -> list[Check]:
    """The tests of every output; `arrival` is the given rate. Where inputs are unknown only that rate is tested."""
    return [row for i, end in enumerate(ends) for row in _of_output(end, records, i, arrival)]


def summary(found: Sequence[Check]) -> list[Check]:
    """One check of all tests: the largest first, since the others may follow from it."""
    if not found:
        return []
    first, *others = sorted(found, key=lambda row: -abs(row.value) / row.limit)
    passed = all(row.passed for row in found)
    sentence = (
        f"Scores: none of {len(found)} tests of the link and the plant is significant (the largest: {first.name})."
    )
    if not passed:
        names = [row.name for row in others if not row.passed]
        more = f" {checks.listed(names)} may follow from it." if names else ""
        sentence = f"{first.sentence}{more}"
    return [Check("scores", passed, first.value, first.limit, sentence)]


def _of_output(end: OneOutput, records: Sequence[Record], i: int, arrival: float | None) -> list[Check]:
    if end.end is None:
        return []
    task, x, e, J, at = end.end
    masks = [one.seen for one in task.data]
    unknown = any(np.isnan(record.applied()).any() for record in records)
    if (unknown and arrival is None) or sum(int(seen.sum()) for seen in masks) < FEWEST:
        return []
    name = records[0].outputs[i]
    if arrival is not None:
        return _rate_check(end, records, arrival, name)
    outputs, e = task.outputs(x), -e
    weights = np.concatenate([np.broadcast_to(sizes(one), int(one.seen.sum())) for one in task.data])
    rows = [_regressors(task, x, *three) for three in zip(task.data, records, outputs, strict=True)]
    names = list(dict.fromkeys(name for row in rows for name in row))
    Z = np.column_stack([
        np.concatenate([row.get(name, np.zeros(len(seen)))[seen] for row, seen in zip(rows, masks, strict=True)])
        for name in names
    ])  # fmt: skip
    values = dict(zip(names, kernel.scores(Z / weights[:, None], J, e, at), strict=True))
    steps = np.concatenate([np.append(0.0, -np.diff(out))[seen] for out, seen in zip(outputs, masks, strict=True)])
    values["stale"] = kernel.stale(e, steps / weights)
    values |= _losses_of_outputs(masks, outputs)
    if len(e) >= FOURTH and all(record.arrived is None and record.dt is not None for record in records):
        values |= _losses_of_inputs(task, x, e * weights)
    return [_check(key, value, name) for key, value in values.items()]


def _check(key: str, value: float, name: str) -> Check:
    passed = abs(value) <= LIMIT
    found = f"Scores: {name}: {key} is {value:.1f} standard deviations from what the fit assumes (limit {LIMIT:g})"
    return Check(key, passed, float(value), LIMIT, f"{found}." if passed else f"{found}: {SENTENCES[key]}.")


def _regressors(task: Fitted, x: np.ndarray, datum: Datum, record: Record, out: np.ndarray) -> dict[str, np.ndarray]:
    """What failed assumptions would add to the output of one record, by their names."""
    T, applied = len(out), record.applied()

    def of(u: np.ndarray) -> np.ndarray:
        """The response to other inputs."""
        return task.response(x, datum._replace(u=u))

    def less(u: np.ndarray) -> np.ndarray:
        """That response less the one that was fitted."""
        return of(u) - forced

    forced = of(applied)
    own, about = applied - applied.mean(axis=0), out - out.mean()
    found = {
        "offset": np.ones(T), "trend": powers(datum, 2)[:, 1], "drift": about * (np.arange(T) / T - 0.5),
        "late": less(np.concatenate([applied[:1], applied[:-1]])),
        "square of u": of(own**2), "cube of u": of(own**3), "square of x": about**2, "cube of x": about**3,
    }  # fmt: skip
    if record.arrived is not None and (record.arrived == 0).any():
        name, lost = ("zero", "zero") if record.lost == "hold" else ("held", "hold")
        found[name] = less(replace(record, lost=lost).applied())
        found["applied"] = less(record.u)
    return found


def _losses_of_outputs(masks: Sequence[np.ndarray], outputs: Sequence[np.ndarray]) -> dict[str, float]:
    """Whether the loss of samples depends on the output; not where none, or every n-th, is seen."""
    seen, x = np.concatenate(masks).astype(float), np.concatenate(outputs)
    if seen.all() or spacing(masks) > 1:
        return {}
    about = x - x.mean()
    return {"loss with x": kernel.dependence(seen, about), "loss with |x|": kernel.dependence(seen, np.abs(about))}


def _energy(task: Fitted, x: np.ndarray) -> np.ndarray:
    """Σ_j h_j² u²[k-j] of the seen rows, over all inputs."""
    found = []
    for datum in task.data:
        total = np.zeros(len(datum.y))
        for j in range(task.m):
            impulse = np.zeros_like(datum.u)
            impulse[0, j] = 1.0
            total += _convolved(task.response(x, datum._replace(u=impulse)) ** 2, datum.u[:, j] ** 2)
        found.append(total[datum.seen])
    return np.concatenate(found)


def _convolved(h: np.ndarray, u: np.ndarray) -> np.ndarray:
    size = 1 << (2 * len(u) - 1).bit_length()
    return np.fft.irfft(np.fft.rfft(h, size) * np.fft.rfft(u, size), size)[: len(u)]


def _losses_of_inputs(task: Fitted, x: np.ndarray, e: np.ndarray) -> dict[str, float]:
    """Whether the residuals are larger after large inputs, as where some are lost."""
    found = kernel.losses(e, _energy(task, x))
    return {} if found is None or not found.sigma > 0 else {"lost inputs": max(found.β / found.sigma, 0.0)}


class Rate(NamedTuple):
    """The rate at which inputs arrive, and its standard deviation."""

    value: float
    sigma: float


def rate_of(end: OneOutput) -> Rate | None:
    """The rate of arrival λ = 1 / (1 + β), from a fit in which the inputs sent, or a multiple of them, count as applied.

    Its standard deviation is that of β and of the impulse response. None where the input has a constant square.
    """
    assert end.end is not None
    task, x, e, J, _ = end.end
    found = kernel.losses(e, _energy(task, x))
    if found is None:
        return None
    Σ = np.linalg.pinv(J.T @ J)[: task.d, : task.d] * float(e @ e) / max(len(e) - len(x), 1)
    g = np.zeros(task.d)
    for j, step in enumerate(STEP * np.sqrt(np.diagonal(Σ))):
        moved = x.copy()
        moved[j] += step
        again = kernel.losses(e, _energy(task, moved))
        g[j] = 0.0 if again is None or not step else (again.β - found.β) / step
    λ = 1 / (1 + max(found.β, 0.0))
    return Rate(λ, λ**2 * float(np.hypot(found.sigma, np.sqrt(g @ Σ @ g))))


def _rate_check(end: OneOutput, records: Sequence[Record], arrival: float, name: str) -> list[Check]:
    """The estimated rate of arrival against the given one, where no arrival is known and every input was logged."""
    if any(one.arrived is None or not np.isnan(one.arrived).all() or np.isnan(one.u).any() for one in records):
        return []
    found = rate_of(end)
    if found is None or not found.sigma > 0:
        return []
    t = (found.value - arrival) / found.sigma
    said = f"Scores: {name}: inputs arrive at a rate of {found.value:.2f} ± {found.sigma:.2f}; `arrival` is {arrival:g}"
    advice = "" if abs(t) <= ARRIVAL else f": give arrival={found.value:.2g}, or check that losses are independent"
    return [Check("arrival", abs(t) <= ARRIVAL, float(t), ARRIVAL, f"{said}{advice}.")]
