"""The gain of a record, by the whole chain: fitted noise, lasting disturbances, jumps and drifts, a verdict, an interval."""

from typing import Any

import numpy as np

from .. import checks
from ..data.record import Record
from ..diagnostics import changes, gain_rows
from ..errors import EstimableError
from ..filters.change_detection import ChangeDetection
from ..filters.mixture import SHARES, WALKS, Mixture
from ..filters.unknown_gain import UnknownGain
from ..frozen import replace
from ..models import gain_blocks
from ..models.markov_disturbance import markov_disturbance
from ..models.prior import Prior
from ..models.state_space import StateSpace
from ..models.uncertainty import ModelUncertainty
from ..results import DetectableLoss, Estimate, GainAssessment, NoiseFit
from .detectable_loss import detectable_loss
from .estimate import estimate
from .estimate_mixture import estimate_mixture
from .fit_noise import fit_noise
from .trust import trust

OFFSET = 0.05  # of the range of an input, times |B|: standard deviation of an offset of a state equation
FEWEST = 100  # rows to fit the noise to
PERSISTENCE = 15.0  # of the process noise, in the search for the part before a change
RELATIVE = 0.1  # of the entries of A and B: their standard deviation where none is given
EVERY, MOST = 1.0, 30  # seconds of an interval for which the detectable loss is found, and how many at most
LASTING = 10.0  # steps of the record: first time constant of a lasting disturbance


def assess_gain(
    algorithm: UnknownGain,
    record: Record,
    *,
    prior: Prior,
    healthy: tuple[float, float] | None = None,
    offset: bool = True,
    as_given: bool = False,
) -> GainAssessment:
    """Find the gain of a record, with an interval that counts what the answer rests on, and say whether to believe it.

    1. An offset of each state equation that an input drives, with a standard deviation of 5 % of the input's range
       (`offset=False`: none).
    2. Q, R, and disturbances that last, each with a time constant and a density, are fitted to the part before any change
       (`healthy`: its first and last second). Where the record does not determine them, those of the model remain.
    3. The entries of A and B count as uncertain: by the algorithm's own `uncertainty`, or else by 10 % of those of a continuous
       model other than 0 and 1.
    4. The gain is followed by a mixture of three detectors of changes, for gains that are constant or drift.
    5. `trust` judges the model. `detectable_loss` says how small a loss the record would have shown.

    `algorithm`: an `UnknownGain`; its model may be continuous or discrete. `as_given`: none of 1 to 3.

    Returns a `GainAssessment`. Raises `InputError` with every fault of the call, `RunError` if the computation fails.

    >>> model = StateSpace([[0.5]], [[1.0]], Q=[[0.01]], R=[[0.04]], dt=1)
    >>> u = np.sign(np.random.default_rng(0).normal(size=300))
    >>> record, prior = simulate(model, u, seed=1).record, Prior([0.0], [[1.0]])
    >>> found = assess_gain(UnknownGain(model, Prior([1.0], [[0.25]])), record, prior=prior, as_given=True)
    >>> found.trust.word
    'believe'
    """
    faults = checks.Faults()
    faults.instance("algorithm", algorithm, UnknownGain)
    faults.instance("record", record, Record)
    for name, value in (("offset", offset), ("as_given", as_given)):
        faults.flag(name, value)
    rows = None if healthy is None else _rows_of(healthy, record, faults)
    faults.finish()
    notes, fit, chosen = [], None, algorithm
    if not as_given:
        chosen, fit, notes = _prepared(replace(algorithm, uncertainty=None), record, prior, rows, offset)
    plain, member = replace(chosen, uncertainty=None), algorithm if as_given else _uncertain(algorithm, chosen, notes)
    mixture = Mixture([ChangeDetection(member, walk=walk) for walk in WALKS], probability=SHARES)
    result = estimate_mixture(mixture, record, prior=prior)
    verdict = trust(ChangeDetection(plain), record, prior=prior, result=result)
    loss = _detectable(mixture.algorithms[0], record, prior, result)
    return GainAssessment(result, mixture, plain, verdict, loss, fit, tuple(notes), gain_rows(result, detectable=loss))


def _rows_of(healthy: tuple[float, float], record: Record, faults: checks.Faults) -> slice | None:
    span = faults.array("healthy", list(healthy) if isinstance(healthy, tuple) else healthy, "2")
    if span is None:
        return None
    t = np.arange(len(record), dtype=float) if record.t is None else np.asarray(record.t)
    first, last = (int(np.searchsorted(t, end)) for end in span)
    if not span[0] < span[1] or last - first < FEWEST:
        faults.add(
            f"`healthy` must be the first and the last second of a part of at least {FEWEST} rows. Got {span[0]:g} to "
            f"{span[1]:g} s, which has {max(last - first, 0)}."
        )
        return None
    return slice(first, last)


