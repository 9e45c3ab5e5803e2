# pyright: reportUnknownArgumentType=false, reportUnknownLambdaType=false
"""What simulations return: drawn records, closed loops, and values over many runs."""

from typing import Annotated, Any

import jax
import numpy as np

from ..frozen import frozen, replace, static
from .estimates import Kept
from .steps import Info, Names, Outcome


@frozen
class Simulation:
    """What `simulate` returns: the `record` that arrives, and what is behind it.

    The true `state` (T, n); `applied` (T, m), what the actuator did; `measured` (T, p), what the sensors gave before the
    network; `input_delay` and `output_delay` (T, c): of each packet, in steps, infinite where it was lost (None: no link).
    `Trace(delay)` is a link that does the same again.
    """

    record: Any
    state: Annotated[Any, "T n"]
    applied: Annotated[Any, "T m"] = None
    measured: Annotated[Any, "T p"] = None
    input_delay: Annotated[Any, "T m"] = None
    output_delay: Annotated[Any, "T p"] = None


@frozen
class ClosedLoop(Kept):
    """What `close_loop` returns; row k of every array is of time t[k].

    `reference` (T, r); `output` (T, p) as it came to the estimator, NaN where it was lost; `state` (T, n) of the plant, true;
    `command` (T, m) of the controller; `applied` (T, m): what came to the actuators, within their limits; `input` (T, m): what
    they did; `arrived` (T, m): whether the command came. `info`: what the estimator said (`mean`, `covariance`, `gain`,
    `gain_covariance`, ..), `extra` what it alone says (`alarm`, ..), `control` what the controller said (`effect`, ..).
    `outcome` and `engine` as in `Estimate`; `names` are those of the estimator.
    """

    t: Annotated[Any, "T"]
    reference: Annotated[Any, "T r"]
    output: Annotated[Any, "T p"]
    state: Annotated[Any, "T n"]
    command: Annotated[Any, "T m"]
    applied: Annotated[Any, "T m"]
    input: Annotated[Any, "T m"]
    arrived: Annotated[Any, "T m"]
    info: Annotated[Info, "T"]
    control: Annotated[Any, "T"]
    outcome: Outcome = static()
    engine: str = static()
    names: Names = static()

    def __repr__(self) -> str:
        ended = self.outcome.sentence or f"engine {self.engine}"
        return f"ClosedLoop({len(self.t)} samples, {ended})"

    def __len__(self) -> int:
        return len(self.t)


@frozen
class ClosedLoopBank:
    """What `close_loop_bank` returns: the arrays of `ClosedLoop` with a leading axis of runs; `bank[i]` is one of them."""

    runs: ClosedLoop
    outcomes: tuple[Outcome, ...] = static()

    def __repr__(self) -> str:
        failed = sum(outcome.code != 0 for outcome in self.outcomes)
        return f"ClosedLoopBank({len(self)} runs, {failed} failed, engine {self.runs.engine})"

    def __len__(self) -> int:
        return len(self.outcomes)

    def __getitem__(self, i: int) -> ClosedLoop:
        shared = {"t": self.runs.t, "reference": self.runs.reference}
        one = jax.tree_util.tree_map(lambda leaf: leaf[i], replace(self.runs, t=None, reference=None))
        return replace(one, outcome=self.outcomes[i], **shared)


@frozen
class MonteCarlo:
    """What `monte_carlo` returns: `values[name]` (runs, ...), what `summary` said of each run; run i is row i.

    `failed` (runs,): which runs failed (with `on_failure="keep"`).
    """

    values: Annotated[Any, "runs"]
    failed: Annotated[Any, "runs"]
    seed: int = static()
    engine: str = static()

    def __repr__(self) -> str:
        told = ", ".join(f"{name} = {self.mean(name)} ± {self.sigma(name)}" for name in self.values)
        return f"MonteCarlo({len(self)} runs, {told})"

    def __len__(self) -> int:
        return len(self.failed)

    def mean(self, name: str) -> Any:
        """The mean over the runs, of those where the value is known (not NaN)."""
        return np.nanmean(self.values[name], axis=0)

    def sigma(self, name: str) -> Any:
        """The standard deviation of one run, over the runs where the value is known."""
        return np.nanstd(self.values[name], axis=0, ddof=1)

    def standard_error(self, name: str) -> Any:
        """The standard deviation of the mean."""
        return self.sigma(name) / np.sqrt(np.sum(~np.isnan(self.values[name]), axis=0))
