"""The choice of orders by information criteria, on incomplete data."""

from collections.abc import Iterable, Sequence
from itertools import product

import numpy as np

from .. import checks
from ..data.record import Record, several
from ..identifiers.output_error_ml import OutputErrorML
from ..results import Fit
from ..results.order_selection import OrderCandidate, OrderRanking
from .connected import parts_of
from .search import maximise
from .select_order import to_try

CRITERIA = ("aic", "aicc", "bic")


def choose_orders(
    record: Record | Sequence[Record], *, na: Iterable[int] = (1, 2, 3), nb: Iterable[int] = (0, 1, 2),
    delay: Iterable[int] = (0, 1), criterion: str = "bic", initial: str = "rest",
) -> OrderRanking:  # fmt: skip
    """Choose the orders of an output-error model by an information criterion.

    Every combination of the given `na`, `nb` and `delay` is fitted by `OutputErrorML` to the N seen outputs. The orders are
    degrees of the polynomials. For k parameters, one noise variance for each output included, the criteria are AIC = -2 log
    L + 2 k, AICC = AIC + 2 k (k + 1) / (N - k - 1) and BIC = -2 log L + k log N, with L the likelihood. BIC finds the true
    orders of long records; AIC chooses the model that predicts best.

    Returns an `OrderRanking`. Raises `InputError` with every fault of the call.

    Reference: H. Akaike (1974); G. Schwarz (1978).

    >>> plant = OutputError([-0.5], [1.0], delay=1, noise_variance=0.01, dt=1)
    >>> u = np.random.default_rng(1).normal(size=200)
    >>> found = choose_orders(simulate(plant, u, seed=1).record, na=(1, 2), nb=(0, 1))
    >>> (found.best.na, found.best.nb, found.best.delay)
    (1, 0, 1)
    """
    faults, ranges = checks.Faults(), {}
    faults.choice("criterion", criterion, CRITERIA)
    for name, given in (("na", na), ("nb", nb), ("delay", delay)):
        ranges[name] = to_try(name, given, 0, faults)
    records = several("record", record, faults)
    faults.finish()
    parts = parts_of(records)
    initial = "free" if len(parts) > len(records) else initial  # no part begins at rest
    found = [
        _candidate(parts, a, b, steps, initial) for a, b, steps in product(ranges["na"], ranges["nb"], ranges["delay"])
    ]
    return OrderRanking(tuple(sorted(found, key=lambda one: getattr(one, criterion))), criterion)


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def _candidate(records: list[Record], na: int, nb: int, delay: int, initial: str) -> OrderCandidate:
    fit = OutputErrorML(na, nb, delay=delay, initial=initial).fit(records, search=maximise)
    N = int(sum(record.seen.sum() for record in records))
    k = len(fit.parameters) + len(records[0].outputs)
    k += len(records) * len(records[0].outputs) * max(na, nb + delay) if initial == "free" else 0
    weighed = any(one.sigma is not None for one in records)
    deviance = -2 * (fit.log_likelihood if weighed else _likelihood(fit))
    correction = 2 * k * (k + 1) / (N - k - 1) if k + 1 < N else np.inf
    return OrderCandidate(
        na, nb, delay, deviance + 2 * k, deviance + 2 * k + correction, deviance + k * np.log(max(N, 1)), fit
    )


def _likelihood(fit: Fit) -> float:
    """The log-likelihood at the variance of maximum likelihood: the sum of squares over N, not over N - d."""
    total = 0.0
    for e in np.concatenate(fit.validation.residuals).T:
        seen = e[~np.isnan(e)]
        r = max(float(seen @ seen) / len(seen), np.finfo(float).tiny)
        total -= 0.5 * len(seen) * (np.log(2 * np.pi * r) + 1)
    return total
