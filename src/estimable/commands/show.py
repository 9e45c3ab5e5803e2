"""Where output goes: data to stdout, as text or as JSON; notes and progress to stderr."""

import json
import math
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any, Protocol, TypeVar

import typer

from .. import checks
from ..annotations import Tree

Run = TypeVar("Run")
OneRun = TypeVar("OneRun", contravariant=True)


class Words(Protocol[OneRun]):
    """The module of a command that prints its result."""

    def as_data(self, run: OneRun) -> dict[str, Any]:
        """What a command prints as JSON."""
        ...

    def as_text(self, run: OneRun) -> list[Any]:
        """What a command prints as text."""
        ...


def front_page(context: typer.Context, version: bool, machine: bool) -> None:
    """What `estimable` alone prints: its version, or its help."""
    if version:
        data("version", {"outcome": {"code": 0, "sentence": ""}}) if machine else print(f"estimable {_version()}")
    elif machine:
        checks.refuse("--json needs a command, as in estimable demo --json: see estimable --help.")
    else:
        print(context.get_help())


def data(command: str, found: dict[str, Any]) -> None:
    """Print one JSON object: the command, the version, and the result."""
    print(json.dumps(plain({"command": command, "version": _version(), **found}), indent=2, allow_nan=False))


def plain(value: Tree) -> Tree:
    """`value` as JSON; a number that is not finite is None.

    >>> plain({"a": float("nan"), "b": (1, float("inf"))})
    {'a': None, 'b': [1, None]}
    """
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value


def text(write: Callable[[Any], Iterable[Any]]) -> None:
    """Print lines, tables and plots; `write(console)` makes them as wide as the terminal."""
    from rich.console import Console

    console = Console(highlight=False, markup=False, emoji=False)
    for line in write(console):
        console.print(line)


def notes(*sentences: str) -> None:
    """Print sentences on stderr."""
    sys.stdout.flush()
    for sentence in sentences:
        print(sentence, file=sys.stderr)


def working(sentence: str) -> AbstractContextManager[Any]:
    """A spinner on stderr while something runs, if stderr is a terminal."""
    from rich.console import Console

    console = Console(stderr=True)
    return console.status(sentence) if console.is_terminal else nullcontext()


@contextmanager
def counted(sentence: str) -> Iterator[Callable[[str, int, int], None] | None]:
    """A progress bar on stderr, if stderr is a terminal; it is called with (what runs now, number done, total)."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        yield None
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(sentence, total=None)
        yield lambda name, done, total: progress.update(
            task, description=f"{sentence}: {name}" if name else sentence, completed=done, total=total
        )


def both(command: str, machine: bool, words: Words[Run], run: Run) -> None:
    """Print the result, as JSON or as text."""
    if machine:
        data(command, words.as_data(run))
    else:
        text(lambda _: words.as_text(run))


def _version() -> str:
    from .. import __version__

    return __version__
