"""The choice of an order by information criteria, cross-validation and singular values, side by side."""

from collections.abc import Iterable, Sequence
from itertools import islice
from typing import Any

import numpy as np

from .. import checks
from ..data.record import Record, several
from ..errors import EstimableError, InputError
from ..identifiers.least_squares import LeastSquares, OutputEquations
from ..identifiers.subspace import Subspace
from ..kernels.regression import regress
from ..results.order_selection import CRITERIA, OrderSelection

FOLDS = 5
MOST = 1000  # most orders or delays to try
TINY = np.finfo(float).tiny


def select_order(
    record: Record | Sequence[Record], *, orders: Iterable[int] = range(1, 9), delays: Iterable[int] = range(6),
    criterion: str = "bic",
) -> OrderSelection:  # fmt: skip
    """Recommend an order for a linear model, and show the criteria behind the recommendation.

    For each order n an ARX model with na = nb + 1 = n and the best of `delays` is fitted. With N samples, k parameters per
    output, residuals e, and D = Σ N log(mean e²) over the outputs, the criteria are AIC = D + 2 k, AICc = D + 2 k N / (N - k
    - 1) and BIC = D + k log N. `cross_validation` is N log of the mean squared error over five blocks of data, each predicted
      by a fit to the other four. A subspace model (`Subspace`) gives singular values, whose gap also shows the order. BIC
      finds the true order of long records; AIC and cross-validation choose the model that predicts best.

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
    names = ("delays", "aic", "aicc", "bic", "cross_validation")
    columns = {name: np.array(column) for name, column in zip(names, zip(*found, strict=True), strict=True)}
    if not np.isfinite(columns["bic"]).any():
        checks.refuse(
            f"the record is too short for order {min(tried)}: it has {checks.counted(_seen(records), 'sample')}."
        )
    values = _singular_values(records, max(tried))
    gap = None if values is None else _gap(values, max(tried))
    best = tried[int(np.argmin(columns[criterion]))]
    return OrderSelection(np.array(tried), **columns, singular_values=values, gap=gap, order=best, criterion=criterion)


def _read(
    record: Record | Sequence[Record], orders: Iterable[int], delays: Iterable[int], criterion: str
) -> tuple[list[Record], list[int], list[int]]:
    faults = checks.Faults()
    records = several("record", record, faults)
    if records and not records[0].inputs:
        faults.add("`record` has no input: give `u`.")
    ranges = []
    for name, given, least in (("orders", orders, 1), ("delays", delays, 0)):
        ranges.append(to_try(name, given, least, faults))
    faults.choice("criterion", criterion, CRITERIA)
    faults.finish()
    return records, *ranges


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


def _best(records: Sequence[Record], n: int, delays: Sequence[int]) -> tuple[int, float, float, float, float]:
    """The delay with the smallest residuals at order n; AIC, AICc, BIC and cross-validation there."""
    N, k, p = _seen(records), n * (1 + len(records[0].inputs)), len(records[0].outputs)
    tried = []
    for delay in delays:
        rows = _complete(records, n, delay)
        if rows is not None and min(len(one.y) for one in rows) > k + 1:
            tried.append((_deviance(N, [regress(one.Φ, one.y).e for one in rows]), delay, rows))
    if not tried:
        return delays[0], np.inf, np.inf, np.inf, np.inf
    deviance, delay, rows = min(tried, key=lambda one: one[0])
    left = max(N - k - 1, 1)
    corrected, bic = deviance + p * 2 * k * N / left, deviance + p * k * np.log(N)
    return delay, deviance + p * 2 * k, corrected, bic, _deviance(N, [_held_out(one) for one in rows])


def _complete(records: Sequence[Record], n: int, delay: int) -> list[OutputEquations] | None:
    try:
        return LeastSquares(n, n - 1, delay=delay).complete_rows(records)
    except InputError:
        return None


def _seen(records: Sequence[Record]) -> int:
    """The average number of samples of an output: the same for every order, for any number of complete equations."""
    return max(round(sum(int(record.seen.sum()) for record in records) / len(records[0].outputs)), 1)


def _deviance(N: int, residuals: Sequence[np.ndarray]) -> float:
    """N log of the mean square, of all outputs together."""
    return N * sum(float(np.log(max(float(e @ e) / len(e), TINY))) for e in residuals)


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
