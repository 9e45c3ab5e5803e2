"""The sigma of quantities over time: by powers of two for a constant model, sample by sample for another."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from ..kernels import noise_free
from ..kernels import square_root_elements as el
from ..kernels.square_root_elements import Element, lengths, state_error
from ..kernels.step_factors import halvings, of_short_time, pencil, sources_of_short_time
from ..kernels.undetectable import split, undetectable
from .covariance_problem import Question, Stage

Real = np.ndarray
LATEST = 30  # octaves, for the end of a run without a horizon
OCTAVES = 50  # of steps: 2^50
ALL = 32  # steps up to which a constant model is shown at every sample
FORGOTTEN = 1e-14  # of Φ: what came before has no effect
TOUCHES = 1e-9  # share of a quantity in a direction, of its parts, below which it is rounding
SETTLED = 1e-6  # relative change over the last octave of a sigma that has settled
MOST_ROWS = 20_000  # of a noise-free channel without a horizon


class Spreads(NamedTuple):
    """After `steps` (K,): sigma (K, q) with the outputs and `open` (K, q) without; `belief` and `alone` the elements at the end.

    `settled` (q,) and `limit` (q,); `hidden` (q,): quantities with a part that is never shown and does not die out. `until`:
    the last step before an overflow, else None.
    """

    steps: list[int]
    sigma: Real
    open: Real
    belief: Element
    alone: Element
    settled: Real
    limit: Real
    hidden: Real
    until: int | None


def sigma_of(belief: Element, H: Real) -> Real:
    """The sigma of H x: infinite where a diffuse direction touches it."""
    if not all(np.all(np.isfinite(part)) for part in belief):
        return np.full(len(H), np.inf)
    F, N, _ = state_error(belief)
    return np.where(touched(H, N), np.inf, lengths(H @ F))


def touched(H: Real, N: Real) -> Real:
    """Which rows of H are not orthogonal to N, relative to the terms of the products."""
    if N.shape[1] == 0:
        return np.zeros(len(H), bool)
    return np.any(np.abs(H @ N) > TOUCHES * (np.abs(H) @ np.abs(N)), axis=1)


class Powers:
    """The elements of 2^j steps of a constant model, with and without samples, made when they are asked for."""

    def __init__(self, question: Question, *, h: float):
        stage = question.first
        g = stage.noise
        if question.continuous:
            Q, J = g @ g.T, information(stage)
            self.steps, self.alone = [of_short_time(stage.A, Q, J, h)], [of_short_time(stage.A, Q, 0 * J, h)]
        else:
            self.steps = [el.of_step(stage.A, g, stage.C, stage.sensors)]
            self.alone = [Element(stage.A, g, np.zeros((0, len(g))))]

    def at(self, j: int, *, seen: bool = True) -> Element:
        """2^j steps."""
        powers = self.steps if seen else self.alone
        while len(powers) <= j:
            powers.append(el.then(powers[-1], powers[-1]))
        return powers[j]

    def after(self, start: Element, steps: int, *, seen: bool = True) -> Element:
        """`start`, then so many steps."""
        for j in range(steps.bit_length()):
            if steps >> j & 1:
                start = el.then(start, self.at(j, seen=seen))
        return start


def information(stage: Stage) -> Real:
    """C' R^-1 C of a continuous model."""
    half = el.solve_lower(el.lower(stage.sensors), stage.C)
    return half.T @ half


def grid(last: int | None) -> Iterator[int]:
    """0, 1, 2, 3, 4, 6, 8, 12, .. to `last`; every step where there are few."""
    if last is not None and last <= ALL:
        yield from range(last + 1)
        return
    yield from (k for k in (0, 1, 2, 3) if last is None or k < last)
    for j in range(2, OCTAVES + 1):
        yield from (k for k in (2**j, 3 * 2 ** (j - 1)) if last is None or k < last)
    if last is not None:
        yield last


def base_step(question: Question, horizon: float | None) -> tuple[float, int | None]:
    """The step of a constant model and the number of them in the horizon (steps, or the duration where continuous)."""
    if not question.continuous:
        return question.dt, None if horizon is None else int(horizon)
    stage = question.first
    g = stage.noise
    balanced = pencil(stage.A, g @ g.T, information(stage))[0]
    if horizon is None:
        return 2.0 ** -np.ceil(np.log2(max(np.abs(balanced).sum(axis=1).max(), 1e-300))), None
    m = halvings(balanced * horizon)
    return horizon / 2**m, 2**m


