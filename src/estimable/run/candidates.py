"""Which methods to compare where nobody says: one of each kind, with orders chosen on the same records by BIC."""

from collections.abc import Callable, Sequence
from itertools import product
from typing import Any

import numpy as np

from ..data.record import Record
from ..errors import EstimableError
from ..identifiers.ho_kalman import HoKalman
from ..identifiers.least_squares import LeastSquares
from ..identifiers.output_error_ml import OutputErrorML
from ..identifiers.subspace import Subspace
from .choose_orders import choose_orders

MOST = 6  # order tried of ARX and state-space models
DELAYS = range(6)


def candidates(records: Sequence[Record]) -> tuple[Any, ...]:
    """ARX, output error, two subspace methods and Ho-Kalman, with the orders that BIC chooses.

    The delay is that of the best ARX model. A kind that the records do not bear is left out.
    """
    found: list[Any] = []
    arx = _tried(lambda: _best_arx(records))
    if arx is not None:
        found.append(arx)
        delay = arx.delay
        orders = _tried(lambda: choose_orders(list(records), delay=(delay,), initial="free").best)
        if orders is not None:
            found.append(OutputErrorML(orders.na, orders.nb, delay=orders.delay, initial="free"))
    for weighting in ("moesp", "cva"):
        order = _tried(lambda weighting=weighting: best_order(records, weighting))
        if order is not None:
            found.append(Subspace(order, weighting=weighting))
            if weighting == "moesp":
                found.append(HoKalman(order))
    return tuple(found)


def _tried(choose: Callable[[], Any]) -> Any:
    """What is chosen; None where the records do not bear it."""
    try:
        return choose()
    except (EstimableError, np.linalg.LinAlgError):
        return None


def _best_arx(records: Sequence[Record]) -> LeastSquares:
    """The smallest BIC over na = nb + 1 up to `MOST`, and delays."""
    tried = [LeastSquares(n, n - 1, delay=delay) for n, delay in product(range(1, MOST + 1), DELAYS)]
    m, p = len(records[0].inputs), len(records[0].outputs)
    scores = [
        _bic(records, _tried(lambda one=one: one.model(records).noise_variance), p * one.na * (1 + m)) for one in tried
    ]
    return tried[int(np.argmin(scores))]


def best_order(records: Sequence[Record], weighting: str) -> int:
    """The smallest BIC of the innovations over orders up to `MOST`."""
    m, p = len(records[0].inputs), len(records[0].outputs)
    scores = []
    for n in range(1, MOST + 1):
        model = _tried(lambda n=n: Subspace(n, weighting=weighting).model(records)[0])
        variance = None if model is None else np.linalg.eigvalsh(np.asarray(model.R))
        scores.append(_bic(records, variance, n * (m + 2 * p) + m * p))
    if not np.isfinite(scores).any():
        Subspace(1, weighting=weighting).model(records)  # says why
    return 1 + int(np.argmin(scores))


def _bic(records: Sequence[Record], variance: Any, parameters: int) -> float:
    """N log det of the residuals' covariance and k log N; infinite where there is no model."""
    N = max(sum(int(record.seen.any(axis=1).sum()) for record in records), 1)
    if variance is None:
        return np.inf
    return N * float(np.sum(np.log(np.maximum(variance, np.finfo(float).tiny)))) + parameters * np.log(N)
