"""The dead time of a plant, from one scan over all delays."""

from collections.abc import Callable, Sequence

import numpy as np

from .. import checks
from ..data.record import Record, several
from ..diagnostics.chi_squared import exceeded
from ..diagnostics.feedback import is_white
from ..errors import EstimableError
from ..identifiers.output_error_ml import OutputErrorML
from ..kernels.regression import lagged
from ..results import DeadTime
from .connected import known, parts_of

PAST, LAGS = 8, 4  # lags of y, and of each input from the delay on
WITHOUT_PAST = 16  # lags of each input where outputs are missing
COMPLETE = 0.75  # of the rows: below it, lags of y lose too many rows
WITHIN = 6.6  # of 2 log L: the delays that fit as well
MOST, LARGEST = 100, 10_000
SURE = 1e-3  # p-value from which no effect of the input is seen
EDGE = 4  # delays at the end of the scan that may be the foot of a larger one
SHORT = (1,)  # delays that are compared with the best of the scan where the input is not white
NEAR = 2  # delays next to those that fit as well, which output-error fits decide between


def dead_time(record: Record | Sequence[Record], *, most: int = MOST) -> DeadTime:
    """Find the number of samples after which the inputs begin to act on the outputs.

    `record`: one record, or a list. `most`: the largest delay that is tried. For each delay d the outputs are regressed on
    their own past and on the inputs from lag d on, all from one matrix of products; the delay with the smallest error is the
    dead time. It is common to all inputs and outputs. Where outputs are missing, their past is left out, and output-error
    fits decide between the delays that fit as well.

    Returns a `DeadTime`. Its `delay` is None where no effect of the input is seen within `most`; at the edge of the scan a
    larger delay may fit better, as its `sentence` states. Raises `InputError` with every fault of the call.

    Cost: one solution of some 20 equations for each delay: 25 ms for 100 delays and 1,500 rows.

    >>> u = np.random.default_rng(0).normal(size=400)
    >>> plant = OutputError([-0.5], [1.0], delay=17, noise_variance=0.1, dt=1)
    >>> dead_time(simulate(plant, u, seed=1).record).delay
    17
    """
    faults = checks.Faults()
    records = several("record", record, faults)
    faults.whole("most", most, 1, LARGEST)
    if records and not records[0].inputs:
        faults.add("`record` has no input: give `u`.")
    faults.finish()
    records, _ = known(parts_of(records))
    most = min(most, max(min(map(len, records)) // 4, 1))
    whole = np.concatenate([_whole(one, PAST) for one in records])
    complete = np.sum(whole) >= COMPLETE * max(len(whole), 1)
    error, p_value = _scan(records, most, PAST if complete else 0, LAGS if complete else WITHOUT_PAST)
    if error is None:
        return DeadTime(None, (), 1.0, False, most)
    best = int(np.argmin(error))
    alike = tuple(int(d) for d in np.flatnonzero(error - error[best] < WITHIN))
    p = min(1.0, p_value(best) * (most + 1))
    if p >= SURE:
        return DeadTime(None, (), p, False, most)
    if not complete or _earlier_is_likelier(records, best):
        best, alike = _by_output_error(records, alike if not complete else (*SHORT, *alike), most)
    return DeadTime(best, alike, p, max(best, *alike) > most - EDGE, most)


def _whole(record: Record, past: int) -> np.ndarray:
    """The rows whose outputs, and those of the `past` rows before them, were all seen."""
    seen = np.asarray(record.seen.all(axis=1))
    count = np.convolve(seen, np.ones(past + 1))[: len(seen)]
    return count[past:] == past + 1


def _scan(
    records: Sequence[Record], most: int, past: int, lags: int
) -> tuple[np.ndarray | None, Callable[[int], float]]:
    """-2 log L of each delay but for a constant, and the p-value of the input's part at one; None and 1 without rows."""
    m, p = len(records[0].inputs), len(records[0].outputs)
    blocks = [_block(record, most, past, lags) for record in records]
    Z = np.concatenate(blocks)
    if len(Z) < past * p + lags * m + 10:
        return None, lambda d: 1.0
    Z = Z / np.maximum(np.linalg.norm(Z, axis=0), np.finfo(float).tiny)
    gram, own, width = Z.T @ Z, 1 + past * p, most + lags
    targets = np.arange(own + m * width, Z.shape[1])

    def left(d: int | None) -> np.ndarray:
        """The squared errors of the outputs."""
        columns = list(range(own))
        if d is not None:
            columns += [own + j * width + d + lag for j in range(m) for lag in range(lags)]
        G, b = gram[np.ix_(columns, columns)], gram[np.ix_(columns, targets)]
        θ = np.linalg.solve(G + 1e-12 * np.eye(len(columns)), b)
        return np.maximum(np.diag(gram)[targets] - np.sum(b * θ, axis=0), np.finfo(float).tiny)

    N = len(Z)
    error = np.array([N * np.sum(np.log(left(d))) for d in range(most + 1)])
    without = N * np.sum(np.log(left(None)))
    return error, lambda d: float(exceeded(without - error[d], lags * m * p))


def _block(record: Record, most: int, past: int, lags: int) -> np.ndarray:
    """The complete rows: a constant, the past of the outputs, each input from lag 0 to the last, and the outputs."""
    y, u = record.y, record.applied()
    columns = [np.ones((len(y), 1)), *(lagged(one, range(1, past + 1)) for one in y.T)]
    columns += [lagged(one - np.nanmean(one), range(most + lags)) for one in u.T]
    Z = np.concatenate([*columns, y], axis=1)
    return Z[~np.isnan(Z).any(axis=1)]


def _earlier_is_likelier(records: Sequence[Record], best: int) -> bool:
    """Whether an output-error model with a short delay is likelier than one with the best delay of the scan.

    An input of few frequencies at a time, such as a sweep, can be matched at a wrong delay by lags of noisy outputs.
    """
    if best <= max(SHORT) or all(is_white(u) for one in records for u in one.applied().T):
        return False
    found = _likelihoods(records, (*SHORT, best))
    return bool(found) and min(found, key=lambda d: found[d]) != best


def _by_output_error(records: Sequence[Record], alike: tuple[int, ...], most: int) -> tuple[int, tuple[int, ...]]:
    """The delay whose output-error model is likeliest, and those within `WITHIN` of it."""
    near = sorted({d + step for d in alike for step in range(-NEAR, NEAR + 1) if 0 <= d + step <= most})
    found = _likelihoods(records, near)
    if not found:
        return alike[0], alike
    least = min(found.values())
    return min(found, key=lambda d: found[d]), tuple(d for d, value in found.items() if value - least < WITHIN)


def _likelihoods(records: Sequence[Record], delays: Sequence[int]) -> dict[int, float]:
    """-2 log L of an output-error model with each delay for which it can be fitted."""
    found = {}
    for d in delays:
        try:
            found[d] = -2 * OutputErrorML(2, 1, delay=d).fit(records).log_likelihood
        except EstimableError:
            continue
    return found