def starts(question: Question) -> tuple[Element, Element]:
    """The prior after the first sample, and the prior alone. A continuous model has no first sample."""
    alone = el.of_prior(question.L, question.D)
    if question.continuous:
        return alone, alone
    return el.then(alone, el.of_sample(question.first.C, question.first.sensors)), alone


class SplitQuestion(NamedTuple):
    """A constant question in a frame that splits off the undetectable part, the question of the other states alone (None: there
    is no undetectable part), the frame, and which quantities have an undetectable part."""

    whole: Question
    part: Question | None
    frame: Real
    hidden: Real


def split_off(question: Question) -> SplitQuestion:
    """The undetectable part is split off first."""
    stage, n = question.first, len(question.first.A)
    U = undetectable(stage.A, stage.C, continuous=question.continuous)
    hidden = touched(question.H, U)
    if U.shape[1] == 0:
        return SplitQuestion(question, None, np.eye(n), hidden)
    frame = split(stage.A, U)
    r = n - U.shape[1]
    A, C = frame.T @ stage.A @ frame, stage.C @ frame
    A[:r, r:] = C[:, r:] = 0
    turned = Stage(A, [frame.T @ g for g in stage.g], C, stage.V)
    whole = question._replace(first=turned, L=frame.T @ question.L, D=frame.T @ question.D, H=question.H @ frame)
    if r == 0 or hidden.all():
        return SplitQuestion(whole, None, frame, hidden)
    part = Stage(A[:r, :r], [g[:r] for g in turned.g], C[:, :r], stage.V)
    return SplitQuestion(
        whole, whole._replace(first=part, L=whole.L[:r], D=whole.D[:r], H=whole.H[:, :r]), frame, hidden
    )


def by_octaves(question: Question, h: float, last: int | None) -> Spreads:
    """A constant model."""
    whole, part, frame, hidden = split_off(question)
    seen = None if part is None else _octaves(part, h, last, hidden & False)
    found = _octaves(whole, h, last, hidden, enough=None if seen is None else seen.steps[-1])
    if seen is not None:
        found = _merged(found, seen, hidden)
    belief, alone = (Element(frame @ E.Φ, frame @ E.S, E.Z) for E in (found.belief, found.alone))
    return found._replace(belief=belief, alone=alone)


def sigma_after(question: Question, h: float, steps: int | None) -> Real:
    """The sigma of each quantity of a constant model after so many steps; None: when a start is forgotten."""
    whole, part, _, hidden = split_off(question)

    def end(one: Question) -> Real:
        powers, count = Powers(one, h=h), steps
        if count is None:
            count = next((2**j for j in range(LATEST) if _forgotten(powers, 2**j)), 2**LATEST)
        return sigma_of(powers.after(starts(one)[0], count), one.H)

    with np.errstate(over="ignore", invalid="ignore"):
        found = end(whole)
        return found if part is None else np.where(hidden, found, end(part))


def of_quantity(question: Question, i: int) -> Question:
    """The constant question of one quantity, in the frame in which `by_octaves` answers it."""
    whole, part, _, hidden = split_off(question)
    one = whole if part is None or hidden[i] else part
    return one._replace(H=one.H[i : i + 1])


def _merged(whole: Spreads, seen: Spreads, hidden: Real) -> Spreads:
    """Quantities without a hidden part are those of the other states alone."""
    rows = [min(i, len(seen.steps) - 1) for i in range(len(whole.steps))]
    return whole._replace(
        sigma=np.where(hidden, whole.sigma, seen.sigma[rows]),
        settled=np.where(hidden, whole.settled, seen.settled),
        limit=np.where(hidden, whole.limit, seen.limit),
    )


