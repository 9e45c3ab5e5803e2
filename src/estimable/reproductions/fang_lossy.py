"""Chapter 3: identification over a lossy network. Tables 3.1, 3.2 and Figures 3.2-3.11."""

from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from ..diagnostics.cramer_rao import cramer_rao
from ..estimation.estimate_bank import estimate_bank
from ..estimation.stack import stack
from ..identifiers.output_error_ml import OutputErrorML
from ..identifiers.recursive_output_error import RecursiveOutputError
from ..models.output_error import OutputError
from ..models.prior import Prior
from ..networks.links import BernoulliLink
from ..simulation.simulate import simulate
from .entries import Reproduced, ReproducedRow, drawn
from .plots import Line, Panel, over_time

NOISE = 0.1
PLANT = OutputError([0.523, 0.349], [0.440, 0.762], noise_variance=NOISE, dt=1)
θ = PLANT.parameters
NAMES = PLANT.parameter_names
CHUNK = 10  # runs in memory at once
UNIFORM = np.sqrt(3.0)  # half the width of the uniform density of unit variance
P0 = (
    "The source states neither P0 nor the first estimate: here P0 = 1 and zero. With the large P0 that it recommends, one draw "
    "in three of Example 2 stays near 60 %."
)
REFINED = "The refined recursion, from P0 = 1e6, and maximum likelihood are compared with the Cramér-Rao bound of the packets."
TARGET = "The mean of (z - y°)² tends to (1 - γ) r_v, and not to 0 as in the source. The error against x° tends to 0."


class LossyExample(NamedTuple):
    """Arrival rates, rows, and the published table: {k: (a1, a2, b0, b1, relative error in %)}."""

    input_arrival: float
    output_arrival: float
    rows: int
    table: dict[int, tuple[float, float, float, float, float]]


ONE = LossyExample(0.8, 0.7, 1000, {
    10: (0.567627, 1.6701, 3.20898, 1.68664, 296.32), 63: (0.42823, 0.174088, 0.49568, 0.631873, 22.5757),
    125: (0.46955, 0.22639, 0.474952, 0.726835, 13.1901), 250: (0.506762, 0.278517, 0.417336, 0.737531, 7.36484),
    500: (0.540054, 0.308427, 0.407041, 0.747389, 5.26075), 1000: (0.53704, 0.335451, 0.428435, 0.749043, 2.41542),
})  # fmt: skip
TWO = LossyExample(0.4, 0.2, 5000, {
    10: (-0.182577, -0.148257, 0.0, 0.0, 113.976), 313: (0.299781, 0.115871, 0.42551, 0.762816, 29.875),
    625: (0.338345, 0.239968, 0.325255, 0.65233, 24.6696), 1250: (0.452098, 0.269698, 0.424789, 0.72987, 10.371),
    2500: (0.509494, 0.314595, 0.414112, 0.755212, 4.21955), 5000: (0.530625, 0.312564, 0.420325, 0.760732, 3.8951),
})  # fmt: skip


class IdentificationRuns(NamedTuple):
    """Many draws: errors of the parameters in % (B, T), running means of (z - y°)² and of (z - x°)² (B, T), θ of draw 0."""

    parameter_error: np.ndarray
    output_error: np.ndarray
    true_output_error: np.ndarray
    first: Any
    measured: np.ndarray


def printed() -> RecursiveOutputError:
    """The recursion of the source."""
    return RecursiveOutputError(2, 1, noise_variance=NOISE, method="printed", prior=Prior(np.zeros(4), np.eye(4)))


def refined() -> RecursiveOutputError:
    """Our recursion, from a vague prior."""
    return RecursiveOutputError(2, 1, noise_variance=NOISE, prior=Prior(np.zeros(4), 1e6 * np.eye(4)))


@lru_cache(1024)
def simulation(example: int, run: int) -> Any:
    """Draw `run` of Example 1 or 2."""
    case = (ONE, TWO)[example - 1]
    u = np.random.default_rng((example, run)).uniform(-UNIFORM, UNIFORM, case.rows)
    to, back = BernoulliLink(case.input_arrival), BernoulliLink(case.output_arrival)
    return simulate(PLANT, u, seed=1000 * example + run, input_link=to, output_link=back)


