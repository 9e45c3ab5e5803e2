"""Responses and predictions in blocks are those of a loop, to rounding, whatever is missing."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable.kernels import innovations_form as kernel
from estimable.kernels import tangents


def system(n, m, p, seed=0):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    A *= 0.9 / np.abs(np.linalg.eigvals(A)).max()
    B, C, D = rng.normal(size=(n, m)), rng.normal(size=(p, n)), rng.normal(size=(p, m))
    return kernel.System(A, B, C, D, np.eye(n), np.eye(p), np.zeros((n, p)))


@pytest.mark.parametrize(("n", "m", "p", "rows"), [(3, 2, 2, 200), (1, 1, 1, 31), (2, 1, 3, 64), (4, 0, 2, 70)])
def test_blocks_are_the_loop(n, m, p, rows):
    one, rng = system(n, m, p), np.random.default_rng(1)
    u, y, x = rng.normal(size=(rows, m)), rng.normal(size=(rows, p)), rng.normal(size=n)
    y[10:14, 0] = np.nan
    state, slow = x, []
    for row in u:
        slow.append(one.C @ state + one.D @ row)
        state = one.A @ state + one.B @ row
    found, end = kernel.response(one, u, x)
    assert_allclose(found, slow, atol=1e-12)
    assert_allclose(end, state, atol=1e-12)

    state, P, slow = x, np.zeros((n, n)), []
    for row, datum in zip(u, y, strict=True):
        step = kernel._step(one, P, ~np.isnan(datum))
        slow.append(one.C @ state + one.D @ row)
        state = one.A @ state + one.B @ row + step.K @ (datum - slow[-1])[~np.isnan(datum)]
        P = step.P
    predicted, V, (end, _) = kernel.predictions(one, u, y, x, np.zeros((n, n)))
    assert_allclose(predicted, slow, atol=1e-10)
    assert_allclose(end, state, atol=1e-10)
    assert V.shape == (rows, p, p)


def test_moves_of_outputs_are_differences_of_responses():
    one, rng = system(2, 1, 2), np.random.default_rng(2)
    base = tangents.Dynamics(*one[:4])
    d = tangents.Dynamics(*(rng.normal(size=(3, *M.shape)) for M in base))
    u, x = rng.normal(size=(40, 1)), rng.normal(size=2)
    found = tangents.output_moves(base, d, u, x)
    for i in range(3):
        moved = {name: 1e-6 * getattr(d, name)[i] for name in "ABCD"}
        ends = [one._replace(**{name: getattr(base, name) + side * moved[name] for name in "ABCD"}) for side in (1, -1)]
        up, down = (kernel.response(end, u, x)[0] for end in ends)
        assert_allclose(found[i], (up - down) / 2e-6, atol=1e-5)
    assert tangents.output_moves(base, tangents.Dynamics(*(M[:0] for M in d)), u, x).shape == (0, 40, 2)
