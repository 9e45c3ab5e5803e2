# pyright: reportUnknownArgumentType=false, reportUnknownLambdaType=false, reportUnknownMemberType=false
"""Run many estimators, or one over many records, at once."""

from collections.abc import Sequence
from typing import Any, TypeAlias

import jax
import numpy as np

from .. import checks
from ..data.record import Record
from ..data.record_arguments import UNIFORM
from ..errors import RunError
from ..models.prior import Prior
from ..protocols import Algorithm
from ..results import EstimateBank, Outcome, Stacked
from . import windows
from .binding import Bound, bind, select
from .declared_angles import ranged
from .estimate import check_options
from .following import bank_along_records
from .gaps import Given
from .stack import stack

Part: TypeAlias = Algorithm[Any] | Record | Prior | Stacked | Sequence[Any] | None  # of a bank: one, or several


def estimate_bank(
    algorithms: Algorithm[Any] | Stacked | Sequence[Algorithm[Any]],
    records: Record | Stacked | Sequence[Record],
    *,
    prior: Prior | Stacked | Sequence[Prior] | None,
    on_failure: str = "raise",
    engine: str = "auto",
    keep: str = "all",
    gaps: Given = "auto",
) -> EstimateBank:
    """Run many estimators at once.

    Each of `algorithms`, `records` and `prior` is either one object, which all runs share, or several: a list, or a stack
    made by `stack`. All stacks have the same length B. Run i uses entry i of each stack. The records must have equal times.
    The other arguments are as in `estimate`. Run i equals a single run to rounding.

    Returns an `EstimateBank`, whose arrays have a leading axis of length B. Raises `InputError` with every fault of the call;
    `RunError` for the first run that failed, naming it.

    >>> model = StateSpace([[1.0]], C=[[1.0]], Q=[[0.0]], R=[[1.0]], dt=1)
    >>> records = stack([Record([[2.0]], dt=1), Record([[4.0]], dt=1)])
    >>> estimate_bank(Kalman(model), records, prior=Prior([0.0], [[1.0]])).mean.ravel().tolist()
    [1.0, 2.0]
    """
    check_options(on_failure, engine, keep)
    parts = [several(part) for part in (algorithms, records, prior)]
    parts[0] = bank_along_records(*parts[:2])
    bound = bind_bank(*parts, gaps=gaps)
    axes = tuple(0 if isinstance(part, Stacked) else None for part in parts)
    priors = prior_items.items if isinstance(prior_items := parts[2], Stacked) else prior_items
    rows = (bound.samples, bound.intervals)
    engine, run = windows.scan_bank(engine, bound.algorithm, priors, *rows, axes=axes, keep=keep, select=select)
    run = jax.tree_util.tree_map(np.asarray, jax.block_until_ready(run))
    outcomes = outcomes_of(run.code, bound.rows_at(run.failed_at), bound.t, on_failure)
    info = jax.tree_util.tree_map(lambda leaf: leaf[:, None], run.info) if keep == "last" else run.info
    t = bound.t if keep != "last" or bound.t is None else bound.t[..., -1:]
    info = ranged(info, bound.names) if keep == "last" else bound.expanded(info, axis=1)
    return EstimateBank(info, t, run.log_likelihood, tuple(outcomes), engine, bound.names, bound.gaps)


def bind_bank(
    algorithms: Algorithm[Any] | Stacked | Sequence[Algorithm[Any]],
    records: Record | Stacked | Sequence[Record],
    prior: Prior | Stacked | Sequence[Prior] | None,
    gaps: Given = "auto",
) -> Bound:
    """Check the first run like a single one, then bind the numbers of all."""
    parts = {"algorithms": algorithms, "records": records, "prior": prior}
    sizes = {name: len(part) for name, part in parts.items() if isinstance(part, Stacked)}
    if not sizes:
        checks.refuse(
            "nothing here is stacked: use estimate for one run, or stack([...]) algorithms, records or priors."
        )
    if len(set(sizes.values())) > 1:
        counted = ", ".join(f"`{name}` holds {size}" for name, size in sizes.items())
        checks.refuse(f"all stacked arguments must have the same size: {counted}.")
    bank = records.items if isinstance(records, Stacked) else None
    if isinstance(bank, Record):
        _check_times(bank)
    return bind(
        first_of(algorithms), first_of(records), first_of(prior), bank=bank,
        algorithms=algorithms.items if isinstance(algorithms, Stacked) else None, gaps=gaps,
    )  # fmt: skip


def several(part: Part) -> Any:
    """A list as a stack; anything else unchanged."""
    return stack(part) if isinstance(part, list | tuple) else part


def first_of(part: Part) -> Any:
    """The first of a stack, or the shared argument."""
    return jax.tree_util.tree_map(lambda leaf: leaf[0], part.items) if isinstance(part, Stacked) else part


def _check_times(bank: Record) -> None:
    """Check that the records of a bank have equal times."""
    if bank.t is None or bank.t.shape[-1] == 1 or (bank.t == bank.t[0]).all():
        return
    steps = np.diff(bank.t, axis=-1)
    apart = np.abs(steps - steps[0]).max(axis=-1) > UNIFORM * steps.min()
    if apart.any():
        checks.refuse(
            f"the records of a bank must have the same time steps: record {np.argmax(apart)} differs from record 0."
        )


def outcomes_of(codes: np.ndarray, failed_at: np.ndarray, times: np.ndarray | None, on_failure: str) -> list[Outcome]:
    """The outcome of every run. Raises `RunError` for the first run that failed, unless `on_failure` is "keep"."""
    outcomes = [Outcome.of(0, 0, None)] * len(codes)
    for i in np.flatnonzero(codes):
        t = times if times is None or times.ndim == 1 else times[i]
        outcomes[i] = Outcome.of(int(codes[i]), int(failed_at[i]), t)
        if on_failure == "raise":
            raise RunError(outcomes[i]._replace(sentence=f"Run {i}: {outcomes[i].sentence}"))
    return outcomes