def _prepared(
    algorithm: UnknownGain, record: Record, prior: Prior, rows: slice | None, offset: bool
) -> tuple[UnknownGain, NoiseFit | None, list[str]]:
    """The algorithm with fitted noise and offsets, and what was done."""
    model = algorithm.model
    if model.varying or model.schedule is not None:
        return algorithm, None, ["Q, R and offsets are those of the model: it varies in time."]
    if rows is None:
        found = changes(estimate(ChangeDetection(algorithm, persistence=PERSISTENCE), record, prior=prior))
        rows = slice(0, found[0].onset if found else len(record))
    fit, notes = _fitted(algorithm, record[rows], prior)
    algorithm = algorithm if fit is None else fit.algorithm
    density = _offset_sizes(model, record)
    if offset and np.any(density > 0):
        states = [name for name, size in zip(model.states, density, strict=True) if size > 0]
        lasting = markov_disturbance(algorithm.model, time_constant=None, density=density[density > 0], states=states)
        algorithm = replace(algorithm, model=lasting)
        notes.append(f"A constant offset of the rate of {checks.listed(states)} is estimated.")
    return algorithm, fit, notes


def _offset_sizes(model: StateSpace, record: Record) -> np.ndarray:
    """5 % of the range of each input times |B|, for each state equation; per second."""
    columns = [record.inputs.index(name) for name in model.inputs if name in record.inputs]
    u = record.applied()[:, columns]
    span = np.nan_to_num(np.nanmax(u, axis=0) - np.nanmin(u, axis=0))
    size = OFFSET * np.abs(model.B) @ span
    return size if model.is_continuous else size / model.dt


def _fitted(algorithm: UnknownGain, healthy: Record, prior: Prior) -> tuple[NoiseFit | None, list[str]]:
    """Q and R by likelihood, and disturbances that last where BIC prefers them."""
    model, best, bic = algorithm.model, None, np.inf
    if len(healthy) < FEWEST:
        return None, [f"Q and R are those of the model: only {len(healthy)} rows precede a change."]
    for tried, free in ((model, ("Q", "R")), (_lasting(model, healthy), ("Q", "R", "disturbance"))):
        if tried is None:
            continue
        try:
            fit = fit_noise(
                replace(algorithm, model=tried), healthy, prior=prior, free=_nonzero(model, free), progress=False
            )
        except EstimableError:
            continue
        score = -2 * fit.log_likelihood + len(fit.parameters) * np.log(max(int(healthy.seen.sum()), 2))
        if fit.converged and score < bic:
            best, bic = fit, score
    if best is None:
        return None, ["Q and R are those of the model: the record does not determine them."]
    span = "" if healthy.t is None else f" to {healthy.t[0]:.4g} to {healthy.t[-1]:.4g} s"
    what = "Q, R and disturbances that last" if best.model.n > model.n else "Q and R"
    return best, [f"{what} are fitted{span}."]


def _lasting(model: StateSpace, healthy: Record) -> StateSpace | None:
    """The model with a disturbance of each state that has process noise; None without one."""
    q = np.diagonal(model.Q)
    if not np.any(q > 0) or model.Q.shape != model.A.shape:
        return None
    step = float(np.median(np.diff(healthy.t))) if healthy.t is not None else float(model.dt or 1.0)
    density = 10 * q if model.is_continuous else 10 * q / model.dt
    return markov_disturbance(model, time_constant=LASTING * step, density=density)


def _nonzero(model: StateSpace, free: tuple[str, ...]) -> dict[str, Any]:
    """What is free: the variances above zero."""
    found: dict[str, Any] = {}
    for name in free:
        if name == "disturbance":
            found[name] = None
            continue
        size = np.diagonal(getattr(model, name))
        if np.any(size > 0):
            found[name] = (size > 0).tolist()
    return found


def _uncertain(given: UnknownGain, prepared: UnknownGain, notes: list[str]) -> UnknownGain:
    """The prepared algorithm with the uncertainty of the given one, or with the default one."""
    if given.uncertainty is not None:
        notes.append("The interval includes the uncertainty of the model.")
        return replace(prepared, uncertainty=given.uncertainty)
    model = given.model
    if (
        not model.is_continuous
        or model.varying
        or model.schedule is not None
        or not gain_blocks.is_word(given.directions)
    ):
        notes.append("The interval takes A and B as exact: give `uncertainty`, or a continuous model.")
        return prepared
    notes.append(f"The interval includes errors of {100 * RELATIVE:.0f} % in the entries of A and B.")
    return replace(prepared, uncertainty=ModelUncertainty(relative=RELATIVE))


def _detectable(detector: ChangeDetection, record: Record, prior: Prior, result: Estimate) -> DetectableLoss | None:
    """The smallest loss after the last change; None where the record is too short behind it."""
    found, t = changes(result), record.t
    if t is None or len(record) < 10:
        return None
    begun = float(t[found[-1].detected_at]) if found else float(t[0])
    start, seconds = begun + (float(t[-1]) - begun) / 3, float(t[-1] - t[0])
    every = max(EVERY, seconds / MOST) if seconds > 2 * EVERY else None
    try:
        return detectable_loss(detector, record, prior=prior, start=start, every=every)
    except EstimableError:
        return None
