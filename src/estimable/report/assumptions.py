"""The assumptions of an estimate, for the report."""

import math
from typing import Any

import numpy as np

from .. import checks
from ..annotations import Tree
from ..data.record import Record
from ..estimation.binding import model_of
from ..filters.change_detection import ChangeDetection
from ..models.markov_disturbance import with_disturbances
from ..models.nonlinear_model import NonlinearModel
from ..models.prior import Prior
from ..models.state_space import StateSpace
from ..protocols import Algorithm, GainAlgorithm, Wrapper
from .contents import Section

MOST = 8  # most rows of a matrix that are shown
HOLDS = {"zero_order": "held over each sample", "first_order": "varying linearly between samples"}


def sections_of(algorithm: Algorithm[Any], record: Record, prior: Prior) -> tuple[Section, ...]:
    """The algorithm and its settings, the record, the prior, and the model's matrices."""
    model = model_of(algorithm)
    return (
        Section("Algorithm", tuple(_algorithm(algorithm))),
        Section("Record", tuple(record_items(record))),
        Section("Prior", tuple(_priors(algorithm, model, prior))),
        Section("Model", tuple(model_items(model))),
    )


def _algorithm(algorithm: Algorithm[Any]) -> Any:
    """Each wrapper and what it wraps, outermost first, with its settings."""
    from ..catalogue import ENTRIES

    detects, one = False, algorithm
    while one is not None:
        entry = next((entry for entry in ENTRIES if type(one) is entry.cls), None)
        assumes = "" if entry is None else f"Assumes that {entry.assumes}. Reference: {entry.reference}."
        settings = _settings(one)
        settings += " (inside ChangeDetection its walk and forgetting are not used)" if detects else ""
        detects = isinstance(one, ChangeDetection)
        yield type(one).__name__, " ".join(filter(None, (assumes, settings and f"Settings: {settings}.")))
        one = one.algorithm if isinstance(one, Wrapper) else None


def _settings(algorithm: Algorithm[Any]) -> str:
    from ..catalogue import settings_of

    settings = {name: getattr(algorithm, name) for name in settings_of(type(algorithm))}
    return ", ".join(f"{name} = {_value(value)}" for name, value in settings.items() if value is not None)


def _value(value: Tree) -> str:
    if isinstance(value, str | bool | int):
        return str(value)
    array = np.asarray(value)
    if array.dtype.kind not in "fiub":
        return type(value).__name__
    return f"{float(array.ravel()[0]):.6g}" if array.size == 1 else matrix_text(array)


def record_items(record: Record) -> Any:
    """The channels of a record, how often they were measured, and what is missing."""
    when = "" if record.seconds is None else f" over {record.seconds:.6g} s"
    step = "" if record.dt is None else f", every {record.dt:.6g} s"
    yield "Samples", f"{len(record):,}{when}{step}"
    units = dict(record.units)
    missing = np.isnan(record.y).mean(axis=0)
    for name, share in zip(record.outputs, missing, strict=True):
        yield f"Output {_with_unit(name, units)}", "seen at every sample" if share == 0 else f"{share:.1%} not seen"
    for i, name in enumerate(record.inputs):
        lost = "" if record.arrived is None else f"; {np.mean(record.arrived[:, i] == 0):.1%} lost on the link"
        yield f"Input {_with_unit(name, units)}", f"{HOLDS[record.hold]}; measured without error{lost}"


def _priors(algorithm: Algorithm[Any], model: StateSpace | NonlinearModel, prior: Prior) -> Any:
    disturbance = model.disturbance if isinstance(model, StateSpace) else None
    if disturbance is not None:
        prior = with_disturbances(prior, disturbance.variance, model.n)
    for name, text in zip(model.states, _spreads(prior), strict=True):
        yield f"State {name}", text
    inner = algorithm.innermost
    if isinstance(inner, GainAlgorithm) and inner.gain is not None:
        for name, text in zip(inner.names.gains, _spreads(inner.gain), strict=True):
            yield "Gain" if name == "gain" else f"Gain {name}", text


def _spreads(prior: Prior) -> list[str]:
    """Mean ± sigma of each entry, or a note that it is diffuse."""
    diffuse = np.zeros(len(prior.mean), bool) if prior.diffuse is None else np.any(prior.diffuse != 0, axis=1)
    sigmas = np.sqrt(np.diagonal(prior.covariance))
    return [
        "unknown (diffuse)" if wide else f"{mean:.4g} ± {sigma:.3g} (1 sigma)"
        for mean, sigma, wide in zip(prior.mean, sigmas, diffuse, strict=True)
    ]


def model_items(model: StateSpace | NonlinearModel) -> Any:
    """The kind, the sizes and the matrices of a model."""
    linear = isinstance(model, StateSpace)
    how = "discretised exactly at each step" if linear else "integrated over each step"
    kind = f"continuous, {how}" if model.is_continuous else f"discrete, dt = {model.dt:g} s"
    counts = ((model.n, "state"), (model.m, "input"), (model.p, "output"))
    sizes = ", ".join(checks.counted(size, what) for size, what in counts)
    yield "Kind", f"{'linear' if linear else 'nonlinear'}, {kind}; {sizes}"
    density = "density per second" if model.is_continuous else "covariance of a step"
    meanings = {"A": "", "B": "", "C": "", "D": "", "Q": f"process noise, {density}", "R": "sensor noise of a sample"}
    for letter, meaning in meanings.items():
        matrix = getattr(model, letter) if linear or letter in "QR" else None
        if matrix is None or (letter == "D" and not np.any(matrix)):
            continue
        yield letter + (f", {meaning}" if meaning else ""), matrix_text(np.asarray(matrix))
    if not linear:
        return
    for one in model.schedule or ():
        yield f"Follows {one.channel}", one.sentence
    point = model.operating_point
    if point is not None and np.any(point.states != 0):
        yield "Linear about", f"states {matrix_text(point.states)}, inputs {matrix_text(point.inputs)}"
    elif point is not None and (np.any(point.inputs != 0) or np.any(point.outputs != 0)):
        yield "Linear about", f"inputs {matrix_text(point.inputs)}, outputs {matrix_text(point.outputs)}"


def matrix_text(matrix: np.ndarray) -> str:
    """Numbers in brackets; only the size of a large matrix."""
    if matrix.ndim > 2:
        return f"varies over {len(matrix):,} rows in time"
    if matrix.ndim and max(matrix.shape) > MOST:
        return " × ".join(map(str, matrix.shape))
    if matrix.ndim < 2:
        return "[" + ", ".join(_number(value) for value in np.atleast_1d(matrix)) + "]"
    return "[" + "; ".join(", ".join(_number(value) for value in row) for row in matrix) + "]"


def _number(value: float) -> str:
    return f"{value:.6g}" if math.isfinite(value) else "not known"


def _with_unit(name: str, units: dict[str, str]) -> str:
    return f"{name} [{units[name]}]" if name in units else name