@lru_cache(8)
def runs(example: int, method: str, draws: int) -> IdentificationRuns:
    """A recursion over many draws."""
    algorithm = printed() if method == "printed" else refined()
    parts, first = [], None
    for start in range(0, draws, CHUNK):
        simulations = [simulation(example, i) for i in range(start, min(start + CHUNK, draws))]
        bank = estimate_bank(algorithm, stack([one.record for one in simulations]), prior=None)
        first = bank[0] if first is None else first
        measured = np.stack([one.measured[:, 0] for one in simulations])
        true = np.stack([PLANT.response(one.applied)[:, 0] for one in simulations])
        z, k = bank.extra["completed"][..., 0], np.arange(1, measured.shape[1] + 1)
        error = 100 * np.linalg.norm(bank.mean - θ, axis=2) / np.linalg.norm(θ)
        against = [np.cumsum((z - goal) ** 2, axis=1) / k for goal in (measured, true)]
        missing = np.isnan(np.stack([one.record.y[:, 0] for one in simulations]))
        lost = np.cumsum(np.where(missing, (z - true) ** 2, 0.0), axis=1) / np.maximum(np.cumsum(missing, axis=1), 1)
        parts.append((error, against[0], lost))
    error, output, against_true = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return IdentificationRuns(error, output, against_true, first, simulation(example, 0).measured[:, 0])


def table(example: int, draws: int) -> Reproduced:
    """Estimates and relative errors at the published samples, and the bound."""
    case, found = (ONE, TWO)[example - 1], runs(example, "printed", draws)
    ours, rows = runs(example, "refined", draws), []
    for k, published in case.table.items():
        rows.append(drawn(f"relative error, k = {k}", "%", published[4], found.parameter_error[:, k - 1]))
    for name, column, value in zip(NAMES, np.asarray(found.first.mean).T, case.table[case.rows][:4], strict=True):
        rows.append(ReproducedRow(f"{name}, k = {case.rows}, first draw", "", value, float(column[case.rows - 1])))
    for k in case.table:
        rows.append(
            drawn(f"relative error of the refined recursion, k = {k}", "%", None, ours.parameter_error[:, k - 1])
        )
    likelihood, bound = zip(*(_reachable(example, i) for i in range(draws)), strict=True)
    rows.append(drawn(f"relative error by maximum likelihood, k = {case.rows}", "%", None, likelihood))
    rows.append(drawn(f"Cramér-Rao bound (relative RMS), k = {case.rows}", "%", None, bound))
    return Reproduced(tuple(rows), partial(_errors, example, draws), (P0, REFINED))


def _reachable(example: int, run: int) -> tuple[float, float]:
    """The relative error of maximum likelihood on one draw, and the bound of that draw, in %."""
    record, size = simulation(example, run).record, np.linalg.norm(θ) / 100
    error = np.linalg.norm(OutputErrorML(2, 1, level="none", initial="rest").fit([record]).parameters - θ)
    return float(error / size), float(np.sqrt(np.trace(cramer_rao(PLANT, record))) / size)


def parameters(example: int, draws: int) -> Reproduced:
    """The estimates of the first draw over time, with the published values at the end."""
    case, path = (ONE, TWO)[example - 1], np.asarray(runs(example, "printed", draws).first.mean)
    ends = zip(NAMES, case.table[case.rows][:4], path[-1], strict=True)
    rows = [
        ReproducedRow(f"{name}, last sample, first draw", "", published, float(value))
        for name, published, value in ends
    ]
    return Reproduced(tuple(rows), partial(_paths, path), (P0,))


def _paths(path: np.ndarray) -> Any:
    k = np.arange(1, len(path) + 1)
    lines = [Line(name, k, path[:, i], i) for i, name in enumerate(NAMES)]
    true = [Line("true", k[[0, -1]], np.full(2, value), "#767676", "dash", 1.5) for value in θ]
    return over_time([Panel("estimate", [*lines, *true], (-1.0, 1.5))], x="sample k")


def errors(example: int, draws: int) -> Reproduced:
    """The relative parameter error over time."""
    case, found = (ONE, TWO)[example - 1], runs(example, "printed", draws)
    rows = [drawn(f"relative error, k = {k}", "%", published[4], found.parameter_error[:, k - 1])
            for k, published in case.table.items()]  # fmt: skip
    return Reproduced(tuple(rows), partial(_errors, example, draws), (P0,))


