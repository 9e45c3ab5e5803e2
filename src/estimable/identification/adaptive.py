"""A nonlinear model identified by a filter of its parameters, and its comparison with a record."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .. import checks, forks
from ..analysis.structural_identifiability import hidden_parameters
from ..annotations import Array
from ..data.record import Record
from ..estimation.binding import bind, columns
from ..estimation.climb import Limits, climb
from ..estimation.estimate import estimate
from ..estimation.named_numbers import Setup
from ..estimation.slopes import Ascent, Rows, ascent_over
from ..frozen import replace
from ..identifiers.linear_start import Start, deviation, levels, order_check
from ..identifiers.residuals import residual_checks
from ..identifiers.standing import Standing, held
from ..identifiers.validation import fit_percent, noise_of_innovations
from ..kernels.small import factors
from ..models.nonlinear_model import NonlinearModel
from ..models.plant import Functions, Matrices, plant
from ..models.prior import Prior
from ..protocols import FilterIdentifier
from ..results import Estimate, Fit, Interval, Validation
from .candidates import best_order

LONGEST = 100_000  # rows up to which every row is stored
LARGEST = 1e6  # of the spread of an output: the limit of a simulated deviation
STEP = 1e-3  # of a standard deviation, for the differences of scores
FURTHEST = 10.0  # standard deviations of the start, in one step of the search


def tracked(method: FilterIdentifier, records: Sequence[Record], engine: str) -> Fit:
    """Start the parameters, run the filter over the records, and validate the final model."""
    records = [of_channels(one, method.model) for one in records]
    begun = method.begin(records)
    prior, paths = begun.parameters, []
    for record in records:
        keep = "all" if len(record) <= LONGEST else "last"
        paths.append(estimate(method.tracker(prior), record, prior=method.state_prior, engine=engine, keep=keep))
        prior = Prior(paths[-1].gain[-1], paths[-1].gain_covariance[-1])
    total = sum(path.log_likelihood for path in paths)
    if method.refinement == "likelihood":
        prior, total = most_likely(method, records, prior)
    return _assembled(method, records, begun, prior, paths, total)


def of_channels(record: Record, model: NonlinearModel) -> Record:
    """The record with the channels of the model, in its order, and the applied inputs."""
    faults = checks.Faults()
    outputs = columns(model.outputs, record.outputs, "output", "y", faults)
    inputs = columns(model.inputs, record.inputs, "input", "u", faults)
    faults.finish()
    times: dict[str, Any] = {"t": record.t} if record.dt is None else {"dt": record.dt}
    return Record(
        record.y[:, outputs],
        record.applied()[:, inputs],
        inputs=model.inputs,
        outputs=model.outputs,
        hold=record.hold,
        sigma=None if record.sigma is None else record.sigma[:, outputs],
        **times,
    )


def _assembled(
    method: FilterIdentifier,
    records: Sequence[Record],
    begun: Start,
    parameters: Prior,
    paths: list[Estimate],
    total: float,
) -> Fit:
    model, path = replace(method.model, parameters=parameters.mean), paths[-1]
    validation = _validated(method, model, records, begun, paths)
    hidden = hidden_parameters(model, method.state_prior.mean, np.nan_to_num(records[-1].applied()))
    extra = {"start": begun.parameters.mean, "start_covariance": begun.parameters.covariance, "linear": begun.linear}
    return Fit(
        model, parameters.mean, parameters.covariance, model.parameter_names, validation, path, total, hidden, path.outcome,
        type(method).__name__, path.engine, extra,
    )  # fmt: skip


def _validated(
    method: FilterIdentifier, model: NonlinearModel, records: Sequence[Record], begun: Start, paths: list[Estimate]
) -> Validation:
    """The checks; for varying parameters the innovations are those of the filter that follows them."""
    stands = [standing(method, model, one) for one in records]
    if method.varies and all(len(path.innovation) == len(one) for path, one in zip(paths, records, strict=True)):
        stands = [Standing(s.simulated, *_whitened(path)) for s, path in zip(stands, paths, strict=True)]
    white = [s.standardised for s in stands]
    looked = [*begun.checks, noise_of_innovations(white), *residual_checks(white, records, direct=True)]
    if begun.linear is not None:
        looked.insert(0, order_check(_order(records), model.n))
    residuals, one_step = tuple(s.simulated for s in stands), tuple(s.one_step for s in stands)
    fit, one_step_fit = fit_percent(residuals, records), fit_percent(one_step, records)
    return Validation(residuals, fit, tuple(looked), one_step_fit, one_step)


def _whitened(path: Estimate) -> tuple[np.ndarray, np.ndarray]:
    """The innovations of a run, and the same in units of their standard deviations."""
    return path.innovation, path.innovation / np.sqrt(np.diagonal(path.innovation_covariance, axis1=1, axis2=2))


def _order(records: Sequence[Record]) -> int:
    about = levels(records)
    return best_order([deviation(one, about) for one in records], "moesp")


def standing(method: FilterIdentifier, model: NonlinearModel, record: Record, rows: int | None = None) -> Standing:
    """The comparison of a nonlinear model with a record, like `identifiers.standing` for a linear one."""
    record = of_channels(record, model)
    known = estimate(method.known(model.parameters), record, prior=method.state_prior, on_failure="keep")
    return Standing(record.y - simulated(model, record, method.state_prior, rows), *_whitened(known))


def simulated(model: NonlinearModel, record: Record, prior: Prior, rows: int | None) -> np.ndarray:
    """The noise-free outputs (T, p), from the state at row 0 that is nearest to the first rows and to the prior."""
    from scipy.optimize import least_squares

    clock, u = record.clock(model.dt or None), held(record.applied())
    ready = plant(model, clock)
    lengths = clock.lengths if clock.rows is None else clock.lengths[clock.rows]
    intervals = Interval(u, np.concatenate([u[1:], u[-1:]]), None, np.broadcast_to(lengths, len(u)).astype(float))
    L, scale = np.asarray(factors(prior.covariance)), np.sqrt(np.diagonal(model.R)) + 1e-9 * np.nanstd(record.y, axis=0)
    first, y = slice(0, rows), record.y
    seen = ~np.isnan(y[first])

    def outputs(z: np.ndarray):
        return _response(ready, prior.mean + L @ z, intervals, u)

    def error(z: np.ndarray):
        e = (np.asarray(outputs(z))[first] - np.nan_to_num(y[first])) / scale
        return np.r_[np.nan_to_num(np.clip(e[seen], -LARGEST, LARGEST), nan=LARGEST), z]

    found = least_squares(error, np.zeros(model.n), x_scale=1.0, max_nfev=50)
    ends = np.asarray(outputs(found.x))
    largest = LARGEST * (np.nanstd(y, axis=0) + 1)
    return np.nan_to_num(np.clip(ends, -largest, largest), nan=float(largest.max()))


@forks.jit
def _response(ready: Functions | Matrices, x: Array, intervals: Interval, u: Array):
    """h along the trajectory of f from x, without noise."""

    def step(x: Array, row: tuple[Interval, Array]):
        interval, now = row
        return _moved(ready, x, interval), ready.output(x, ready.θ, now)

    return jax.lax.scan(step, jnp.asarray(x), (intervals, u))[1]


def _moved(ready: Functions | Matrices, x: Array, interval: Interval):
    from ..kernels import flow

    if not isinstance(ready, Functions) or not ready.continuous:
        return ready.next_state(x, ready.θ, interval)
    f = ready.derivative(interval)
    return flow.integrate(lambda t, x: f(x, ready.θ, t), x, interval.dt, ready.substeps)[0]


def most_likely(method: FilterIdentifier, records: Sequence[Record], start: Prior) -> tuple[Prior, float]:
    """The constant parameters of maximum likelihood, with the inverse of the observed information.

    The unknowns z are in units of the start's standard deviations: θ = mean + L z.
    """
    known, prior = method.known(method.model.parameters), method.state_prior
    rows = [Rows.of(bind(known, one, prior)) for one in records]
    L = np.linalg.cholesky(start.covariance)

    def moved(z: np.ndarray) -> Setup:
        return Setup(replace(known, model=replace(known.model, parameters=start.mean + L @ z)), prior)

    def at(z: np.ndarray) -> Ascent:
        return ascent_over([moved] * len(rows), z, rows)

    k = start.size
    found = climb(at, np.zeros(k), Limits(np.full(k, -np.inf), np.full(k, np.inf), np.full(k, FURTHEST)))
    information = np.array([(at(found.θ - s).score - at(found.θ + s).score) / (2 * STEP) for s in STEP * np.eye(k)])
    values, vectors = np.linalg.eigh((information + information.T) / 2)
    if not found.converged or not np.isfinite(values).all() or values[0] <= 0:
        checks.refuse('the search for the maximum of the likelihood did not end at a maximum: use refinement = "none".')
    spread = L @ vectors
    return Prior(start.mean + L @ found.θ, spread @ np.diag(1 / values) @ spread.T), found.end.log_likelihood
