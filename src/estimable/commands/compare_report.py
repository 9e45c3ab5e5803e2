"""What `estimable identify` says when it compares methods."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ..data.record import Record
from ..run.compare import Comparison, Ranked
from .identify_report import read
from .numbers import counted


class Compared(NamedTuple):
    """A comparison, and what was compared on."""

    path: Path
    record: Record
    split: float
    found: Comparison


def compared(
    path: Path, *, outputs: Sequence[str], inputs: Sequence[str], split: float, reading: dict[str, Any],
    progress: Callable[[str], None] | None,
) -> Compared:  # fmt: skip
    """Read the record, and compare the methods that suit it."""
    from ..run.compare import compare

    record = read(path, outputs, inputs, reading)
    return Compared(path, record, split, compare(None, record, split=split, progress=progress))


def as_data(run: Compared) -> dict[str, Any]:
    """What a comparison says to a machine: `best` is null where no linear model explains the record."""
    best = run.found.best
    return {
        "outcome": {"code": 0, "sentence": run.found.sentence},
        "record": str(run.path),
        "samples": len(run.record),
        "outputs_seen": int(run.record.seen.sum()),
        "split": run.split,
        "best": None if best is None else _short(best),
        "methods": [_long(one, run.record.outputs) for one in run.found.ranked],
    }


def _short(one: Ranked) -> dict[str, Any]:
    return {"method": one.name, "order": one.order, "fit_percent": one.fit_percent}


def _long(one: Ranked, outputs: Sequence[str]) -> dict[str, Any]:
    """One method; numbers are null where it failed, and `failure` says why."""
    if one.fit is None:
        return {"method": one.name, "order": None, "fit_percent": None, "failure": one.failure}
    return {
        **_short(one),
        "settings": settings(one),
        "fits": dict(zip(outputs, map(float, one.fits), strict=True)),
        "one_step_fits": dict(zip(outputs, map(float, one.one_step_fits), strict=True)),
        "behind": one.behind,
        "within_noise_of_best": one.alike,
        "checks": [check._asdict() | {"passed": bool(check.passed)} for check in one.fit.validation.checks],
        "failure": "",
    }


def settings(one: Ranked) -> dict[str, Any]:
    """The settings of a method that are plain numbers and words."""
    fields = {name: getattr(one.method, name) for name in type(one.method).__dataclass_fields__ if name != "_"}
    return {name: value for name, value in fields.items() if isinstance(value, bool | int | float | str)}


def as_text(run: Compared) -> list[Any]:
    """What a comparison says to people."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 2, 0, 0), show_edge=False)
    table.add_column("method")
    for name in ("order", "fit %", "one step %", "behind"):
        table.add_column(name, justify="right")
    for one in run.found.ranked:
        if one.fit is not None:
            behind = f"{one.behind:.1f}" + (" (noise)" if one.alike and one.behind else "")
            table.add_row(one.name, str(one.order), f"{one.fit_percent:.1f}", f"{one.one_step_fits.mean():.1f}", behind)
    head = f"{run.path.name}: {counted(len(run.record), 'sample')}; fitted to the first {run.split:.0%}, ranked on the rest"
    failed = [f"{one.name}: {one.failure}" for one in run.found.ranked if one.failure]
    legend = "Fit of a simulation; behind: standard errors between its squared errors and the best one's."
    return [head, "", table, "", legend, *failed, run.found.sentence]
