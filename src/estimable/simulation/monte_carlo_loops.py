# pyright: reportUnknownVariableType=false, reportUnnecessaryIsInstance=false
"""Many simulated loops, for one setting or a grid, on this machine or a cluster, with a summary of each run."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, fields
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from .. import checks
from ..engines import choice
from ..errors import RunError
from ..frozen import saved
from ..progress import bar
from ..results import ClosedLoop, ClosedLoopBank, MonteCarlo, Outcome
from .close_loop import close_loop_bank
from .fingerprint import UnseenError, fingerprint
from .monte_carlo import gathered
from .parts import Folder, Part, worked_out

CHUNK = 250  # runs in memory together, which are one part: it only bounds the memory


@saved
@dataclass(frozen=True)
class LoopCase:
    """The arguments of `close_loop`, except the seed, as one case of `monte_carlo_loops`.

    >>> model = StateSpace([[1.0]], [[1.0]], Q=[[0.0]], R=[[0.0]], dt=1)
    >>> case = LoopCase(model, StateFeedback([[0.5]]), Kalman(model), reference=np.zeros((5, 0)), prior=Prior([0.0], [[0.0]]))
    >>> case.fly(seed=0, runs=2).runs.state.shape
    (2, 5, 1)
    """

    plant: Any
    controller: Any
    estimator: Any
    _: KW_ONLY
    reference: Any
    prior: Any
    dt: float | None = None
    start: Any = None
    input_link: Any = None
    output_link: Any = None
    lost: str = "zero"
    schedule: Any = None

    def fly(
        self, *, seed: int, runs: int, first: int = 0, on_failure: str = "raise", engine: str = "auto"
    ) -> ClosedLoopBank:
        """Simulate this case many times by `close_loop_bank`."""
        return close_loop_bank(**self.settings, seed=seed, runs=runs, first=first, on_failure=on_failure, engine=engine)

    @property
    def settings(self) -> dict[str, Any]:
        """The arguments of `close_loop`, by name."""
        return {field.name: getattr(self, field.name) for field in fields(self) if field.name != "_"}


def loop_grid(make: Callable[..., LoopCase], /, **values: Sequence[Any]) -> dict[str, LoopCase]:
    """Cases for every combination of values: {"name=value": make(name=value, ...)}.

    `make` is a function that returns a `LoopCase`; each further argument is a list of the values of one of its arguments.

    >>> model = StateSpace([[1.0]], [[1.0]], Q=[[0.0]], R=[[0.1]], dt=1)
    >>> start = Prior([0.0], [[0.0]])
    >>> make = lambda gain: LoopCase(model, StateFeedback([[gain]]), Kalman(model), reference=np.zeros((5, 0)), prior=start)
    >>> list(loop_grid(make, gain=[0.2, 0.5]))
    ['gain=0.2', 'gain=0.5']
    """
    points = [dict(zip(values, point, strict=True)) for point in product(*values.values())]
    return {", ".join(f"{name}={value}" for name, value in point.items()): make(**point) for point in points}


def monte_carlo_loops(
    cases: LoopCase | Mapping[str, LoopCase],
    *,
    runs: int,
    seed: int,
    summary: Callable[[ClosedLoop], dict[str, Any]],
    folder: str | Path | None = None,
    version: str | None = None,
    scheduler: str | None = None,
    chunk: int = CHUNK,
    on_failure: str = "raise",
    engine: str = "auto",
    progress: bool = True,
) -> dict[str, MonteCarlo]:
    """Simulate each of several loops many times, and store a summary of each run.

    - `cases`: {name: `LoopCase`}, such as `loop_grid` makes. A single case gets the name "".
    - `summary(closed)`: a function that returns {name: number or array} from one `ClosedLoop`. NaN marks a value that a run
      does not have.
    - `runs` and `seed`: the number of runs, and the seed. Run i of every case draws with the key `fold_in(key(seed), i)`.
      Cases are thus compared on the same draws. Values do not depend on `runs`, `chunk`, cores or cluster, except to rounding
      on other processors.
    - `folder`: a folder for finished parts of `chunk` runs each. A later call with the same cases, seed, summary and chunk
      reads them, so that an interrupted computation continues. Two summaries are the same if their source, everything it uses
      and the versions of the packages are the same.
    - `version`: a name for a summary whose source cannot be inspected. Change it whenever the summary changes.
    - `scheduler`: the address of a Dask scheduler, such as "tcp://10.0.0.1:8786". Its workers run the parts; they need this
      version of estimable. None: the processors of this machine.
    - `chunk`: the number of runs in memory at once.
    - `on_failure`: "raise": an error at the first failed run; "keep": a failed run is stored with its incomplete result.
    - `progress`: shows a bar on stderr, if that is a terminal.

    Returns {name of the case: `MonteCarlo`}. Raises `InputError` with every fault of the call, where no scheduler or
    worker answers within 10 s, and where the workers cannot import the summary; `RunError` for the first failed run.

    >>> model = StateSpace([[1.0]], [[1.0]], Q=[[0.1]], R=[[0.1]], dt=1)
    >>> law, start = StateFeedback([[0.5]], reference_gain=[[0.5]]), Prior([0.0], [[0.0]])
    >>> case = LoopCase(model, law, Kalman(model), reference=np.ones(9), prior=start)
    >>> last = lambda closed: {"error": closed.state[-1, 0] - 1}
    >>> found = monte_carlo_loops({"law": case}, runs=500, seed=1, summary=last)
    >>> bool(abs(found["law"].mean("error")) < 3 * found["law"].standard_error("error"))
    True
    """
    cases = {"": cases} if isinstance(cases, LoopCase) else cases
    _check_call(cases, runs, seed, summary, chunk, on_failure, engine, scheduler, version, progress)
    parts = _Parts(cases, runs, seed, summary if version is None else version, chunk, Folder(folder))
    with bar("runs", runs * len(cases), shown=progress) as advance:
        found = {place: part for place in parts.places if (part := parts.read(*place)) is not None}
        advance(sum(len(part["failed"]) for part in found.values()))
        missing = [place for place in parts.places if place not in found]
        calls = [(cases[name], seed, first, min(chunk, runs - first), summary, engine) for name, first in missing]
        for i, part in worked_out(fly_part, calls, scheduler):
            parts.folder.write(parts.name(*missing[i]), part)
            found[missing[i]] = part
            _settle(part, missing[i], on_failure)
            advance(len(part["failed"]))
    return {name: _joined([found[place] for place in parts.places if place[0] == name], seed) for name in cases}


class _Parts:
    """The parts of all cases, by (case, first run), and their names in a folder."""

    def __init__(
        self,
        cases: Mapping[str, LoopCase],
        runs: int,
        seed: int,
        summary: Callable[..., Any] | str,
        chunk: int,
        folder: Folder,
    ):
        self.runs, self.chunk, self.folder = runs, chunk, folder
        self.places = [(name, first) for name in cases for first in range(0, runs, chunk)]
        self.digests = {name: self._digest(case.settings, seed, summary) for name, case in cases.items()}

    def _digest(self, *things: Any) -> str:
        if self.folder.path is None:
            return ""
        try:
            return fingerprint(*things)
        except UnseenError as reason:
            checks.refuse(
                f"`folder`: the stored parts cannot be matched to this computation: {reason} cannot be inspected. "
                "Pass `version`, a name that you change whenever the summary or the cases change."
            )

    def name(self, case: str, first: int) -> str:
        """The file of a part."""
        return f"{self.digests[case]}-{first}-{self.count(first)}"

    def count(self, first: int) -> int:
        """The number of runs of a part."""
        return min(self.chunk, self.runs - first)

    def read(self, case: str, first: int) -> Part | None:
        """A stored, complete part."""
        return self.folder.read(self.name(case, first), self.count(first))


def fly_part(
    case: LoopCase, seed: int, first: int, runs: int, summary: Callable[..., Any], engine: str
) -> dict[str, np.ndarray]:
    """One part: the values of its runs by name, and the outcome of each."""
    bank = case.fly(seed=seed, runs=runs, first=first, on_failure="keep", engine=engine)
    values = gathered([summary(bank[i]) for i in range(runs)])
    ended = {
        "failed": np.array([outcome.code != 0 for outcome in bank.outcomes]),
        "sentences": np.array([outcome.sentence for outcome in bank.outcomes]), "engine": np.array(bank.runs.engine),
    }  # fmt: skip
    return {**ended, **{f"value {name}": array for name, array in values.items()}}


def _settle(part: dict[str, np.ndarray], place: tuple[str, int], on_failure: str) -> None:
    failed = np.flatnonzero(part["failed"])
    if on_failure == "raise" and len(failed):
        name, first = place
        which = f"Run {first + failed[0]}" + (f" of {name}" if name else "")
        raise RunError(Outcome(1, None, None, f"{which}: {part['sentences'][failed[0]]}"))


def _joined(parts: list[dict[str, np.ndarray]], seed: int) -> MonteCarlo:
    names = [name for name in parts[0] if name.startswith("value ")]
    values = {name.removeprefix("value "): np.concatenate([part[name] for part in parts]) for name in names}
    return MonteCarlo(values, np.concatenate([part["failed"] for part in parts]), seed, str(parts[0]["engine"]))


def _check_call(
    cases: Mapping[str, LoopCase],
    runs: int,
    seed: int,
    summary: Callable[..., Any],
    chunk: int,
    on_failure: str,
    engine: str,
    scheduler: str | None,
    version: str | None,
    progress: bool,
) -> None:
    faults = checks.Faults()
    if not isinstance(cases, Mapping) or not cases or not all(isinstance(case, LoopCase) for case in cases.values()):
        faults.add(f"`cases` must be a LoopCase, or {{name: LoopCase}} as from `loop_grid`. Got {checks.short(cases)}.")
    if not callable(summary):
        faults.add(
            "`summary` must be a function of a ClosedLoop that returns {name: number}. Got "
            + f"{checks.short(summary)}."
        )
    for name, value, least in (("runs", runs, 1), ("seed", seed, 0), ("chunk", chunk, 1)):
        faults.whole(name, value, least, checks.LARGEST if name == "seed" else checks.MOST_ROWS)
    faults.flag("progress", progress)
    if version is not None and not isinstance(version, str):
        faults.add(f"`version` must be a text. Got {checks.short(version)}.")
    if scheduler is not None and not isinstance(scheduler, str):
        faults.add(f'`scheduler` must be an address, such as "tcp://10.0.0.1:8786". Got {checks.short(scheduler)}.')
    faults.choice("on_failure", on_failure, ("raise", "keep"))
    choice.check(engine, faults)
    faults.finish()
