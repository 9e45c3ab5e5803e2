"""The curvature of a model over the uncertainty of its state: whether the extended filter is sufficient."""

from typing import Annotated, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .. import checks, forks
from ..annotations import Array
from ..data.record import Record
from ..frozen import saved
from ..kernels import expansion, flow
from ..kernels.small import factor, product, triangularise
from ..models.nonlinear_model import NonlinearModel
from ..models.plant import Functions, Matrices, plant
from ..results import Estimate, Interval

WORTH = 0.1  # of a standard deviation: bias of the mean above which the second order is worth its cost
STRONG = 0.3  # of a standard deviation: third-order term above which the gain changes


@saved
class Nonlinearity(NamedTuple):
    """The result of `nonlinearity`: what a linearised filter omits at each row, in standard deviations of the quantity.

    - `state_bias` (T - 1, n): the bias of the mean that is predicted for row k + 1.
    - `output_bias` (T - 1, p): the bias of the output that is predicted for row k + 1.
    - `third_order` (T - 1, p): the change of the slope of h by its third derivatives, a term that second-order filters omit
      too.
    """

    state_bias: Annotated[np.ndarray, "T n"]
    output_bias: Annotated[np.ndarray, "T p"]
    third_order: Annotated[np.ndarray, "T p"]
    states: Annotated[tuple[str, ...], "n"]
    outputs: Annotated[tuple[str, ...], "p"]

    @property
    def sentence(self) -> str:
        """The largest bias, and the filter to use."""
        worst, which, row = max(
            (np.abs(bias).max(), names[np.abs(bias).max(axis=0).argmax()], int(np.abs(bias).max(axis=1).argmax()) + 1)
            for bias, names in ((self.state_bias, self.states), (self.output_bias, self.outputs))
        )
        third = float(self.third_order.max())
        at = f"the extended filter's prediction of {which!r} is biased by {worst:.2g} sigma at row {row}"
        if third > STRONG:
            return (
                f"{at}, and third derivatives of h change its slope by {third:.2g} sigma: the second order is not sufficient "
                "either. Start from a smaller covariance, sample faster, or use a particle filter."
            )
        if worst > WORTH:
            return f"{at}: use SecondOrderKalman or UnscentedKalman."
        return f"{at}, which is small: ExtendedKalman is sufficient."


def nonlinearity(model: NonlinearModel, result: Estimate, record: Record) -> Nonlinearity:
    """Measure how far `model` is from linear along an estimate of its state, by its second- and third-order terms.

    `result`: the result of a filter of that model over `record`, with covariances (`keep="all"`). At each row the terms are
    computed for the covariance that the filter reports there. The parameters have their values in the model.

    Returns a `Nonlinearity`. Raises `InputError` for another model, or for a result without covariances.

    >>> model = NonlinearModel(lambda x, u, θ: x, lambda x, u, θ: x**2, Q=[[0.0]], R=[[0.1]], dt=1)
    >>> record = Record([np.nan, 5.0], dt=1)
    >>> result = estimate(ExtendedKalman(model), record, prior=Prior([2.0], [[1.0]]))
    >>> diagnostics.nonlinearity(model, result, record).output_bias.round(3)  # 1 / sqrt(4 · 2² + 2 + .1)
    array([[0.235]])
    """
    faults = checks.Faults()
    faults.instance("model", model, NonlinearModel)
    faults.instance("record", record, Record)
    if faults.instance("result", result, Estimate) and (result.covariance is None or len(result.covariance) < 2):
        faults.add('`result` must hold the covariances of at least two rows. Make it by estimate(..., keep="all").')
    faults.finish()
    assert result.covariance is not None
    clock = record.clock(model.dt or None)
    ready = plant(model, clock)
    columns = [record.inputs.index(name) if name in record.inputs else i for i, name in enumerate(model.inputs)]
    u = record.applied()[:, columns]
    lengths = clock.lengths if clock.rows is None else clock.lengths[clock.rows]
    intervals = Interval(u[:-1], u[1:], None, np.broadcast_to(lengths, len(u)).astype(float)[:-1])
    measured = forks.jit(jax.vmap(_terms, in_axes=(None, 0, 0, 0)))(
        ready, result.mean[:-1], result.covariance[:-1], intervals
    )
    state, output, third = map(np.asarray, measured)
    return Nonlinearity(state, output, third, model.states, model.outputs)


def _terms(ready: Functions | Matrices, m: Array, P: Array, interval: Interval):
    """The biases and the third-order term of one interval and of the sample at its end."""
    L = factor(P)
    straight, curved, Z = _moved(ready, m, L, interval)
    θ, u = ready.θ, interval.u_end
    line = expansion.second_order(lambda x: ready.output(x, θ, u), curved, Z)
    HZ = product(line.slope, Z)
    σ_y = jnp.sqrt(jnp.sum(HZ**2, axis=1) + jnp.sum(line.rest**2, axis=1) + jnp.sum(ready.V**2, axis=1))
    points = expansion.sigma_points(lambda x: ready.output(x, θ, u), curved, Z, max(0.0, 3.0 - len(m)))
    σ_x = jnp.sqrt(jnp.sum(Z**2, axis=1))
    third = jnp.sqrt(jnp.sum((points.slope - HZ) ** 2, axis=1))  # ½ Σ_a h'''[Z_a, Z_a, Z_j], by differences
    return _ratio(curved - straight, σ_x), _ratio(line.bias, σ_y), _ratio(third, σ_y)


def _ratio(size: Array, σ: Array) -> Array:
    return jnp.where(σ > 0, size / jnp.where(σ > 0, σ, 1.0), 0.0)


def _moved(ready: Functions | Matrices, m: Array, L: Array, interval: Interval):
    """The mean predicted to the first and to the second order, and a factor of the covariance."""
    if isinstance(ready, Functions) and ready.continuous:
        return _flowed(ready, m, L, interval)
    line = expansion.second_order(lambda x: ready.next_state(x, ready.θ, interval), m, L)
    W = ready.noise(m, ready.θ, interval.u)
    Z = triangularise(jnp.concatenate([product(line.slope, L), line.rest, W], axis=1))
    return line.mean - line.bias, line.mean, Z


def _flowed(ready: Functions, m: Array, L: Array, interval: Interval):
    derivative, n = ready.derivative(interval), len(m)
    start = flow.Moments(m, L, jnp.zeros((n, n)))
    ends = [
        flow.integrate(
            flow.moment_derivative(
                lambda x, t: derivative(x, ready.θ, t), lambda x, t: ready.noise(x, ready.θ, interval.u), order,
                factor_columns=n,
            ),
            start, interval.dt, ready.substeps,
        )[0]
        for order in (1, 2)
    ]  # fmt: skip
    Z = triangularise(jnp.concatenate([ends[1].Y, factor(ends[1].N)], axis=1))
    return ends[0].m, ends[1].m, Z
