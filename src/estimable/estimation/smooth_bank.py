# pyright: reportUnknownArgumentType=false, reportUnknownLambdaType=false, reportUnknownMemberType=false
"""Smooth many records, or one by many algorithms, at once."""

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from .. import checks
from ..data.record import Record
from ..filters.linearised import Linearised
from ..filters.unknown_input import UnknownInput
from ..models.prior import Prior
from ..protocols import Smoothable
from ..results import EstimateBank, Stacked
from . import two_filters
from .declared_angles import ranged
from .estimate import check_options
from .estimate_bank import bind_bank, outcomes_of, several
from .following import bank_along_records
from .gaps import Given
from .smooth import check_smoothable


def smooth_bank(
    algorithms: Smoothable[Any] | Linearised | Stacked | Sequence[Smoothable[Any] | Linearised],
    records: Record | Stacked | Sequence[Record],
    *,
    prior: Prior | Stacked | Sequence[Prior],
    on_failure: str = "raise",
    engine: str = "auto",
    gaps: Given = "auto",
) -> EstimateBank:
    """Run a bank of smoothers over a fixed interval: row k of every run uses all samples of its record.

    Each of `algorithms`, `records` and `prior` is one (shared) or several, as in `estimate_bank`. `log_likelihood` is that of the
    filters. A fixed lag and `iterations` need `smooth`, run by run.

    Raises `InputError` with every fault of the call; `RunError` for the first run that failed, naming it.

    >>> model = StateSpace([[1.0]], C=[[1.0]], Q=[[0.0]], R=[[1.0]], dt=1)
    >>> records = stack([Record([[2.0], [4.0]], dt=1), Record([[4.0], [8.0]], dt=1)])
    >>> smooth_bank(Kalman(model), records, prior=Prior([0.0], [[1.0]])).mean[:, 0].ravel().round(6).tolist()
    [2.0, 4.0]
    """
    check_options(on_failure, engine, "all")
    parts = [several(part) for part in (algorithms, records, prior)]
    parts[0] = bank_along_records(_for_smoothing(parts[0]), parts[1])
    bound = bind_bank(*parts, gaps=gaps)
    if bound.hides_rows:
        checks.refuse("the records have gaps without any measured number: smooth them one by one, with smooth.")
    axes = tuple(0 if isinstance(part, Stacked) else None for part in parts)
    priors = parts[2].items if isinstance(parts[2], Stacked) else parts[2]
    ran, run = two_filters.of_bank(bound, priors, engine, axes)
    run = jax.tree_util.tree_map(np.asarray, jax.block_until_ready(run))
    outcomes = outcomes_of(run.code, bound.rows_at(run.failed_at), bound.t, on_failure)
    names = bound.names._replace(note="")
    return EstimateBank(ranged(run.info, names), bound.t, run.log_likelihood, tuple(outcomes), ran, names, bound.gaps)


def _for_smoothing(algorithms: Any) -> Any:
    """The algorithms in the form for the smoother. Raises `InputError` where one cannot be smoothed."""
    if not isinstance(algorithms, Stacked):
        check_smoothable(algorithms)
        return algorithms.for_smoothing
    items = algorithms.items
    forgetting = np.atleast_1d(items.forgetting if isinstance(items, Smoothable) else 1.0)
    worst = int(np.argmax(forgetting != 1.0))
    one = jax.tree_util.tree_map(lambda leaf: leaf[worst], items)
    check_smoothable(one)
    if isinstance(one, UnknownInput):
        checks.refuse("smooth_bank takes one UnknownInput and several records. Smooth several UnknownInput run by run.")
    _ = one.for_smoothing  # raises an error where there is none
    return algorithms