def _octaves(question: Question, h: float, last: int | None, hidden: Real, *, enough: int | None = None) -> Spreads:
    """Until nothing is remembered, or for `enough` steps, where there is no `last`."""
    powers = Powers(question, h=h)
    start, alone = starts(question)
    steps, sigma, open_, until = [], [], [], None
    belief, prior = start, alone
    ahead, ahead_alone = _Followed(powers, start, seen=True), _Followed(powers, alone, seen=False)
    with np.errstate(over="ignore", invalid="ignore"):
        for k in grid(last):
            new, new_prior = ahead(k), ahead_alone(k)
            if not all(np.all(np.isfinite(part)) for part in new):
                until = steps[-1]
                break
            sigma.append(sigma[-1] if new is belief and sigma else sigma_of(new, question.H))
            open_.append(open_[-1] if new_prior is prior and open_ else sigma_of(new_prior, question.H))
            belief, prior = new, new_prior
            steps.append(k)
            if last is None and (k == enough or (enough is None and k & (k - 1) == 0 and _forgotten(powers, k))):
                break
    σ, σ0 = np.array(sigma), np.array(open_)
    settled, limit = limits(σ, steps, last)
    return Spreads(steps, σ, σ0, belief, prior, settled, limit, hidden, until)


class _Followed:
    """A start, followed to the steps of `grid` in turn: from the last power of two, and no further once it is forgotten."""

    def __init__(self, powers: "Powers", start: Element, *, seen: bool):
        self.powers, self.start, self.seen = powers, start, seen
        self.belief, self.power, self.exponent, self.over = start, start, -1, False

    def __call__(self, k: int) -> Element:
        """After k steps."""
        j = k.bit_length() - 1
        if k == 0 or self.over:
            return self.belief
        if k == 2**j:
            one = self.powers.at(j, seen=self.seen)
            self.belief = self.power = el.then(self.start, one)
            self.exponent, self.over = j, _without_past(one)
        elif k == 3 * 2 ** (j - 1) and self.exponent == j:
            self.belief = el.then(self.power, self.powers.at(j - 1, seen=self.seen))
        else:
            self.belief = self.powers.after(self.start, k, seen=self.seen)
        return self.belief


def _forgotten(powers: Powers, k: int) -> bool:
    """Whether a start has no effect after k steps, a power of two."""
    return k > 0 and _without_past(powers.at(k.bit_length() - 1))


def _without_past(one: Element) -> bool:
    """Whether what came before an element changes no sigma after it."""
    return bool(np.all(np.abs(one.Φ).max(axis=1, initial=0.0) <= FORGOTTEN * lengths(one.S)))


def limits(σ: Real, steps: list[int], last: int | None) -> tuple[Real, Real]:
    """Whether the last octave changed anything; the value it tends to: 0 where it still falls as 1 / sqrt(t) does."""
    before = next((i for i in range(len(steps) - 1, -1, -1) if 2 * steps[i] <= steps[-1]), 0)
    now, then = σ[-1], σ[before]
    with np.errstate(invalid="ignore"):
        settled = (np.abs(now - then) <= SETTLED * now) | (np.isinf(now) & np.isinf(then)) | ((now == 0) & (then == 0))
        falls = now < 0.75 * then
    settled = settled & (steps[-1] >= 2)
    limit = np.where(settled, now, np.where(falls & (last is None), 0.0, np.nan))
    return settled | (falls & (last is None)), limit


def sample_by_sample(question: Question, rows: int, *, noise_free: bool, settle: bool = False) -> Spreads:
    """A model in rows, or one with noise-free channels: every sample."""
    L, D, H = question.L, question.D, question.H
    alone = el.of_prior(L, D)
    belief = noise_free_prior(question) if noise_free else alone
    sigma, open_, stage = [], [], question.first
    done = 0
    for k in range(rows):
        if k:
            stage = question.stages(k - 1)
            alone = el.then(alone, Element(stage.A, stage.noise, np.zeros((0, len(L)))))
        belief = _sample(belief, stage, first=k == 0, exact=noise_free)
        sigma.append(sigma_of(belief, H))
        open_.append(sigma_of(alone, H))
        done = k
        if settle and k > 2 * len(L) and np.all(np.abs(sigma[-1] - sigma[-2]) <= 1e-14 * sigma[-1]):
            break
    σ, σ0 = np.array(sigma), np.array(open_)
    settled, limit = limits(σ, list(range(done + 1)), None if settle and done + 1 < rows else rows)
    return Spreads(list(range(done + 1)), σ, σ0, belief, alone, settled, limit, np.zeros(len(H), bool), None)


