"""The straight line replayed in JAX, each scalar an array over the runs of a bank: on any device, and without LLVM."""

import math
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .lowering import Written, batch, write
from .program.primitives import PYTHON, UnsupportedError, row, type_of
from .program.straight_line import Program
from .time_varying import laid_out
from .xla import Run

MOST = 2_600  # operations: XLA compiles 1,000 in 4 s and 4,400 in 32 s
QUICK = {"xla_cpu_use_fusion_emitters": False}  # long lines of scalars then compile on a CPU in half the time


def scan_bank(algorithm: Any, prior: Any, samples: Any, intervals: Any, *, axes: tuple, keep: str, select: Any) -> Run:
    """What `xla.scan_bank` does, to rounding. Raises `UnsupportedError` where the step cannot be lowered."""
    algorithm, samples, intervals, axes = laid_out(algorithm, samples, intervals, axes)
    written = write(algorithm, prior, samples, intervals, axes=axes, keep=keep, select=select)
    if len(written.row.operations) > MOST:
        raise UnsupportedError(f"more than {MOST:,} operations, which XLA compiles too slowly")
    size, fixed, rows = batch(algorithm, prior, samples, intervals, axes)
    rows = [(leaf if axis is None else leaf.swapaxes(0, 1), axis) for leaf, axis in rows]
    return _scan(
        [_across(leaf, axis, leaf.shape[:0]) for leaf, axis in fixed],
        [_across(leaf, axis, leaf.shape[:1]) for leaf, axis in rows], written=written, size=size, keep=keep,
    )  # fmt: skip


def _across(leaf: np.ndarray, axis: int | None, rows: tuple) -> np.ndarray:
    """(*rows, entries, runs) of (*rows, runs, ..), with one run where all share it, as floats, integers or bools."""
    runs = 1 if axis is None else leaf.shape[len(rows)]
    flat = leaf.reshape(*rows, runs, math.prod(leaf.shape) // max(1, math.prod(rows) * runs)).swapaxes(-1, -2)
    return flat.astype(PYTHON[type_of(leaf.dtype)])


@partial(jax.jit, static_argnames=("written", "size", "keep"), compiler_options=QUICK)
def _scan(fixed: list, rows: list, *, written: Written, size: int, keep: str) -> Run:
    """The loop over time; the step is replayed while it is traced."""
    program, before = written.row, written.fixed + written.states
    always = _scalars(program.inputs[: written.fixed], fixed)
    outputs = written.outputs
    kept, likelihood, outcome = outputs.kept, int(outputs.log_likelihood), int(outputs.outcome)
    names = sorted({int(name) for array in kept for name in array.ravel()})

    def step(carry, samples):
        now = dict(zip((entry.now for entry in written.carried), carry[0], strict=True))
        values = replay(program, always | now | _scalars(program.inputs[before:], samples))
        state = [_wide(values[entry.after], size) for entry in written.carried]
        each = [_wide(values[name], size) for name in names]
        told = _wide(values[likelihood], size), _wide(values[outcome], size).astype(int)
        return ((state, each), (None, told)) if keep == "last" else ((state, None), (each, told))

    begin = replay(written.start, _scalars(written.start.inputs, fixed))
    start = [_wide(begin[entry.start], size) for entry in written.carried]
    types = [PYTHON[program.operations[name].type] for name in names]
    blank = [jnp.zeros(size, type_) for type_ in types] if keep == "last" else None
    (_, last), (each, (likelihoods, outcomes)) = lax.scan(step, (start, blank), rows)
    scalars: dict[int, Any] = dict(zip(names, last or each or [], strict=True))
    lead = (size,) if keep == "last" else (size, len(outcomes))
    info = jax.tree_util.tree_map(
        lambda leaf, array: _arranged([scalars[int(name)] for name in array.ravel()], lead, leaf),
        written.kept, jax.tree_util.tree_unflatten(jax.tree_util.tree_structure(written.kept), kept),
    )  # fmt: skip
    failed_at = jnp.argmax(outcomes != 0, axis=0)
    return Run(info, jnp.sum(likelihoods, axis=0), outcomes[failed_at, jnp.arange(size)], failed_at, None)


def replay(program: Program, inputs: dict[int, Any]) -> list:
    """Each scalar as an array over the runs, or over one run where it is the same in all."""
    values: list[Any] = []
    for name, operation in enumerate(program.operations):
        if operation.name == "constant":
            values.append(np.full(1, operation.value))
        elif operation.name == "input":
            values.append(inputs[name])
        else:
            arguments = [values[argument] for argument in operation.arguments]
            found = row(operation.name, tuple(program.operations[argument].type for argument in operation.arguments))
            width = max(len(argument) for argument in arguments)
            values.append(found.jax(*(_wide(argument, width) for argument in arguments)))
    return values


def _scalars(names: tuple[np.ndarray, ...], arrays: list) -> dict[int, Any]:
    """The entries that are read of arrays (entries, runs), by name."""
    return {
        int(name): lax.index_in_dim(array, entry, 0, keepdims=False)
        for named, array in zip(names, arrays, strict=True)
        for entry, name in enumerate(named.ravel())
        if name >= 0
    }


def _wide(scalar: Any, width: int) -> Any:
    return scalar if len(scalar) == width else jnp.broadcast_to(scalar, (width,))


def _arranged(scalars: list, lead: tuple, leaf: Any) -> Any:
    """The entries of an array, each (rows, runs) or (runs,), as that array for each run and row."""
    flat = jnp.stack([scalar.T for scalar in scalars], axis=-1) if scalars else jnp.zeros(0)
    return flat.reshape(*lead, *leaf.shape).astype(leaf.dtype)
