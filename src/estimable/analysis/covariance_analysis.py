"""How well each quantity can be known, over time, before any data."""

from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..data.record import Record
from ..frozen import frozen, replace, static
from ..kernels.step_factors import semidefinite_factor
from ..models.nonlinear_model import NonlinearModel
from ..models.prior import Prior
from ..models.state_space import StateSpace
from ..protocols import Algorithm
from ..results import CovarianceQuestion, Remedy
from . import covariance_courses as courses
from .blind_combinations import blind, certificates
from .covariance_models import ArrayQuestion, as_dict, ask
from .covariance_sentences import covariance_sentences
from .covariance_verdicts import judge, times
from .filter_errors import filter_course, of_filter
from .remedies import remedies, without


@frozen
class CovarianceAnalysis:
    """The result of `covariance_analysis`: the sigma of q quantities over time, before any data.

    - `time` (K,): seconds after the first sample. `sigma` (K, q): the standard deviation of the error of the optimal estimate
      after the sample at that time. `prior_sigma` (K, q): that without any sample. Infinite where a quantity is undetermined.
    - `limit` (q,): the value to which sigma tends, NaN where the horizon does not show it.
    - `names` (q,), and their `verdicts` (q,): "known already" (by the prior and the model alone), "known" (from
      `time_to_requirement` to the end; without a requirement: sigma falls), "lost again" (met before, but not at the end),
      "improves no further" (settled above the requirement), "never" (the outputs remove less than `learnt` of sigma), or
      "still improving".
    - `requirement` (q,): NaN where there is none. `time_to_requirement` (q,): seconds from which on it is met, to the sample;
      NaN if it is not met at the end. `time_to_improve` (q,): seconds until 90 % of the improvement is made.
    - `states` (n,): the names of the states, then of gains or parameters. `indistinguishable` (r, n): shifts that look the same
      to the outputs, by one sigma of the model alone (for a diffuse prior: norm 1). `share_left` (r,): the share of that sigma
      that is left.
    - `squared_correlations` (s,): the squared canonical correlations of the state with the outputs, the least known first.
    - `rank`: the number of independent directions of the state that noise-free outputs show. `distance`: the relative size of
      the smallest change of the model that hides one; 0 if one is hidden. Both are certificates of the structure, and no
      verdict depends on them. None for models that vary in time.
    - `sigma_range` (2, K, q): with `draws`, the 10 and 90 % quantiles of sigma over the trajectories; else None.
    - `claimed_sigma` (K, q): with `filter`, the sigma that this filter computes for itself; else None.
    - `until`: the time after which numbers overflow, None if they do not.
    - `question`: the arguments.
    """

    time: Annotated[Any, "K"]
    sigma: Annotated[Any, "K q"]
    prior_sigma: Annotated[Any, "K q"]
    limit: Annotated[Any, "q"]
    names: Annotated[tuple[str, ...], "q"] = static()
    verdicts: tuple[str, ...] = static()
    requirement: Annotated[Any, "q"]
    time_to_requirement: Annotated[Any, "q"]
    time_to_improve: Annotated[Any, "q"]
    states: Annotated[tuple[str, ...], "n"] = static()
    outputs: tuple[str, ...] = static()
    indistinguishable: Annotated[Any, "r n"]
    share_left: Annotated[Any, "r"]
    squared_correlations: Any
    rank: int | None = static()
    distance: float | None
    until: float | None
    question: CovarianceQuestion
    sigma_range: Any = None
    claimed_sigma: Any = None

    @property
    def met(self) -> bool:
        """Whether every requirement is met at the end."""
        asked = np.isfinite(np.asarray(self.requirement))
        return not bool(np.any(asked & ~np.isfinite(np.asarray(self.time_to_requirement))))

    @property
    def sentences(self) -> tuple[str, ...]:
        """One sentence for each quantity, then the shifts that look the same."""
        return covariance_sentences(self)

    @property
    def error_budget(self) -> dict[str, dict[str, float]]:
        """For each quantity the share of each source in the variance at the end: prior, process noises and sensors.

        The shares add up to 1. Each is the relative change of the variance for a relative change of the variance of its
        source. Cost: that of the analysis, times the number of sources. Raises `AssumptionError` for a model with cross
        noise S.
        """
        return _error_budget(self)

    def at(self, prior: Prior) -> "CovarianceAnalysis":
        """The same analysis from another prior."""
        return self._again(prior=prior)

    def without(self, sensor: str) -> "CovarianceAnalysis":
        """The same analysis with one sensor lost from the beginning. Raises `InputError` for an unknown name."""
        return self._again(**without(self, sensor))

    def remedies(self) -> tuple[Remedy, ...]:
        """What would lower the largest sigma, relative to its requirement, the best first.

        Tried are half the noise of each sensor whose share in the variance is at least 5 %, half the prior sigma where the
        prior has that share, and a new sensor of each quantity, as accurate as its requirement (or half its sigma). Cost:
        an analysis for each.
        """
        return remedies(self, self._again)

    def plot(self) -> Any:
        """A plotly figure: sigma over time, next to that of the model alone and the requirement."""
        from ..figures.covariance_plots import plot_covariance

        return plot_covariance(self)

    def _again(self, **changes: StateSpace | Algorithm[Any] | Prior | Numbers | None) -> "CovarianceAnalysis":
        return _analysed(replace(self.question, **changes))

    def __repr__(self) -> str:
        return f"CovarianceAnalysis({' '.join(self.sentences)})"


