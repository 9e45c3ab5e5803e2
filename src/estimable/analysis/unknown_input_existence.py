"""Whether the outputs determine unmeasured inputs, and with what delay."""

from collections.abc import Sequence

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..kernels.steady_unknown_input import closed_loop, fang_closed_loop
from ..models.state_space import StateSpace
from ..results import UnknownInputExistence
from .zeros import invariant_zeros

ON_THE_CIRCLE = 1e-9  # distance inside the unit circle from which a zero counts as inside
ROUNDING = 1e-13  # of the terms of a sum: a smaller sum is rounding
RANK = 1e-10  # of the largest singular value, after scaling: smaller ones do not count
METHODS = {
    "feedthrough": "Gillijns & De Moor (2007b), with feedthrough",
    "no_feedthrough": "Gillijns & De Moor (2007a), without feedthrough",
    "partial": "exact conditioning, D of partial rank",
    "delayed": "exact conditioning, with delay",
}


def unknown_input_existence(
    model: StateSpace, *, unknown: str | Sequence[str] | Sequence[int], seen: Numbers | Sequence[str] | None = None
) -> UnknownInputExistence:
    """Whether the outputs determine the inputs named in `unknown`. The function needs the model only, no data.

    Model: x[k+1] = A x[k] + B u[k] + w[k], y[k] = C x[k] + D u[k] + v[k]. Here u holds the d unknown inputs, and B and D are
    their columns.

    Two conditions decide. The first is a rank: let M[L] be the block-Toeplitz matrix that maps the inputs of samples 0 to L
    to the outputs of these samples. An input is known after L samples if the rank of M[L] is d more than the rank of M[L]
    without its first d columns (Sain & Massey 1969, for a state with finite variance). The second is stability: errors die
    out if every invariant zero lies inside the unit circle (strong detectability, Hautus 1983). Then the spectral radius of
    the steady filter is below 1.

    `unknown`: names of inputs, or their column numbers. `seen` (T, p): which outputs of the next T samples arrive. With it
    the result also gives the delay for the input of each sample, NaN where that input is never known. For a continuous model
    the delay counts derivatives instead of samples, and the zeros must lie in the open left half plane. A time-varying model
    has ranks, but no zeros.

    Returns an `UnknownInputExistence`. Raises `InputError` for names that are not inputs, and for a `seen` of the wrong
    shape.

    Cost: a few singular value decompositions; with `seen` about T of them, of size T d.

    Reference: M. L. J. Hautus, Linear Algebra and its Applications 50 (1983) 353-368; M. K. Sain, J. L. Massey, IEEE TAC 14
    (1969) 141-149; H. Fang (2009) §2.4, §5.2.

    >>> model = StateSpace([[0.5]], [[1.0]], [[1.0]], R=[[1.0]], dt=1)
    >>> unknown_input_existence(model, unknown=["u1"]).delay
    1
    """
    faults = checks.Faults()
    if not faults.instance("model", model, StateSpace):
        faults.finish()
    columns = unknown_columns(model, unknown, faults)
    pattern = None if seen is None else _read_seen(seen, model, faults)
    faults.finish()
    verdict = existence(model, columns, steady=True)
    if pattern is None:
        return verdict
    from ..frozen import replace

    input_delay, state_known = _delays(model, columns, pattern)
    return replace(verdict, input_delay=input_delay, state_known=state_known)


def unknown_columns(
    model: StateSpace, unknown: str | Sequence[str] | Sequence[int], faults: checks.Faults
) -> tuple[int, ...]:
    """Columns of the inputs given by name or number, checked."""
    if isinstance(unknown, np.ndarray) and unknown.ndim == 1:
        unknown = unknown.tolist()
    if not isinstance(unknown, str | int | np.integer | list | tuple | range):
        faults.add(f"`unknown` must be a list of input names or columns. Got {checks.short(unknown)}.")
        return ()
    given = list(unknown) if isinstance(unknown, list | tuple | range) else [unknown]
    columns = []
    for one in given:
        if isinstance(one, int | np.integer) and not isinstance(one, bool) and 0 <= one < model.m:
            columns.append(int(one))
        elif isinstance(one, str) and one in model.inputs:
            columns.append(model.inputs.index(one))
        else:
            faults.add(
                f"`unknown` names {checks.short(one)}, which is not an input of the model: "
                f"{checks.listed(model.inputs)}.{checks.suggestion(one, model.inputs)}"
            )
    if not given:
        faults.add("`unknown` must name at least one input.")
    if len(set(columns)) < len(columns):
        faults.add("`unknown` names an input twice.")
    return tuple(columns)


