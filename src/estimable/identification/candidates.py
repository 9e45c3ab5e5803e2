"""The default methods of a comparison: one of each kind, with orders chosen on the same records by BIC."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..data.record import Record
from ..errors import EstimableError
from ..identifiers.ho_kalman import HoKalman
from ..identifiers.least_squares import LeastSquares
from ..identifiers.output_error_ml import OutputErrorML
from ..identifiers.subspace import Subspace
from .choose_orders import choose_orders
from .connected import known
from .dead_time import dead_time
from .select_order import select_order

DELAYS = 6  # tried in any case
NEAR = 2  # delays tried on either side of the dead time
MOST = 6  # order tried of ARX and state-space models


def candidates(
    records: Sequence[Record], order: int | None = None, tell: Callable[[str], object] = lambda what: None
) -> tuple[Any, ...]:
    """ARX, output error, two subspace methods and Ho-Kalman, of a given order, or of the orders that BIC chooses.

    The delay is that of the best ARX model. A kind for which the records are too short is left out.
    `tell` is called with what is chosen next.
    """
    found: list[Any] = []
    logged, _ = known(records)
    tried = range(1, MOST + 1) if order is None else (order,)
    tell("the dead time")
    late = _tried(lambda: dead_time(list(logged)))
    far = [] if late is None or late.delay is None else range(max(late.delay - NEAR, 0), late.delay + NEAR + 1)
    delays = sorted({*range(DELAYS), *far})
    tell("the order of ARX")
    selection = _tried(lambda: select_order(list(logged), orders=tried, delays=delays))
    if selection is not None:
        n, delay = selection.order, selection.delay
        found.append(LeastSquares(n, n - 1, delay=delay))
        na, nb = ((1, 2, 3), (0, 1, 2)) if order is None else ((n,), (n - 1,))
        tell("the orders of output error")
        chosen = _tried(lambda: choose_orders(list(records), na=na, nb=nb, delay=(delay,), initial="free").best)
        if chosen is not None:
            found.append(OutputErrorML(chosen.na, chosen.nb, delay=chosen.delay, initial="free"))
    for weighting in ("moesp", "cva"):
        tell(f"the order of {weighting} subspaces")
        best = _tried(lambda weighting=weighting: best_order(logged, weighting, tried))
        if best is not None:
            found.append(Subspace(best, weighting=weighting))
            if weighting == "moesp":
                found.append(HoKalman(best))
    return tuple(found)


def _tried(choose: Callable[[], Any]) -> Any:
    """The choice; None where the records are too short for it."""
    try:
        return choose()
    except (EstimableError, np.linalg.LinAlgError):
        return None


def best_order(records: Sequence[Record], weighting: str, orders: Sequence[int] = range(1, MOST + 1)) -> int:
    """The order with the smallest BIC of the innovations."""
    m, p = len(records[0].inputs), len(records[0].outputs)
    scores = []
    for n in orders:
        model = _tried(lambda n=n: Subspace(n, weighting=weighting).model(records)[0])
        variance = None if model is None else np.linalg.eigvalsh(np.asarray(model.R))
        scores.append(_bic(records, variance, n * (m + 2 * p) + m * p))
    if not np.isfinite(scores).any():
        Subspace(orders[0], weighting=weighting).model(records)  # raises the reason
    return orders[int(np.argmin(scores))]


def _bic(records: Sequence[Record], variance: np.ndarray | None, parameters: int) -> float:
    """N log det of the residuals' covariance and k log N; infinite where there is no model."""
    N = max(sum(int(record.seen.any(axis=1).sum()) for record in records), 1)
    if variance is None:
        return np.inf
    return N * float(np.sum(np.log(np.maximum(variance, np.finfo(float).tiny)))) + parameters * np.log(N)
