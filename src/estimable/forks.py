"""Compiled functions of XLA, which refuse to run in a process that was forked after JAX was used.

XLA's threads exist only in the process that started them. A call in a forked process would wait for them without end.
"""

import functools
import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import jax
from jax._src.core import trace_state_clean

from .errors import EstimableError

if TYPE_CHECKING:
    from .annotations import Tree

_state = {"forked": False}


def check() -> None:
    """Raise `EstimableError` in a process where XLA cannot run."""
    if _state["forked"] and trace_state_clean():
        raise EstimableError(
            "XLA cannot run in this process: it was forked after JAX was used, and XLA's threads exist only in the first "
            'process. Start processes with multiprocessing.get_context("spawn"), or fork before the first use.'
        )


def jit(function: Callable[..., Any] | None = None, **options: str | int | tuple[str, ...]) -> Any:
    """`jax.jit`, with `check` before each call."""
    if function is None:
        return functools.partial(jit, **options)
    compiled: Any = jax.jit(function, **options)  # pyright: ignore[reportArgumentType]

    @functools.wraps(function)
    def call(*arguments: "Tree", **named: "Tree") -> Any:
        check()
        return compiled(*arguments, **named)

    call._cache_size = compiled._cache_size  # type: ignore[attr-defined]
    return call


def _mark() -> None:
    from jax._src import xla_bridge

    _state["forked"] = _state["forked"] or xla_bridge.backends_are_initialized()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_mark)