def covariance_analysis(
    model: StateSpace | NonlinearModel | Algorithm[Any],
    *,
    prior: Prior,
    horizon: float | None = None,
    dt: float | None = None,
    u: Numbers | None = None,
    record: Record | None = None,
    arrival: Numbers | None = None,
    wanted: Mapping[str, Numbers] | None = None,
    requirement: Mapping[str, float] | None = None,
    parameters: Prior | None = None,
    filter: StateSpace | Algorithm[Any] | None = None,
    draws: int = 0,
    learnt: float = 0.01,
) -> CovarianceAnalysis:
    """The sigma of every state, or wanted combination, over time, with a verdict on each: covariance analysis before any data.

    For a linear model the error covariance of the optimal filter does not depend on the data. So this is exact, and the filter
    of the same model reaches it. Nothing depends on the units, unstable models and vague priors are ordinary, and ranks are
    not guessed from rounding: what the outputs never show is split off first.

    - `model`: a `StateSpace`, constant or with rows in time; or an `UnknownGain`, whose gains become quantities too (its own
      `gain` is their prior, `walk` their drift); or a `NonlinearModel`, along the trajectory from the mean of the prior under
      the inputs: the bound of Cramér and Rao where it has no process noise.
    - `prior`: the `Prior` of the state before the first sample: exact, vague, zero or diffuse.
    - `horizon`: the number of samples (seconds where the model has dt = 0). None: until nothing changes, by powers of two; for
      a model with rows in time, all its rows.
    - `dt`: the step at which a continuous model is sampled, in seconds; R is then the covariance of a sample. None: R is a
      density, and the outputs are continuous.
    - `u` (T, m) or `record`: the inputs, for an `UnknownGain` or a `NonlinearModel`; a record also has its missing outputs.
    - `arrival`: (T,) or (T, p) of 0 and 1: the samples, or channels, that arrive.
    - `wanted`: {name: row (n,)}: the quantities as combinations of states (then gains). None: every state and gain.
    - `requirement`: {name: sigma} in the user's units; None: verdicts against the prior only.
    - `parameters`: the `Prior` of the parameters of a `NonlinearModel`, which become quantities. None: they are known.
    - `filter`: a `Kalman` filter with fewer states, or with other matrices or noises, whose true errors on this model are asked
      for. Its states are named as those of the model; a state that it omits is considered, and never estimated. `sigma` is then
      that of its true error, and `claimed_sigma` what it says itself. None: the optimal filter of the model.
    - `draws`: the number of trajectories of a `NonlinearModel`, with starts and parameters drawn from the priors. `sigma` is then
      the rms over them, and `sigma_range` has their 10 and 90 % quantiles. 0: the trajectory of the means alone. Where the
      information depends strongly on the trajectory, that is too optimistic.
    - `learnt`: the share of sigma below which an improvement counts as none.

    Returns a `CovarianceAnalysis`. Raises `InputError` with all faults: a requirement that is not positive or has an unknown
    name, a row of the wrong length, a prior of another size, a horizon beyond the rows, an `arrival` other than 0 and 1, an
    `UnknownGain` without inputs, and noise-free sensors that repeat each other.

    Cost: for a constant model 20 products and factorisations of n × n per power of two of the horizon. For others 10 per row.

    References: A. Gelb (ed.), Applied Optimal Estimation (1974) ch. 7; P. S. Maybeck, Stochastic Models, Estimation and
    Control 1 (1979) ch. 6; Särkkä & García-Fernández, IEEE TAC 66 (2021) 299-306 (composition);
    J. H. Taylor, IEEE TAC 24 (1979) 343 (along a trajectory).

    >>> model = StateSpace([[1.0, 1.0], [0.0, 1.0]], C=[[1.0, 0.0]], R=[[1.0]], dt=1, states=["position", "speed"])
    >>> found = covariance_analysis(model, prior=Prior([0.0, 0.0], np.eye(2)), horizon=50, requirement={"speed": 0.1})
    >>> found.verdicts[1], float(found.time_to_requirement[1])
    ('known', 9.0)
    """
    question = CovarianceQuestion(
        model, prior, horizon, dt, u, record, arrival,
        as_dict(wanted), as_dict(requirement), learnt,
        parameters, draws, filter,
    )  # fmt: skip
    return _analysed(question)