def _errors(example: int, draws: int) -> Any:
    case = (ONE, TWO)[example - 1]
    k = np.arange(1, case.rows + 1)
    lines = [Line(f"{how}, median of {draws} draws", k, np.median(runs(example, how, draws).parameter_error, axis=0), i)
             for i, how in enumerate(("printed", "refined"))]  # fmt: skip
    published = Line("published, one run", list(case.table), [row[4] for row in case.table.values()], 2, "dash")
    return over_time([Panel("relative error [%]", [*lines, published], (0.0, 60.0))], x="sample k")


def outputs(example: int, draws: int) -> Reproduced:
    """Estimated and true outputs at 501..550 of the first draw."""
    found, case = runs(example, "printed", draws), (ONE, TWO)[example - 1]
    window = slice(500, 550)
    z = np.asarray(found.first.extra["completed"])[window, 0]
    missing = np.isnan(simulation(example, 0).record.y[window, 0])
    rms = float(np.sqrt(np.mean((z - found.measured[window])[missing] ** 2)))
    rows = (
        ReproducedRow("share of outputs missing in 501..550", "", 1 - case.output_arrival, float(np.mean(missing))),
        ReproducedRow("RMS of z - y° where it is missing", "", None, rms),
    )
    return Reproduced(rows, partial(_outputs, z, found.measured[window], missing), (TARGET,))


def _outputs(z: np.ndarray, measured: np.ndarray, missing: np.ndarray) -> Any:
    k = np.arange(501, 551)
    lost = Line("z where the output was lost", k, np.where(missing, z, np.nan), 1, "dash")
    lines = [Line("output y°", k, measured, 0), lost]
    figure = over_time([Panel("output", lines)], x="sample k")
    return figure.update_traces(mode="markers+lines", selector={"name": "z where the output was lost"})


def output_errors(example: int, draws: int) -> Reproduced:
    """The average output error over time."""
    case, found = (ONE, TWO)[example - 1], runs(example, "printed", draws)
    floor = (1 - case.output_arrival) * NOISE
    rows = (
        drawn("average output error at the end", "", None, found.output_error[:, -1]),
        ReproducedRow("(1 - γ) r_v, its limit", "", None, floor),
        drawn("mean square of z - x° where the output was lost, at the end", "", None, found.true_output_error[:, -1]),
    )
    return Reproduced(rows, partial(_output_errors, example, draws, floor), (TARGET, P0))


def _output_errors(example: int, draws: int, floor: float) -> Any:
    found = runs(example, "printed", draws)
    k = np.arange(1, found.output_error.shape[1] + 1)
    lines = [
        Line("average of (z - y°)²", k, np.median(found.output_error, axis=0), 0),
        Line("(1 - γ) r_v", k[[0, -1]], np.full(2, floor), "#767676", "dash", 1.5),
        Line("average of (z - x°)² where lost", k, np.median(found.true_output_error, axis=0), 1),
    ]
    return over_time([Panel("average output error", lines, (0.0, 4 * floor))], x="sample k")


def patterns(what: str, draws: int) -> Reproduced:
    """Example 3: two patterns of losses at the same rates, and the spread over many patterns."""
    found = runs(1, "printed", max(draws, 2))
    values = found.parameter_error if what == "parameter" else found.output_error
    unit = "%" if what == "parameter" else ""
    rows = [
        ReproducedRow(f"{what} error of pattern {i + 1}, last sample", unit, None, float(values[i, -1]))
        for i in range(2)
    ]
    rows.append(drawn(f"{what} error, over patterns, last sample", unit, None, values[:draws, -1]))
    return Reproduced(tuple(rows), partial(_patterns, what, values[:2], unit), (P0,))


def _patterns(what: str, values: np.ndarray, unit: str) -> Any:
    k = np.arange(1, values.shape[1] + 1)
    lines = [Line(f"pattern {i + 1}", k, row, i, ("solid", "dash")[i]) for i, row in enumerate(values)]
    top = float(np.quantile(values, 0.97))
    return over_time([Panel(f"{what} error{unit and ' [%]'}", lines, (0.0, top))], x="sample k")
