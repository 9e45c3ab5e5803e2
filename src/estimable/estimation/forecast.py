"""Forecasts: states and outputs of future samples."""

from typing import Any

import jax
import numpy as np

from .. import checks, forks
from ..annotations import Array, Numbers
from ..data.record import Record
from ..data.record_arguments import column
from ..frozen import replace
from ..protocols import Smoothable
from ..results import Estimate, Forecast, Info, Interval, Origin, Sample
from .binding import Bound, bind
from .estimate import estimate


def forecast(result: Estimate, u: Numbers | None = None, steps: int | None = None) -> Forecast:
    """Predict the states and outputs of the samples after a record, with their covariances.

    - `result`: the result of `estimate` with `Kalman`, `UnknownGain` or another algorithm with a linear Gaussian model.
    - `u` (steps, m): the inputs from the first row after the record on, in the order of the record's inputs. The last row
      acts only on the outputs of its own sample. None for a model without inputs; `steps` is then the number of samples.

    Returns a `Forecast`. Its times `t` continue with the last step of the record. Where the record leaves directions of the
    state undetermined, they are in `diffuse_covariance`, and the output covariances that are infinite because of them are
    NaN.

    Cost: one run over the record, with the future rows as missing samples.

    Raises `InputError` with every fault of the call.

    >>> model = StateSpace([[0.5]], C=[[1.0]], Q=[[0.0]], R=[[1.0]], dt=1)
    >>> result = estimate(Kalman(model), Record([[2.0]], dt=1), prior=Prior([0.0], [[1.0]]))
    >>> ahead = forecast(result, steps=2)
    >>> ahead.output.ravel().tolist(), ahead.output_covariance.ravel().round(6).tolist(), ahead.t.tolist()
    ([0.5, 0.25], [1.125, 1.03125], [1.0, 2.0])
    """
    origin = _origin(result)
    u = _read_inputs(origin.record, u, steps)
    algorithm, record, prior = origin.algorithm, _extended(origin.record, u), origin.prior
    T = len(origin.record)
    info = estimate(algorithm, record, prior=prior).info
    info = jax.tree_util.tree_map(lambda leaf: leaf[T:], info)
    output = _outputs(bind(algorithm, record, prior), info)
    S = info.innovation_covariance
    info = replace(info, innovation=None, innovation_covariance=None, log_likelihood=None)
    t = None if record.t is None else record.t[T:]
    return Forecast(info, t, output, S, result.names)


def _origin(result: Estimate) -> Origin:
    if not isinstance(result, Estimate) or result.origin is None:
        checks.refuse(f"`result` must be a result of estimate. Got {type(result).__name__}.")
    origin: Origin = result.origin
    if not isinstance(origin.algorithm, Smoothable):
        checks.refuse(
            f"forecast needs an algorithm with a linear Gaussian model, such as Kalman or UnknownGain. "
            f"{type(origin.algorithm).__name__} has none."
        )
    if (rows := origin.algorithm.model.steps) is not None:
        checks.refuse(f"the model varies over the {rows} rows of the record, but has no rows after it.")
    return origin


def _read_inputs(record: Record, u: Numbers | None, steps: int | None) -> np.ndarray:
    faults = checks.Faults()
    m = record.u.shape[1]
    faults.learn("m", m, f"the record has {checks.counted(m, 'input')}")
    if steps is not None:
        faults.whole("steps", steps, 1, checks.MOST_ROWS)
    if u is None and m:
        faults.add(f"`u` must be (steps, m) = (steps, {m}): the inputs of the future rows.")
    if u is None and steps is None:
        faults.add("`steps` must be the number of rows to forecast, as there is no `u`.")
    faults.finish()
    if u is None:
        return np.zeros((int(steps or 0), 0))
    inputs = faults.array("u", column(u), "steps m")
    if inputs is not None and steps is not None and len(inputs) != steps:
        faults.add(f"`steps` = {steps}, but `u` has {len(inputs)} rows: leave `steps` out.")
    elif inputs is not None and len(inputs) == 0:
        faults.add("`u` must have at least one row.")
    faults.finish()
    return np.asarray(inputs)


def _extended(record: Record, u: np.ndarray) -> Record:
    """The record, followed by rows without seen outputs."""
    rows = len(u)
    t = record.t
    if t is not None:
        step = record.dt if record.dt is not None else t[-1] - t[-2] if len(t) > 1 else 0.0
        t = np.append(t, t[-1] + step * np.arange(1, rows + 1))
    arrived = None if record.arrived is None else np.vstack([record.arrived, np.ones_like(u)])
    y = np.vstack([record.y, np.full((rows, record.y.shape[1]), np.nan)])
    sigma = None if record.sigma is None else np.vstack([record.sigma, np.full((rows, y.shape[1]), np.nan)])
    return replace(record, y=y, u=np.vstack([record.u, u]), t=t, arrived=arrived, sigma=sigma)


def _outputs(bound: Bound, info: Info) -> np.ndarray:
    """C x + d of the last rows, without noise."""
    x = info.mean if info.gain is None else np.concatenate([info.mean, info.gain], axis=1)
    point = bound.algorithm.ready.point.states
    x = x - np.concatenate([point, np.zeros(x.shape[1] - len(point))])
    T, ahead = len(bound.samples.seen), len(x)
    samples, intervals = jax.tree_util.tree_map(lambda leaf: leaf[-ahead:], (bound.samples, bound.intervals))
    return np.asarray(_measured(bound.algorithm, T - ahead + np.arange(ahead), samples, intervals, x))


@forks.jit
def _measured(algorithm: Smoothable[Any], rows: Array, samples: Sample, intervals: Interval, x: Array):
    def row(k: Array, sample: Sample, interval: Interval, x: Array):
        measurement = algorithm.at(k).instant(sample, interval).measurement
        return measurement.C @ x + measurement.d

    return jax.vmap(row)(rows, samples, intervals, x)
