"""Chapter 4: adaptive control over a network that loses outputs. Figures 4.3-4.8."""

from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from ..controllers.tracking import Tracking
from ..identifiers.joint_output_error import JointOutputError
from ..identifiers.recursive_output_error import RecursiveOutputError
from ..models.controlled import ControlledPlant
from ..models.events import Change
from ..models.output_error import OutputError
from ..models.prior import Prior
from ..networks.links import BernoulliLink
from ..results import ClosedLoopBank
from ..simulation.close_loop import close_loop_bank
from .entries import Reproduced, ReproducedRow, drawn
from .plots import Line, Panel, over_time

θ = np.array([-0.3, 0.6, 0.5, 0.2, 0.34])
NOISE = 0.05**2
ROWS, JUMP = 5000, 2500
REFERENCE = (-1.0) ** (np.arange(ROWS) // 500 + 1)
ARRIVAL = {1: 0.85, 2: 0.65, 3: 0.65}
PRIOR = Prior(np.ones(5), np.eye(5))
CHUNK = 10  # runs in memory at once
SEED = 41
ERRATUM = (
    "(4.15) feeds back the noisy z, but (4.14) and Theorem 4.1 use x_b. With z the RMS is sqrt(r_v (1 + γ Σ a²)) instead of "
    "sqrt(r_v)."
)
NEVER = "The algorithm as printed does not recover from the jump: its P is zero and the new A is not positive real."
STARTS = "The source states neither P0 nor the arrival rate of Example 3: here P0 = 1 and 65 %; .85 and .3 are shown as well."


class TrackingRuns(NamedTuple):
    """Many runs, (B, T): y - r of all samples, relative errors of θ in %; and for run 0 the outputs y, z and the mask `seen`."""

    error: np.ndarray
    parameter_error: np.ndarray
    measured: np.ndarray
    completed: np.ndarray
    seen: np.ndarray


def blocks(method: str) -> tuple[Tracking, Any]:
    """The law and the identifier: as printed, or ours."""
    if method == "printed":
        law = Tracking(2, 2, feedback="measured", law="inverse", lower=0.05, reach=1e9)
        return law, RecursiveOutputError(2, 2, noise_variance=NOISE, prior=PRIOR, method="printed")
    return Tracking(2, 2), JointOutputError(2, 2, noise_variance=NOISE, prior=PRIOR)


def plant(factor: float = 1.0) -> OutputError:
    """The source's plant, all parameters times `factor`."""
    return OutputError(factor * θ[:2], factor * θ[2:], noise_variance=NOISE, dt=1)


@lru_cache(16)
def runs(arrival: float, jumps: bool, method: str, draws: int) -> TrackingRuns:
    """Many runs of an example."""
    flown = ControlledPlant(plant(), events=[Change(JUMP, plant(1.5))] if jumps else [])
    law, identifier = blocks(method)
    parts, first = [], None
    for start in range(0, draws, CHUNK):
        bank = close_loop_bank(
            flown, law, identifier, reference=REFERENCE, seed=SEED, runs=min(CHUNK, draws - start), first=start, prior=None,
            output_link=BernoulliLink(arrival), on_failure="keep",
        )  # fmt: skip
        parts.append(_errors(bank, jumps))
        first = bank[0] if first is None else first
    assert first is not None
    error, of_parameters = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    y, z = first.output[:, 0], np.asarray(first.extra["completed"])[:, 0]
    return TrackingRuns(error, of_parameters, y, z, ~np.isnan(y))


def _errors(bank: ClosedLoopBank, jumps: bool) -> tuple[np.ndarray, np.ndarray]:
    """x° - r (the noise of y is added in the mean square), and the relative errors of θ."""
    x = np.asarray(bank.runs.state)[:, 1:, 0]  # of the sample before
    true = np.where(jumps & (np.arange(ROWS) >= JUMP), 1.5, 1.0)[:, None] * θ
    away = np.linalg.norm(np.asarray(bank.runs.info.mean) - true, axis=2) / np.linalg.norm(true, axis=1)
    return x - REFERENCE[:-1], 100 * away


def rms(found: TrackingRuns, first: int, last: int) -> np.ndarray:
    """The RMS of y - r over some samples, for each run."""
    return np.sqrt(np.mean(found.error[:, first:last] ** 2, axis=1) + NOISE)


def _row(what: str, found: TrackingRuns, first: int, last: int, published: float | None = None) -> ReproducedRow:
    """The RMS of all runs together, and its spread between runs."""
    each = rms(found, first, last)
    one = drawn(f"RMS of y - r, {first}..{last}, {what}", "", published, each)
    return one._replace(mean=float(np.sqrt(np.mean(each**2))))


def response(example: int, draws: int) -> Reproduced:
    """Examples 1 and 2: the output follows the reference."""
    γ = ARRIVAL[example]
    printed, ours = runs(γ, False, "printed", draws), runs(γ, False, "joint", draws)
    floor = float(np.sqrt(NOISE * (1 + γ * np.sum(θ[:2] ** 2))))
    rows = (
        _row("as printed", printed, 1000, ROWS - 1), ReproducedRow("sqrt(r_v (1 + γ Σ a²)), its limit", "", None, floor),
        _row("ours", ours, 1000, ROWS - 1), ReproducedRow("sqrt(r_v), the smallest possible", "", None, float(np.sqrt(NOISE))),
    )  # fmt: skip
    return Reproduced(rows, partial(_response, ours, False), (ERRATUM, STARTS))


def _response(found: TrackingRuns, jumps: bool) -> Any:
    k = np.arange(1, ROWS + 1)
    lines = [Line("y, where it arrived", k, found.measured, 0), Line("reference", k, REFERENCE, 1, "dash")]
    title = "output" if not jumps else "output; parameters rise by half at 2500"
    return over_time([Panel(title, lines, (-2.5, 2.5))], x="sample k")


def parameters(draws: int) -> Reproduced:
    """The relative parameter errors of Examples 1 and 2."""
    rows = []
    for example in (1, 2):
        for method, what in (("printed", "as printed"), ("joint", "ours")):
            found = runs(ARRIVAL[example], False, method, draws).parameter_error
            rows += [
                drawn(f"relative error, Example {example}, k = {k}, {what}", "%", None, found[:, k - 1])
                for k in (500, ROWS)
            ]
    return Reproduced(tuple(rows), partial(_parameters, draws), (STARTS,))


def _parameters(draws: int) -> Any:
    k = np.arange(1, ROWS + 1)
    lines = [
        Line(f"Example {example}, {what}", k, np.median(runs(ARRIVAL[example], False, method, draws).parameter_error, axis=0),
             i, ("solid", "dash")[example - 1])
        for example in (1, 2) for i, (method, what) in enumerate((("printed", "as printed"), ("joint", "ours")))
    ]  # fmt: skip
    return over_time([Panel("relative error [%]", lines, (0.0, 60.0))], x="sample k")


def outputs(example: int, draws: int) -> Reproduced:
    """Estimated outputs at 501..550 where they were lost, of the first run."""
    found, window = runs(ARRIVAL[example], False, "joint", draws), slice(500, 550)
    lost = ~found.seen[window]
    true = (found.error[0] + REFERENCE[:-1])[window]
    of_missing = float(np.sqrt(np.mean((found.completed[window] - true)[lost] ** 2)))
    rows = (
        ReproducedRow("share of outputs missing in 501..550", "", 1 - ARRIVAL[example], float(lost.mean())),
        ReproducedRow("RMS of z - x° where it is missing", "", None, of_missing),
    )
    return Reproduced(rows, partial(_outputs, found, window), (STARTS,))


def _outputs(found: TrackingRuns, window: slice) -> Any:
    k = np.arange(501, 551)
    z = np.where(found.seen, np.nan, found.completed)[window]
    lines = [Line("y, where it arrived", k, found.measured[window], 0), Line("z, where y was lost", k, z, 1, "dash")]
    return over_time([Panel("output", lines)], x="sample k").update_traces(mode="markers+lines")


def changed(draws: int) -> Reproduced:
    """Example 3: all parameters rise by half at 2500."""
    rows = []
    for γ in (0.85, 0.65, 0.3):
        found = runs(γ, True, "joint", draws)
        what = f"ours, {100 * γ:.0f} % arrive"
        rows += [_row(what, found, *window) for window in ((1500, 2500), (2520, 2600), (2600, 3000), (4000, ROWS - 1))]
        rows.append(ReproducedRow(f"largest |x° - r| of all runs, {what}", "", None, float(np.abs(found.error).max())))
    for γ in (0.85, 0.65):
        found = runs(γ, True, "printed", draws)
        rows += [
            _row(f"as printed, {100 * γ:.0f} % arrive", found, *window)
            for window in ((1500, 2500), (2600, 3000), (4000, ROWS - 1))
        ]
    return Reproduced(
        tuple(rows), partial(_response, runs(ARRIVAL[3], True, "joint", draws), True), (NEVER, ERRATUM, STARTS)
    )
