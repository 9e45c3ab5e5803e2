# pyright: reportUnknownArgumentType=false, reportUnknownLambdaType=false
"""The results of simulations: drawn records, closed loops, and values over many runs."""

from typing import Annotated, Any

import jax
import numpy as np

from ..checks import Faults
from ..frozen import frozen, replace, static
from .estimates import Kept
from .steps import Info, Names, Outcome


@frozen
class Simulation:
    """The result of `simulate`: the `record` that arrives, and the true signals behind it.

    The true `state` (T, n); `applied` (T, m), the applied inputs; `measured` (T, p), the measured outputs before the network;
    `input_delay` and `output_delay` (T, c): of each packet, in steps, infinite where it was lost (None: no link).
    `Trace(delay)` is a link that repeats them.
    """

    record: Any
    state: Annotated[Any, "T n"]
    applied: Annotated[Any, "T m"] = None
    measured: Annotated[Any, "T p"] = None
    input_delay: Annotated[Any, "T m"] = None
    output_delay: Annotated[Any, "T p"] = None


@frozen
class ClosedLoop(Kept):
    """The result of `close_loop`; row k of every array is at time t[k].

    `reference` (T, r); `output` (T, p) as received by the estimator, NaN where it was lost; `state` (T, n): the true state of the
    plant; `command` (T, m) of the controller; `applied` (T, m): the commands at the actuators, within their limits; `input`
    (T, m): the actuator positions; `arrived` (T, m): whether the command arrived. `info`: the report of the estimator (`mean`,
    `covariance`, `gain`, `gain_covariance`, ..), `extra` its specific results (`alarm`, ..), `control` the report of the
    controller (`effect`, ..). `outcome` and `engine` as in `Estimate`; `names` are those of the estimator.
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
    """The result of `close_loop_bank`: the arrays of `ClosedLoop` with a leading axis of runs; `bank[i]` is one of them."""

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
    """The result of `monte_carlo`: `values[name]` (runs, ...), from the `summary` of each run; run i is row i.

    `failed` (runs,): which runs failed (with `on_failure="keep"`).
    """

    values: Annotated[Any, "runs"]
    failed: Annotated[Any, "runs"]
    seed: int = static()
    engine: str = static()

    def __repr__(self) -> str:
        values = ", ".join(f"{name} = {self.mean(name)} ± {self.sigma(name)}" for name in self.values)
        return f"MonteCarlo({len(self)} runs, {values})"

    def __len__(self) -> int:
        return len(self.failed)

    def _values(self, name: str) -> Any:
        faults = Faults()
        faults.choice("name", name, tuple(self.values))
        faults.finish()
        return self.values[name]

    def mean(self, name: str) -> Any:
        """The mean over the runs in which the value is known (not NaN)."""
        return np.nanmean(self._values(name), axis=0)

    def sigma(self, name: str) -> Any:
        """The standard deviation of one run, over the runs where the value is known."""
        return np.nanstd(self._values(name), axis=0, ddof=1)

    def standard_error(self, name: str) -> Any:
        """The standard deviation of the mean."""
        return self.sigma(name) / np.sqrt(np.sum(~np.isnan(self.values[name]), axis=0))
