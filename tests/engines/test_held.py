"""An entry of a row that seldom changes: what follows from it is not computed again, and is the same."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest

from estimable.engines import native, xla
from estimable.engines.llvm.scalar_loop import steady_part
from estimable.frozen import frozen
from estimable.kernels.small import gram, held, triangularise


class Row(NamedTuple):
    M: Any
    seen: Any


@frozen
class Report:
    P: Any
    log_likelihood: Any
    outcome: Any


@frozen
class Holding:
    """P = M M' by a long way, of the M of each row."""

    M: Any

    def at(self, k):
        return self

    def init(self, prior):
        return self.M

    def correct(self, state, row):
        M = held(row.M, state)
        return M, Report(gram(triangularise(M)), jnp.zeros(()), jnp.zeros((), int))

    def predict(self, state, interval):
        return state


def select(report, keep):
    return report.P


@pytest.fixture
def rows():
    """Matrices that stay, become NaN, and stay again; and one that differs in a single row."""
    some = np.random.default_rng(0).normal(size=(4, 3, 3))
    M = np.concatenate([np.repeat(some[[i]], 60, axis=0) for i in range(4)])
    M[70:90, 1, 2] = np.nan
    M[200] += 1e-9 * np.eye(3)
    return Row(M, np.ones((len(M), 1), bool))


def test_every_row_is_that_of_its_own_entry(rows):
    runs = [e.scan(Holding(np.eye(3)), None, rows, None, keep="all", select=select).info for e in (native, xla)]
    ours, theirs = (np.delete(run, np.s_[70:90], axis=0) for run in runs)
    np.testing.assert_allclose(ours, theirs, rtol=1e-13)
    assert np.isfinite(ours).all()
    assert np.isnan(runs[0][70:90, 2, 2]).all()


def test_what_follows_is_left_out(rows, monkeypatch):
    found = []
    monkeypatch.setenv("ESTIMABLE_CACHE", "off")  # what was once assembled is not written again

    def spy(loop, same):
        found.append(steady_part(loop, same))
        return found[-1]

    monkeypatch.setattr("estimable.engines.llvm.scalar_loop.steady_part", spy)
    native.compiled_step.cache_clear()
    native.scan(Holding(2 * np.eye(3)), None, rows, None, keep="all", select=select)
    assert any(part is not None and len(part.carry) == 9 and sum(part.slow) > 64 for part in found)
