"""The parameters of an ARMAX model by prediction errors: maximum likelihood, from incomplete records."""

from collections.abc import Sequence
from dataclasses import KW_ONLY
from typing import NamedTuple

import numpy as np

from .. import checks
from ..analysis.excitation import excitation_check
from ..annotations import Array
from ..data.record import Record
from ..diagnostics.cramer_rao import undetermined
from ..errors import InputError
from ..frozen import frozen, static
from ..kernels import armax_errors as kernel
from ..kernels.auxiliary_model import stabilise
from ..kernels.coloured_noise import colour, times
from ..kernels.impulse_start import Datum
from ..kernels.innovation_information import Search
from ..kernels.levenberg_marquardt import search, within
from ..kernels.realisation import markov
from ..kernels.regression import lagged, regress
from ..kernels.uncertain_input_likelihood import Companion, companion
from ..models.armax import ARMAX
from ..protocols import StartedIdentifier
from ..results import Check, Fit, Sample
from .least_squares import LeastSquares
from .one_output import FAR, coloured_covariance, covariance, marginal
from .output_error_ml import block_diagonal, by_output
from .predictor_subspace import PredictorSubspace
from .realised import check_lags, check_records
from .standing import validation_of
from .uncertain_inputs import STRIDE, UncertainInputStep
from .validation import search_checks, sigma_check

LONG = 3  # times na + nc: order of the ARX model whose residuals approximate e at the start
BOUND = 0.999  # of the modulus of a root of C
EDGE = BOUND * (1 - 1e-6)  # at the bound
CONVERGED = 1e-10  # relative change of parameters and sum of squares, and angle to the gradient, that end a search


class Ended(NamedTuple):
    """θ and pasts at the end of a search, the residuals there, their derivatives, the sum of the logarithms of V, and
    whether the search has converged."""

    x: np.ndarray
    e: np.ndarray
    J: np.ndarray
    cost: float
    log_variances: float
    converged: bool


