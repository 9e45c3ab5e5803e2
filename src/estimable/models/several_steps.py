"""A discrete model over several of its own steps, for rows that are missing."""

from typing import Any

import jax
import numpy as np

from ..frozen import replace
from .state_space import StateSpace


def several_steps(model: StateSpace, lengths: np.ndarray, hold: str) -> tuple[StateSpace, np.ndarray]:
    """The model at each distinct length of a clock (K,), and `wandering` of `SampledModel`.

    Over j steps x+ = A^j x + Σ_i A^(j-1-i) (B u_i + B_end u_(i+1) + G w_i), where u_i moves as `hold` says. Only w_0 is
    correlated with the output noise at the start.
    """
    if model.A.ndim == 3:
        ones = [jax.tree_util.tree_map(lambda leaf, i=i: leaf[i], model) for i in range(len(model.A))]
        each = [several_steps(one, lengths, hold) for one in ones]
        longer, Ψ = jax.tree_util.tree_map(lambda *leaves: np.stack(leaves), *each)
        return longer, Ψ
    counts = np.maximum(np.round(np.asarray(lengths) / model.dt).astype(int), 1)
    each = [_over(model, int(j), hold) for j in counts]
    A, B, B_end, Q, S, Ψ = (None if part[0] is None else np.stack(part) for part in zip(*each, strict=True))
    varying = {"A": A, "B": B, "B_end": B_end, "Q": Q, "S": S}
    longer = replace(
        model, **varying, G=np.eye(model.n), varying=tuple(sorted(name for name, M in varying.items() if M is not None))
    )
    return longer, np.asarray(Ψ)


def part(model: StateSpace, j: int, hold: str) -> tuple[Any, ...]:
    """A, B, B_end, Q, the effects of an error that grows from zero to one and of one at the start, and the wandering."""
    powers = _powers(model.A, j)
    moves = hold == "first_order" and model.B_end is not None
    share = np.arange(j + 1) / j
    constant, ramp = (_driven(model, powers, s) for s in (np.ones(j + 1), share))
    B, B_end = (constant - ramp, ramp) if moves else (constant, None)
    GQG = model.G @ model.Q @ model.G.T
    Q = sum(Φ @ GQG @ Φ.T for Φ in powers)
    return model.A @ powers[0], B, B_end, Q, ramp, B, _wandering(model, powers, moves)


def _over(model: StateSpace, j: int, hold: str) -> tuple[Any, ...]:
    """A, B, B_end, Q, S and the wandering over j steps."""
    A, B, B_end, Q, _, _, Ψ = part(model, j, hold)
    S = None if model.S is None else _powers(model.A, j)[0] @ model.G @ model.S
    return A, B, B_end, Q, S, Ψ


def _powers(A: np.ndarray, j: int) -> list[np.ndarray]:
    """A^(j-1-i): the effect of step i on the end."""
    powers = [np.eye(len(A))]
    for _ in range(j - 1):
        powers.append(A @ powers[-1])
    return powers[::-1]


def _driven(model: StateSpace, powers: list[np.ndarray], u: np.ndarray) -> np.ndarray:
    """The effect of every input that moves as u (j + 1,)."""
    end = 0.0 if model.B_end is None else model.B_end
    return np.sum([Φ @ (u[i] * model.B + u[i + 1] * end) for i, Φ in enumerate(powers)], axis=0)


def _wandering(model: StateSpace, powers: list[np.ndarray], moves: bool) -> np.ndarray:
    """Ψ (K, n, m): an input error that wanders by unit diffusion adds Σ_k Ψ_k ε_k to the state at the end."""
    j, (n, m) = len(powers), model.B.shape
    at = np.arange(j + 1) * model.dt
    covariance = np.minimum(at[:, None], at) - (np.outer(at, at) / at[-1] if moves else 0.0)
    values, vectors = np.linalg.eigh(covariance)
    L = vectors * np.sqrt(np.maximum(values, 0.0))  # the error at the nodes is L ε
    terms = np.stack([_driven(model, powers, column) for column in L.T]).reshape(j + 1, n * m)
    size = np.abs(terms).max(axis=0, keepdims=True)
    size = np.where(size > 0, size, 1.0)
    U = np.linalg.svd(np.real(terms / size), full_matrices=False)[0]  # a rotation of the noises, without derivative
    rows = (U.T @ terms)[: n * m]  # they are in a space of at most so many dimensions
    return np.concatenate([rows, np.zeros((n * m - len(rows), n * m))]).reshape(n * m, n, m)
