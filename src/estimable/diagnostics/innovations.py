"""Tests for a predictable part in the innovations: whiteness, and correlation with an input."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..frozen import saved
from ..kernels.regression import lagged
from . import chi_squared

LAGS = 20
FEWEST = 8  # fewest pairs of samples for which a correlation is judged
COLLINEAR = 1e-3  # relative size below which a direction of the input is omitted
CANCELS = 0.5  # a time shift leaves effects of both signs, a wrong gain mostly of one


@saved
class Correlations(NamedTuple):
    """The result of `whiteness` and `cross_correlation`: correlations of standardised innovations at several lags, and a
    verdict.

    - `lags`: the lags in samples. `values` (lags,): the correlations at these lags. `pairs` (lags,): the number of pairs of
      samples behind each.
    - `band`: two standard deviations of each correlation under a correct model.
    - `statistic`: the weighted sum of squared correlations. `limit`: a correct model stays below it with the chosen
      probability.
    - `p_value` and `passed`: the p-value of `statistic`, and whether `statistic` is below `limit`. `sentence`: the verdict as
      a sentence.
    - `lag`: the lag of the correlation that is largest relative to its band.
    """

    values: np.ndarray
    pairs: np.ndarray
    lags: np.ndarray
    statistic: float
    limit: float
    p_value: float
    passed: bool
    sentence: str

    @property
    def band(self) -> np.ndarray:
        """Two standard deviations of each correlation."""
        return 2 / np.sqrt(np.maximum(self.pairs, 1))

    @property
    def lag(self) -> int:
        """Lag of the correlation that is largest relative to its band."""
        return int(self.lags[np.argmax(np.abs(self.values) * np.sqrt(self.pairs))])


def standardised(innovation: Numbers, innovation_covariance: Numbers) -> np.ndarray:
    """Innovations (T, p) divided by their standard deviations. NaN where an output is missing, known exactly, or of infinite
    variance.

    >>> standardised([[2.0]], [[[4.0]]]).tolist()
    [[1.0]]
    """
    faults = checks.Faults()
    e = faults.numbers("innovation", innovation, nan=True)
    S = faults.numbers("innovation_covariance", innovation_covariance, nan=True)
    faults.finish()
    assert e is not None
    assert S is not None
    if e.ndim != 2 or S.shape != (*e.shape, e.shape[-1]):
        checks.refuse(f"`innovation` must be (T, p) and its covariance (T, p, p). Got {e.shape} and {S.shape}.")
    return in_sigmas(e, S)


def in_sigmas(e: np.ndarray, S: np.ndarray) -> np.ndarray:
    """Divide innovations e (T, p) by their standard deviations from S (T, p, p), as `standardised`, without its checks.

    The predictions of an unstable model may be infinite, which the checks would refuse.
    """
    variance = np.einsum("tii->ti", S)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(variance > 0, e / np.sqrt(variance), np.nan)


def whiteness(e: Numbers, *, name: str = "the output", lags: int = LAGS, probability: float = 0.999) -> Correlations:
    """Test whether the standardised innovations (T,) of one output are white. Samples may be missing.

    The test is the portmanteau test of Ljung & Box (1978) for a mean that is known to be zero. The correlation at a lag comes
    from the pairs of samples that are both seen, divided by the size of these innovations. A wrong noise level therefore has
    no effect. Under a correct model the variance of a correlation is 1 / pairs, whichever samples are missing, and different
    lags are uncorrelated. The sum Σ pairs correlation² is then χ² with `lags` degrees of freedom.

    Returns a `Correlations`.

    >>> whiteness(np.random.default_rng(0).normal(size=500)).passed
    True
    """
    series = _one(e, "e")
    probability = _check(lags, probability, len(series))
    known = ~np.isnan(series)
    z = np.where(known, series, 0.0)
    steps = np.arange(1, lags + 1)
    found = [_correlation(z[lag:], z[:-lag], known[lag:] & known[:-lag]) for lag in steps]
    return _judged(found, steps, probability, lambda verdict: _white_sentence(verdict, name))


def _correlation(a: np.ndarray, b: np.ndarray, both: np.ndarray) -> tuple[float, int]:
    """Correlation of two series of mean zero over the samples where both are known, and their number.

    Its variance is exactly 1 / pairs if either is white and Gaussian, for any other series.
    """
    a, b = a[both], b[both]
    size = np.sqrt((a @ a) * (b @ b))
    return (float(a @ b / size), len(a)) if size > 0 else (0.0, 0)


def cross_correlation(
    e: Numbers,
    u: Numbers,
    *,
    name: str = "the output",
    input_name: str = "the input",
    lags: int = LAGS,
    first: int = 0,
    probability: float = 0.999,
) -> Correlations:
    """Test whether the standardised innovations (T,) of one output depend on an input (T,) at the same sample or at earlier
    samples.

    `lags`: how many samples back; `first`: the smallest lag. Use 1 where the input was computed from the output of the same
    sample. The innovations are regressed on the input at all these lags together. A slow or periodic
    input then does not spread the effect at one lag over its neighbours. The mean of the input is subtracted first, because
    its effect cannot be distinguished from an offset. Rows with a missing output do not count.

    Returns a `Correlations` whose `values` are the partial correlations. Its `statistic` is n R² for n rows and the
    coefficient of determination R². Under a correct model it is χ² with as many degrees of freedom as the input has
    independent directions (a Lagrange multiplier test).

    >>> rng = np.random.default_rng(0)
    >>> cross_correlation(rng.normal(size=500), np.sign(rng.normal(size=500))).passed
    True
    """
    series, driving = _one(e, "e"), _one(u, "u")
    if len(series) != len(driving):
        checks.refuse(f"`e` and `u` must have the same length. Got {len(series)} and {len(driving)}.")
    probability = _check(lags, probability, len(series))
    faults = checks.Faults()
    faults.whole("first", first, 0, lags)
    faults.finish()
    steps = np.arange(first, lags + 1)
    past = lagged(driving, range(first, lags + 1))
    rows = ~np.isnan(series) & ~np.isnan(past).any(axis=1)
    if rows.sum() < FEWEST + len(steps):
        checks.refuse(f"there are too few samples to judge: {rows.sum()} for {len(steps)} lags, {FEWEST} more needed.")
    return _regressed(series[rows], past[rows], steps, probability, name, input_name)


def _regressed(
    e: np.ndarray, past: np.ndarray, steps: np.ndarray, probability: float, name: str, input_name: str
) -> Correlations:
    """The verdict of a regression of e on columns of past inputs."""
    n, centred = len(e), past - past.mean(axis=0)
    left, size, right = np.linalg.svd(centred, full_matrices=False)
    excited = size > COLLINEAR * max(size.max(), 1e-300)
    if not e.any():
        checks.refuse(f"{name} has innovations of exactly zero, so there is nothing to judge.")
    if not size.max() > 0:
        checks.refuse(f"{input_name} is constant: its effect cannot be tested.")
    along = left[:, excited].T @ e
    effect = right[excited].T @ (along / size[excited])
    spread = np.sqrt(np.sum((right[excited] / size[excited][:, None]) ** 2, axis=0) * (e @ e))
    values, pairs = effect / np.where(spread > 0, spread, 1.0), np.full(len(steps), n)
    verdict = _verdict(values, pairs, steps, n * float(along @ along / (e @ e)), int(excited.sum()), probability)
    return verdict._replace(sentence=_input_sentence(verdict, effect, name, input_name))


def _one(values: Numbers, name: str) -> np.ndarray:
    faults = checks.Faults()
    array = faults.numbers(name, values, nan=True)
    if array is not None and array.ndim != 1:
        faults.add(f"`{name}` must be one channel, (T,). Got {array.shape}.")
    faults.finish()
    assert array is not None
    return array


def _check(lags: int, probability: float, T: int) -> float:
    """`probability` as a float, checked with the number of lags."""
    faults = checks.Faults()
    faults.whole("lags", lags, 1)
    probability = faults.number("probability", probability, above=0.0, upper=1.0)
    if isinstance(lags, int | np.integer) and lags >= T:
        faults.add(f"`lags` must be less than the number of samples, {T}. Got {checks.short(lags)}.")
    faults.finish()
    return probability


def _judged(
    correlations: Sequence[tuple[float, int]], steps: np.ndarray, probability: float, sentence: Callable[..., str]
) -> Correlations:
    values, pairs = (np.array(column) for column in zip(*correlations, strict=True))
    counted = pairs >= FEWEST
    if not counted.any():
        checks.refuse(f"there are too few pairs of samples to judge: at most {pairs.max()} at a lag, {FEWEST} needed.")
    values, pairs = np.where(counted, values, 0.0), np.where(counted, pairs, 0)
    found = _verdict(values, pairs, steps, float(np.sum(pairs * values**2)), int(counted.sum()), probability)
    return found._replace(sentence=sentence(found))


def _verdict(
    values: np.ndarray, pairs: np.ndarray, steps: np.ndarray, statistic: float, degrees: float, probability: float
) -> Correlations:
    limit, p_value = float(chi_squared.quantile(probability, degrees)), float(chi_squared.exceeded(statistic, degrees))
    return Correlations(values, pairs, steps, statistic, limit, p_value, statistic <= limit, "")


def _white_sentence(found: Correlations, name: str) -> str:
    size = f"(sum of squared correlations {found.statistic:.1f}, limit {found.limit:.1f})"
    if found.passed:
        return f"innovations of {name} are white {size}"
    first = found.values[0]
    if found.lag == 1 or abs(first) * np.sqrt(found.pairs[0]) > 3:
        cause = (
            "each is similar to the one before: Q too small relative to R, or an unmodelled input or mode"
            if first > 0
            else "each has the opposite sign of the one before: Q too large relative to R"
        )
    else:
        cause = "a mode, a delay or a disturbance with that period is not in the model"
    most = f"most correlated at lag {found.lag}"
    return f"innovations of {name} are not white {size}, {most}: {cause} (correlation {first:+.2f} at lag 1)"


def _input_sentence(found: Correlations, effect: np.ndarray, name: str, input_name: str) -> str:
    size = f"(n R² of the regression {found.statistic:.1f}, limit {found.limit:.1f})"
    if found.passed:
        return f"innovations of {name} do not depend on {input_name} {size}"
    where = "at the same sample" if found.lag == 0 else f"{checks.counted(found.lag, 'sample')} later"
    beyond = effect[np.abs(found.values) > found.band]
    shifted = len(beyond) > 1 and np.abs(beyond.sum()) < CANCELS * np.abs(beyond).sum()
    cause = (
        "the effect comes too early or too late: the delay or the hold of the input is probably wrong"
        if shifted
        else "the gain of the input is probably wrong, or its effect is not in the model"
    )
    return f"innovations of {name} depend on {input_name} {size}, most {where}: {cause}"