@frozen
class PredictionError(StartedIdentifier):
    """The parameters of an ARMAX model by the prediction-error method, from one record or several with gaps.

    Model: `ARMAX`: A_i(z) y_i[k] = Σ_j B_ij(z) u_j[k] + C_i(z) e_i[k], e white; each output has its own polynomials.

    Assumes right orders and white Gaussian e. For other white noise it is still consistent where nothing is missing. The
    plant need not be at rest when a record begins: the past before row 0 is fitted too. Feedback from outputs to inputs does
    no harm. `OutputErrorML` is better for white noise on the outputs. With nc = 0 the method is `LeastSquares` without the
    loss of its first rows.

    Settings: `na`, `nb`, `nc`: degrees of A, B and C (Ljung's (na, nb, nc, nk) is (na, nb - 1, nc, delay = nk) here); `delay`
    in steps.

    Where all outputs were seen, the sum of squared prediction errors is minimised by the Levenberg-Marquardt method, with the
    roots of C inside .999: where one is at this bound, the check "invertibility" fails and c has no sigma. It starts from C = 1,
    from the residuals of a long ARX model (Hannan and Rissanen), and from `PredictorSubspace`. The covariance is H^-1 M H^-1
    with H = ψ'ψ, ψ the derivatives of the errors, and the spectrum of the errors in M; `fit.covariance_white` is σ² (ψ'ψ)^-1.
    Where outputs are missing, the likelihood of the seen ones is maximised by Fisher scoring, and the covariance is the inverse
    of the information. Both allow for the fitted past before row 0.

    Cost: about 15 passes over the T samples, each of O(T d) operations for d parameters: 20 ms at T = 1000, with gaps or
    without. Gaps need a second of compilation before.

    Reference: L. Ljung, System Identification (1999), §7.2, §10.2, §10.3; E. Hannan, J. Rissanen (1982).

    >>> u = np.random.default_rng(1).normal(size=500)
    >>> plant = ARMAX([-0.5], [1.0], [0.4], noise_variance=0.04, dt=1)
    >>> fit = identify(PredictionError(1, 0, 1), simulate(plant.to_state_space(), u, seed=1).record)
    >>> bool(np.all(np.abs(fit.parameters - plant.parameters) < 4 * fit.sigma))
    True
    """

    na: int = static()
    nb: int = static()
    nc: int = static()
    _: KW_ONLY
    delay: int = static(default=0)

    cannot_weigh = "its noise is that of the equations, not of single samples"
    fits_series = True

    def __post_init__(self):
        faults = checks.Faults()
        for name in ("na", "nb", "nc", "delay"):
            faults.whole(name, getattr(self, name), 0, checks.LARGEST_ORDER)
        faults.finish()

    @property
    def past(self) -> int:
        """The number of values that represent the past before a record."""
        return max(self.na, self.nb + self.delay, self.nc)

    def starter(self, records: Sequence[Record]) -> None:
        """None: each search has its own starts."""

    def fit(self, records: Sequence[Record], start: Array | None = None, search: Search | None = None) -> Fit:
        """The fit to records of equal channels and step; `search` where outputs are missing: `identify` gives it."""
        self.check(records)
        data = by_output(records)
        if search is None and not all(one.seen.all() for each in data for one in each):
            checks.refuse(
                "outputs are missing: use identify(PredictionError(...), record), which searches the likelihood then."
            )
        ends = [self.search(each, search) for each in data]
        return self._assembled(records, ends, self.na + self.nc + len(records[0].inputs) * (self.nb + 1))

    def check(self, records: Sequence[Record]) -> None:
        """Check that the records are regular, and each output was seen more often than there are unknowns."""
        faults, first = checks.Faults(), records[0]
        check_records(records, faults)
        check_lags(self, records, faults)
        d = self.na + self.nc + len(first.inputs) * (self.nb + 1)
        for i, name in enumerate(first.outputs):
            seen = sum(int(record.seen[:, i].sum()) for record in records)
            if seen <= d + self.past * len(records):
                faults.add(
                    f"output {name} was seen {checks.counted(seen, 'time')}: {d + self.past * len(records) + 1} are needed for "
                    f"{checks.counted(d, 'parameter')} and the past before row 0. Lower the orders."
                )
        faults.finish()

    def search(self, data: Sequence[Datum], climb: Search | None = None) -> Ended:
        """The best of the searches, for one output."""
        starts = [self._begun(data, θ) for θ in self._starts(data)]
        if climb is not None and not all(one.seen.all() for one in data):
            return min((self._searched_in_gaps(data, x, climb) for x in starts), key=lambda end: end.cost)
        return min((self._searched(data, x) for x in starts), key=lambda end: end.cost)

    def _begun(self, data: Sequence[Datum], θ: np.ndarray) -> np.ndarray:
        """θ with C made stable, and nothing before row 0."""
        c = θ[len(θ) - self.nc :]
        stable = np.asarray(stabilise(c)) if self.nc else c
        return np.concatenate([θ[: len(θ) - self.nc], stable, np.zeros(self.past * len(data))])

    def _starts(self, data: Sequence[Datum]) -> list[np.ndarray]:
        """Least squares with C = 1; and, on the longest record, with the residuals of a long ARX model instead of e."""
        records = [Record(one.y, one.u, dt=1) for one in data]
        ordinary = LeastSquares(self.na, self.nb, delay=self.delay)
        rows = ordinary.complete_rows(records)[0]
        starts = [np.concatenate([regress(rows.Φ, rows.y).θ, np.zeros(self.nc)]), *self._subspace_start(records)]
        order, longest = LONG * (self.na + self.nc), max(records, key=len)
        long = LeastSquares(order, order, delay=self.delay).rows([longest], 0)
        if not self.nc or len(long.y) < 2 * long.Φ.shape[1]:
            return starts
        e, rows = np.full(len(longest), np.nan), ordinary.rows([longest], 0)
        e[long.at] = regress(long.Φ, long.y).e
        columns = np.concatenate([rows.Φ, lagged(e, range(1, self.nc + 1))[rows.at]], axis=1)
        known = ~np.isnan(columns).any(axis=1)
        if known.sum() > 2 * columns.shape[1]:
            starts.append(regress(columns[known], rows.y[known]).θ)
        return starts

    def _subspace_start(self, records: Sequence[Record]) -> list[np.ndarray]:
        """The polynomials of an SSARX model: A and C have the eigenvalues of A and of A - K C; none where it cannot be fitted."""
        n = max(self.na, self.nc)
        if not self.nc:
            return []
        try:
            found = PredictorSubspace(n, blocks=0).innovations_form(records)
        except InputError:
            return []
        A, B, C, K = found[:4]
        a, c = np.poly(A).real, np.poly(A - K @ C).real
        M = markov(A, B, C, np.zeros((1, B.shape[1])), self.delay + self.nb)[:, 0]
        b = [np.convolve(a, response)[self.delay : self.delay + self.nb + 1] for response in M.T]
        return [np.concatenate([a[1 : self.na + 1], *b, c[1 : self.nc + 1]])]

    def _searched(self, data: Sequence[Datum], start: np.ndarray) -> Ended:
        d = len(start) - self.past * len(data)

        def inside(x: np.ndarray) -> np.ndarray:
            return np.concatenate([x[: d - self.nc], within(x[d - self.nc : d], BOUND), x[d:]])

        found = search(lambda x: self._errors(data, x), lambda x: self._slopes(data, x), start, inside, CONVERGED)
        return Ended(found.x, found.e, self._slopes(data, found.x), found.cost, 0.0, found.converged)

    def _searched_in_gaps(self, data: Sequence[Datum], start: np.ndarray, climb: Search) -> Ended:
        """The search by the likelihood of the seen samples; its last unknown is log r."""
        variance = np.var(np.concatenate([one.y[one.seen] for one in data])) / 2 or 1.0
        stride = np.append(np.full(len(start), np.inf), STRIDE)

        def build(θ: np.ndarray, i: int) -> tuple[UncertainInputStep, np.ndarray]:
            a, b, c, z = self._parts(θ[:-1], data[i].u.shape[1], i)
            return _step(a, b, c, self.delay, np.exp(θ[-1] / 2), z)

        found = climb(build, [_rows(one) for one in data], np.append(start, np.log(variance)), stride)
        r, pairs = float(np.exp(found.θ[-1])), zip(data, found.innovations, strict=True)
        e, V = np.concatenate([np.stack([e[one.seen, 0], V[one.seen, 0, 0] / r], 1) for one, (e, V) in pairs]).T
        e = e / np.sqrt(V) * np.exp(np.log(V).mean() / 2)
        cost = float(e @ e) / 2
        values, vectors = np.linalg.eigh(marginal(found.information, len(start)))
        J = (vectors * np.sqrt(np.maximum(values, 0) * 2 * cost / max(len(e) - len(start), 1))).T
        return Ended(found.θ[:-1], e, J, cost, float(np.log(V).sum()), found.converged)

    def _parts(self, x: np.ndarray, m: int, i: int) -> tuple[np.ndarray, ...]:
        """a, b, c and the past of record i."""
        na, nb, d = self.na, m * (self.nb + 1), self.na + m * (self.nb + 1) + self.nc
        return (
            x[:na], x[na : na + nb].reshape(m, self.nb + 1), x[na + nb : d], x[d + i * self.past : d + (i + 1) * self.past],
        )  # fmt: skip

    def _errors(self, data: Sequence[Datum], x: np.ndarray) -> np.ndarray:
        """The errors of complete records."""
        parts = [self._parts(x, one.u.shape[1], i) for i, one in enumerate(data)]
        found = [
            kernel.errors(a, b, c, self.delay, one.u, one.y, z) for one, (a, b, c, z) in zip(data, parts, strict=True)
        ]
        return np.clip(np.concatenate(found), -FAR, FAR)

    def _slopes(self, data: Sequence[Datum], x: np.ndarray) -> np.ndarray:
        blocks, pasts = [], self.past * len(data)
        for i, one in enumerate(data):
            a, b, c, z = self._parts(x, one.u.shape[1], i)
            ε = kernel.errors(a, b, c, self.delay, one.u, one.y, z)
            ψ = kernel.slopes(c, (self.na, self.nb, self.nc), self.delay, one.u, one.y, ε, self.past)
            d = ψ.shape[1] - self.past
            block = np.zeros((len(ε), d + pasts))
            block[:, :d], block[:, d + i * self.past : d + (i + 1) * self.past] = ψ[:, :d], ψ[:, d:]
            blocks.append(block)
        return np.clip(np.concatenate(blocks), -FAR, FAR)

    def _assembled(self, records: Sequence[Record], ends: list[Ended], d: int) -> Fit:
        first, m = records[0], len(records[0].inputs)
        variances = [2 * end.cost / max(len(end.e) - len(end.x), 1) for end in ends]
        parts = [self._parts(end.x, m, 0) for end in ends]
        a, b, c = (np.stack([part[k] for part in parts]) for k in range(3))
        size = [np.exp(-end.log_variances / len(end.e)) for end in ends]  # what the errors were scaled by
        noise = [max(r * s, np.finfo(float).tiny) for r, s in zip(variances, size, strict=True)]
        model = ARMAX(
            a,
            b,
            c,
            delay=self.delay,
            noise_variance=noise,
            dt=float(first.dt or 0.0),
            inputs=first.inputs,
            outputs=first.outputs,
        )
        information, spread = zip(*(self._accuracy(records, i, end, d) for i, end in enumerate(ends)), strict=True)
        M, Σ, names = block_diagonal(list(information)), block_diagonal(list(spread)), model.parameter_names
        free, white = undetermined(M), covariance(M)
        extra = [excitation_check(M, names, free), sigma_check(Σ, white, names), *search_checks(ends)]
        extra += [
            _invertibility_check(name, row) for name, row in zip(first.outputs, c, strict=True) if _largest(row) >= EDGE
        ]
        free = np.linalg.qr(np.concatenate([free, np.eye(len(M))[:, self._noise_at_its_bound(c, d)]], axis=1))[0]
        likelihood = sum(map(_log_likelihood, ends))
        return Fit(
            model, model.parameters, Σ, names, validation_of(model, records, extra), None,
            likelihood, free if free.shape[1] else None, method=type(self).__name__,
            covariance_white=white,
        )  # fmt: skip

    def _noise_at_its_bound(self, c: np.ndarray, d: int) -> list[int]:
        """Where c of an output with a root at the bound is in the parameters: it has no standard deviation."""
        return [i * d + d - j - 1 for i, row in enumerate(c) if _largest(row) >= EDGE for j in range(self.nc)]

    def _accuracy(self, records: Sequence[Record], i: int, end: Ended, d: int) -> tuple[np.ndarray, np.ndarray]:
        """The information about θ, and its covariance under the spectrum of the errors; where outputs are missing, the inverse
        of the information."""
        r = max(2 * end.cost / max(len(end.e) - len(end.x), 1), 1e-300)
        if not all(record.seen[:, i].all() for record in records):
            M = marginal(end.J.T @ end.J / r, d)
            return M, covariance(M)
        at = times([np.ones(len(one), bool) for one in records])
        return coloured_covariance(end.J, d, colour(end.e, at), at, r)


