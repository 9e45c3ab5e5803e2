"""The accuracy that an unbiased estimate of an output-error model can reach with the packets that arrived."""

from typing import NamedTuple

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..data.record import Record
from ..errors import AssumptionError
from ..frozen import saved
from ..kernels import output_error_response as kernel
from ..models.output_error import OutputError

UNTOLD = 1e-9  # relative eigenvalue of the scaled information below which a direction counts as undetermined


@saved
class Efficiency(NamedTuple):
    """The result of `efficiency`: the squared errors of estimates, relative to the Cramér-Rao bound.

    - `ratio`: the mean over the runs of the squared errors, summed over the parameters, divided by the mean trace of the
      bounds. 1 is the best possible.
    - `normalised`: the mean of e' I e divided by the number of parameters, with e the error and I the information, the
      inverse of the bound. It does not depend on units. 1 is the best possible.
    - `runs`: the number of runs.
    """

    ratio: float
    normalised: float
    runs: int

    @property
    def sentence(self) -> str:
        """The verdict, as a sentence."""
        loss = 100 * (self.normalised - 1)
        return f"{self.runs} runs: the normalised squared error is {self.normalised:.3f} of the bound ({loss:+.1f} %)."


def slopes(model: OutputError, record: Record) -> tuple[np.ndarray, ...]:
    """The derivatives of each noise-free output with respect to the d parameters of that output, an array (T, d) for each.

    The plant starts at rest, and the inputs are those that the actuators applied. Raises `InputError` if an input is unknown.
    """
    u = applied(model, record)
    rows = zip(np.asarray(model.a), np.asarray(model.b), strict=True)
    return tuple(kernel.slopes(a, b, model.delay, u, kernel.response(a, b, model.delay, u)) for a, b in rows)


def check_noise(model: OutputError) -> None:
    """Refuse a model without noise."""
    if np.any(np.asarray(model.noise_variance) <= 0):
        checks.refuse("`model` must have a noise variance greater than 0: without noise the information is infinite.")


def information(model: OutputError, record: Record) -> np.ndarray:
    """The Fisher information (d, d) of the d parameters of `model` in the seen outputs of `record`.

    It has one diagonal block for each output. A sample with its own `sigma` in the record counts by it.

    >>> plant = OutputError([], [2.0], noise_variance=0.5, dt=1)
    >>> information(plant, Record([1.0, np.nan, 1.0], [1.0, 1.0, 3.0], dt=1)).tolist()
    [[20.0]]
    """
    from scipy.linalg import block_diag

    checks.require(model=(model, OutputError), record=(record, Record))
    check_noise(model)
    blocks = zip(slopes(model, record), record.seen.T, noise_of(model.noise_variance, record).T, strict=True)
    return np.asarray(block_diag(*(kernel.information(ψ, seen, r) for ψ, seen, r in blocks)))


def noise_of(noise_variance: np.ndarray | float, record: Record) -> np.ndarray:
    """The variance of the noise of each sample, (T, p): that of the record where it has one."""
    r = np.broadcast_to(np.asarray(noise_variance, float), record.y.shape)
    return r if record.sigma is None else np.where(np.isnan(record.sigma), r, record.sigma**2)


def cramer_rao(model: OutputError, record: Record) -> np.ndarray:
    """The Cramér-Rao bound: the smallest covariance (d, d) of an unbiased estimate of the d parameters of `model` from
    `record`.

    `model` is an `OutputError`, and starts at rest. The bound depends on the applied inputs and on the mask of the seen
    outputs, not on the values of the outputs. It can therefore be computed before an experiment, for any pattern of losses.
    `simulate` with links draws such patterns.

    Raises `InputError` if an input is unknown, `AssumptionError` if the record has no information about a direction of the
    parameters.

    >>> plant = OutputError([], [2.0], noise_variance=0.5, dt=1)
    >>> cramer_rao(plant, Record([1.0, np.nan, 1.0], [1.0, 1.0, 3.0], dt=1)).round(9).tolist()
    [[0.05]]
    """
    M = information(model, record)
    if (directions := undetermined(M)).shape[1]:
        lacking = checks.counted(directions.shape[1], "direction")
        raise AssumptionError(
            f"the record has no information about {lacking} of the {len(M)} parameters, so there is no bound: "
            "`excitation(model, record)` names them."
        )
    scale = scale_of(M)
    return np.linalg.inv(M * np.outer(scale, scale)) * np.outer(scale, scale)


