"""A progress bar on stderr, where stderr is a terminal."""

import sys
import time
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager

AFTER = 1.0  # seconds of work from which a search shows its bar


@contextmanager
def bar(name: str, total: int, *, shown: bool, after: float = 0.0) -> Generator[Callable[[int], None], None, None]:
    """A bar that is removed at the end; it is called with the number of steps just done. `after`: seconds until it appears."""
    if not (shown and sys.stderr.isatty()):
        yield lambda count: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn(name), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    progress, start = Progress(*columns, console=Console(stderr=True), transient=True), time.monotonic()
    task = progress.add_task(name, total=total)
    with ExitStack() as stack:

        def advance(count: int) -> None:
            if not progress.live.is_started and time.monotonic() - start >= after:
                stack.enter_context(progress)
            progress.advance(task, count)

        advance(0)
        yield advance
