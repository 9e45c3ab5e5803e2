"""Steps run as they are written, compiled by XLA: the reference engine."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

LONG = 10_000  # rows from which it pays to write steps out in a row: 20 % faster, for twice the compilation
UNROLL = 2
KEEP = ("all", "means", "last", "likelihood")


class Run(NamedTuple):
    """What a run leaves: kept infos (T rows, the last one, or None), the log-likelihood, the first failure, the state."""

    info: Any
    log_likelihood: Any
    code: Any
    failed_at: Any
    state: Any


@partial(jax.jit, static_argnames=("keep", "select"))
def scan(algorithm, prior, samples, intervals, *, keep: str, select) -> Run:
    """`init`, then `correct` and `predict` over T samples. `select(info, keep)` drops from an info what is not kept."""
    state, T = algorithm.init(prior), samples.seen.shape[0]

    def step(carry, row):
        state, total, code, failed_at, _ = carry
        k, sample, interval = row
        now = algorithm.at(k)
        state, info = now.correct(state, sample)
        kept = select(info, keep)
        first = (code == 0) & (info.outcome != 0)
        total = total + (0.0 if info.log_likelihood is None else info.log_likelihood)
        carry = (
            now.predict(state, interval), total, jnp.where(first, info.outcome, code), jnp.where(first, k, failed_at),
            kept if keep == "last" else None,
        )  # fmt: skip
        return carry, None if keep == "last" else kept

    rows = (jnp.arange(T), samples, intervals)
    first_row = jax.tree_util.tree_map(lambda leaf: leaf[0], rows)
    start = (state, jnp.zeros(()), jnp.zeros((), int), jnp.zeros((), int), None)
    if keep == "last":
        shapes = jax.eval_shape(lambda: step((*start[:4], None), first_row)[0][4])
        start = (*start[:4], jax.tree_util.tree_map(lambda s: jnp.zeros(s.shape, s.dtype), shapes))
    unroll = UNROLL if T >= LONG else 1
    (state, total, code, failed_at, last), infos = lax.scan(step, start, rows, unroll=unroll)
    return Run(last if keep == "last" else infos, total, code, failed_at, state)