def efficiency(error: Numbers, bound: Numbers) -> Efficiency:
    """How close estimates from B runs come to the Cramér-Rao bound.

    `error` (B, d): the error of each estimate. `bound` (B, d, d): the bound of each run, from `cramer_rao`. Returns an
    `Efficiency`.

    >>> rng = np.random.default_rng(0)
    >>> abs(efficiency(rng.normal(size=(4000, 2)), np.broadcast_to(np.eye(2), (4000, 2, 2))).ratio - 1) < 0.05
    True
    """
    faults = checks.Faults()
    e, V = faults.array("error", error, "B d"), faults.array("bound", bound, "B d d")
    faults.finish()
    if not e.size:
        checks.refuse(f"`error` and `bound` must hold at least one run and one parameter. Got `error` {e.shape}.")
    if not _definite(V):
        checks.refuse("`bound` must be positive definite in every run.")
    squares = np.einsum("bi,bi->b", e, np.linalg.solve(V, e[..., None])[..., 0])
    ratio = np.mean(np.sum(e**2, axis=1)) / np.mean(np.trace(V, axis1=1, axis2=2))
    return Efficiency(float(ratio), float(np.mean(squares) / e.shape[1]), len(e))


def efficient_estimate(model: OutputError, record: Record) -> np.ndarray:
    """The estimate from `record` that attains the Cramér-Rao bound, to first order; it needs the true `model`.

    It is θ + I(θ)^-1 s, with θ the true parameters, I(θ) the information, and s the derivative of the log-likelihood. Compare
    another estimate with it on the same records: the difference contains little of the randomness of the records.
    """
    u = applied(model, record)
    e = record.y - model.response(u)
    score = [
        ψ[seen].T @ (e[seen, i] / r[seen])
        for i, (ψ, seen, r) in enumerate(
            zip(slopes(model, record), record.seen.T, noise_of(model.noise_variance, record).T, strict=True)
        )
    ]
    return model.parameters + cramer_rao(model, record) @ np.concatenate(score)


def applied(model: OutputError, record: Record) -> np.ndarray:
    """The applied inputs (T, m) of `record`. Raises `InputError` where one is unknown."""
    checks.require(model=(model, OutputError), record=(record, Record))
    faults = checks.Faults()
    if (len(record.inputs), len(record.outputs)) != (model.m, model.p):
        faults.add(
            f"the model has {checks.counted(model.m, 'input')} and {checks.counted(model.p, 'output')}, the record "
            f"{len(record.inputs)} and {len(record.outputs)}."
        )
    u = np.asarray(record.applied())
    if np.isnan(u).any():
        faults.add(
            f"an input is unknown at row {checks.first_index(np.isnan(u))}: it is NaN, or its arrival is unknown."
        )
    faults.finish()
    return u


def _definite(bound: np.ndarray) -> bool:
    """Whether every matrix (B, d, d) is positive definite, in any units."""
    variance = np.einsum("bii->bi", bound)
    if not (variance > 0).all():
        return False
    size = np.sqrt(variance)
    return bool((np.linalg.eigvalsh(bound / size[:, :, None] / size[:, None, :]) > 0).all())


def undetermined(M: np.ndarray) -> np.ndarray:
    """An orthonormal basis (d, r) of the directions about which the information M (d, d) is zero, for any units of the
    parameters.
    """
    scale = scale_of(M)
    values, vectors = np.linalg.eigh(M * np.outer(scale, scale))
    largest = values.max(initial=0.0)
    if largest <= 0:
        return np.eye(len(M))
    basis = vectors[:, values <= UNTOLD * largest] * np.where(scale > 0, scale, 1.0)[:, None]
    return np.linalg.qr(basis)[0] if basis.shape[1] else basis


def scale_of(M: np.ndarray) -> np.ndarray:
    """The factors (d,) that scale the diagonal of a matrix M (d, d) to one; zero where the diagonal is zero."""
    size = np.sqrt(np.diagonal(M))
    return np.where(size > 0, 1 / np.where(size > 0, size, 1.0), 0.0)