def noise_free_prior(question: Question) -> Element:
    """The prior with its finite part in S."""
    return noise_free.of_known_prior(question.L, question.D)


def _sample(belief: Element, stage: Stage, *, first: bool, exact: bool) -> Element:
    if exact:
        moved = belief if first else noise_free.moved(belief, stage.A, stage.noise)
        return noise_free.corrected(moved, stage.C, stage.sensors @ stage.sensors.T) if len(stage.C) else moved
    if first:
        return el.then(belief, el.of_sample(stage.C, stage.sensors))
    return el.then(belief, el.of_step(stage.A, stage.noise, stage.C, stage.sensors))


def thinned(steps: list[int]) -> list[int]:
    """Indices of the rows that the grid of a constant model shows."""
    wanted = set(grid(steps[-1]))
    return [i for i, k in enumerate(steps) if k in wanted]


def first_met(question: Question, h: float, low: int, high: int, met: Callable[[Real], bool]) -> int:
    """The first step in (low, high] at which `met` holds, by bisection: not at `low`, and from some step to `high`."""
    powers, (start, _) = Powers(question, h=h), starts(question)
    belief = powers.after(start, low)
    for j in range((high - low).bit_length() - 1, -1, -1):
        if low + 2**j >= high:
            continue
        ahead = el.then(belief, powers.at(j))
        if not met(sigma_of(ahead, question.H)):
            belief, low = ahead, low + 2**j
    return low + 1


def shares(question: Question, h: float, steps: int, *, constant: bool) -> Real:
    """The share of each source (noises, sensors, prior) in the variance of each quantity after `steps`, (sources, q)."""
    if constant:
        belief, parts = _constant_shares(question, h, steps)
    else:
        belief, parts = _shares_in_rows(question, steps)
    F, _, inverse = state_error(belief)
    whole = lengths(question.H @ F) ** 2
    found = np.array([el.share(belief, part, inverse, question.H) for part in parts])
    return found / np.where(whole > 0, whole, 1.0)


def _beginning(question: Question) -> tuple[Element, list[el.Source]]:
    """The prior, and its sources: itself only."""
    belief, count = el.of_prior(question.L, question.D), len(question.sources) - 1
    n, z = len(belief.Φ), len(belief.Z)
    nothing = el.Source(np.zeros((n, 0)), np.zeros((z, 0)))
    return belief, [*[nothing] * count, el.Source(np.zeros((n, z)), np.eye(z))]


def _with_sources(stage: Stage, *, first: bool) -> tuple[Element, list[el.Source]]:
    n = len(stage.A)
    if first:
        stage = stage._replace(A=np.eye(n), g=[np.zeros((n, 0)) for _ in stage.g])
    nothing = el.Source(np.zeros((n, 0)), np.zeros((len(stage.C), 0)))
    return (
        el.of_step(stage.A, stage.noise, stage.C, stage.sensors),
        [*el.sources_of_step(stage.g, stage.C, stage.V), nothing],
    )


def _shares_in_rows(question: Question, steps: int) -> tuple[Element, list[el.Source]]:
    belief, parts = _beginning(question)
    for k in range(steps + 1):
        step = _with_sources(question.stages(k - 1) if k else question.first, first=k == 0)
        belief, parts = el.sources_then(belief, parts, *step)
    return belief, parts


def _constant_shares(question: Question, h: float, steps: int) -> tuple[Element, list[el.Source]]:
    belief, parts = _beginning(question)
    stage = question.first
    if question.continuous:
        E, of_E = sources_of_short_time(stage.A, stage.g, stage.C, stage.V, h)
        of_E = [*of_E, el.Source(np.zeros((len(E.Φ), 0)), np.zeros((len(E.Z), 0)))]
    else:
        belief, parts = el.sources_then(belief, parts, *_with_sources(stage, first=True))
        E, of_E = _with_sources(stage, first=False)
    while steps:
        if steps & 1:
            belief, parts = el.sources_then(belief, parts, E, of_E)
        steps >>= 1
        if steps:
            E, of_E = el.sources_then(E, of_E, E, of_E)
    return belief, parts
