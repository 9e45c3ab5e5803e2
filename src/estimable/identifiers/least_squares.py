"""The parameters of an ARX model by least squares, from incomplete records."""

from collections.abc import Sequence
from dataclasses import KW_ONLY
from typing import NamedTuple

import numpy as np

from .. import checks
from ..analysis.excitation import excitation_check
from ..data.record import Record
from ..frozen import frozen, static
from ..kernels.coloured_noise import ORDERS, colour, moments
from ..kernels.regression import Regression, lagged, regress
from ..models.arx import ARX, arx_names
from ..protocols import Identifier
from ..results import Fit
from .standing import validation_of
from .validation import sigma_check

NOT_THE_PLANT = (
    "The residuals are predictable: the parameters and their sigma are those of the best one-step predictor of this form, not "
    "of the plant. Use OutputErrorML, PredictionError or InstrumentalVariables, or raise the orders."
)


class OutputEquations(NamedTuple):
    """The equations of one output: Φ (N, d), y (N,), and `at` (N,), in steps from row 0 of the first record.

    Records lie so far apart that no two of their rows appear correlated.
    """

    Φ: np.ndarray
    y: np.ndarray
    at: np.ndarray


@frozen
class LeastSquares(Identifier):
    """The parameters of an ARX model by least squares, from one record or several with gaps.

    Model: `ARX`: A_i(z) y_i[k] = Σ_j B_ij(z) u_j[k] + c_i + e_i[k], e white; each output has its own polynomials.

    Assumes right orders and white noise on the equation. With white noise on the outputs instead (the usual case of a sensor)
    the estimate is biased even for long records: then `OutputErrorML` is better. Least squares needs no search and no start.
    The plant may be unstable, may have process noise, and need not be at rest when a record begins; with `OutputErrorML` it
    must be stable and without process noise.

    Settings: `na`, `nb`: degrees of A and B (Ljung's (na, nb, nk) is (na, nb - 1, delay = nk) here); `delay` in steps;
    `offset`: whether a constant c is fitted to each output (signals in absolute units need it; nothing is subtracted).

    An equation with a missing output or input is left out, for that output only; so are the first max(na, nb + delay) of each
    record. The covariance is σ² H^-1 M H^-1 with H = Φ'Φ, Φ the matrix of regressors, σ² = e'e / (N - d) for N equations and d
    parameters, and the spectrum of the residuals in M; `fit.covariance_white` is σ² (Φ'Φ)^-1. Neither contains the bias under
    noise on the outputs. Directions of the parameters without information are in `fit.undetermined`, and the covariance is that
    of the other directions. `fit.validation.fit` is of the simulation, `one_step_fit` of one-step predictions.

    Cost: O(T d²) operations, with T samples and d parameters: 2 ms at T = 1000, d = 4.

    Reference: L. Ljung, System Identification (1999), §4.2, §7.3; J. Sillence (1999), (22)-(23).

    >>> u = np.random.default_rng(0).normal(size=200)
    >>> plant = ARX([-0.5], [1.0], delay=1, noise_variance=0.0, dt=1)
    >>> record = simulate(plant.to_state_space(), u, seed=0).record
    >>> identify(LeastSquares(1, 0, delay=1), record).parameters.round(9).tolist()
    [-0.5, 1.0]
    """

    na: int = static()
    nb: int = static()
    _: KW_ONLY
    delay: int = static(default=0)
    offset: bool = static(default=False)

    fits_series = True
    takes_unknown_inputs = True  # equations with one are left out
    cannot_weigh = "its noise is that of the equations, not of single samples"

    def __post_init__(self):
        faults = checks.Faults()
        for name in ("na", "nb", "delay"):
            faults.whole(name, getattr(self, name), 0, checks.LARGEST_ORDER)
        faults.flag("offset", self.offset)
        faults.finish()

    def fit(self, records: Sequence[Record]) -> Fit:
        """The fit to records of equal channels and step.

        Raises `InputError` where an output has no complete equation.
        """
        rows = self.complete_rows(records)
        return self._assembled(records, rows, [regress(one.Φ, one.y) for one in rows])

    def model(self, records: Sequence[Record]) -> ARX:
        """The model of the fit alone."""
        return self._model(records[0], [regress(one.Φ, one.y) for one in self.complete_rows(records)])

    def complete_rows(self, records: Sequence[Record]) -> list[OutputEquations]:
        """The complete equations of each output. Raises `InputError` where one has none."""
        rows = [self.rows(records, i) for i in range(len(records[0].outputs))]
        self._check(rows, records[0])
        return rows

    def rows(self, records: Sequence[Record], i: int) -> OutputEquations:
        """The complete equations of output i, in all records."""
        found = [
            one._replace(at=one.at + start)
            for start, one in zip(self.starts(records), (self._equations(one, i) for one in records), strict=False)
        ]
        Φ, y, at = (np.concatenate(columns) for columns in zip(*found, strict=True))
        complete = ~np.isnan(y) & ~np.isnan(Φ).any(axis=1)
        return OutputEquations(Φ[complete], y[complete], at[complete])

    def starts(self, records: Sequence[Record]) -> np.ndarray:
        """Row 0 of each record in `at`, and the end of the last."""
        return np.cumsum([0, *(2 * len(record) + max(self.na, self.nb + self.delay) + ORDERS for record in records)])

    def _equations(self, record: Record, i: int) -> OutputEquations:
        """Every equation of output i in one record; NaN where a value is missing."""
        y, lags = record.y[:, i], range(self.delay, self.delay + self.nb + 1)
        columns = [-lagged(y, range(1, self.na + 1)), *(lagged(u, lags) for u in record.applied().T)]
        return OutputEquations(
            np.concatenate([*columns, np.ones((len(y), int(self.offset)))], axis=1), y, np.arange(len(y))
        )

    def _check(self, rows: Sequence[OutputEquations], first: Record) -> None:
        """Check that every output has an equation."""
        faults = checks.Faults()
        for name, one in zip(first.outputs, rows, strict=True):
            if not len(one.y):
                needed = max(self.na, self.nb + self.delay) + 1
                faults.add(
                    f"output {name} has no equation without missing values: it needs {needed} rows without a gap in {name} "
                    "and the inputs. Lower the orders, or use OutputErrorML, which allows gaps."
                )
        faults.finish()

    def _model(self, first: Record, found: list[Regression]) -> ARX:
        θ = np.stack([one.θ for one in found])
        lags = slice(self.na, self.na + len(first.inputs) * (self.nb + 1))
        return ARX(
            θ[:, : self.na], θ[:, lags].reshape(len(found), -1, self.nb + 1), delay=self.delay,
            noise_variance=[one.variance for one in found], offset=θ[:, -1] if self.offset else None, dt=float(first.dt or 0.0),
            inputs=first.inputs, outputs=first.outputs,
        )  # fmt: skip

    def _assembled(self, records: Sequence[Record], rows: list[OutputEquations], found: list[Regression]) -> Fit:
        from scipy.linalg import block_diag

        first, model = records[0], self._model(records[0], found)
        white = np.asarray(block_diag(*(one.variance * one.inverse for one in found)))
        Σ = np.asarray(block_diag(*(coloured_inverse(*pair) for pair in zip(rows, found, strict=True))))
        M = np.asarray(block_diag(*(one.information / max(one.variance, 1e-300) for one in found)))
        free = np.asarray(block_diag(*(one.undetermined for one in found)))
        names = arx_names(self.na, self.nb, first.inputs, first.outputs, self.offset)
        excitation = excitation_check(M, names, free)
        likelihood = sum(_log_likelihood(one) for one in found)
        validation = validation_of(model, records, [excitation, sigma_check(Σ, white, names)], NOT_THE_PLANT)
        return Fit(
            model, model.parameters, Σ, names, validation, None, likelihood,
            free if free.shape[1] else None, method=type(self).__name__, covariance_white=white,
        )  # fmt: skip


def coloured_inverse(rows: OutputEquations, found: Regression, variance: float | None = None) -> np.ndarray:
    """The covariance of θ under the spectrum of the residuals, whose variance may be known."""
    M = moments(rows.Φ, rows.at, colour(found.e, rows.at))
    return (found.variance if variance is None else variance) * found.inverse @ M @ found.inverse


def _log_likelihood(found: Regression) -> float:
    """The log-likelihood of the equations, given the samples before them."""
    r = max(found.variance, 1e-300)
    return -0.5 * (len(found.e) * np.log(2 * np.pi * r) + float(found.e @ found.e) / r)
