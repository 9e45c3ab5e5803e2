"""Results as tables."""

from typing import Any

import numpy as np

from . import checks

BLOCKS = (  # field, covariance, which names, prefix of the columns
    ("mean", "covariance", "states", ""),
    ("gain", "gain_covariance", "gains", ""),
    ("unknown_input", "unknown_input_covariance", "unknown_inputs", ""),
    ("innovation", "innovation_covariance", "outputs", "innovation_"),
)
KINDS = ("states", "gains", "unknown_inputs", "outputs")
NEGLIGIBLE = 1e-12  # relative to the largest diffuse variance of a row: rounding in a determined direction


def standard_deviation(covariance: np.ndarray, diffuse: np.ndarray | None = None) -> np.ndarray:
    """Standard deviations (T, n) of covariances (T, n, n); infinite where `diffuse` marks an unknown quantity.

    >>> standard_deviation([[[4.0]]]).tolist(), standard_deviation([[[4.0]]], [[[1.0]]]).tolist()
    ([[2.0]], [[inf]])
    """
    sigma = np.sqrt(np.maximum(_diagonal(covariance), 0.0))
    if diffuse is None:
        return sigma
    unknown = _diagonal(diffuse)
    largest = unknown.max(axis=-1, keepdims=True, initial=0.0)
    return np.where(unknown > NEGLIGIBLE * largest, np.inf, sigma)


def _diagonal(matrices: np.ndarray) -> np.ndarray:
    return np.diagonal(np.asarray(matrices, float), axis1=-2, axis2=-1)


def at_its_instant(field: str, values: np.ndarray | None, delay: int) -> Any:
    """An unknown input that is estimated `delay` rows later, moved to its own row; inputs not yet estimated are NaN.

    >>> at_its_instant("unknown_input", np.array([0.0, 1.0, 2.0]), 1).tolist()
    [1.0, 2.0, nan]
    """
    if not field.startswith("unknown_input") or delay == 0 or values is None or len(values) == 1:
        return values
    moved = np.full(np.shape(values), np.nan)
    moved[: len(values) - delay] = values[delay:]
    return moved


def diffuse_of(result: Any) -> dict[str, Any]:
    """The diffuse (infinite) part of each quantity."""
    return {
        "mean": result.diffuse_covariance,
        "gain": result.extra.get("gain_diffuse_covariance"),
        "unknown_input": result.extra.get("unknown_input_diffuse_covariance"),
    }


def to_pandas(result, outputs):
    """One row for each sample, indexed by time (or by sample): each quantity next to its standard deviation, which is infinite
    if it is unknown (a diffuse prior). An unknown input is in the row of its sample, also if it was estimated later."""
    import pandas as pd

    columns = {}
    diffuse, delay = diffuse_of(result), result.names.input_delay
    for field, covariance, kind, prefix in BLOCKS:
        values, P = getattr(result, field), getattr(result, covariance)
        if values is None:
            continue
        sigma = None if P is None else standard_deviation(P, diffuse.get(field))
        values, sigma = at_its_instant(field, values, delay), at_its_instant(field, sigma, delay)
        for i, name in enumerate(getattr(result.names, kind)):
            columns[prefix + name] = values[:, i]
            if sigma is not None:
                columns[f"{prefix}{name}_sigma"] = sigma[:, i]
    if result.log_likelihood_steps is not None:
        columns["log_likelihood"] = result.log_likelihood_steps
    columns |= _output_columns(result, outputs)
    if not columns:
        checks.refuse('this result has no rows, because it was made with keep="likelihood". Use keep="all".')
    index = None if result.t is None else pd.Index(result.t, name="time")
    return pd.DataFrame(columns, index=index)


def _output_columns(result, outputs) -> dict[str, np.ndarray]:
    """Each output that the states imply, and its standard deviation."""
    kind, columns = result.kind, {}
    sigma = None if outputs.covariance is None else standard_deviation(outputs.covariance)
    if outputs.mean is None:
        return {}
    for i, name in enumerate(result.names.outputs):
        columns[f"{name}_{kind}"] = outputs.mean[:, i]
        if sigma is not None:
            columns[f"{name}_{kind}_sigma"] = sigma[:, i]
    return columns


def _variables(result) -> dict[str, Any]:
    """(dimensions, values) of each array of a result, and of each covariance."""
    names = result.names
    variables = {}
    for field, covariance, kind, _ in BLOCKS:
        for name, shape in ((field, (kind,)), (covariance, (kind, f"{kind}_2"))):
            if getattr(result, name) is not None:
                values = at_its_instant(name, getattr(result, name), names.input_delay)
                variables[name] = (("time", *shape), values)
    if result.log_likelihood_steps is not None:
        variables["log_likelihood_steps"] = (("time",), result.log_likelihood_steps)
    return variables


def to_xarray(result, outputs):
    """Named dimensions time, states, gains, outputs, and a second of each (states_2, ..) for covariances."""
    try:
        import xarray as xr
    except ImportError:
        checks.refuse("xarray is not installed: pip install 'estimable[xarray]'.")
    names = result.names
    coordinates = {kind: list(getattr(names, kind)) for kind in KINDS if getattr(names, kind)}
    coordinates |= {f"{kind}_2": labels for kind, labels in coordinates.items()}
    variables = _variables(result)
    for name, values, axes in (("output", outputs.mean, ()), ("output_covariance", outputs.covariance, ("outputs_2",))):
        variables |= {} if values is None else {name: (("time", "outputs", *axes), values)}
    if not variables:
        checks.refuse('this result has no rows, because it was made with keep="likelihood". Use keep="all".')
    if result.t is not None:
        coordinates["time"] = result.t
    used = {dimension for dimensions, _ in variables.values() for dimension in dimensions}
    coordinates = {axis: labels for axis, labels in coordinates.items() if axis in used}
    attributes = {"log_likelihood": result.log_likelihood, "engine": result.engine, "units": dict(names.units)}
    return xr.Dataset(variables, coords=coordinates, attrs=attributes)
