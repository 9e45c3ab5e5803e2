"""The parameters of an ARX model whose outputs act on each other, by least squares."""

from collections.abc import Sequence
from dataclasses import KW_ONLY
from typing import NamedTuple

import numpy as np

from .. import checks
from ..analysis.excitation import excitation_check
from ..data.record import Record
from ..frozen import frozen, static
from ..kernels.regression import Regression, lagged, regress
from ..kernels.tangents import Dynamics, root
from ..models.state_space import StateSpace
from ..protocols import Identifier
from ..results import Fit
from .least_squares import NOT_THE_PLANT, LeastSquares
from .standing import validation_of


class JointEquations(NamedTuple):
    """Every equation of all records: Φ (N, d), the same for all outputs, Y (N, p); NaN where a value is missing."""

    Φ: np.ndarray
    Y: np.ndarray


@frozen
class CoupledLeastSquares(Identifier):
    """The parameters of an ARX model with a full matrix polynomial A, by least squares, from one record or several with gaps.

    Model: y[k] + Σ_{l=1..na} A_l y[k-l] = Σ_{l=0..nb} B_l u[k-delay-l] + c + e[k]. The A_l are (p, p), and e is white with
    the covariance Σ (p, p). `fit.model` is a `StateSpace` in innovations form with p max(na, nb + delay) states.

    Assumes right orders and white noise on the equations. `LeastSquares` gives each output its own polynomials
    (diagonal A_l): it has fewer parameters, but cannot describe noise that several outputs share. Feedback from outputs to
    inputs does no harm.

    Settings: `na`, `nb`: degrees of A and B (Ljung's (na, nb, nk) is (na, nb - 1, delay = nk) here); `delay` in steps;
    `offset`: whether a constant c is fitted to each output.

    An equation with a missing input, past output or own output is left out. `fit.parameters` holds those of one output after
    the other: a, then b input by input, then c. With Φ the matrix of regressors, their covariance is Σ ⊗ (Φ'Φ)^-1 where
    nothing is missing.

    Cost: O(T (p na + m nb)²) operations, with T samples, m inputs and p outputs.

    Reference: L. Ljung, System Identification (1999), (4.52)-(4.57).

    >>> model = StateSpace([[0.8, 0.1], [0.0, 0.5]], np.eye(2), np.eye(2), Q=np.zeros((2, 2)), R=np.zeros((2, 2)), dt=1)
    >>> u = np.random.default_rng(0).normal(size=(60, 2))
    >>> fit = identify(CoupledLeastSquares(1, 0, delay=1), simulate(model, u, seed=0).record)
    >>> fit.names[:2], fit.parameters[:2].round(9).tolist()
    (('a1_y1_y1', 'a1_y1_y2'), [-0.8, -0.1])
    """

    na: int = static()
    nb: int = static()
    _: KW_ONLY
    delay: int = static(default=0)
    offset: bool = static(default=False)

    takes_unknown_inputs = True  # equations with one are left out
    cannot_weigh = "its noise is that of the equations, not of single samples"

    def __post_init__(self):
        LeastSquares(self.na, self.nb, delay=self.delay, offset=self.offset)

    def fit(self, records: Sequence[Record]) -> Fit:
        """The fit to records of equal channels and step. Raises `InputError` where an output has no complete equation."""
        rows, first = self._rows(records), records[0]
        found = self._regressions(rows, first)
        θ = np.stack([one.θ for one in found])
        Σ = _noise(rows, θ)
        covariance = _covariance(rows, found, Σ)
        free = _diagonal([one.undetermined for one in found])
        names = self._names(first)
        M = _diagonal([one.information / max(r, 1e-300) for one, r in zip(found, np.diagonal(Σ), strict=True)])
        excitation = excitation_check(M, names, free)
        model = self._model(first, θ, Σ)
        columns = root(covariance)
        extra = {"tangents": self._tangents(first, θ, columns)} if columns.shape[1] and not free.shape[1] else {}
        return Fit(
            model, θ.ravel(), covariance, names, validation_of(model, records, [excitation], NOT_THE_PLANT), None, None,
            free if free.shape[1] else None, method=type(self).__name__, extra=extra,
        )  # fmt: skip

    def _rows(self, records: Sequence[Record]) -> JointEquations:
        found, lags = [], range(self.delay, self.delay + self.nb + 1)
        for record in records:
            columns = [-lagged(y, range(1, self.na + 1)) for y in record.y.T]
            columns += [lagged(u, lags) for u in record.applied().T]
            found.append(np.concatenate([*columns, np.ones((len(record), int(self.offset)))], axis=1))
        return JointEquations(np.concatenate(found), np.concatenate([record.y for record in records]))

    def _regressions(self, rows: JointEquations, first: Record) -> list[Regression]:
        faults, found = checks.Faults(), []
        for name, y in zip(first.outputs, rows.Y.T, strict=True):
            complete = ~np.isnan(rows.Φ).any(axis=1) & ~np.isnan(y)
            if not complete.any():
                needed = max(self.na, self.nb + self.delay) + 1
                faults.add(
                    f"output {name} has no equation without missing values: it needs {needed} rows without "
                    "a gap in any output and input. Lower the orders, or use LeastSquares."
                )
            found.append(regress(rows.Φ[complete], y[complete]))
        faults.finish()
        return found

    def _names(self, first: Record) -> tuple[str, ...]:
        names = []
        for y in first.outputs:
            names += [f"a{lag}_{y}_{other}" for other in first.outputs for lag in range(1, self.na + 1)]
            names += [f"b{lag}_{y}_{u}" for u in first.inputs for lag in range(self.nb + 1)]
            names += [f"c_{y}"] if self.offset else []
        return tuple(names)

    def _parts(self, θ: np.ndarray, m: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A_1.. (L, p, p) and B_0 .. (L+1, p, m) with the delay in them, and c (p,)."""
        p, L = len(θ), max(self.na, self.nb + self.delay, 1)
        A, B = np.zeros((L, p, p)), np.zeros((L + 1, p, m))
        A[: self.na] = θ[:, : p * self.na].reshape(p, p, self.na).transpose(2, 0, 1)
        lags = θ[:, p * self.na : p * self.na + m * (self.nb + 1)].reshape(p, m, self.nb + 1)
        B[self.delay : self.delay + self.nb + 1] = lags.transpose(2, 0, 1)
        return A, B, θ[:, -1] if self.offset else np.zeros(p)

    def _dynamics(self, θ: np.ndarray, m: int) -> Dynamics:
        """In block observer form."""
        A, B, _ = self._parts(θ, m)
        L, p, _ = A.shape
        companion = np.concatenate([-A.reshape(L * p, p), np.eye(L * p)[:, : (L - 1) * p]], axis=1)
        return Dynamics(companion, (B[1:] - A @ B[0]).reshape(L * p, m), np.eye(p, L * p), B[0])

    def _model(self, first: Record, θ: np.ndarray, Σ: np.ndarray) -> StateSpace:
        A, _, c = self._parts(θ, len(first.inputs))
        found = self._dynamics(θ, len(first.inputs))
        point = None
        if self.offset:
            level = np.linalg.lstsq(np.eye(len(c)) + A.sum(axis=0), c, rcond=None)[0]
            point = {"states": np.zeros(len(found.A)), "outputs": level}
        return StateSpace(
            *found, G=-A.reshape(-1, A.shape[1]), Q=Σ, R=Σ, S=Σ, dt=float(first.dt or 0.0), inputs=first.inputs,
            outputs=first.outputs, operating_point=point,
        )  # fmt: skip

    def _tangents(self, first: Record, θ: np.ndarray, columns: np.ndarray) -> Dynamics:
        """Central differences by the columns of a factor of the covariance: exact, as the matrices are of second degree in θ."""
        moves = []
        for column in columns.T:
            up, down = (self._dynamics(θ + side * column.reshape(θ.shape), len(first.inputs)) for side in (1, -1))
            moves.append([(above - below) / 2 for above, below in zip(up, down, strict=True)])
        return Dynamics(*(np.stack(one) for one in zip(*moves, strict=True)))


def _noise(rows: JointEquations, θ: np.ndarray) -> np.ndarray:
    """The covariance of the residuals, over complete equations; of each output alone where there are none."""
    e = rows.Y - rows.Φ @ θ.T
    complete = e[~np.isnan(e).any(axis=1)]
    spare = len(complete) - θ.shape[1]
    if spare > 0:
        return complete.T @ complete / spare
    return np.diag(np.nansum(e**2, axis=0) / np.maximum((~np.isnan(e)).sum(axis=0) - θ.shape[1], 1))


def _covariance(rows: JointEquations, found: Sequence[Regression], Σ: np.ndarray) -> np.ndarray:
    """Σ_ij (Φ_i'Φ_i)^+ Φ_i'Φ_j (Φ_j'Φ_j)^+ for each pair of outputs, Φ_i'Φ_j over the equations of both."""
    d = rows.Φ.shape[1]
    known = np.logical_and(~np.isnan(rows.Y), ~np.isnan(rows.Φ).any(axis=1, keepdims=True))
    total = np.zeros((len(found) * d, len(found) * d))
    for i, one in enumerate(found):
        for j, other in enumerate(found):
            Φ = rows.Φ[known[:, i] & known[:, j]]
            block = Σ[i, j] * one.inverse @ (Φ.T @ Φ) @ other.inverse
            total[i * d : (i + 1) * d, j * d : (j + 1) * d] = block
    return (total + total.T) / 2


def _diagonal(blocks: Sequence[np.ndarray]) -> np.ndarray:
    from scipy.linalg import block_diag

    return np.asarray(block_diag(*blocks))
