"""The impulse response of a system by ordinary or generalised least squares."""

from collections.abc import Sequence
from dataclasses import KW_ONLY
from typing import Any

import numpy as np

from .. import checks
from ..analysis.excitation import excitation_check
from ..data.record import Record
from ..diagnostics.responses import spread_of
from ..frozen import frozen, set_field, static
from ..kernels.banded import autocovariance, whitened
from ..kernels.regression import Regression, regress
from ..kernels.tangents import Dynamics, impulse_moves
from ..models.arx import ARX
from ..protocols import Identifier
from ..results import Fit
from .coupled_least_squares import CoupledLeastSquares
from .least_squares import LeastSquares, OutputEquations, coloured_inverse
from .realised import at_starts, impulse_names, variances_of, whole
from .standing import validation_of

WEIGHTINGS = ("ordinary", "best", "observer")
ROUNDS = 3  # alternating the noise, from the residuals, and the response


@frozen
class MarkovParameters(Identifier):
    """The Markov parameters (impulse response) of a stable system by least squares, from one record or several with gaps.

    Model: y[k] = Σ_{j=0..length} M_j u[k-j] + c + v[k]. `fit.model` is an `ARX` with na = 0. For a state-space model M_0 = D
    and M_j = C A^(j-1) B.

    Assumes a response that dies out within `length` steps (the rest is taken as noise), an input that excites as many
    frequencies as there are parameters, and v white ("ordinary") or stationary ("best"). The order of the system need not be
    known. `HoKalman` reduces the result to a small model. Where an order is known, `Subspace` and `OutputErrorML` need far
    fewer data.

    Settings:

    - `length`: the number of steps of the response. `offset`: whether a constant c is fitted.
    - `weighting`: "ordinary": ordinary least squares. "best": generalised least squares with the (banded) covariance of
      stationary noise, the best linear unbiased estimate. "observer": the method OKID. It fits an ARX model with full
      matrices (`CoupledLeastSquares`), whose response is the result; the Markov parameters of this ARX model are those of a
      deadbeat observer. The response need not die out, so lightly damped and unstable plants with process noise are possible.
      The covariance follows to first order.
    - `noise_covariance`: for "best", the autocovariance r_0, r_1, .. of v in squared units, (q+1,) or (p, q+1). None: it is
      estimated from the residuals up to lag `length`, in three rounds.
    - `observer`: for "observer", the number of terms of the ARX model. None: half of `length`.

    Rows with a missing value are left out, for that output only; so are the first `length` of each record. With Φ the matrix
    of regressors and R the covariance of the noise, the covariance is that of `LeastSquares` ("ordinary": it holds in noise of
    any colour) or (Φ' R^-1 Φ)^-1 ("best").

    Cost: O(T d²) operations, with T samples, m inputs and d = m (length + 1); "best" adds O(T q²), with q lags.

    Reference: R. W. Bass (2005); A. C. Aitken (1935) for the best weights; J.-N. Juang et al. (1993) for OKID.

    >>> u = np.random.default_rng(0).normal(size=300)
    >>> record = simulate(OutputError([], [1.0, 0.5], noise_variance=1e-8, dt=1), u, seed=0).record
    >>> identify(MarkovParameters(2), record).parameters.round(3).tolist()
    [1.0, 0.5, 0.0]
    """

    length: int = static()
    _: KW_ONLY
    weighting: str = static(default="ordinary")
    noise_covariance: Any = None
    offset: bool = static(default=False)
    observer: int | None = static(default=None)

    takes_unknown_inputs = True  # equations with one are left out

    in_a_loop = "biased"

    def __post_init__(self):
        faults = checks.Faults()
        faults.whole("length", self.length, 0, checks.LARGEST_ORDER)
        faults.flag("offset", self.offset)
        known = faults.choice("weighting", self.weighting, WEIGHTINGS)
        r = self.noise_covariance
        if r is not None:
            r = faults.numbers("noise_covariance", r)
            r = None if r is None else faults.array("noise_covariance", np.atleast_2d(r), "p lags")
            if known and self.weighting != "best":
                faults.add('`noise_covariance` belongs to weighting = "best": ordinary least squares does not use it.')
            if r is not None and not (r.size and np.all(r[:, 0] > 0)):
                faults.add(
                    f"`noise_covariance` must begin with variances greater than 0. Got {checks.short(r[:, :1].ravel().tolist())}."
                )
        whole("observer", self.observer, 1, faults)
        if known and self.observer is not None and self.weighting != "observer":
            faults.add('`observer` belongs to weighting = "observer".')
        faults.finish()
        set_field(self, noise_covariance=r)

    @property
    def cannot_weigh(self) -> str:  # type: ignore[override]
        """Why samples cannot be weighed: noise that has a covariance in time has that of all rows."""
        return "" if self.weighting == "ordinary" else f'its weighting "{self.weighting}" takes the noise as stationary'

    def fit(self, records: Sequence[Record]) -> Fit:
        """The fit to records of equal channels and step."""
        from scipy.linalg import block_diag

        if self.weighting == "observer":
            return self._observed(records)
        first, p = records[0], len(records[0].outputs)
        equations = LeastSquares(0, self.length, offset=self.offset)
        self._check(p)
        plain, starts = equations.complete_rows(records), equations.starts(records)
        noises = [variances_of(records, i) for i in range(p)]
        rows = [one if v is None else _weighed(one, at_starts(v, starts)) for one, v in zip(plain, noises, strict=True)]
        found = [self._regressed(one, i) for i, one in enumerate(rows)]
        θ = np.stack([one.θ for one in found])
        d = len(first.inputs) * (self.length + 1)
        noise = [float(np.mean((one.y - one.Φ @ fit.θ) ** 2)) for one, fit in zip(plain, found, strict=True)]
        model = ARX(
            np.zeros((p, 0)), θ[:, :d].reshape(p, -1, self.length + 1), noise_variance=noise, dt=float(first.dt or 0.0),
            offset=θ[:, -1] if self.offset else None, inputs=first.inputs, outputs=first.outputs,
        )  # fmt: skip
        ordinary = self.weighting == "ordinary"
        known = [
            1.0 if v is not None or not ordinary else None for v in noises
        ]  # the variance of the equations, once weighted
        white = [fit.inverse * (fit.variance if one is None else one) for fit, one in zip(found, known, strict=True)]
        spread = [coloured_inverse(*three) for three in zip(rows, found, known, strict=True)] if ordinary else white
        free, M = (
            np.asarray(block_diag(*parts))
            for parts in zip(*((f.undetermined, f.information) for f in found), strict=True)
        )
        names = impulse_names(self.length, first.inputs, first.outputs)
        if self.offset:
            names = tuple(n for i, y in enumerate(first.outputs) for n in (*names[i * d : (i + 1) * d], f"c_{y}"))
        excitation = excitation_check(M, names, free)
        return Fit(
            model, θ.ravel(), np.asarray(block_diag(*spread)), names, validation_of(model, records, [excitation]),
            undetermined=free if free.shape[1] else None, method=type(self).__name__,
            covariance_white=np.asarray(block_diag(*white)) if ordinary else None,
        )  # fmt: skip

    def _observed(self, records: Sequence[Record]) -> Fit:
        """OKID: the impulse response of an ARX model with full matrices, and the covariance that follows."""
        first, terms = records[0], self.observer or max(self.length // 2, 1)
        fitted = CoupledLeastSquares(terms, terms, offset=self.offset).fit(records)
        found = spread_of(fitted)
        M, dM = impulse_moves(found.dynamics, found.tangents, self.length)
        b, columns = M.transpose(1, 2, 0), np.moveaxis(dM, 1, -1).reshape(len(dM), M.size)
        point, p = fitted.model.operating_point, len(first.outputs)
        offset = None if point is None else np.asarray(point.outputs)
        noise = np.nanmean(np.concatenate(fitted.validation.residuals) ** 2, axis=0)
        model = ARX(
            np.zeros((p, 0)), b, noise_variance=noise, dt=float(first.dt or 0.0), offset=offset, inputs=first.inputs,
            outputs=first.outputs,
        )  # fmt: skip
        names, Σ = impulse_names(self.length, first.inputs, first.outputs), columns.T @ columns
        checked = [check for check in fitted.validation.checks if check.name == "excitation"]
        return Fit(
            model, b.ravel(), Σ if found.known else None, names, validation_of(model, records, checked),
            method=type(self).__name__, extra={"tangents": _response_tangents(model, dM)} if found.known else None,
        )  # fmt: skip

    def _check(self, p: int) -> None:
        given = self.noise_covariance
        if given is not None and len(given) not in (1, p):
            checks.refuse(
                f"`noise_covariance` must have a row for each of {checks.counted(p, 'output')}. Got {len(given)}."
            )

    def _regressed(self, rows: OutputEquations, i: int) -> Regression:
        """The regression of one output; weighted equations have noise of variance 1."""
        found = regress(rows.Φ, rows.y)
        if self.weighting == "ordinary":
            return found
        given = self.noise_covariance
        for _ in range(ROUNDS if given is None else 1):
            e = rows.y - rows.Φ @ found.θ
            r = autocovariance(e, rows.at, self.length) if given is None else given[i % len(given)]
            found = self._weighted(rows, r)
        return found

    def _weighted(self, rows: OutputEquations, r: np.ndarray) -> Regression:
        r = np.append(max(r[0] * (1 + 1e-9), np.finfo(float).tiny), r[1:])
        try:
            both = whitened(r, rows.at, np.column_stack([rows.Φ, rows.y]))
        except np.linalg.LinAlgError:
            checks.refuse(
                "`noise_covariance` is not the autocovariance of any noise: its matrix must be positive definite."
            )
        return regress(both[:, :-1], both[:, -1])


def _weighed(rows: OutputEquations, variances: np.ndarray) -> OutputEquations:
    """The equations with noise of variance 1."""
    σ = np.sqrt(variances[rows.at])
    return rows._replace(Φ=rows.Φ / σ[:, None], y=rows.y / σ)


def _response_tangents(model: ARX, dM: np.ndarray) -> Dynamics:
    """Moves (r, ..) of the matrices of a model given by its impulse response."""
    still = model.to_state_space()
    A, _, C, _ = (np.asarray(getattr(still, name)) for name in "ABCD")
    r, m = len(dM), dM.shape[-1]
    B = dM[:, 1:].transpose(0, 2, 1, 3).reshape(r, -1, m)
    if B.shape[1] != len(A):
        B = np.pad(B, ((0, 0), (0, len(A) - B.shape[1]), (0, 0)))
    return Dynamics(np.zeros((r, *A.shape)), B, np.zeros((r, *C.shape)), dM[:, 0])
