"""Results as tables."""

import numpy as np

from . import checks

BLOCKS = (  # field, covariance, which names, prefix of the columns
    ("mean", "covariance", "states", ""),
    ("gain", "gain_covariance", "gains", ""),
    ("innovation", "innovation_covariance", "outputs", "innovation_"),
)


def to_pandas(result):
    """One row a sample, indexed by time (or by sample): each quantity beside its standard deviation."""
    import pandas as pd

    columns = {}
    for field, covariance, kind, prefix in BLOCKS:
        values, P = getattr(result, field), getattr(result, covariance)
        if values is None:
            continue
        for i, name in enumerate(getattr(result.names, kind)):
            columns[prefix + name] = values[:, i]
            if P is not None:
                columns[f"{prefix}{name}_sigma"] = np.sqrt(P[:, i, i])
    if result.log_likelihood_steps is not None:
        columns["log_likelihood"] = result.log_likelihood_steps
    if not columns:
        checks.refuse('this result has no rows: it was kept with keep="likelihood".')
    index = None if result.t is None else pd.Index(result.t, name="time")
    return pd.DataFrame(columns, index=index)


def to_xarray(result):
    """Named dimensions time, states, gains, outputs, and a second of each (states_2, ..) for covariances."""
    try:
        import xarray as xr
    except ImportError:
        checks.refuse("xarray is not installed: pip install 'estimable[xarray]'.")
    names = result.names
    coordinates = {kind: list(getattr(names, kind)) for kind in ("states", "gains", "outputs") if getattr(names, kind)}
    coordinates |= {f"{kind}_2": labels for kind, labels in coordinates.items()}
    variables = {}
    for field, covariance, kind, _ in BLOCKS:
        for name, shape in ((field, (kind,)), (covariance, (kind, f"{kind}_2"))):
            if getattr(result, name) is not None:
                variables[name] = (("time", *shape), getattr(result, name))
    if result.log_likelihood_steps is not None:
        variables["log_likelihood_steps"] = (("time",), result.log_likelihood_steps)
    if result.t is not None:
        coordinates["time"] = result.t
    used = {dimension for dimensions, _ in variables.values() for dimension in dimensions}
    coordinates = {axis: labels for axis, labels in coordinates.items() if axis in used}
    attributes = {"log_likelihood": result.log_likelihood, "engine": result.engine, "units": dict(names.units)}
    return xr.Dataset(variables, coords=coordinates, attrs=attributes)