def existence(model: StateSpace, columns: tuple[int, ...], *, steady: bool = False) -> UnknownInputExistence:
    """The verdict on the columns `unknown`; where `steady`, also the spectral radii, which need an iteration."""
    systems = list(_systems(model, columns))
    ranks = [_ranks(*system) for system in systems]
    delays = [np.inf if delay is None else float(delay) for _, _, delay in ranks]
    worst = int(np.argmax(delays))
    rank_D, rank_next, delay = ranks[worst]
    constant = len(systems) == 1
    zeros = invariant_zeros(*systems[0]) if constant else None
    values: np.ndarray = np.zeros(0, complex) if zeros is None else zeros.values
    outside = np.real(values) >= -ON_THE_CIRCLE if model.is_continuous else np.abs(values) >= 1 - ON_THE_CIRCLE
    radius = fang = None
    if (
        steady
        and constant
        and not model.is_continuous
        and model.R is not None
        and delay in (0, 1)
        and not outside.any()
    ):
        radius = closed_loop(*systems[0], *_noises(model))
        if delay == 0 and model.B_end is None:
            fang = fang_closed_loop(*systems[0], *_noises(model)[:2])
    method = None if delay is None else _method(rank_D, delay)
    sentence = _sentence(model, columns, ranks[worst], values[outside], radius)
    return UnknownInputExistence(
        delay is not None and not outside.any(), method, delay, rank_D, rank_next,
        None if zeros is None else zeros.normal_rank, values, values[outside], radius, fang, sentence,
    )  # fmt: skip


def _systems(model: StateSpace, columns: tuple[int, ...]):
    """(A, B, C, D) of the unknown inputs at each row of time (one row for a constant model).

    Where the input moves between samples, x - B_end u is the state that it enters without delay.
    """
    rows = range(model.steps or 1) if model.varying else [None]
    for k in rows:
        A, B, C, D = (_at(model, name, k) for name in ("A", "B", "C", "D"))
        B, D = B[:, columns], D[:, columns]
        if model.B_end is not None:
            B_end = _at(model, "B_end", k)[:, columns]
            B, D = B + A @ B_end, D + C @ B_end
        yield A, B, C, D


def _at(model: StateSpace, name: str, k: int | None) -> np.ndarray:
    M = np.asarray(getattr(model, name))
    return M[k] if name in model.varying else M


def _noises(model: StateSpace):
    """Covariances of the process noise, of the measurement noise, and between them."""
    Q = model.G @ model.Q @ model.G.T
    S = np.zeros((model.n, model.p)) if model.S is None else model.G @ model.S
    return Q, model.R, S


def rank(M: np.ndarray) -> int:
    """The rank, independent of the units of rows and columns."""
    if M.size == 0:
        return 0
    rows = np.abs(M).max(axis=1, keepdims=True)
    M = M / np.where(rows > 0, rows, 1.0)
    columns = np.abs(M).max(axis=0, keepdims=True)
    s = np.linalg.svd(M / np.where(columns > 0, columns, 1.0), compute_uv=False)
    return int(np.sum(s > RANK * max(s.max(), 1e-300)))


def product(M: np.ndarray, N: np.ndarray) -> np.ndarray:
    """M N, with entries at the rounding of their terms set to zero."""
    found, terms = M @ N, np.abs(M) @ np.abs(N)
    return np.where(np.abs(found) <= ROUNDING * terms, 0.0, found)


def null_space(M: np.ndarray) -> np.ndarray:
    """An orthonormal basis of the null space, independent of the units of the rows."""
    if M.size == 0:
        return np.eye(M.shape[1])
    rows = np.abs(M).max(axis=1, keepdims=True)
    _, s, V = np.linalg.svd(M / np.where(rows > 0, rows, 1.0))
    return V[int(np.sum(s > RANK * max(s.max(initial=0.0), 1e-300))) :].T


def _ranks(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray) -> tuple[int, int, int | None]:
    """rank D, rank of [C B N, D], and the delay after which the input is known."""
    d = B.shape[1]
    N = null_space(D)
    both = np.hstack([product(C, product(B, N)), D])
    blocks, power = [D], B
    for L in range(len(A) + 1):
        if _is_determined(blocks, d):
            return rank(D), rank(both), L
        blocks.append(product(C, power))
        power = product(A, power)
    return rank(D), rank(both), None


