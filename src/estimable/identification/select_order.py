"""The choice of an order by information criteria, cross-validation and singular values, side by side."""

from collections.abc import Iterable, Sequence
from itertools import islice
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..data.record import Record, several
from ..errors import EstimableError
from ..identifiers.least_squares import LeastSquares, OutputEquations
from ..identifiers.subspace import Subspace
from ..kernels.regression import regress
from ..results.order_selection import CRITERIA, OrderSelection
from .connected import parts_of

FOLDS = 5
MOST = 1000  # most orders or delays to try
TINY = np.finfo(float).tiny


def select_order(
    record: Record | Sequence[Record], *, orders: Iterable[int] = range(1, 9), delays: Iterable[int] = range(6),
    criterion: str = "bic",
) -> OrderSelection:  # fmt: skip
    """Recommend an order for a linear model, and show the criteria behind the recommendation.

    For each order n an ARX model with na = nb + 1 = n and the best of `delays` is fitted; without inputs, an AR model. With N
    equations, k parameters per output, residuals e, and D = Σ N log(mean e²) over the outputs, the criteria are AIC = D + 2 k,
    AICc = D + 2 k N / (N - k - 1) and BIC = D + k log N. Where samples are missing, a larger order has fewer complete
    equations: each step to the next order is judged on the equations that both have, and the steps are added. An order with
    fewer than 2 n + 8 equations, and every larger one, is infinite. `cross_validation` is N log of the mean squared error over
    five blocks of data, each predicted by a fit to the other four. A subspace model (`Subspace`) gives singular values, whose
    gap also shows the order. BIC finds the true order of long records; AIC and cross-validation choose the model that predicts
    best.

    Returns an `OrderSelection`. Raises `InputError` with every fault of the call, or where the records are too short for the
    smallest order.

    Reference: H. Akaike (1974); C. Hurvich, C.-L. Tsai (1989) for AICc; G. Schwarz (1978).

    >>> plant = ARX([-1.2, 0.5], [1.0, 0.4], delay=1, noise_variance=0.04, dt=0.5)
    >>> u = np.random.default_rng(0).normal(size=400)
    >>> found = select_order(simulate(plant.to_state_space(), u, seed=0).record)
    >>> found.order, found.delay, found.gap
    (2, 1, 2)
    """
    records, tried, lags = _read(record, orders, delays, criterion)
    found = [_best(records, n, lags) for n in tried]
    criteria = _by_pairs(found, len(records[0].inputs))
    columns = {name: np.array([getattr(one, name) for one in criteria]) for name in _Criteria._fields}
    if not np.isfinite(columns["bic"]).any():
        checks.refuse(
            f"the record is too short for order {min(tried)}: it has {checks.counted(_seen(records), 'sample')}. "
            "An order n needs 2 n + 8 rows without a gap before them."
        )
    delays = np.array([lags[0] if one is None else one.delay for one in found])
    values = _singular_values(records, max(tried))
    gap = None if values is None else _gap(values, max(tried))
    best = tried[int(np.argmin(columns[criterion]))]
    return OrderSelection(
        np.array(tried), delays, **columns, singular_values=values, gap=gap, order=best, criterion=criterion
    )


def _read(
    record: Record | Sequence[Record], orders: Iterable[int], delays: Iterable[int], criterion: str
) -> tuple[list[Record], list[int], list[int]]:
    faults = checks.Faults()
    records = several("record", record, faults)
    ranges = []
    for name, given, least in (("orders", orders, 1), ("delays", delays, 0)):
        ranges.append(to_try(name, given, least, faults))
    faults.choice("criterion", criterion, CRITERIA)
    faults.finish()
    tried, lags = ranges
    return parts_of(records), tried, lags if records[0].inputs else lags[:1]


def to_try(name: str, given: Iterable[int] | int, least: int, faults: checks.Faults) -> list[int]:
    """The orders or delays to try, in increasing order: one integer, or several."""
    values: list[Any] = [given]
    if isinstance(given, Iterable) and getattr(given, "ndim", 1) == 1 and not isinstance(given, bytes | bytearray):
        values = list(islice(given, MOST + 1))
    if not values:
        faults.add(f"`{name}` must hold at least one number to try.")
    before = len(faults.sentences)
    for value in values[:MOST]:
        faults.whole(name, value, least, checks.LARGEST_ORDER)
    if len(values) > MOST:
        faults.add(f"`{name}` must hold at most {MOST} numbers to try.")
    return sorted(int(value) for value in values) if len(faults.sentences) == before else []


