"""The verdicts of a covariance analysis as sentences."""

import numpy as np

from .answered import AnsweredQuestion

SHIFTS = 4  # shown at most
SMALL = 1e-3  # of the largest entry of a shift in sigmas, below which an entry is not named


def covariance_sentences(found: AnsweredQuestion) -> tuple[str, ...]:
    """One for each quantity, then the shifts that look the same, then the limits of the numbers."""
    each = [_sentence(found, i) for i in range(len(found.names))]
    shifts = [_shift(found, i) for i in range(min(len(found.indistinguishable), SHIFTS))]
    more = len(found.indistinguishable) - SHIFTS
    if more > 0:
        shifts.append(f"And {more} more {'shift looks' if more == 1 else 'shifts look'} the same.")
    until = [] if found.until is None else [
        f"An unseen mode grows until numbers overflow: the answer holds until {_seconds(found.until)}."
    ]  # fmt: skip
    return (*each, *_claims(found), *shifts, *until)


def _claims(found: AnsweredQuestion) -> list[str]:
    """Where the filter claims less than its true error."""
    if found.claimed_sigma is None:
        return []
    pairs = zip(found.names, found.sigma[-1], found.claimed_sigma[-1], strict=True)
    low = [f"{name} (claimed {claimed:.3g}, true {σ:.3g})" for name, σ, claimed in pairs if 0 < claimed < 0.9 * σ]
    return [f"This filter claims too small a sigma for {', '.join(low)}."] if low else []


def _sentence(found: AnsweredQuestion, i: int) -> str:
    name, r, limit = found.names[i], found.requirement[i], found.limit[i]
    after = "" if found.question.horizon is None else f" after {_seconds(found.time[-1])}"
    now = f"{_value(found.sigma[-1, i], limit)}{after}"
    match found.verdicts[i]:
        case "known already":
            return _known_already(found, i)
        case "known":
            return _known(found, i, now)
        case "lost again":
            return f"{name} meets {r:.3g} at first and loses it again: its sigma is {now}."
        case "improves no further":
            return f"{name} settles at {limit:.3g}, above the required {r:.3g}: more time does not help."
        case "still improving":
            return f"{name} is at {now}, above the required {r:.3g}, and still improves."
    return _never(found, i, after)


def _known_already(found: AnsweredQuestion, i: int) -> str:
    name, r, largest = found.names[i], found.requirement[i], np.max(found.prior_sigma[:, i])
    if largest == 0:
        return f"{name} is known already: it has no variance."
    return f"{name} is known already to {r:.3g}: the sigma of the model alone is at most {largest:.3g}."


def _known(found: AnsweredQuestion, i: int, now: str) -> str:
    name, r, since, when = found.names[i], found.requirement[i], found.time_to_requirement[i], found.time_to_improve[i]
    if np.isfinite(r):
        start = "from the first sample on" if since == 0 else f"after {_seconds(since)}"
        return f"{name} is known to {r:.3g} {start}; its sigma is {now}."
    σ, σ0 = found.sigma[-1, i], found.prior_sigma[-1, i]
    share = f", {_percent(σ / σ0)} of its prior" if np.isfinite(σ0) and σ > 1e-3 * σ0 > 0 else ""
    within = f"within {_seconds(when)}" if when > 0 else "by the first sample"
    soon = f"; 90 % of the improvement is made {within}" if np.isfinite(when) else ""
    return f"{name} becomes known to {now}{share}{soon}."


def _never(found: AnsweredQuestion, i: int, after: str) -> str:
    name, σ, σ0 = found.names[i], found.sigma[-1, i], found.prior_sigma[-1, i]
    if not np.isfinite(σ):
        return f"{name} is never known: its prior is diffuse, and the outputs do not determine it."
    if found.question.horizon is None and not np.isfinite(found.limit[i]):
        return f"{name} is never known from these outputs: a part of it that they never show keeps growing."
    left = f"{_percent(σ / σ0)} of its sigma is left" if np.isfinite(σ0) and σ0 > 0 else f"its sigma is {σ:.3g}"
    return f"{name} is never known from these outputs: {left}{after}."


def _value(now: float, limit: float) -> str:
    return f"{now:.3g}" if limit != 0 else f"{now:.3g} and falls to 0"


def _shift(found: AnsweredQuestion, i: int) -> str:
    """A shift in the user's units: its entries that are not rounding."""
    v = found.indistinguishable[i]
    sigma = np.abs(v) / _scale(found)
    entries = [j for j in np.argsort(-sigma, kind="stable") if sigma[j] > SMALL * sigma.max()]
    parts = [f"{found.states[j]} by {v[j]:.3g}" for j in sorted(entries)[:6]]
    more = "" if len(entries) <= 6 else f" and {len(entries) - 6} more"
    text = parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
    return f"Moving {text}{more} looks the same."


def _scale(found: AnsweredQuestion) -> np.ndarray:
    """Prior sigmas of the states, 1 where they are 0 or the prior is diffuse."""
    prior = found.question.prior
    sigma = np.sqrt(np.diagonal(np.asarray(prior.covariance)))
    full = np.ones(len(found.states))
    full[: len(sigma)] = np.where((sigma > 0) & (prior.diffuse is None), sigma, 1.0)
    return full


def _seconds(t: float) -> str:
    return f"{t:.4g} s"


def _percent(share: float) -> str:
    """A share in per cent, with enough digits to differ from 100 %.

    >>> _percent(0.0312), _percent(0.99999)
    ('3.1 %', '99.999 %')
    """
    if 0.99 < share < 1:
        return f"{100 - float(f'{100 * (1 - share):.1g}'):.9g} %"
    return f"{100 * share:.2g} %" if share < 0.995 else "100 %"