def _analysed(question: CovarianceQuestion) -> CovarianceAnalysis:
    """The answer to a question."""
    asked = ask(question)
    (found, h), spread = _courses(asked), None
    if question.draws:
        found, spread = _drawn(question, found)
    claimed = None
    if question.filter is not None:
        found, claimed = _filtered(question, asked)
    time = np.array(found.steps, float) * h
    r = asked.requirement
    since = times(asked, found, h)
    shifts, left, squared = blind(asked, found)
    rank, distance = certificates(asked)
    return CovarianceAnalysis(
        time=time, sigma=found.sigma, prior_sigma=found.open, limit=found.limit, names=asked.names,
        verdicts=judge(found, r, since, float(question.learnt), asked.horizon), requirement=r, time_to_requirement=since,
        time_to_improve=_improved(time, found), states=asked.states, outputs=asked.outputs, indistinguishable=shifts,
        share_left=left, squared_correlations=squared, rank=rank, distance=distance, sigma_range=spread, claimed_sigma=claimed,
        until=None if found.until is None else found.until * h, question=question,
    )  # fmt: skip


def _error_budget(found: CovarianceAnalysis) -> dict[str, dict[str, float]]:
    """The share of each source in the variance of each quantity at the end."""
    asked = ask(found.question)
    if asked.crossed:
        checks.refuse("an error budget needs separate sources: the noises of this model are correlated by `S`.")
    h = courses.base_step(asked.question, asked.horizon)[0]
    steps = round(float(found.time[-1]) / h)
    shares = courses.shares(asked.question, h, steps, constant=asked.question.constant and not asked.noise_free)
    names = asked.question.sources
    return {name: {source: float(shares[j, i]) for j, source in enumerate(names)} for i, name in enumerate(found.names)}


def _courses(asked: ArrayQuestion) -> tuple[courses.Spreads, float]:
    """The sigmas over time, and the time of a step."""
    question = asked.question
    if question.constant and not asked.noise_free:
        h, last = courses.base_step(question, asked.horizon)
        return courses.by_octaves(question, h, last), h
    rows = courses.MOST_ROWS if asked.horizon is None else int(asked.horizon) + 1
    found = courses.sample_by_sample(question, rows, noise_free=asked.noise_free, settle=asked.horizon is None)
    return found, question.dt


def _drawn(question: CovarianceQuestion, nominal: courses.Spreads) -> tuple[courses.Spreads, np.ndarray]:
    """The rms of sigma over trajectories from drawn starts and parameters, and its quantiles; the same draws at each call."""
    rng = np.random.default_rng(0)
    sigma = []
    for _ in range(question.draws):
        changes = {"prior": _moved(question.prior, rng)}
        if question.parameters is not None:
            changes["parameters"] = _moved(question.parameters, rng)
        sigma.append(_courses(ask(replace(question, **changes)))[0].sigma)
    rms = np.sqrt(np.mean(np.square(sigma), axis=0))
    return nominal._replace(sigma=rms), np.quantile(sigma, [0.1, 0.9], axis=0)


def _moved(prior: Prior, rng: np.random.Generator) -> Prior:
    """The prior about a mean that is drawn from it."""
    half = semidefinite_factor(np.asarray(prior.covariance))
    return replace(prior, mean=prior.mean + half @ rng.normal(size=half.shape[1]))


def _filtered(question: CovarianceQuestion, asked: ArrayQuestion) -> tuple[courses.Spreads, np.ndarray]:
    """The true sigma of a given filter at every sample, and what it claims."""
    own, M = of_filter(question, asked)
    settle = asked.horizon is None
    rows = courses.MOST_ROWS if settle else int(asked.horizon or 0) + 1
    filtered = filter_course(asked.question, own.question, M, rows, settle=settle)
    steps = len(filtered.sigma)
    optimal = courses.sample_by_sample(asked.question, steps, noise_free=asked.noise_free)
    settled, limit = courses.limits(filtered.sigma, optimal.steps, None if settle and steps < rows else rows)
    return optimal._replace(sigma=filtered.sigma, settled=settled, limit=limit), filtered.claimed


def _improved(time: np.ndarray, found: courses.Spreads) -> np.ndarray:
    """The first time shown at which 90 % of the improvement from the prior to the end is made; NaN without a finite prior."""
    start, end = found.open[0], found.sigma[-1]
    with np.errstate(invalid="ignore"):
        enough = found.sigma <= start - 0.9 * (start - end)
        improves = np.isfinite(start) & (end < start)
    return np.where(improves, time[np.argmax(enough, axis=0)], np.nan)
