# pyright: reportUnknownArgumentType=false, reportUnknownLambdaType=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false
"""Monte Carlo runs of an estimator over drawn records, with a summary of each run."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .. import checks, forks
from ..data.record import Record
from ..errors import RunError
from ..estimation.binding import check_algorithm
from ..estimation.estimate import check_options
from ..estimation.estimate_bank import estimate_bank
from ..models.prior import Prior
from ..progress import bar
from ..protocols import Algorithm
from ..results import MonteCarlo, Outcome, Simulation, Stacked

CHUNK = 256  # runs drawn and estimated at once: it only bounds the memory


def monte_carlo(
    algorithm: Algorithm[Any], draw: Callable[[Any], Any], *, prior: Prior, runs: int, seed: int,
    summary: Callable[[Any, Any], dict[str, Any]], on_failure: str = "raise", engine: str = "auto",
    chunk: int = CHUNK, progress: bool = True,
) -> MonteCarlo:  # fmt: skip
    """Draw many records, run an estimator over each, and store a summary of each run.

    - `draw(key)`: a function, written in JAX, that draws a `Record` with a random key, or an object with a field `record`,
      such as a `Simulation`. `drawn_from(model, u)` makes such a function from a model.
    - `summary(drawn, estimate)`: a function that returns {name: number or array} for one run, from the drawn object and its
      `Estimate`. NaN marks a value that a run does not have.
    - `runs` and `seed`: the number of runs, and the seed. Run i draws with the key `fold_in(key(seed), i)`: its values do not
      depend on `chunk`, `runs` or the number of cores.
    - `prior`: the `Prior` of the state x[0].
    - `on_failure`: "raise": an error at the first failed run; "keep": the summary of a failed run uses its incomplete result.
    - `chunk`: the number of runs in memory at once. `progress`: shows a bar on stderr, if that is a terminal.

    Returns a `MonteCarlo`. Raises `InputError` with every fault of the call; `RunError` for the first run that failed, naming
    it.

    >>> model = StateSpace([[0.9]], Q=[[0.1]], R=[[0.2]], dt=1)
    >>> start = Prior([0.0], [[1.0]])
    >>> error = lambda drawn, estimate: {"error": (estimate.mean - drawn.state)[-1, 0]}
    >>> runs = monte_carlo(Kalman(model), drawn_from(model, steps=20, prior=start), prior=start, runs=100, seed=1, summary=error)
    >>> runs.values["error"].shape, bool(abs(runs.mean("error")) < 3 * runs.standard_error("error"))
    ((100,), True)
    """
    check_options(on_failure, engine, "all")
    _check_call(algorithm, draw, summary, runs, seed, chunk, progress)
    size = min(chunk, runs)
    draws = forks.jit(jax.vmap(lambda i: draw(jax.random.fold_in(jax.random.key(seed), i))))
    summaries: list[dict[str, Any]] = []
    failed: list[bool] = []
    used = engine
    with bar("runs", runs, shown=progress) as advance:
        for first in range(0, runs, size):
            count = min(size, runs - first)
            things = draws(first + jnp.arange(size))
            record = _record_of(things)
            things, record = jax.tree_util.tree_map(np.asarray, (things, record))
            bank = estimate_bank(algorithm, Stacked(record, size), prior=prior, engine=engine, on_failure="keep")
            _settle(bank.outcomes[:count], first, on_failure)
            used = bank.engine
            for i in range(count):
                one = jax.tree_util.tree_map(partial(_row, i=i), things)
                summaries.append(summary(one, bank[i]))
                failed.append(bank.outcomes[i].code != 0)
            advance(count)
    return MonteCarlo(gathered(summaries), np.array(failed), seed, used)


def _check_call(
    algorithm: Algorithm[Any],
    draw: Callable[..., Any],
    summary: Callable[..., Any],
    runs: int,
    seed: int,
    chunk: int,
    progress: bool,
) -> None:
    faults = checks.Faults()
    check_algorithm(algorithm, faults)
    for name, value, hint in (
        ("draw", draw, "write drawn_from(model, u), or a function of a random key that returns a Record"),
        ("summary", summary, "it takes the drawn object and its estimate, and returns {name: number}"),
    ):
        faults.function(name, value, hint)
    faults.whole("runs", runs, 1, checks.MOST_ROWS)
    faults.whole("seed", seed, 0)
    faults.whole("chunk", chunk, 1)
    faults.flag("progress", progress)
    faults.finish()


def _row(leaf: np.ndarray, *, i: int) -> np.ndarray:
    return leaf[i]


def _record_of(things: Record | Simulation) -> Record:
    record = things if isinstance(things, Record) else getattr(things, "record", None)
    if not isinstance(record, Record):
        checks.refuse(
            f"`draw` must return a Record, or an object with a field `record`, such as a Simulation. Got {type(things).__name__}."
        )
    return record


def _settle(outcomes: Sequence[Outcome], first: int, on_failure: str) -> None:
    for i, outcome in enumerate(outcomes, start=first):
        if outcome.code and on_failure == "raise":
            raise RunError(outcome._replace(sentence=f"Run {i}: {outcome.sentence}"))


def gathered(summaries: list[Any]) -> dict[str, np.ndarray]:
    """The values of all runs by name."""
    if not isinstance(summaries[0], dict):
        checks.refuse(f"`summary` must return {{name: number or array}}. Got {checks.short(summaries[0])}.")
    for i, one in enumerate(summaries):
        if set(one) != set(summaries[0]):
            given, first = checks.listed(sorted(one)), checks.listed(sorted(summaries[0]))
            checks.refuse(
                f"`summary` must return the same names for every run: {given} for run {i}, {first} for run 0."
            )
    return {name: np.array([one[name] for one in summaries], float) for name in summaries[0]}
