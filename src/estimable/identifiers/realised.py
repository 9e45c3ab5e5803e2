"""Shared by the identifiers of state-space models: checks of records, the innovations form, and its impulse response."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from .. import checks
from ..data.record import Record
from ..errors import AssumptionError
from ..kernels.realisation import markov
from ..kernels.riccati import dare
from ..kernels.tangents import Dynamics, impulse_moves
from ..models.state_space import StateSpace
from ..results import Check

EXCITED = 1e-8  # of the largest eigenvalue of the covariance of the input at all lags
HIGH = 100  # lags from which a fit takes long


def check_records(records: Sequence[Record], faults: checks.Faults) -> None:
    """Check that every input is known and every output was seen at least once."""
    for i, record in enumerate(records):
        unknown = np.isnan(record.applied())
        if unknown.any():
            faults.add(
                f"record {i}: an input is unknown at index {checks.first_index(unknown)}. Cut the record there, or use "
                "LeastSquares, which leaves out the rows that need it."
            )
    seen = np.concatenate([record.seen for record in records])
    never = [name for i, name in enumerate(records[0].outputs) if not seen[:, i].any()]
    if never:
        faults.add(f"output {checks.listed(never)} was never seen: there is nothing to fit. Leave it out.")


def variances_of(records: Sequence[Record], i: int) -> list[np.ndarray] | None:
    """The variance of each sample of output i (T,), or None where the records have no `sigma`.

    Raises `InputError` where some samples have one and others not: only a search can estimate the noise of the others.
    """
    if all(record.sigma is None for record in records):
        return None
    found = [np.full(len(one), np.nan) if one.sigma is None else one.sigma[:, i] ** 2 for one in records]
    for k, (one, v) in enumerate(zip(records, found, strict=True)):
        missing = one.seen[:, i] & np.isnan(v)
        if missing.any():
            checks.refuse(
                f"record {k}: `sigma` of output {one.outputs[i]} is unknown in row {int(np.argmax(missing))}. Give it for every "
                "sample, or use OutputErrorML, which estimates the noise of the others."
            )
    return found


def at_starts(variances: Sequence[np.ndarray], starts: np.ndarray) -> np.ndarray:
    """The variances of all records in one array, each from its row 0 in `starts` on; NaN between them."""
    every = np.full(starts[-1], np.nan)
    for start, v in zip(starts, variances, strict=False):
        every[start : start + len(v)] = v
    return every


def check_lags(method: Any, records: Sequence[Record], faults: checks.Faults) -> None:
    """Check that a model of high orders does not reach beyond the records; of low ones, directions stay undetermined."""
    lags, longest = max(method.na, method.nb + method.delay), max(len(record) for record in records)
    if lags >= max(longest, HIGH):
        faults.add(
            f"a model with na = {method.na}, nb = {method.nb} and delay = {method.delay} reaches {checks.counted(lags, 'row')} "
            f"back, but the longest record has {longest}: lower the orders."
        )


def check_moving(records: Sequence[Record], faults: checks.Faults) -> None:
    """Check that inputs move, and are linearly independent."""
    if not records[0].inputs:
        return
    u = np.concatenate([record.applied() - record.applied().mean(axis=0) for record in records])
    still = [name for name, moved in zip(records[0].inputs, np.abs(u).max(axis=0), strict=True) if moved == 0]
    if still:
        faults.add(
            f"input {checks.listed(still)} never moves: its effect cannot be distinguished from an offset. Leave it out."
        )
        return
    size = np.linalg.svd(u / np.linalg.norm(u, axis=0), compute_uv=False)
    if size[-1] < 1e-8 * size[0]:
        faults.add(
            f"inputs {checks.listed(records[0].inputs)} are linearly dependent: one is a combination of the others. Leave it out."
        )


def persistence_check(records: Sequence[Record], i: int, n: int) -> Check:
    """Check that the input excites as many directions of its 2i lags as i block rows and n states need.

    Reference: L. Ljung (1999), §13.2.
    """
    inputs = [record.applied() - record.applied().mean(axis=0) for record in records]
    m, total = inputs[0].shape[1], np.zeros((2 * i * inputs[0].shape[1],) * 2)
    for u in inputs:
        if len(u) >= 2 * i:
            H = np.lib.stride_tricks.sliding_window_view(u, 2 * i, axis=0).reshape(-1, 2 * i * m)
            total += H.T @ H
    values = np.linalg.eigvalsh(total)
    order, needed = int((values > EXCITED * values[-1]).sum()), m * (i + n)
    if order >= needed:
        sentence = f"Excitation: the input excites {order} directions, and order {n} needs {needed}."
        return Check("excitation", True, float(order), float(needed), sentence)
    sentence = (
        f"Excitation: the input has {checks.counted(-(-order // 2), 'frequency')} ({order} directions of its lags), but order "
        f"{n} needs {needed} directions: other responses fit as well. Apply an input with more frequencies, or lower the order."
    )
    return Check("excitation", False, float(order), float(needed), sentence)


def innovations_model(matrices: Sequence[np.ndarray], noise: np.ndarray, record: Record) -> StateSpace:
    """x+ = A x + B u + K e, y = C x + D u + e, with the K of the stationary Kalman filter for the joint noise of (w, v)."""
    A, B, C, D = matrices
    K, Σ = stationary_gain(A, C, noise)
    return StateSpace(
        A, B, C, D, G=K, Q=Σ, R=Σ, S=Σ, dt=float(record.dt or 0.0), inputs=record.inputs, outputs=record.outputs
    )


def stationary_gain(A: np.ndarray, C: np.ndarray, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """K (n, p) and the covariance of e; zero and the covariance of v where the noise allows no stationary filter."""
    n, size = len(A), max(float(np.diagonal(noise).max()), np.finfo(float).tiny)
    noise = noise / size
    Q, S, R = noise[:n, :n], noise[:n, n:], noise[n:, n:]
    try:
        found = dare(A.T, C.T, Q, R, S)
    except (AssumptionError, np.linalg.LinAlgError):
        return np.zeros((n, len(C))), size * R
    Σ = C @ found.X @ C.T + R
    return found.K.T, size * (Σ + Σ.T) / 2


def impulse(model: StateSpace, length: int) -> np.ndarray:
    """M_0 .. M_length of a model, output by output, input by input: they do not depend on the choice of states."""
    return markov(model.A, model.B, model.C, model.D, length).transpose(1, 2, 0).ravel()


def impulse_covariance(model: StateSpace, moves: Dynamics, length: int) -> np.ndarray:
    """The covariance of M_0 .. M_length, of a model whose covariance is that of the tangents `moves` (r, ..)."""
    dM = impulse_moves(Dynamics(model.A, model.B, model.C, model.D), moves, length)[1]
    columns = np.moveaxis(dM, 1, -1).reshape(len(dM), -1)
    return columns.T @ columns


def impulse_names(length: int, inputs: Sequence[str], outputs: Sequence[str]) -> tuple[str, ...]:
    """M0, M1, ..; with several channels M0_y1_u1.

    >>> impulse_names(1, ["u1"], ["y1"])
    ('M0', 'M1')
    """
    alone = len(inputs) == len(outputs) == 1
    return tuple(f"M{j}" + ("" if alone else f"_{y}_{u}") for y in outputs for u in inputs for j in range(length + 1))


def whole(name: str, value: int | None, lower: int, faults: checks.Faults) -> None:
    """An integer, or None for the default."""
    if value is not None:
        faults.whole(name, value, lower, checks.LARGEST_ORDER)
