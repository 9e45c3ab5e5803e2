"""Likelihood ratios of jumps in the state of a linear Gaussian filter.

Letters: under a hypothesis the state z jumped at onset r along the directions e_j by ν (p,), ν ~ N(0, J s): J = diag(J_j), s a
scale. One component jumps alone, or all jump together. A filter that assumes no jump has mean m; had z jumped by ν, the true
mean would be m + f ν, with f (n, p) the response Φ[:, :, r]. Its innovations, made white and of variance one, are ε; E (y, n) is
their derivative with respect to m, so that given the jump they have mean -E f ν. The log of the likelihood ratio is then
d'ν - ν'Λν / 2 with d = -f' E' ε (p,) and Λ = f' E' E f (p, p), summed over the samples.

References: A. S. Willsky, H. L. Jones, IEEE Trans. Automatic Control 21 (1976) 108-112, (14)-(22): their G is H f, their C the
sum of Λ and their d that of d; M. Pollak, Annals of Statistics 13 (1985) 206-227 for the sum of ratios; R. P. Adams, D. J. C.
MacKay (2007), arXiv:0710.3742, and P. Fearnhead, Z. Liu, J. R. Statist. Soc. B 69 (2007) 589-605, for the belief between alarms.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import lax

from .onset_grid import Grid, by_level
from .shapes import Float
from .small import Real, apply, product


def whitened(Φ: Float[Real, "n p r"], E: Float[Real, "y n"]) -> Float[Real, "y p r"]:
    """The response of the white innovations to a jump of 1 of each component at each onset."""
    n, p, r = Φ.shape
    return -product(E, Φ.reshape(n, p * r)).reshape(E.shape[0], p, r)  # (17) of the reference, made white


def learn(
    d: Float[Real, "p r"], Λ: Float[Real, "p p r"], G: Float[Real, "y p r"], ε: Float[Real, " y"]
) -> tuple[Float[Real, "p r"], Float[Real, "p p r"]]:
    """The score d and the information Λ of each jump, after one more sample."""
    return d + jnp.sum(G * ε[:, None, None], axis=0), Λ + jnp.sum(G[:, :, None] * G[:, None], axis=0)  # (21), (22)


class Ratios(NamedTuple):
    """Of each hypothesis: the log of its likelihood ratio with ν integrated out, and the mean and covariance of ν.

    `alone`: component j jumps alone, (p, s, r). `together`: all jump, None if that is no hypothesis.
    """

    log_ratio_alone: Float[Real, "p s r"]
    ν_alone: Float[Real, "p s r"]
    variance_alone: Float[Real, "p s r"]
    log_ratio_together: Any = None      # (s, r)
    ν_together: Any = None              # (p, s, r)
    covariance_together: Any = None     # (p, p, s, r)

    @property
    def log_ratio(self) -> Float[Real, "h s r"]:
        """Of all labels: one for each component, and then that of all together."""
        if self.log_ratio_together is None:
            return self.log_ratio_alone
        return jnp.concatenate([self.log_ratio_alone, self.log_ratio_together[None]])


def weigh(
    d: Float[Real, "p r"], Λ: Float[Real, "p p r"], J: Float[Real, " p"], scales: Float[Real, " s"], together: bool
) -> Ratios:
    """The evidence for each hypothesis."""
    V = (J[:, None] * scales[None, :])[:, :, None]                       # variance of ν_j
    c = jnp.stack([Λ[j, j] for j in range(len(d))])[:, None, :]
    v = V / (1 + V * c)                                                  # of ν_j given the samples
    ν = v * d[:, None, :]
    alone = (ν * d[:, None, :] - jnp.log(1 + V * c)) / 2, ν, v
    return Ratios(*alone, *(_together(d, Λ, jnp.sqrt(V)) if together else ()))


def _together(d: Float[Real, "p r"], Λ: Float[Real, "p p r"], D: Float[Real, "p s 1"]):
    """-½ log det(I + J Λ) + ½ d' Σ d, ν = Σ d and Σ = (J^-1 + Λ)^-1 = D (I + D Λ D)^-1 D with D D = J."""
    d = d[:, None, :]
    W, log_root = _whitening([[float(i == j) + D[i] * Λ[i, j][None] * D[j] for j in range(i + 1)] for i in range(len(d))])
    W = [[W[i][j] * D[j] for j in range(i + 1)] for i in range(len(d))]  # L^-1 D, so that Σ = W' W
    Wd = [sum(W[i][j] * d[j] for j in range(i + 1)) for i in range(len(d))]
    ν = jnp.stack([sum(W[i][j] * Wd[i] for i in range(j, len(d))) for j in range(len(d))])
    Σ = [[sum(W[i][j] * W[i][k] for i in range(max(j, k), len(d))) for k in range(len(d))] for j in range(len(d))]
    return sum(w * w for w in Wd) / 2 - log_root, ν, jnp.stack([jnp.stack(row) for row in Σ])


def _whitening(M: list[list[Real]]) -> tuple[list[list[Real]], Real]:
    """L^-1 of the Cholesky factor L of a positive definite M, given by its lower half, and log det L. Entries are arrays."""
    p = len(M)
    L: list[list[Any]] = [[0.0] * (i + 1) for i in range(p)]
    W: list[list[Any]] = [[0.0] * (i + 1) for i in range(p)]
    det: Any = 1.0
    for i in range(p):
        for j in range(i + 1):
            left = M[i][j] - sum(L[i][k] * L[j][k] for k in range(j))
            L[i][j] = jnp.sqrt(left) if i == j else left / L[j][j]
        for j in range(i):
            W[i][j] = -sum(L[i][k] * W[k][j] for k in range(j, i)) / L[i][i]
        W[i][i] = 1 / L[i][i]
        det = det * L[i][i]
    return W, jnp.log(det)


