"""The parameters of an output-error model by weighted least squares, iterated."""

from collections.abc import Sequence
from dataclasses import KW_ONLY
from typing import NamedTuple

import numpy as np

from .. import checks
from ..data.record import Record
from ..frozen import frozen, replace, static
from ..kernels.banded import whitened
from ..kernels.regression import regress
from ..models.output_error import OutputError
from ..protocols import Identifier
from ..results import Fit
from .least_squares import LeastSquares, OutputEquations
from .realised import at_starts, check_lags, check_records, variances_of
from .standing import validation_of

ROUNDS = 200  # alternating weights and parameters, at most
CONVERGED = 1e-10  # relative change of the parameters that ends the rounds


class Weighted(NamedTuple):
    """θ (d,) of one output, the variance of v, and the last change of θ relative to it."""

    θ: np.ndarray
    variance: float
    change: float


@frozen
class MinimumVariance(Identifier):
    """The parameters of an output-error model by least squares, with weights that are iterated
    (the method of Steiglitz and McBride).

    Model: `OutputError`, as the equation A(z) y = B(z) u + A(z) v. The noise of this equation, A(z) v, has a banded
    covariance, with which the equation is weighted.

    Assumes right orders, a stable plant, and white v. The weights need the unknown A, hence the iteration. The result is
    consistent for white v only. A single round is biased, because the regressors are noisy. With another noise, or many gaps,
    `OutputErrorML` is better: it is consistent, and efficient where v is white.

    Settings: `na`, `nb`: degrees of A and B (Ljung's (na, nb, nk) is (na, nb - 1, delay = nk) here); `delay` in steps.

    An equation with a missing output is left out, and the covariance of the noise of the others is exact. The covariance of
    the estimate is σ² (Ψ'Ψ)^-1 Φ'Φ (Ψ'Ψ)^-1, with Φ the weighted regressors and Ψ the same without noise. It is exact for
    long records. The covariance of weighted least squares with known regressors, σ² (Φ'Φ)^-1, would be too small.

    Cost: some 10 rounds of O(T d²) operations, with T samples and d parameters. No (T, T) matrix is formed.

    Reference: J. Sillence (1999) ch. 2; K. Steiglitz, L. McBride (1965); P. Stoica, T. Söderström (1981).

    >>> u = np.random.default_rng(1).normal(size=500)
    >>> plant = OutputError([-0.5], [1.0], noise_variance=0.01, dt=1)
    >>> fit = identify(MinimumVariance(1, 0), simulate(plant, u, seed=1).record)
    >>> bool(abs(fit.parameters[0] + 0.5) < 4 * fit.sigma[0])
    True
    """

    na: int = static()
    nb: int = static()
    _: KW_ONLY
    delay: int = static(default=0)

    cannot_weigh = ""
    in_a_loop = "biased"

    def __post_init__(self):
        faults = checks.Faults()
        for name in ("na", "nb", "delay"):
            faults.whole(name, getattr(self, name), 0, checks.LARGEST_ORDER)
        faults.finish()

    def fit(self, records: Sequence[Record]) -> Fit:
        """The fit to records of equal channels and step. Raises `InputError` where the weights do not converge."""
        from scipy.linalg import block_diag

        first, faults = records[0], checks.Faults()
        check_records(records, faults)
        check_lags(self, records, faults)
        faults.finish()
        ordinary = LeastSquares(self.na, self.nb, delay=self.delay)
        rows = ordinary.complete_rows(records)
        starts = ordinary.starts(records)
        noises = [None if (v := variances_of(records, i)) is None else at_starts(v, starts) for i in range(len(rows))]
        found = [self._iterated(one, w) for one, w in zip(rows, noises, strict=True)]
        for name, one in zip(first.outputs, found, strict=True):
            if one.change > np.sqrt(CONVERGED):
                faults.add(
                    f"output {name}: the weights do not converge: after {ROUNDS} rounds the parameters still change by "
                    f"{one.change:.1g} of their size. Lower the orders, or use OutputErrorML."
                )
        faults.finish()
        noise = [one.variance if w is None else float(np.nanmean(w)) for one, w in zip(found, noises, strict=True)]
        model = OutputError.of_parameters(
            np.concatenate([one.θ for one in found]), na=self.na, nb=self.nb, delay=self.delay,
            noise_variance=noise, dt=float(first.dt or 0.0), inputs=first.inputs, outputs=first.outputs,
        )  # fmt: skip
        still = ordinary.complete_rows(_without_noise(model, records))
        spread = [self._covariance(*four) for four in zip(rows, still, found, noises, strict=True)]
        return Fit(
            model, model.parameters, np.asarray(block_diag(*spread)), model.parameter_names, validation_of(model, records),
            method=type(self).__name__,
        )  # fmt: skip

    def _iterated(self, rows: OutputEquations, w: np.ndarray | None) -> Weighted:
        """Alternating weights and parameters."""
        θ, change, variance = regress(rows.Φ, rows.y).θ, np.inf, 0.0
        for _ in range(ROUNDS):
            W = self._weigh(θ, w, rows.at, np.column_stack([rows.Φ, rows.y]))
            found = regress(W[:, :-1], W[:, -1])
            change = float(np.linalg.norm(found.θ - θ) / max(np.linalg.norm(found.θ), np.finfo(float).tiny))
            θ, variance = found.θ, found.variance
            if change < CONVERGED:
                break
        return Weighted(θ, variance, change)

    def _weigh(self, θ: np.ndarray, w: np.ndarray | None, at: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Rows whitened by the covariance T(a) W T(a)', with W = I or the variances w: r_jk = Σ_i a_i a_(i+j) w_(k-i)."""
        a = np.append(1.0, θ[: self.na])
        if w is None:
            return whitened(np.correlate(a, a, mode="full")[self.na :], at, X)
        late = w[at - np.arange(len(a))[:, None]]
        return whitened(np.stack([(a[: len(a) - j] * a[j:]) @ late[: len(a) - j] for j in range(len(a))]), at, X)

    def _covariance(
        self, rows: OutputEquations, still: OutputEquations, found: Weighted, w: np.ndarray | None
    ) -> np.ndarray:
        """The covariance of one output; `still`: the same equations at more rows, of outputs without noise."""
        Φ = self._weigh(found.θ, w, rows.at, rows.Φ)
        Ψ = self._weigh(found.θ, w, rows.at, still.Φ[np.isin(still.at, rows.at)])
        inverse = regress(Ψ, Ψ[:, 0]).inverse
        return (found.variance if w is None else 1.0) * inverse @ (Φ.T @ Φ) @ inverse


def _without_noise(model: OutputError, records: Sequence[Record]) -> list[Record]:
    """The records with the outputs of the model, from rest."""
    return [replace(record, y=model.response(record.applied())) for record in records]
