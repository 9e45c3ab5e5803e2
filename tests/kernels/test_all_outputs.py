"""Many outputs at once against the array form, which takes one after the other, and against sixty digits."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable.kernels import all_outputs, kalman
from estimable.kernels.kalman import Gaussian, Measurement

N, P = 10, 12


def case(seed=0, scale=1.0, **changed):
    """A belief about ten states, and twelve outputs of which some were not seen."""
    rng = np.random.default_rng(seed)
    drawn = {
        "m": rng.normal(size=N), "Z": scale * rng.normal(size=(N, N)), "C": rng.normal(size=(P, N)), "d": rng.normal(size=P),
        "r": rng.uniform(0.1, 2.0, size=P), "y": rng.normal(size=P), "seen": rng.random(P) < 0.8, "size": np.ones(N),
    }  # fmt: skip
    return drawn | changed


def correct(update, c):
    """The posterior of a case by one of the kernels."""
    prior = Gaussian(c["m"], c["Z"], jnp.zeros((N, 0)), c["size"], jnp.zeros(()))
    return update(prior, Measurement(c["C"], c["d"], jnp.eye(P) * c["r"][:, None]), c["y"], c["seen"])


def covariance(posterior):
    """That of the state."""
    return posterior.state.Z @ posterior.state.Z.T


def twins():
    """Two noise-free outputs that are one and the same, before others."""
    c = case(3, seen=np.ones(P, bool))
    c["C"][4], c["d"][4], c["y"][4] = c["C"][1], c["d"][1], c["y"][1]
    c["r"][[1, 4]] = 0.0
    return c


def noise_free():
    """More noise-free outputs than states, of a state that there is."""
    c = case(1, r=np.zeros(P), seen=np.ones(P, bool))
    return c | {"y": c["C"] @ np.arange(N) + c["d"]}


CASES = {
    "some seen": case(),
    "all seen": case(seen=np.ones(P, bool)),
    "none seen": case(seen=np.zeros(P, bool)),
    "little known": case(scale=1e6),
    "exact": case(r=np.full(P, 1e-6)),
    "twins": twins(),
    "noise-free": noise_free(),
    "contradicted": noise_free() | {"y": np.arange(P) * 1.0},
    "known exactly": case(Z=np.zeros((N, N))),
    "known exactly, noise-free": case(Z=np.zeros((N, N)), r=np.zeros(P)),
    "of rank three": case(Z=np.eye(N)[:, :3]),
    "other units": case(C=case()["C"] * 10.0 ** np.arange(-6, 6)[:, None]),
}


@pytest.mark.parametrize("name", CASES)
def test_all_outputs_at_once_tell_what_they_tell_in_turn(name):
    ours, theirs = (jax.jit(correct, static_argnums=0)(by.correct, CASES[name]) for by in (all_outputs, kalman))
    sigma = np.sqrt(np.diag(covariance(theirs))) + 1e-8
    assert_allclose(ours.state.m / sigma, theirs.state.m / sigma, rtol=1e-9, atol=1e-6)
    assert_allclose(covariance(ours) / np.outer(sigma, sigma), covariance(theirs) / np.outer(sigma, sigma), atol=1e-10)
    assert_allclose(ours.log_likelihood, theirs.log_likelihood, rtol=1e-10)
    assert_allclose(ours.error, theirs.error, rtol=1e-9, atol=1e-9)
    assert_allclose(ours.variance, theirs.variance, rtol=1e-9)
    assert_allclose(ours.innovation_covariance, theirs.innovation_covariance, rtol=1e-12, atol=1e-12)
    assert bool(ours.contradicted) == bool(theirs.contradicted)


def test_contradictions_are_found():
    assert bool(correct(all_outputs.correct, CASES["contradicted"]).contradicted)
    assert not bool(correct(all_outputs.correct, CASES["noise-free"]).contradicted)


@pytest.mark.parametrize("scale", [1.0, 1e6, 1e8])
def test_the_posterior_has_its_digits_however_little_was_known(scale):
    c = case(5, scale, seen=np.ones(P, bool))
    with mpmath.workdps(60):
        Z, C, R = (mpmath.matrix(M.tolist()) for M in (c["Z"], c["C"], np.diag(c["r"])))
        prior = Z * Z.T
        K = prior * C.T * (C * prior * C.T + R * R) ** -1
        e = mpmath.matrix(c["y"].tolist()) - mpmath.matrix(c["d"].tolist()) - C * mpmath.matrix(c["m"].tolist())
        m = np.array((mpmath.matrix(c["m"].tolist()) + K * e).tolist(), float).ravel()
        exact = np.array((prior - K * C * prior).tolist(), float)
    found, sigma = correct(all_outputs.correct, c), np.sqrt(np.diag(exact))
    assert_allclose(found.state.m / sigma, m / sigma, atol=1e-9)
    assert_allclose(covariance(found) / np.outer(sigma, sigma), exact / np.outer(sigma, sigma), atol=1e-9)


@pytest.mark.parametrize("name", ["some seen", "exact"])
def test_derivatives_are_those_of_the_outputs_in_turn(name):
    c = jax.tree_util.tree_map(jnp.asarray, CASES[name])

    def slope(update):
        return jax.grad(lambda Z, r: correct(update, c | {"Z": Z, "r": r}).log_likelihood, argnums=(0, 1))(
            c["Z"], c["r"]
        )

    for a, b in zip(slope(all_outputs.correct), slope(kalman.correct), strict=True):
        assert_allclose(a, b, rtol=1e-6, atol=1e-9 * np.abs(b).max())


def test_many_beliefs_are_conditioned_as_one():
    some = [case(seed, scale) for seed, scale in ((0, 1.0), (1, 1e6), (2, 1e-3))]
    stacked = {name: np.stack([c[name] for c in some]) for name in some[0]}
    found = jax.jit(jax.vmap(lambda c: correct(all_outputs.correct, c).state.Z))(stacked)
    for Z, c in zip(found, some, strict=True):
        one = covariance(correct(all_outputs.correct, c))
        assert_allclose(Z @ Z.T, one, rtol=1e-9, atol=1e-9 * np.abs(one).max())