class _Equations(NamedTuple):
    """The complete ARX equations of each output at one order and its best delay; `at` holds the row of each, over all records."""

    order: int
    delay: int
    rows: list[OutputEquations]

    def at_rows(self, common: Sequence[np.ndarray]) -> list[OutputEquations]:
        """Those of the given rows of each output."""
        chosen = [np.isin(one.at, rows) for one, rows in zip(self.rows, common, strict=True)]
        return [
            OutputEquations(one.Φ[keep], one.y[keep], one.at[keep]) for one, keep in zip(self.rows, chosen, strict=True)
        ]


def _best(records: Sequence[Record], n: int, delays: Sequence[int]) -> _Equations | None:
    """The equations at order n with the delay of the smallest residuals; None where there are too few for every delay."""
    tried = []
    for delay in delays:
        rows = [_rows(records, n, delay, i) for i in range(len(records[0].outputs))]
        if min(len(one.y) for one in rows) >= max(2 * n + 8, rows[0].Φ.shape[1] + 2):
            tried.append((sum(_log_square(regress(one.Φ, one.y).e) for one in rows), delay, rows))
    if not tried:
        return None
    _, delay, rows = min(tried, key=lambda one: one[0])
    return _Equations(n, delay, rows)


def _rows(records: Sequence[Record], n: int, delay: int, i: int) -> OutputEquations:
    """The complete equations of output i; rows are counted over all records, alike at every order."""
    found, start = [], 0
    for record in records:
        one = LeastSquares(n, n - 1, delay=delay).rows([record], i)
        found.append(one._replace(at=one.at + start))
        start += len(record)
    return OutputEquations(*(np.concatenate(columns) for columns in zip(*found, strict=True)))


class _Criteria(NamedTuple):
    """AIC, AICc, BIC and cross-validation."""

    aic: float
    aicc: float
    bic: float
    cross_validation: float


NONE = _Criteria(np.inf, np.inf, np.inf, np.inf)


def _by_pairs(found: Sequence[_Equations | None], inputs: int) -> list[_Criteria]:
    """The criteria at each order: running sums of what the step from an order to the next adds on the rows that both can use.

    A larger order has fewer complete equations where samples are missing, so that sums over the rows of each would compare
    different data. An order without equations ends the sums.
    """
    criteria, before, total = [], None, NONE
    for one in found:
        if one is None:
            return criteria + [NONE] * (len(found) - len(criteria))
        if before is None:
            total = _sums(one.rows, one.order * (1 + inputs))
        else:
            common = [np.intersect1d(a.at, b.at) for a, b in zip(before.rows, one.rows, strict=True)]
            k, more = (each.order * (1 + inputs) for each in (before, one))
            if min(len(rows) for rows in common) < more + 2:
                return criteria + [NONE] * (len(found) - len(criteria))
            smaller, larger = (_sums(each.at_rows(common), size) for each, size in ((before, k), (one, more)))
            total = _Criteria(*(np.array(total) + np.array(larger) - np.array(smaller)))
        criteria.append(total)
        before = one
    return criteria


def _sums(rows: Sequence[OutputEquations], k: int) -> _Criteria:
    """The criteria on these equations, for k parameters of each output."""
    deviance = held_out = aic = aicc = bic = 0.0
    for one in rows:
        N = len(one.y)
        deviance += N * _log_square(regress(one.Φ, one.y).e)
        held_out += N * _log_square(_held_out(one))
        aic, aicc, bic = aic + 2 * k, aicc + 2 * k * N / max(N - k - 1, 1), bic + k * np.log(N)
    return _Criteria(deviance + aic, deviance + aicc, deviance + bic, held_out)


def _log_square(e: np.ndarray) -> float:
    """The logarithm of the mean square."""
    return float(np.log(max(float(e @ e) / len(e), TINY)))


def _seen(records: Sequence[Record]) -> int:
    """The average number of samples of an output."""
    return round(sum(int(record.seen.sum()) for record in records) / len(records[0].outputs))


def _held_out(rows: OutputEquations) -> np.ndarray:
    """The residuals of each fifth, predicted by a fit to the other four."""
    found = []
    for block in np.array_split(np.arange(len(rows.y)), FOLDS):
        others = np.setdiff1d(np.arange(len(rows.y)), block)
        found.append(rows.y[block] - rows.Φ[block] @ regress(rows.Φ[others], rows.y[others]).θ)
    return np.concatenate(found)


def _singular_values(records: Sequence[Record], order: int) -> np.ndarray | None:
    for n in range(order, 0, -1):
        try:
            return Subspace(n).model(records)[1]
        except (EstimableError, np.linalg.LinAlgError):
            continue
    return None


def _gap(values: np.ndarray, most: int) -> int:
    """The order before the largest step of the logarithms, among those above the noise."""
    logs = np.log(np.maximum(values[: most + 1], TINY))
    return 1 + int(np.argmax(logs[:-1] - logs[1:]))
