"""The tables and figures of the sources, as JSON and as text."""

from pathlib import Path
from typing import Any

from .. import checks, reproductions, writing
from ..phrases import decimals
from ..reproductions import Reproduced, ReproducedRow, Reproduction
from . import show


def list_all(machine: bool) -> None:
    """Every table and figure, with its status."""
    entries = reproductions.ENTRIES
    if machine:
        listed = [{**_named(entry), "reproduced": entry.compute is not None} for entry in entries]
        show.data("reproduce", {"outcome": {"code": 0, "sentence": ""}, "entries": listed})
        return
    show.text(lambda _: [_contents(), *_summary()])
    show.notes("", "One of them:", "  estimable reproduce sillence-table-2")


def write_figure(entry: Reproduction, result: Reproduced, figure: Path) -> str:
    """Write the figure and return the message."""
    if result.figure is None:
        checks.refuse(f"{entry.name} has no figure: leave --figure out.")
    drawing = result.figure()
    drawing.update_layout(title={"text": f"{entry.source}: {entry.title}", "font": {"size": 17}}, margin={"t": 60})
    page = drawing.to_html(include_plotlyjs=True, config={"displayModeBar": False, "responsive": True})
    writing.write(figure, lambda stream: stream.write(page.encode()), option="--figure")
    return f"Wrote {figure}."


def as_data(entry: Reproduction, result: Reproduced, figure: Path | None) -> dict[str, Any]:
    """What `reproduce NAME` prints as JSON."""
    return {
        "outcome": {"code": 0, "sentence": ""},
        **_named(entry),
        "rows": [row._asdict() for row in result.rows],
        "remarks": result.remarks,
        "figure": None if figure is None else str(figure),
    }


def as_text(entry: Reproduction, result: Reproduced) -> list[Any]:
    """What `reproduce NAME` prints as text."""
    draws = max(row.draws for row in result.rows)
    headings = ("", "published", "ours", *(["± 1 sigma"] if draws else []))
    table = _table(headings, numbers=len(headings) - 1)
    for row in result.rows:
        unit = f" [{row.unit}]" if row.unit else ""
        published = "" if row.published is None else f"{row.published:g}"
        table.add_row(row.quantity + unit, published, *_ours(row)[: len(headings) - 2])
    over = [f"Mean and 1 sigma over {draws} draws."] if draws else []
    return [f"{entry.source}, {entry.name}: {entry.title}", "", table, *over, *result.remarks]


def _ours(row: ReproducedRow) -> tuple[str, str]:
    """Mean and sigma, to the digits that the sigma justifies; without a sigma, the mean to six digits."""
    if row.sigma is None:
        return ("never" if row.mean != row.mean else f"{row.mean:.6g}"), ""
    digits = decimals(row.sigma)
    return f"{row.mean:.{digits}f}", f"{row.sigma:.{digits}f}"


def _named(entry: Reproduction) -> dict[str, Any]:
    return {"name": entry.name, "source": entry.source, "title": entry.title, "status": entry.status}


def _contents() -> Any:
    table = _table(("name", "what", "status"), numbers=0)
    for entry in reproductions.ENTRIES:
        table.add_row(entry.name, entry.title, entry.status)
    return table


def _summary() -> list[str]:
    done = sum(entry.compute is not None for entry in reproductions.ENTRIES)
    return ["", f"{done} of {len(reproductions.ENTRIES)} tables and figures are reproduced."]


def _table(headings: tuple[str, ...], *, numbers: int) -> Any:
    """A table whose last `numbers` columns are numbers, which are never wrapped."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), show_edge=False)
    for i, heading in enumerate(headings):
        is_number = i >= len(headings) - numbers
        table.add_column(
            heading, justify="right" if is_number else "left", no_wrap=is_number or (i == 0 and not numbers)
        )
    return table
