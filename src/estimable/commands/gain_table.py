"""Several gains as one table, and the loss of each that would have been detected, interval by interval."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ..diagnostics import gain_rows, sentence_of
from ..phrases import spread_of
from ..results import DetectableLoss, GainRow
from ..results.detectable import size_of
from ..results.gain_row import SIGMAS
from .gain_summary import by_name
from .run_filter import FilterRun

if TYPE_CHECKING:
    from rich.table import Table

HEADINGS = ("gain", "before", "after", "lost", "changed at", "verdict")


def rows_of(run: FilterRun) -> tuple[GainRow, ...]:
    """A row for each gain."""
    return gain_rows(run.result) if run.assessment is None else run.assessment.rows


def finding(run: FilterRun) -> str:
    """All gains in one sentence."""
    return sentence_of(rows_of(run))


def as_data(run: FilterRun) -> list[dict[str, Any]]:
    """The rows as JSON."""
    return [{**row._asdict(), "phrase": row.phrase} for row in rows_of(run)]


def cells(row: GainRow, sign: str = "±") -> tuple[str, ...]:
    """What a row says, in the order of `HEADINGS`."""
    before, after = (
        spread_of(value, SIGMAS * sigma, sign=sign)
        for value, sigma in ((row.before, row.before_sigma), (row.after, row.after_sigma))
    )
    lost = row.lost.replace("±", sign) if row.effectiveness else ""
    return row.label, before, after, lost, row.when, row.verdict


def table(rows: tuple[GainRow, ...], sign: str) -> "Table":
    """One line for each gain, for the terminal."""
    from rich.table import Table

    found = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for heading in HEADINGS:
        found.add_column(heading, justify="right" if heading in ("before", "after", "lost") else "left")
    for row in rows:
        found.add_row(*cells(row, sign))
    return found


def shown(loss: DetectableLoss, rows: tuple[GainRow, ...]) -> tuple[str, ...]:
    """One sentence about the losses of the gains that did not change, and one about inputs that are still at the end."""
    quiet = [i for i, row in enumerate(rows) if not row.changed_at]
    found = []
    if quiet:
        largest, power = float(np.max(loss.loss[quiet, -1])), 100 * loss.power[-1]
        of = rows[quiet[0]].label if len(quiet) == 1 else "any other gain" if len(quiet) < len(rows) else "any gain"
        begun = f"that began at {loss.start:.4g} s"
        seen = f"would have been detected by {loss.end:.4g} s"
        found.append(
            f"A loss of {largest:.2g} of {of} {begun} {seen} with probability {power:.0f} %."
            if np.isfinite(largest)
            else f"Not every loss {begun} {seen}."
        )
    if loss.quiet:
        since = min(until for until, _ in loss.quiet.values())
        names = ", ".join(row.label for row in rows if row.gain in loss.quiet)
        found.append(f"After {since:.4g} s the input carries no information about {names}.")
    return tuple(found)


def detectable_table(loss: DetectableLoss, rows: tuple[GainRow, ...]) -> "Table":
    """The smallest loss of each gain that begins with an interval and would have been detected before its end."""
    from rich.table import Table

    found = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    found.add_column("interval [s]")
    for row in rows:
        found.add_column(row.label, justify="right")
    for one in loss.intervals:
        found.add_row(f"{one.start:.4g} to {one.end:.4g}", *map(size_of, one.loss[:, -1]))
    return found


def loss_as_data(loss: DetectableLoss) -> dict[str, Any]:
    """The smallest loss, of the whole record and of each interval, as JSON."""
    return {**_one(loss), "intervals": [_one(one) for one in loss.intervals]}


def _one(loss: DetectableLoss) -> dict[str, Any]:
    return {
        "start_s": loss.start, "end_s": loss.end, "power": loss.power,
        "loss": by_name(loss.gains, loss.loss[:, -1]), "floor_sigma": by_name(loss.gains, loss.floor_sigma),
    }  # fmt: skip
