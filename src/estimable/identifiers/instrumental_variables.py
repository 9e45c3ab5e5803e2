"""The parameters of an ARX equation by instrumental variables, for any noise."""

from collections.abc import Sequence
from dataclasses import KW_ONLY
from typing import NamedTuple

import numpy as np

from .. import checks
from ..analysis.excitation import excitation_check
from ..data.record import Record
from ..frozen import frozen, replace, static
from ..kernels.auxiliary_model import stabilise
from ..kernels.banded import whitened
from ..kernels.coloured_noise import colour, moments
from ..kernels.regression import regress
from ..models.arx import ARX, arx_names
from ..protocols import Identifier
from ..results import Fit
from .least_squares import LeastSquares, OutputEquations
from .realised import check_records
from .standing import validation_of

ROUNDS = 4  # alternating auxiliary model, weights and parameters


class Weighed(NamedTuple):
    """θ (d,) of one output, its covariance (d, d), the equation's residuals' variance, and Z'Z of the weighted instruments."""

    θ: np.ndarray
    covariance: np.ndarray
    variance: float
    information: np.ndarray


@frozen
class InstrumentalVariables(Identifier):
    """The parameters of an ARX equation by instrumental variables: consistent for any noise, without a search.

    Model: A_i(z) y_i[k] = Σ_j B_ij(z) u_j[k] + c_i + v_i[k]. The noise v is stationary and may have any colour. Each output
    has its own equation.

    Assumes inputs that do not depend on the noise (no feedback), a stable plant, and right orders of A and B. The noise is
    arbitrary and not modelled: `fit.model` holds its variance on the equation. Where its kind is known, `OutputErrorML` or
    `PredictionError` are more accurate.

    Settings: `na`, `nb`: degrees of A and B (Ljung's (na, nb, nk) is (na, nb - 1, delay = nk) here); `delay` in steps;
    `offset`: whether a constant c is fitted to each output.

    The instruments Z are the noise-free outputs of the last model. Z and the regressors Φ of the equations are weighted as
    for white noise on the outputs, for which these weights are optimal (refined instrumental variables). An equation with a
    missing output is left out. The covariance is (Z'Φ)^-1 S (Φ'Z)^-1 with S = Σ_kl z_k r_|k-l| z_l'. Here z_k is row k of Z,
    and r the autocovariance of an autoregression of the weighted residuals. For long records this is right for any colour of
    the noise.

    Cost: four rounds of O(T d log T) operations, with T samples and d parameters.

    Reference: L. Ljung, System Identification (1999) §7.6, §15.3; T. Söderström, P. Stoica (1983).

    >>> u = np.random.default_rng(1).normal(size=500)
    >>> plant = OutputError([-0.5], [1.0], noise_variance=0.04, dt=1)
    >>> fit = identify(InstrumentalVariables(1, 0), simulate(plant, u, seed=1).record)
    >>> bool(np.all(np.abs(fit.parameters - [-0.5, 1.0]) < 4 * fit.sigma))
    True
    """

    na: int = static()
    nb: int = static()
    _: KW_ONLY
    delay: int = static(default=0)
    offset: bool = static(default=False)

    cannot_weigh = "its noise is stationary, of any colour"
    in_a_loop = "biased"

    def __post_init__(self):
        LeastSquares(self.na, self.nb, delay=self.delay, offset=self.offset)

    @property
    def ordinary(self) -> LeastSquares:
        """The same equations by least squares."""
        return LeastSquares(self.na, self.nb, delay=self.delay, offset=self.offset)

    def fit(self, records: Sequence[Record]) -> Fit:
        """The fit to records of equal channels and step."""
        from scipy.linalg import block_diag

        first, faults = records[0], checks.Faults()
        check_records(records, faults)
        faults.finish()
        rows = self.ordinary.complete_rows(records)
        found = self.parameters(records, rows)
        θ = np.stack([one.θ for one in found])
        model = self._model(first, θ, [one.variance for one in found])
        names = arx_names(self.na, self.nb, first.inputs, first.outputs, self.offset)
        excitation = excitation_check(np.asarray(block_diag(*(one.information for one in found))), names)
        Σ = np.asarray(block_diag(*(one.covariance for one in found)))
        return Fit(model, θ.ravel(), Σ, names, validation_of(model, records, [excitation]), method=type(self).__name__)

    def parameters(self, records: Sequence[Record], rows: Sequence[OutputEquations]) -> list[Weighed]:
        """Alternating auxiliary model, weights and parameters."""
        θ = np.stack([regress(one.Φ, one.y).θ for one in rows])
        found: list[Weighed] = []
        for _ in range(ROUNDS):
            still = self._instruments(records, θ)
            found = [self._weighed(*three) for three in zip(rows, still, θ, strict=True)]
            θ = np.stack([one.θ for one in found])
        return found

    def _model(self, first: Record, θ: np.ndarray, noise: list[float]) -> ARX:
        lags = slice(self.na, self.na + len(first.inputs) * (self.nb + 1))
        return ARX(
            θ[:, : self.na], θ[:, lags].reshape(len(θ), -1, self.nb + 1), delay=self.delay, noise_variance=noise,
            offset=θ[:, -1] if self.offset else None, dt=float(first.dt or 0.0), inputs=first.inputs, outputs=first.outputs,
        )  # fmt: skip

    def _instruments(self, records: Sequence[Record], θ: np.ndarray) -> list[OutputEquations]:
        """The equations of noise-free outputs, from a stabilised model."""
        model = self._model(records[0], θ, [0.0] * len(θ))
        a = np.stack([np.asarray(stabilise(row)) if self.na else row for row in model.a])
        level = 0.0 if model.offset is None else model.offset / (1 + a.sum(axis=1))
        plant = replace(model.plant, a=a)
        still = [
            replace(one, y=plant.response(one.applied()) + level, u=one.applied(), arrived=None) for one in records
        ]
        return [self.ordinary.rows(still, i) for i in range(len(θ))]

    def _weighed(self, rows: OutputEquations, still: OutputEquations, θ: np.ndarray) -> Weighed:
        """(Z'R^-1 Φ)^-1 Z'R^-1 y of one output, R = T(a) T(a)'."""
        Z, a = (
            still.Φ[np.isin(still.at, rows.at)],
            np.append(1.0, np.asarray(stabilise(θ[: self.na])) if self.na else []),
        )
        r = np.correlate(a, a, mode="full")[self.na :]
        W, d = whitened(r, rows.at, np.column_stack([Z, rows.Φ, rows.y])), Z.shape[1]
        Z, Φ, y = W[:, :d], W[:, d : 2 * d], W[:, -1]
        scale = 1 / np.maximum(np.linalg.norm(Z, axis=0), np.finfo(float).tiny)
        inverse = np.linalg.pinv((Z * scale).T @ (Φ * scale)) * np.outer(scale, scale)
        new = inverse @ (Z.T @ y)
        e = y - Φ @ new
        S = float(e @ e) / max(len(y) - d, 1) * moments(Z, rows.at, colour(e, rows.at))
        e = rows.y - rows.Φ @ new
        return Weighed(new, inverse @ S @ inverse.T, float(e @ e) / max(len(e) - d, 1), Z.T @ Z)