def _largest(c: np.ndarray) -> float:
    """The largest modulus of a root of C."""
    return float(np.abs(np.roots(np.append(1.0, c))).max(initial=0.0))


def _invertibility_check(name: str, c: np.ndarray) -> Check:
    sentence = (
        f"Invertibility: C of {name} is at its bound: a root has modulus {_largest(c):.4g}. There is no process noise, or the "
        "signals were differenced: use OutputErrorML. The coefficients c have no standard deviation."
    )
    return Check("invertibility", False, _largest(c), BOUND, sentence)


def _step(
    a: np.ndarray, b: np.ndarray, c: np.ndarray, delay: int, σ: complex, z: np.ndarray
) -> tuple[UncertainInputStep, np.ndarray]:
    """The innovations form, with e / σ as one more input, of variance 1; and the state that responds as to the impulses z."""
    n = max(len(a), len(c), b.shape[1] - 1 + delay, 1)
    a, c, z = (np.concatenate([part, np.zeros(n - len(part))]) for part in (a, c, z))
    F, G, D, _ = companion(a, b, delay, 0.0)
    return UncertainInputStep(Companion(F, np.column_stack([G, σ * (c - a)]), np.append(D, σ), 0.0)), z


def _rows(datum: Datum) -> Sample:
    """The rows of a record, with the innovation as one more input."""
    u = np.column_stack([datum.u, np.zeros(len(datum.u))])
    y, variance = np.where(datum.seen, datum.y, 0.0), np.zeros(u.shape)
    variance[:, -1] = 1.0
    return Sample(y[:, None], datum.seen[:, None], u, None, variance)


def _log_likelihood(end: Ended) -> float:
    N = len(end.e)
    return -0.5 * (N * (np.log(2 * np.pi * max(2 * end.cost / N, 1e-300)) + 1))
