"""Lasting disturbances of the state equations, as additional states."""

from collections.abc import Sequence
from typing import Annotated, Any

import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array, Numbers
from ..frozen import frozen, replace, static
from .operating_point import OperatingPoint
from .prior import Prior
from .state_space import StateSpace, refuse_schedule


@frozen
class Disturbance:
    """The disturbances among the states of a model: its last d states.

    - `time_constant` (d,) in seconds, infinite for a constant offset.
    - `density` (d,): the density at zero frequency of a disturbance, in (unit of the state / s)² s; for an offset its standard
      deviation, in units of the state per second.
    - `at`: the state equation that each disturbance enters.
    - `discretised`: whether the model was continuous when it gained them. Its matrices then no longer follow from these numbers.
    """

    time_constant: Annotated[Any, "d"]
    density: Annotated[Any, "d"]
    at: tuple[int, ...] = static()
    discretised: bool = static(default=False)

    @property
    def is_offset(self) -> Array:
        """Which of them are constant offsets (d,)."""
        return np.isinf(np.real(np.asarray(self.time_constant)))

    @property
    def variance(self) -> Any:
        """The variance of each before the first sample (d,): q / (2 τ), or that of the offset."""
        xp = jnp if checks.is_traced(self.time_constant, self.density) else np
        τ, q = xp.asarray(self.time_constant), xp.asarray(self.density)
        return xp.where(xp.isinf(xp.real(τ)), q * q, q / (2 * xp.where(xp.isinf(xp.real(τ)), 1.0, τ)))


def markov_disturbance(
    model: StateSpace,
    *,
    time_constant: Numbers | None,
    density: Numbers,
    states: Sequence[str] | None = None,
) -> StateSpace:
    """The model with a disturbance in each state equation that lasts: an additional state, of a Gauss-Markov process.

    For each state i with the density q_i, dx_i/dt gains d_i, with dd_i/dt = -d_i / τ + n_i and the density q_i / τ² of the
    white noise n_i. Then E d_i² = q_i / (2 τ), and the density of d_i at zero frequency is q_i, that of a white noise with Q_ii =
    q_i. The process noise of the model stays.

    - `time_constant`: τ in seconds, one number or one for each state. None: d_i is a constant offset, and `density` is its
      standard deviation, in units of the state per second.
    - `density`: q_i, one number or one for each state. A state with zero gains no disturbance.
    - `states`: the names of the states (default: all that are not disturbances).

    A prior of the states without the disturbances then serves too: the disturbances begin with mean 0 and their own variance. A
    discrete model gains d_i dt in each step.

    Measured: a white process noise in the model, where the disturbances of the aircraft last for .075 s, makes the estimated gain
    of a healthy aircraft in closed loop .35 ± .03. With this disturbance it is 1.01 ± .07.

    Returns a `StateSpace`. Raises `InputError` for a density below 0, a time constant not above 0, or an unknown state.

    Reference: R. A. Singer, IEEE Trans. AES 6 (1970) 473-483; A. Gelb, Applied Optimal Estimation (1974), §3.8.

    >>> plant = StateSpace([[-1.0]], [[2.0]], Q=[[0.1]], R=[[0.01]], dt=0, states=["rate"])
    >>> lasting = markov_disturbance(plant, time_constant=0.5, density=0.2)
    >>> lasting.states, lasting.A.tolist(), lasting.Q.diagonal().tolist()
    (('rate', 'disturbance_rate'), [[-1.0, 1.0], [0.0, -2.0]], [0.1, 0.8])
    """
    checks.require(model=(model, StateSpace))
    refuse_schedule(model)
    chosen, τ, q = _read(model, time_constant, density, states)
    before = model.disturbance
    disturbance = Disturbance(
        τ if before is None else np.concatenate([before.time_constant, τ]),
        q if before is None else np.concatenate([before.density, q]),
        (() if before is None else before.at) + chosen,
    )
    prefix = "offset" if time_constant is None else "disturbance"
    larger = _with_states(model, [f"{prefix}_{model.states[i]}" for i in chosen])
    return retuned(replace(larger, disturbance=disturbance), disturbance.time_constant, disturbance.density)


