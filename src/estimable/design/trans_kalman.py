"""The Trans-Kalman filter, with an exact definition: the best constant gain over a set of noises, or of a given sparsity."""

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..errors import AssumptionError
from ..frozen import replace
from ..kernels import minimax_gain as kernel
from ..kernels.joseph import stationary
from ..models.constant import check_constant, check_noise
from ..models.state_space import StateSpace
from ..results import TransKalman

Pairs: TypeAlias = list[tuple[np.ndarray, np.ndarray]]  # (Q, R) of each corner

CRITERIA = ("relative_regret", "regret", "cost")


def trans_kalman(
    model: StateSpace,
    *,
    noises: Sequence[tuple[Numbers, Numbers]] | None = None,
    criterion: str = "relative_regret",
    weight: Numbers | None = None,
    free: Numbers | None = None,
) -> TransKalman:
    """The constant filter gain with the smallest worst case over a set of noise covariances, and a bound that proves it.

    Model: x[k+1] = A x[k] + G w[k], y[k] = C x[k] + v[k], constant and discrete, without cross noise. The covariances (Q, R)
    of w and v are unknown: they lie in the convex hull of `noises`, a list of pairs (Q, R). These pairs are the corners of
    the set. None: the model's own (Q, R), for which the gain is that of the Kalman filter.

    `weight` W (n, n): the cost of a gain is tr W P, with P the covariance of its error. A vector c (n,) weights only the
    combination c'x. None: the identity, in the units of the states. With one corner the weight has no effect. `criterion`:
    "relative_regret", the excess of the cost over that of the Kalman filter that knows the noise, divided by the latter;
    "regret", the excess itself; "cost". `free` (n, p) of True and False: the entries of the gain that may be nonzero; None:
    all.

    Returns a `TransKalman`. Each criterion is largest at a corner, because the cost of a gain is linear in (Q, R) and that of
    the Kalman filter is concave. Only the corners need to be checked. The best gain is the Kalman gain of a least favourable
    mixture of the corners, which is returned too. `worst` equals `bound`, which proves that no constant gain does better. For
    a sparse gain (`free`) there is no such proof: the search is local, and `bound` is that of a full gain.

    Raises `InputError` for wrong shapes, an empty set or invalid covariances; `AssumptionError` where a corner has no
    stationary Kalman filter, or where no stabilising gain of this sparsity was found. Cost: 10 to 100 Riccati equations; .1 s
    at n = 2 and 4 corners.

    Reference: R. W. Bass (2005) gives the name and the aim; this definition is ours.

    >>> model = StateSpace([[1.0]], Q=[[1.0]], R=[[1.0]], dt=1)
    >>> design = trans_kalman(model, noises=[([[0.1]], [[1.0]]), ([[10.0]], [[1.0]])])
    >>> design.filter.round(3), design.relative_regret.round(3)
    (array([[0.668]]), array([0.901, 0.901]))
    """
    faults = checks.Faults()
    faults.choice("criterion", criterion, CRITERIA)
    if faults.instance("model", model, StateSpace):
        _check_model(model, faults)
    faults.finish()
    pairs = _noises(model, noises, faults)
    W = _weight(model, weight, faults)
    allowed = _free(model, free, faults)
    faults.finish()
    plant = kernel.WeightedPlant(model.A, model.C, W)
    corners = _corners(plant, model, pairs)
    a, s = _charges(corners, criterion)
    best = kernel.mixture(plant, corners, a, s)
    K = best.corner.K
    if not allowed.all():
        K = _sparse(plant, corners, a, s, K, allowed)
    return _design(model, plant, corners, pairs, (a, s), best, K, criterion, bool(allowed.all()))


def _design(
    model: StateSpace,
    plant: kernel.WeightedPlant,
    corners: list[kernel.Corner],
    noises: Pairs,
    charge: tuple[np.ndarray, np.ndarray],
    best: kernel.MixedWeights,
    K: np.ndarray,
    criterion: str,
    full: bool,
) -> TransKalman:
    """The result, with the bound that proves it."""
    a, s = charge
    optimal = np.array([one.cost for one in corners])
    cost = optimal + kernel.losses(plant, corners, K)
    bound = float(best.shares @ (a + s * kernel.losses(plant, corners, best.corner.K)))
    part = best.shares * s / (best.shares @ s)
    Q, R = (np.tensordot(part, np.array([noise[i] for noise in noises]), 1) for i in (0, 1))
    return TransKalman(
        filter=K,
        covariance=np.array([stationary(plant.A, plant.C, K, one.N, one.R) for one in corners]),
        cost=cost,
        optimal=optimal,
        guessed=np.array([optimal + kernel.losses(plant, corners, one.K) for one in corners]),
        worst=float((a + s * (cost - optimal)).max()),
        bound=bound,
        shares=part if full else None,
        least_favourable=replace(model, Q=Q, R=R) if full else None,
        poles=np.linalg.eigvals(plant.A - K @ plant.C @ plant.A),
        model=model,
        criterion=criterion,
    )


