"""What `estimable identify` prints when it compares methods."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..data.record import Record
from ..errors import EstimableError
from ..results import Comparison, Ranked
from ..results.comparisons import shown
from ..results.order_selection import OrderSelection
from .identify_files import Asked, WrittenFiles, write_model_file, write_page
from .identify_report import checks_of, file_options, options_of, read
from .numbers import counted


class Compared(NamedTuple):
    """A comparison, its record, the choice of the order, and the files that were written."""

    asked: Asked
    record: Record
    found: Comparison
    selection: OrderSelection | None
    written: WrittenFiles


def compared(asked: Asked, order: int | None, progress: Callable[[str, int, int], None] | None) -> Compared:
    """Read the record, compare the methods that suit it, and write the model and the page."""
    from ..identification.compare import compare

    record, *others = (read(path, asked.outputs, asked.inputs, asked.reading) for path in (asked.path, *asked.held_out))
    level = asked.level or "mean"
    found = compare(
        None, record, split=asked.split, level=level, order=order, held_out=others or None, feedback=asked.feedback,
        progress=progress,
    )  # fmt: skip
    if all(one.fit is None for one in found.ranked):
        why = "; ".join(dict.fromkeys(f"{one.label}: {one.failure}" for one in found.ranked))
        checks.refuse(
            f"{asked.path}: no method could be fitted to this record. {why or 'It is too short for order 1.'}"
        )
    selection = selected(found)
    run = Compared(asked, record, found, selection, WrittenFiles(None, None))
    return run._replace(written=_write(run, order))


def selected(found: Comparison) -> OrderSelection | None:
    """The choice of the order; None if the record is too short for order 1."""
    from ..identification.select_order import select_order

    assert found.task is not None
    try:
        return select_order(found.task.first)
    except EstimableError:
        return None


def _write(run: Compared, order: int | None) -> WrittenFiles:
    """Write the model if one explains the record, and the page if any method could be fitted."""
    best, files = run.found.predictor, run.asked.files
    if run.found.ranked == () or run.found.ranked[0].fit is None:
        return WrittenFiles(None, None)
    if best is not None and best.model is not None:
        write_model_file(best.model, file_options(run.asked, run.record), files.model)
    options = () if order is None else (f"--order {order}",)
    assert run.found.task is not None
    if len(parts := run.found.task.records) > 1:  # the page shows one record
        return WrittenFiles(files.model if best is not None else None, None)
    write_page(
        run.found, parts[0], files.report, chosen=best, selection=run.selection, asked=run.asked,
        options=options, lead=[run.found.verdict, *_sentences(run)],
        reading=options_of(run.asked.path, run.asked.inputs, run.asked.reading),
    )  # fmt: skip
    return WrittenFiles(files.model if best is not None else None, files.report)


def _sentences(run: Compared) -> list[str]:
    """The findings, as sentences."""
    lines = [run.found.sentence]
    if len(orders := run.found.orders) > 1:
        lines.append(
            "Orders differ: " + "; ".join(f"{n} ({', '.join(dict.fromkeys(by))})" for n, by in orders.items()) + "."
        )
    if run.found.delay is not None:
        lines.append(run.found.delay.sentence)
    best, filtering = run.found.best, run.found.predictor
    if best is not None and filtering is not None and filtering is not best:
        ahead, behind = (float(one.one_step_fits.mean()) for one in (filtering, best))
        lines.append(
            f"The model file holds {filtering.label} of order {filtering.order}. Its simulation is as good within the noise, and "
            f"its one-step predictions, which a filter uses, are better ({ahead:.1f} % against {behind:.1f} %)."
        )
    if run.selection is not None:
        lines.append(f"{run.selection.sentence} Choose another order with --order N.")
    return lines


def as_data(run: Compared) -> dict[str, Any]:
    """What a comparison prints as JSON: `best` is null if no linear model explains the record."""
    best, filtering, selection = run.found.best, run.found.predictor, run.selection
    return {
        "outcome": {"code": 0, "sentence": run.found.sentence},
        "verdict": run.found.verdict,
        "judged": "one step ahead" if run.found.ahead else "simulation",
        "feedback": _feedback(run.found),
        "delay": _delay(run.found),
        "record": str(run.asked.path),
        "samples": len(run.record),
        "notes": list(run.record.notes),
        "outputs_seen": int(run.record.seen.sum()),
        "split": None if run.asked.held_out else run.asked.split,
        "held_out": [str(path) for path in run.asked.held_out],
        "best": None if best is None else _short(best),
        "for_a_filter": None if filtering is None else _short(filtering),
        "recommended_orders": None if selection is None else _orders(selection),
        "written": run.written.as_data(),
        "methods": [_long(one, run.record.outputs) for one in run.found.ranked],
    }


def _feedback(found: Comparison) -> dict[str, Any] | None:
    """The test of feedback; null without inputs."""
    seen = found.feedback
    if seen is None:
        return None
    p = {"p_earlier_rows": seen.earlier, "p_same_row": seen.same_row}
    return {"closed": found.closed, "unclear": seen.unclear, **p, "sentence": seen.sentence}


def _delay(found: Comparison) -> dict[str, Any] | None:
    """The dead time; null without inputs."""
    late = found.delay
    if late is None:
        return None
    return {
        "samples": late.delay,
        "alike": list(late.alike),
        "p": late.p,
        "at_edge": late.at_edge,
        "sentence": late.sentence,
    }


def _orders(selection: OrderSelection) -> dict[str, Any]:
    """What each criterion recommends."""
    return {
        **{name: selection.by(name) for name in ("bic", "aicc", "aic", "cross_validation")},
        "singular_value_gap": selection.gap,
        "delay": selection.delay,
    }


def _short(one: Ranked) -> dict[str, Any]:
    return {
        "method": one.name,
        "order": one.order,
        "fit_percent": one.fit_percent if np.isfinite(one.fit_percent) else None,
    }


def _long(one: Ranked, outputs: Sequence[str]) -> dict[str, Any]:
    """One method; if it failed, its numbers are null and `failure` holds the reason."""
    if one.fit is None:
        return {"method": one.name, "order": None, "fit_percent": None, "failure": one.failure}
    return {
        **_short(one),
        "settings": settings(one),
        "fits": dict(zip(outputs, map(_number, one.fits), strict=True)),
        "one_step_fits": dict(zip(outputs, map(_number, one.one_step_fits), strict=True)),
        "diverged": one.diverged,
        "behind": one.behind,
        "ratio": _number(one.ratio),
        "within_noise_of_best": one.alike,
        **checks_of(one.fit),
        "failure": "",
    }


def _number(value: float) -> float | None:
    """None for an infinite one."""
    return float(value) if np.isfinite(value) else None


def settings(one: Ranked) -> dict[str, Any]:
    """The settings of a method that are numbers or strings."""
    fields = {name: getattr(one.method, name) for name in type(one.method).__dataclass_fields__ if name != "_"}
    return {name: value for name, value in fields.items() if isinstance(value, bool | int | float | str)}


def as_text(run: Compared) -> list[Any]:
    """What a comparison prints as text."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 2, 0, 0), show_edge=False)
    table.add_column("method")
    for name in ("order", "fit %", "one step %", "behind"):
        table.add_column(name, justify="right")
    for one in run.found.ranked:
        if one.fit is not None:
            behind = one.shown_behind + (" (noise)" if one.alike and one.behind else "")
            ahead = shown(float(one.one_step_fits.mean()))
            table.add_row(one.label, str(one.order), one.shown_fit.removesuffix(" %"), ahead.removesuffix(" %"), behind)
    samples = counted(len(run.record), "sample")
    judged = f"ranked on {checks.listed([path.name for path in run.asked.held_out])}"
    split = f"fitted to the first {run.asked.split:.0%}, ranked on the rest"
    head = f"{run.asked.path.name}: {samples}; {judged if run.asked.held_out else split}"
    failed = [f"{one.name}: {one.failure}" for one in run.found.ranked if one.failure]
    by = "of predictions one step ahead" if run.found.ahead else "of a simulation of these rows; diverged: it ran away"
    legend = f"fit: {by}. behind: how many standard errors the squared errors are above the best."
    return [run.found.verdict, head, "", table, "", legend, *failed, *_sentences(run)]
