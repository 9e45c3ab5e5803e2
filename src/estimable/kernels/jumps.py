"""Likelihood ratios of jumps in the state of a linear Gaussian filter.

Letters: under hypothesis h the state z jumped by ν_h e_h, ν_h ~ N(0, V_h), where e_h is a fixed direction and ν_h a number.
A filter that assumes no jump has mean m; had z jumped by ν, the true mean would be m + f ν, with f (n,) the response, column h
of Φ. Its innovations, made white and of variance one, are ε; E (p, n) is their derivative with respect to m, so that given
the jump they have mean -E f ν, and the log of the likelihood ratio is d ν - c ν² / 2, d = -f' E' ε and c = |E f|².

References: A. S. Willsky, H. L. Jones, IEEE Trans. Automatic Control 21 (1976) 108-112, (14)-(22): their G is H f, their C the
sum of c and their d that of d; M. Pollak, Annals of Statistics 13 (1985) 206-227 for the sum of ratios.
"""

from typing import NamedTuple

import jax.numpy as jnp

from .shapes import Float
from .small import Real, apply, product


def learn(
    Φ: Float[Real, "n h"],
    d: Float[Real, " h"],
    c: Float[Real, " h"],
    E: Float[Real, "p n"],
    ε: Float[Real, " p"],
) -> tuple[Float[Real, " h"], Float[Real, " h"]]:
    """The score d and the information c of the size of each jump, after one more sample."""
    G = -product(E, Φ)  # (17) of the reference, made white
    return d + apply(G.T, ε), c + jnp.sum(G * G, axis=0)  # (21), (22)


class Verdict(NamedTuple):
    """The log of the summed ratios (NaN without a hypothesis); of each, its probability given that one holds, its ν and v."""

    log_sum: Real
    probability: Real
    ν: Real
    variance: Real


def judge(
    d: Float[Real, " h"], c: Float[Real, " h"], V: Float[Real, " h"], weight: Float[Real, " h"]
) -> Verdict:
    """The ratios of the likelihoods with ν integrated out, exp(ν̂² / 2 v) / sqrt(1 + V c), summed with their weights."""
    variance = V / (1 + V * c)                                   # v, of ν given the samples
    ν = variance * d
    log_ratio = (ν * d - jnp.log(1 + V * c)) / 2
    possible = weight > 0
    largest = jnp.max(jnp.where(possible, log_ratio, -jnp.inf), initial=-1e300)
    ratio = weight * jnp.exp(jnp.where(possible, log_ratio - largest, 0.0))
    total = jnp.sum(ratio)
    some = total > 0
    total = jnp.where(some, total, 1.0)
    return Verdict(jnp.where(some, largest + jnp.log(total), jnp.nan), ratio / total, ν, variance)


def mixture(Φ: Float[Real, "n h"], verdict: Verdict) -> tuple[Float[Real, " n"], Float[Real, "n n"]]:
    """The averaged hypotheses' additions to the mean and covariance of the filter that assumes no jump."""
    π = verdict.probability
    shift = apply(Φ, π * verdict.ν)  # mean of f ν
    apart = Φ * verdict.ν[None, :] - shift[:, None]
    within = product(Φ * (π * verdict.variance)[None, :], Φ.T)  # mean of f v f'
    return shift, within + product(apart * π[None, :], apart.T)
