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
    """The result of `simulate`: the simulated measurements and the true signals behind them.

    - `record`: the `Record` that arrives after the network. Pass it to `estimate` or `identify`.
    - `state` (T, n): the true states.
    - `applied` (T, m): the inputs that the actuators applied.
    - `measured` (T, p): the outputs as measured, before the network loses some of them.
    - `input_delay` (T, m) and `output_delay` (T, p): the delay of each packet in steps, infinite for a lost packet. They are
      None without a link. `Trace(delay)` is a link that repeats these delays.
    """

    record: Any
    state: Annotated[Any, "T n"]
    applied: Annotated[Any, "T m"] = None
    measured: Annotated[Any, "T p"] = None
    input_delay: Annotated[Any, "T m"] = None
    output_delay: Annotated[Any, "T p"] = None


@frozen
class ClosedLoop(Kept):
    """The result of `close_loop`: T rows, one for each sample. Row k of each array is at time t[k].

    - `t` (T,): the times in seconds.
    - `reference` (T, r): the references that the controller follows.
    - `output` (T, p): the outputs that the estimator received, NaN where one was lost.
    - `state` (T, n): the true states of the plant.
    - `command` (T, m): the commands of the controller.
    - `applied` (T, m): the commands that the actuators apply, within their limits.
    - `input` (T, m): the positions of the actuators, which act on the plant.
    - `known_input` (T, m): the inputs that the estimator receives: the measured positions, or the applied commands.
    - `arrived` (T, m): whether each command arrived.
    - `info`: the reports of the estimator. They are also properties: `mean`, `covariance`, `gain`, `gain_covariance` and
      others, with `extra` for results that only this estimator has, such as `alarm`.
    - `control`: the reports of the controller by name, such as `effect`.
    - `outcome`: whether the run failed, at which sample, and why.
    - `engine`: the engine that ran.
    - `names`: the names of the columns of the estimator.
    - `events`: what happened to the plant during the run, in order of time.
    - `schedule`: {channel: (T,)}, the course of the channels that the matrices of the plant or the estimator followed.
    """

    t: Annotated[Any, "T"]
    reference: Annotated[Any, "T r"]
    output: Annotated[Any, "T p"]
    state: Annotated[Any, "T n"]
    command: Annotated[Any, "T m"]
    applied: Annotated[Any, "T m"]
    input: Annotated[Any, "T m"]
    known_input: Annotated[Any, "T m"]
    arrived: Annotated[Any, "T m"]
    info: Annotated[Info, "T"]
    control: Annotated[Any, "T"]
    outcome: Outcome = static()
    engine: str = static()
    names: Names = static()
    events: Any = ()
    schedule: Any = None

    def __repr__(self) -> str:
        ended = self.outcome.sentence or f"engine {self.engine}"
        return f"ClosedLoop({len(self.t)} samples, {ended})"

    def __len__(self) -> int:
        return len(self.t)


@frozen
class ClosedLoopBank:
    """The result of `close_loop_bank`: many runs of one loop.

    `runs` is a `ClosedLoop` whose arrays have a leading axis, one entry for each run; `t`, `reference`, `events` and `schedule`
    are common to all runs. `bank[i]` is the `ClosedLoop` of run i. `outcomes` holds the outcome of each run. `events`: the
    events of each run where the runs have different plants, else None.
    """

    runs: ClosedLoop
    outcomes: tuple[Outcome, ...] = static()
    events: Any = None

    def __repr__(self) -> str:
        failed = sum(outcome.code != 0 for outcome in self.outcomes)
        return f"ClosedLoopBank({len(self)} runs, {failed} failed, engine {self.runs.engine})"

    def __len__(self) -> int:
        return len(self.outcomes)

    def __getitem__(self, i: int) -> ClosedLoop:
        shared = {name: getattr(self.runs, name) for name in ("t", "reference", "events", "schedule")}
        if self.events is not None:
            shared["events"] = self.events[i]
        one = jax.tree_util.tree_map(lambda leaf: leaf[i], replace(self.runs, **dict.fromkeys(shared)))
        return replace(one, outcome=self.outcomes[i], **shared)


@frozen
class MonteCarlo:
    """The result of `monte_carlo`: the values of a summary over many runs.

    - `values`: a mapping. `values[name]` (runs, ...) holds the value `name` of the summary; row i is that of run i.
    - `failed` (runs,): True for each run that failed, where `on_failure="keep"`.
    - `seed`: the seed of the runs.
    - `engine`: the engine that ran.
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
        """The mean of a value over the runs in which it is not NaN."""
        return np.nanmean(self._values(name), axis=0)

    def sigma(self, name: str) -> Any:
        """The standard deviation of a value from run to run, over the runs in which it is not NaN."""
        return np.nanstd(self._values(name), axis=0, ddof=1)

    def standard_error(self, name: str) -> Any:
        """The standard deviation of the mean of a value."""
        return self.sigma(name) / np.sqrt(np.sum(~np.isnan(self.values[name]), axis=0))
