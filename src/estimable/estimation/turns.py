"""The turns of calls that come from several threads and must run one after another."""

import time
from contextlib import suppress

from ..errors import EstimableError

PATIENCE = 10.0  # [s] that a call waits for the end of another thread's call


def wait(turn: list[bool]) -> None:
    """Take the only item of `turn`, which other calls take while they run. Raises `EstimableError` where that lasts too long.

    `pop` is atomic, and costs a third of a lock.
    """
    end = time.monotonic() + PATIENCE
    while True:
        with suppress(IndexError):
            turn.pop()
            return
        if time.monotonic() > end:
            raise EstimableError(
                f"another call of this run has not ended for {PATIENCE:g} s. A signal handler that interrupts a call, and a "
                "process that was forked during a call of another thread, need another run: load it from a file."
            )
        time.sleep(1e-4)