def _charges(corners: list[kernel.Corner], criterion: str) -> tuple[np.ndarray, np.ndarray]:
    """(a, s): the criterion at a corner is a + s loss."""
    optimal = np.array([one.cost for one in corners])
    if criterion == "cost":
        return optimal, np.ones(len(corners))
    if criterion == "regret":
        return np.zeros(len(corners)), np.ones(len(corners))
    if np.any(optimal <= 0):
        checks.refuse(
            f"at noises[{int(np.argmin(optimal))}] the cost of the Kalman filter is zero, so that no relative regret exists: use "
            'criterion = "regret".'
        )
    return np.zeros(len(corners)), 1 / optimal


def _corners(plant: kernel.WeightedPlant, model: StateSpace, noises: Pairs) -> list[kernel.Corner]:
    """The Kalman filter of each corner."""
    found = []
    for i, (Q, R) in enumerate(noises):
        try:
            found.append(kernel.corner(plant, model.G @ Q @ model.G.T, R))
        except (AssumptionError, np.linalg.LinAlgError) as why:
            raise AssumptionError(f"at noises[{i}] there is no stationary Kalman filter: {why}") from None
    return found


def _sparse(
    plant: kernel.WeightedPlant,
    corners: list[kernel.Corner],
    a: np.ndarray,
    s: np.ndarray,
    K: np.ndarray,
    allowed: np.ndarray,
) -> np.ndarray:
    """The gain with zeros where required."""
    found = kernel.restricted(plant, corners, a, s, K, allowed)
    if found is None:
        raise AssumptionError(
            f"no stabilising gain was found with {int(allowed.sum())} of {allowed.size} entries free: free more "
            "of them, or check with observability(model) that these outputs show the unstable modes."
        )
    return found


def _check_model(model: StateSpace, faults: checks.Faults) -> None:
    """Check that the model is discrete and constant, with R and without S."""
    check_constant(model, faults)
    check_noise(model, faults)
    if model.is_continuous:
        faults.add("`model` must be discrete, because the gain applies to a sample: give model.discretise(dt).")
    if model.S is not None:
        faults.add("`model` has cross noise S, which this design does not use: give a model without it.")


def _noises(model: StateSpace, noises: Sequence[tuple[Numbers, Numbers]] | None, faults: checks.Faults) -> Pairs:
    """The corners as pairs of arrays."""
    if noises is None:
        return [(model.Q, model.R)]
    if not isinstance(noises, list | tuple) or not all(
        isinstance(one, list | tuple) and len(one) == 2 for one in noises
    ):
        faults.add(f"`noises` must be a list of pairs (Q, R). Got {checks.short(noises)}.")
        return []
    if not noises:
        faults.add(
            "`noises` must hold at least one pair (Q, R): an empty set has no worst case. noises=None: the model's own (Q, R)."
        )
    q = model.G.shape[-1]
    faults.learn("q", q, f"the model has {checks.counted(q, 'noise')}")
    faults.learn("p", model.p, f"the model has {checks.counted(model.p, 'output')}")
    return [
        (faults.covariance(f"noises[{i}][0]", Q, "q q"), faults.covariance(f"noises[{i}][1]", R, "p p"))
        for i, (Q, R) in enumerate(noises)
    ]


def _weight(model: StateSpace, weight: Numbers | None, faults: checks.Faults) -> Any:
    """W (n, n)."""
    faults.learn("n", model.n, model.size_source)
    if weight is None:
        return np.eye(model.n)
    if checks.depth(weight) == 1:
        c = faults.array("weight", weight, "n")
        W = None if c is None else np.outer(c, c)
    else:
        W = faults.covariance("weight", weight, "n n")
    if W is not None and not np.any(W):
        faults.add("`weight` must not be zero: every gain would have the same cost.")
    return W


def _free(model: StateSpace, free: Numbers | None, faults: checks.Faults) -> Any:
    """Where the gain may be nonzero, (n, p)."""
    if free is None:
        return np.ones((model.n, model.p), bool)
    faults.learn("p", model.p, f"the model has {checks.counted(model.p, 'output')}")
    mask = faults.array("free", free, "n p")
    if mask is None:
        return np.ones((model.n, model.p), bool)
    if not np.all((mask == 0) | (mask == 1)):
        faults.add("`free` must hold only True (may be nonzero) or False.")
    return mask == 1