def _is_determined(blocks: list[np.ndarray], d: int) -> bool:
    """Whether as many samples as there are blocks D, CB, CAB, .. determine the first input."""
    L, p = len(blocks), blocks[0].shape[0]
    M = np.zeros((L * p, L * d))
    for i in range(L):
        for j in range(i + 1):
            M[i * p : (i + 1) * p, j * d : (j + 1) * d] = blocks[i - j]
    return rank(M) == d + rank(M[:, d:])


def _method(rank_D: int, delay: int) -> str:
    if delay == 0:
        return "feedthrough"
    if delay == 1:
        return "no_feedthrough" if rank_D == 0 else "partial"
    return "delayed"


def _sentence(
    model: StateSpace,
    columns: tuple[int, ...],
    ranks: tuple[int, int, int | None],
    outside: np.ndarray,
    radius: float | None,
) -> str:
    rank_D, rank_next, delay = ranks
    d, names = len(columns), checks.listed(model.inputs[i] for i in columns)
    if d > model.p:
        return f"{checks.counted(model.p, 'output')} cannot determine {d} unknown inputs ({names})"
    if delay is None:
        return (
            f"the outputs never distinguish {names} from zero: rank D is {rank_D} and rank [C B N, D] {rank_next} "
            f"where {d} inputs need {d} and {d + d - rank_D}, and more samples do not help"
        )
    when = "derivatives" if model.is_continuous else ("sample" if delay == 1 else "samples")
    at_once = "at once" if delay == 0 else f"after {delay} {when}"
    if len(outside):
        where = "in the right half plane or on its edge" if model.is_continuous else "not inside the unit circle"
        shown = ", ".join(f"{z.real:.6g}" if abs(z.imag) < 1e-9 else f"{z:.6g}" for z in outside)
        return f"{names} can act forever without an effect on the outputs: the invariant zero {shown} is {where}"
    decay = "" if radius is None else f"; errors shrink by a factor of {radius:.4g} per sample"
    return f"{names} is known {at_once} (rank D = {rank_D}, {d} unknown){decay}"


def _read_seen(seen: Numbers | Sequence[str], model: StateSpace, faults: checks.Faults) -> np.ndarray | None:
    faults.learn("p", model.p, f"the model has {checks.counted(model.p, 'output')}")
    pattern = faults.array("seen", seen, "T p")
    if model.is_continuous:
        faults.add("`seen` refers to samples, but the model is continuous (dt = 0): discretise it.")
    if pattern is not None and model.steps not in (None, len(pattern)):
        faults.add(f"`seen` must have {model.steps} rows, as many as the time-varying model. Got {len(pattern)}.")
    return None if pattern is None else pattern.astype(bool)


def _delays(model: StateSpace, columns: tuple[int, ...], seen: np.ndarray):
    """(T, d) the delay in samples after which each input is known; (T,) whether x[k] is known from the outputs up to k.

    The recursion carries the null space of the map from all inputs so far to the seen outputs: an input is known when no
    vector of it moves that input.
    """
    systems = list(_systems(model, columns))
    T, d, n = len(seen), len(columns), model.n
    delay, known = np.full((T, d), np.nan), np.zeros(T, bool)
    basis, states = np.zeros((0, 0)), np.zeros((n, 0))
    for k in range(T):
        A, B, C, D = systems[k % len(systems)]
        free = basis.shape[1]
        basis = np.block([[basis, np.zeros((k * d, d))], [np.zeros((d, free)), np.eye(d)]])
        states = np.hstack([states, np.zeros((n, d))])
        shown = product(np.hstack([C, D]), np.vstack([states, basis[k * d :]]))[seen[k]]
        left = null_space(shown) if len(shown) else np.eye(free + d)
        basis, states = basis @ left, states @ left
        silent = np.abs(basis).max(axis=1, initial=0.0).reshape(k + 1, d) < 1e-9
        new = silent & np.isnan(delay[: k + 1])
        delay[: k + 1] = np.where(new, k - np.arange(k + 1)[:, None], delay[: k + 1])
        known[k] = np.abs(states).max(initial=0.0) < 1e-9
        states = product(np.hstack([A, B]), np.vstack([states, basis[k * d :]]))
    return delay, known