def _read(
    model: StateSpace, time_constant: Numbers | None, density: Numbers, states: Sequence[str] | None
) -> tuple[tuple[int, ...], np.ndarray, np.ndarray]:
    """The state equations, and τ and q of each; without those of zero density."""
    faults = checks.Faults()
    own = model.n - (0 if model.disturbance is None else len(model.disturbance.at))
    names = model.states[:own] if states is None else tuple([states] if isinstance(states, str) else states)
    for name in names:
        if name not in model.states[:own]:
            known = model.states[:own]
            faults.add(
                f"`states` must name states: {checks.listed(known)}. Got {name!r}.{checks.suggestion(name, known)}"
            )
    faults.learn(
        "states", len(names), f"{checks.counted(len(names), 'state')} {'has' if len(names) == 1 else 'have'} one"
    )
    q = faults.array("density", [density] * len(names) if checks.depth(density) == 0 else density, "states")
    if q is not None and np.any(q < 0):
        faults.add(f"`density` must be at least 0. Got {checks.short(density)}.")
    if q is not None and q.size and not np.any(q):
        faults.add("`density` must be above 0 for at least one state.")
    τ: Any = np.full(len(names), np.inf)
    if time_constant is not None:
        each = [time_constant] * len(names) if checks.depth(time_constant) == 0 else time_constant
        τ = faults.array("time_constant", each, "states")
        if τ is not None and np.any(τ <= 0):
            faults.add(
                f"`time_constant` must be above 0 seconds, or None for a constant offset. Got {checks.short(time_constant)}."
            )
    faults.finish()
    assert q is not None
    held = [i for i in range(len(names)) if q[i] > 0]
    at = tuple(model.states.index(names[i]) for i in held)
    return at, np.asarray(τ)[held], np.asarray(q)[held]


def _with_states(model: StateSpace, names: list[str]) -> StateSpace:
    """The model with further states, each with its own noise; A and Q of these are zero."""
    d = len(names)
    point = model.operating_point
    return StateSpace(
        _padded(model.A, d, d), _padded(model.B, d, 0), _padded(model.C, 0, d), model.D, Q=_padded(model.Q, d, d), R=model.R,
        G=_bordered(model.G, d), S=None if model.S is None else _padded(model.S, d, 0),
        B_end=None if model.B_end is None else _padded(model.B_end, d, 0), dt=model.dt,
        states=(*model.states, *names), inputs=model.inputs, outputs=model.outputs, angles=model.angles,
        operating_point=point and OperatingPoint(np.concatenate([point.states, np.zeros(d)]), point.inputs, point.outputs),
    )  # fmt: skip


def _padded(M: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """M with rows and columns of zeros."""
    return np.pad(M, [(0, 0)] * (M.ndim - 2) + [(0, rows), (0, columns)])


def _bordered(G: np.ndarray, d: int) -> np.ndarray:
    """G with a unit matrix for further noises of further states."""
    larger = _padded(G, d, d)
    larger[..., range(-d, 0), range(-d, 0)] = 1.0
    return larger


def retuned(model: StateSpace, time_constant: Array, density: Array) -> StateSpace:
    """The model with other numbers of its disturbances, which may be complex; without checks."""
    found = model.disturbance
    disturbance = replace(found, time_constant=time_constant, density=density)
    offset = found.is_offset
    τ = np.where(offset, 1.0, time_constant)
    rate, noise = np.where(offset, 0.0, 1 / τ), np.where(offset, 0.0, density / τ**2)
    effect = 1.0
    if not model.is_continuous:
        kept = np.exp(-rate * model.dt)
        rate, noise, effect = -kept, np.where(offset, 0.0, density / (2 * τ) * (1 - kept**2)), model.dt
    d = len(found.at)
    A, Q = (np.array(M, np.result_type(M, rate, noise)) for M in (model.A, model.Q))
    own = np.arange(-d, 0)
    A[..., own, own], Q[..., own, own] = -rate, noise
    A[..., list(found.at), own] = effect
    return replace(model, A=A, Q=Q, disturbance=disturbance)


def with_disturbances(prior: Prior, variance: Array | None, n: int) -> Prior:
    """The prior of all n states, from one of those that are not disturbances, where the latter have `variance` (d,)."""
    if variance is None or prior.mean.shape[-1] == n:
        return prior
    d = variance.shape[-1]
    xp = jnp if checks.is_traced(prior.mean, prior.covariance, variance) else np
    mean = xp.concatenate([prior.mean, xp.zeros(d)])
    lower = xp.concatenate([xp.zeros((d, len(mean) - d)), variance[:, None] * xp.eye(d)], axis=1)
    covariance = xp.concatenate([xp.concatenate([prior.covariance, xp.zeros((len(mean) - d, d))], axis=1), lower])
    diffuse = prior.diffuse
    if diffuse is not None:
        diffuse = xp.concatenate([diffuse, xp.zeros((d, diffuse.shape[-1]))])
    return replace(prior, mean=mean, covariance=covariance, diffuse=diffuse)
