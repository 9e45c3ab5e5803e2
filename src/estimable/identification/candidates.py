"""The default methods of a comparison: one of each kind, with orders chosen on the same records by BIC."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..data.record import Record
from ..errors import EstimableError
from ..identifiers.ho_kalman import HoKalman
from ..identifiers.instrumental_variables import InstrumentalVariables
from ..identifiers.least_squares import LeastSquares
from ..identifiers.output_error_ml import OutputErrorML
from ..identifiers.prediction_errors import PredictionError
from ..identifiers.predictor_subspace import WEIGHTINGS, PredictorSubspace
from ..identifiers.subspace import Subspace
from ..results.comparisons import Divided
from .choose_orders import choose_orders
from .connected import known
from .held_out import with_levels
from .ranking import Before
from .select_order import select_order

DELAYS = 6  # tried in any case
NEAR = 2  # delays tried on either side of the dead time
MOST, MOST_AR = 6, 12  # orders tried of ARX and state-space models, and of series without inputs


def candidates(
    task: Divided,
    before: Before,
    order: int | None = None,
    tell: Callable[[str], object] = lambda what: None,
) -> tuple[Any, ...]:
    """One method of each kind that suits the records, of a given order, or of the orders that BIC chooses.

    A kind for which the records are too short is left out. `tell` is called with what is chosen next.
    """
    records = task.first
    logged, _ = known(records)
    tried = range(1, MOST + 1) if order is None else (order,)
    if before.closed or not records[0].inputs:
        return _predictors(logged, before, tried, tell)
    found: list[Any] = []
    late = before.delay
    far = [] if late is None or late.delay is None else range(max(late.delay - NEAR, 0), late.delay + NEAR + 1)
    delays = sorted({*range(DELAYS), *far})
    tell("the order of ARX")
    selection = _tried(lambda: select_order(list(logged), orders=tried, delays=delays))
    if selection is not None:
        found += _polynomials(with_levels(task).first, selection.order, selection.delay, order, tell)
    for weighting in ("moesp", "cva"):
        tell(f"the order of {weighting} subspaces")
        best = _tried(lambda weighting=weighting: best_order(logged, weighting, tried))
        if best is not None:
            found.append(Subspace(best, weighting=weighting))
            if weighting == "moesp":
                found += [HoKalman(best), HoKalman(best, weighting="observer")]
    return tuple(found)


def _polynomials(
    records: Sequence[Record], n: int, delay: int, order: int | None, tell: Callable[[str], object]
) -> list[Any]:
    """ARX of order n; output error, ARMAX and instrumental variables of the orders that BIC chooses for output error."""
    found: list[Any] = [LeastSquares(n, n - 1, delay=delay)]
    na, nb = ((1, 2, 3), (0, 1, 2)) if order is None else ((n,), (n - 1,))
    tell("the orders of output error")
    chosen = _tried(lambda: choose_orders(list(records), na=na, nb=nb, delay=(delay,), initial="free").best)
    if chosen is not None:
        na, nb = chosen.na, chosen.nb
        found += [
            OutputErrorML(na, nb, delay=delay, initial="free"),
            PredictionError(na, nb, na, delay=delay),
            InstrumentalVariables(na, nb, delay=delay),
        ]
    return found


def _predictors(
    records: Sequence[Record], before: Before, tried: Sequence[int], tell: Callable[[str], object]
) -> tuple[Any, ...]:
    """Methods that predict one step ahead, which feedback does not bias; of series without inputs, AR, ARMA and subspaces."""
    found: list[Any] = []
    if not records[0].inputs:
        tell("the order of AR")
        selection = _tried(
            lambda: select_order(list(records), orders=range(1, MOST_AR + 1) if len(tried) > 1 else tried)
        )
        found += [] if selection is None else [LeastSquares(selection.order, 0)]
    for weighting in ("ssarx", "pbsid"):
        tell(f"the order of {weighting} subspaces")
        n = _tried(lambda weighting=weighting: best_order(records, weighting, tried))
        if n is None:
            continue
        if weighting == "ssarx":
            delay = 1 if before.delay is None or before.delay.delay is None else max(before.delay.delay, 1)
            found.append(PredictionError(n, n - 1, n, delay=delay if records[0].inputs else 0))
        found.append(PredictorSubspace(n, weighting=weighting))
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
    direct = 0 if weighting in WEIGHTINGS else m * p
    scores = []
    for n in orders:
        covariance = _tried(lambda n=n: _innovations(records, n, weighting))
        variance = None if covariance is None else np.linalg.eigvalsh(covariance)
        scores.append(_bic(records, variance, n * (m + 2 * p) + direct))
    if not np.isfinite(scores).any():
        _innovations(records, orders[0], weighting)  # raises the reason
    return orders[int(np.argmin(scores))]


def _innovations(records: Sequence[Record], n: int, weighting: str) -> np.ndarray:
    """The covariance of the innovations of a subspace model."""
    if weighting in WEIGHTINGS:
        return PredictorSubspace(n, weighting=weighting, blocks=0).innovations_form(records).Σ
    return np.asarray(Subspace(n, weighting=weighting).model(records)[0].R)


def _bic(records: Sequence[Record], variance: np.ndarray | None, parameters: int) -> float:
    """N log det of the residuals' covariance and k log N; infinite where there is no model."""
    N = max(sum(int(record.seen.any(axis=1).sum()) for record in records), 1)
    if variance is None:
        return np.inf
    return N * float(np.sum(np.log(np.maximum(variance, np.finfo(float).tiny)))) + parameters * np.log(N)
