"""Steps compiled by XLA without changes: the reference engine."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .. import forks
from ..annotations import Array, Tree
from .step import Samples, Select, Stepping, Use, step

LONG = 10_000  # rows from which unrolling pays: 20 % faster, for twice the compilation
UNROLL = 2
KEEP = ("all", "means", "last", "likelihood")


class Run(NamedTuple):
    """The result of a run: selected infos (T rows, the last one, or None), log-likelihood, first failure and state."""

    info: Any
    log_likelihood: Any
    code: Any
    failed_at: Any
    state: Any


@forks.jit(static_argnames=("keep", "select"))
def scan(algorithm: Stepping, prior: Tree, samples: Samples, intervals: Tree, *, keep: str, select: Select) -> Run:
    """`init`, then `correct` and `predict` over T samples. `select(info, keep)` selects the outputs of an info."""
    T = samples.seen.shape[0]

    def go(carry: tuple[Tree, Tree], row: tuple[Array, Tree, Tree]):
        k, sample, interval = row
        left = step(algorithm, k, carry[0], sample, interval, keep, select)
        totals = left.log_likelihood, left.outcome
        return (
            ((left.state, left.kept), (None, totals)) if keep == "last" else ((left.state, None), (left.kept, totals))
        )

    rows = (jnp.arange(T), samples, intervals)
    start = algorithm.init(prior)
    last = None
    if keep == "last":
        first_row = jax.tree_util.tree_map(lambda leaf: leaf[0], rows)
        shapes = jax.eval_shape(lambda: go((start, None), first_row)[0][1])
        last = jax.tree_util.tree_map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
    (state, last), (infos, (likelihoods, outcomes)) = lax.scan(
        go, (start, last), rows, unroll=UNROLL if T >= LONG else 1
    )
    failed_at = jnp.argmax(outcomes != 0)
    return Run(last if keep == "last" else infos, jnp.sum(likelihoods), outcomes[failed_at], failed_at, state)


@forks.jit(static_argnames=("axes", "keep", "select"))
def scan_bank(
    algorithm: Stepping, prior: Tree, samples: Samples, intervals: Tree, *, axes: tuple, keep: str, select: Select
) -> Run:
    """`scan` mapped over those of (algorithm, samples and intervals, prior) with axis 0 in `axes`."""
    a, r, p = axes

    def one(algorithm: Stepping, prior: Tree, samples: Samples, intervals: Tree):
        return scan(algorithm, prior, samples, intervals, keep=keep, select=select)

    return jax.vmap(one, in_axes=(a, p, r, r))(algorithm, prior, samples, intervals)


def scan_in_blocks(
    algorithm: Stepping,
    prior: Tree,
    samples: Samples,
    intervals: Tree,
    *,
    axes: tuple,
    keep: str,
    select: Select,
    use: Use,
) -> Run:
    """`scan_bank`, whose outputs `use(outputs, first row)` takes: here in one block."""
    run = scan_bank(algorithm, prior, samples, intervals, axes=axes, keep=keep, select=select)
    use(jax.tree_util.tree_map(np.asarray, run.info), 0)
    return run._replace(info=None)