class Verdict(NamedTuple):
    """The log of the weighted sum of the ratios (NaN without a hypothesis), the probability of each hypothesis given that one
    holds, and the log ratio of the likeliest scale of each label at each onset (-inf for no onset)."""

    log_sum: Float[Real, ""]
    probability: Float[Real, "h s r"]
    profile: Float[Real, "h r"]


def judge(evidence: Ratios, seconds: Float[Real, " r"]) -> Verdict:
    """Sum the ratios; an onset has the weight of the seconds that it represents, shared by labels and scales alike."""
    log_ratio = evidence.log_ratio
    labels, scales, _ = log_ratio.shape
    possible = seconds > 0
    profile = jnp.where(possible[None], jnp.max(log_ratio, axis=1), -jnp.inf)
    largest = lax.stop_gradient(jnp.max(profile, initial=-1e300))  # it cancels in the sum
    weight = (seconds / (labels * scales))[None, None]
    ratio = weight * jnp.exp(jnp.where(possible[None, None], log_ratio - largest, 0.0))
    total = jnp.sum(ratio)
    some = total > 0
    total = jnp.where(some, total, 1.0)
    return Verdict(jnp.where(some, largest + jnp.log(total), jnp.nan), ratio / total, profile)


class JumpMoments(NamedTuple):
    """Of the jump at each onset, given that onset: its probability, mean and covariance, over labels and scales."""

    probability: Float[Real, " r"]
    mean: Float[Real, "p r"]
    covariance: Float[Real, "p p r"]


def moments(evidence: Ratios, probability: Float[Real, "h s r"]) -> JumpMoments:
    """Average over labels and scales."""
    p = len(evidence.ν_alone)
    π, ν, v = probability[:p], evidence.ν_alone, evidence.variance_alone
    each = jnp.sum(probability, axis=(0, 1))
    at = jnp.where(each > 0, each, 1.0)
    mean = jnp.sum(π * ν, axis=1) / at[None]
    square = jnp.eye(p)[:, :, None] * (jnp.sum(π * (v + ν * ν), axis=1) / at[None])[:, None]
    if evidence.ν_together is not None:
        π, ν, Σ = probability[p], evidence.ν_together, evidence.covariance_together
        mean = mean + jnp.sum(π[None] * ν, axis=1) / at[None]
        square = square + jnp.sum(π[None, None] * (Σ + ν[:, None] * ν[None]), axis=2) / at[None, None]
    return JumpMoments(each, mean, square - mean[:, None] * mean[None])


def mixture(Φ: Float[Real, "n p r"], jump: JumpMoments) -> tuple[Float[Real, " n"], Float[Real, "n n"]]:
    """The averaged hypotheses' additions to the mean and covariance of the filter that assumes no jump."""
    n, p, r = Φ.shape
    π, moves = jump.probability, jnp.sum(Φ * jump.mean[None], axis=1)              # f ν of each onset, (n, r)
    shift = apply(moves, π)
    apart = moves - shift[:, None]
    ΦΣ = jnp.sum(Φ[:, :, None] * jump.covariance[None], axis=1)                    # (n, p, r)
    within = product((ΦΣ * π[None, None]).reshape(n, p * r), Φ.reshape(n, p * r).T)
    return shift, within + product(apart * π[None, :], apart.T)


class Components(NamedTuple):
    """The distribution of each of some numbers under each hypothesis: its shift and the variance that the jump adds, (g, k)."""

    shift: Float[Real, "g k"]
    variance: Float[Real, "g k"]


def components(Φ: Float[Real, "g p r"], evidence: Ratios) -> Components:
    """Of the rows of the state in Φ, in the order of labels, scales and onsets."""
    g = len(Φ)
    shift = [(Φ[:, :, None] * evidence.ν_alone[None]).reshape(g, -1)]
    variance = [(Φ[:, :, None] ** 2 * evidence.variance_alone[None]).reshape(g, -1)]
    if evidence.ν_together is not None:
        shift += [jnp.sum(Φ[:, :, None] * evidence.ν_together[None], axis=1).reshape(g, -1)]
        ΦΣ = jnp.sum(Φ[:, :, None, None] * evidence.covariance_together[None], axis=1)   # (g, p, s, r)
        variance += [jnp.sum(ΦΣ * Φ[:, :, None], axis=1).reshape(g, -1)]
    return Components(jnp.concatenate(shift, axis=1), jnp.concatenate(variance, axis=1))


def jumped(probability: Float[Real, "h s r"], p: int) -> Float[Real, " p"]:
    """The probability that each component is among those that jumped, given that some did."""
    each = jnp.sum(probability, axis=(1, 2))
    return each[:p] + (each[p] if len(each) > p else 0.0)


class Grouped(NamedTuple):
    """A mixture of components, each with its weight (k,), and shifts and variances (g, k)."""

    weight: Float[Real, " k"]
    shift: Float[Real, "g k"]
    variance: Float[Real, "g k"]


def grouped(found: Components, probability: Float[Real, "h s r"], grid: Grid) -> Grouped:
    """The components with the onsets of one level taken together: by their moments, for each label and scale."""
    h, s, r = probability.shape
    g = len(found.shift)
    w = by_level(probability, grid)                                                     # (h, s, l, slots)
    m, v = (by_level(x.reshape(g, h, s, r), grid) for x in (found.shift, found.variance))
    weight = jnp.sum(w, axis=-1)
    each = w / jnp.where(weight > 0, weight, 1.0)[..., None]
    mean = jnp.sum(each[None] * m, axis=-1)
    square = jnp.sum(each[None] * (v + (m - mean[..., None]) ** 2), axis=-1)
    return Grouped(weight.ravel(), mean.reshape(g, -1), square.reshape(g, -1))
