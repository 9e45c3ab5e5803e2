"""Answers checked in a second way: another engine, another order of channels, a textbook formula, a file and back.

Each way is a function of the arguments and the answer: it returns the faults that it finds, or raises `Skip` where it does not
apply. A way is chosen by the name of the call, or by the class of the answer.
"""

import dataclasses
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg

import estimable as es
from estimable import EstimableError, StateSpace
from estimable.frozen import RECORDS, field_names, replace
from estimable.store.declared import declared

Faults = list[str]
Way = Callable[[dict[str, Any], Any], Faults]
WAYS: dict[str, list[Way]] = {}
LONG = 300  # rows: longer records are not run again sample by sample
SIGMAS = 8.0  # of a drawn number
INNER = ("mean", "covariance", "gain", "gain_covariance", "unknown_input", "unknown_input_covariance", "log_likelihood")


NUMBERS = ("mean", "gain", "parameters", "log_likelihood", "margin", "poles")


class Skip(Exception):
    """A way does not apply to a call."""


def way(*names: str) -> Callable[[Way], Way]:
    """A second way to the answers of calls, or of functions, of these names."""

    def add(check: Way) -> Way:
        for name in names:
            WAYS.setdefault(name, []).append(check)
        return check

    return add


def second_ways(name: str, function: Any, given: dict[str, Any], answer: Any) -> tuple[list[str], Faults]:
    """The names of the ways that apply, and the faults that they find."""
    used, faults = [], []
    if isinstance(answer, es.results.Info):  # made by hand, it is not checked
        return used, faults
    owner = getattr(function, "__self__", None)
    if owner is not None and not isinstance(owner, type):
        given = {"self": owner, **given}
    for check in [sound, from_file, as_given, *WAYS.get(name, [])]:
        try:
            found = check(given, answer)
        except (Skip, EstimableError):  # the other way is refused, such as another engine
            continue
        used.append(check.__name__)
        faults += [f"{check.__name__}: {fault}" for fault in found]
    return used, faults


def need(condition: Any) -> None:
    """Skip a way unless the condition holds."""
    if not condition:
        raise Skip


def records_in(thing: Any, where: str = "") -> list[tuple[str, Any]]:
    """(place, record) of every record in an answer."""
    found = [(where, thing)] if field_names(type(thing)) else []
    if isinstance(thing, dict):
        parts = list(thing.items())
    elif isinstance(thing, list | tuple) and not field_names(type(thing)):
        parts = list(enumerate(thing))
    else:
        parts = [(name, getattr(thing, name, None)) for name in field_names(type(thing))]
    return found + [one for name, part in parts for one in records_in(part, f"{where}.{name}")]


def differ(name: str, ours: Any, theirs: Any, rtol: float = 1e-7, atol: float = 1e-9) -> Faults:
    """A fault where two arrays differ by more than rounding, relative to the largest entry of their kind."""
    if ours is None or theirs is None:
        return [] if ours is theirs else [f"{name}: {ours} and {theirs}"]
    ours, theirs = np.asarray(ours, float), np.asarray(theirs, float)
    if ours.shape != theirs.shape:
        return [f"{name}: {ours.shape} and {theirs.shape}"]
    size = np.abs(ours[np.isfinite(ours)]).max(initial=1e-290)
    with np.errstate(all="ignore"):
        close = np.isclose(ours, theirs, rtol=rtol, atol=atol * min(size, 1e300), equal_nan=True)
    if close.all():
        return []
    place = tuple(np.argwhere(~close)[0])
    return [f"{name}{list(map(int, place))}: {ours[place]!r} and {theirs[place]!r}"]


def sound(given: dict[str, Any], answer: Any) -> Faults:
    """Symmetric matrices are symmetric and no variance is negative; numbers are finite, or the outcome says why not."""
    found, faults = False, []
    for where, record in records_in(answer):
        outcome = getattr(record, "outcome", None)
        if isinstance(outcome, es.results.Outcome) and outcome.code:
            raise Skip
        for field in declared(type(record)):
            value = getattr(record, field.name)
            if isinstance(record, es.results.ArrivalCovariance):  # infinite where there is no bound
                continue
            if field.symmetric and isinstance(value, np.ndarray) and value.dtype == float and value.size:
                found = True
                faults += [f"{where}.{field.name} {fault}" for fault in _unsound(value)]
            elif field.name in NUMBERS and isinstance(value, float | np.ndarray):
                found = True
                faults += [] if np.isfinite(np.asarray(value, float)).all() else [f"{where}.{field.name} is not finite"]
    need(found)
    return faults


def _unsound(matrices: np.ndarray) -> Faults:
    """What no covariance may be. A channel that is used up by an unknown input is NaN on the diagonal."""
    unknown = np.isnan(np.diagonal(matrices, axis1=-2, axis2=-1))
    matrices = np.where(unknown[..., None] | unknown[..., None, :], 0.0, matrices)
    if not np.isfinite(matrices).all():
        return ["is not finite"]
    size = np.abs(matrices).max(axis=(-1, -2), keepdims=True)
    scaled = matrices / np.where(size > 0, size, 1.0)
    if np.abs(scaled - np.swapaxes(scaled, -1, -2)).max() > 1e-12:
        return ["is not symmetric"]
    least = np.linalg.eigvalsh(scaled).min()
    return [f"has an eigenvalue of {least:.1e} times its size"] if least < -1e-10 else []


def from_file(given: dict[str, Any], answer: Any) -> Faults:
    """What is saved and loaded is the same to the last bit."""
    need(type(answer).__name__ in RECORDS or isinstance(answer, es.results.Online))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "answer.npz")
        es.save(file, answer)
        loaded = es.load(file)
    if isinstance(answer, es.results.Online):
        return same(answer.progress, loaded.progress)
    return same(answer, loaded)


def same(one: Any, other: Any, where: str = "") -> Faults:
    """The first place at which two things differ."""
    if isinstance(one, np.ndarray | np.generic) or hasattr(one, "__array__"):
        left, right = np.asarray(one), np.asarray(other)
        equal = left.dtype == right.dtype and left.shape == right.shape and left.tobytes() == right.tobytes()
        return [] if equal else [f"{where} has changed"]
    if type(one) is not type(other):
        return [f"{where}: {type(one).__name__} and {type(other).__name__}"]
    if isinstance(one, dict):
        parts = [(key, one[key], other.get(key)) for key in one] if one.keys() == other.keys() else []
        return [fault for key, a, b in parts for fault in same(a, b, f"{where}[{key!r}]")][:1] or (
            [] if one.keys() == other.keys() else [f"{where} has other names"]
        )
    if isinstance(one, list | tuple) and not field_names(type(one)):
        if len(one) != len(other):
            return [f"{where} has another length"]
        return [fault for i, pair in enumerate(zip(one, other, strict=True)) for fault in same(*pair, f"{where}[{i}]")][
            :1
        ]
    if dataclasses.is_dataclass(one) or field_names(type(one)):
        names = field_names(type(one))
        return [f for name in names for f in same(getattr(one, name), getattr(other, name), f"{where}.{name}")][:1]
    return (
        [] if one is other or one == other or (one != one and other != other) else [f"{where}: {one!r} and {other!r}"]
    )


def as_given(given: dict[str, Any], answer: Any) -> Faults:
    """A record that is made of arrays holds their numbers, none turned round, repeated or left out."""
    need(dataclasses.is_dataclass(answer) and set(given) <= {*field_names(type(answer))} | {"diffuse"})
    found, faults = False, []
    for name, value in given.items():
        if not isinstance(value, np.ndarray | list) or not hasattr(answer, name):
            continue
        held = getattr(answer, name)
        try:
            wanted = np.ma.filled(np.ma.asarray(value).astype(float), np.nan)
        except (TypeError, ValueError):
            continue
        if not isinstance(held, np.ndarray) or held.dtype != float:
            continue
        found = True
        if not np.array_equal(wanted.ravel(), held.ravel(), equal_nan=True):
            faults.append(f"{name} holds {held.shape} numbers that are not those of {wanted.shape}")
    need(found)
    return faults


@way("estimate", "smooth", "estimate_bank", "close_loop", "close_loop_bank", "log_likelihood")
def by_the_other_engine(given: dict[str, Any], answer: Any) -> Faults:
    engine = getattr(answer, "runs", answer).engine if not isinstance(answer, float) else "native"
    other = _called_again(given, answer, engine="xla" if engine == "native" else "native")
    if isinstance(answer, float):
        return differ("log_likelihood", answer, other)
    ours, theirs = (getattr(one, "runs", one) for one in (answer, other))
    need(not getattr(ours, "outcome", None) or not ours.outcome.code)
    need(not any(outcome.code for outcome in getattr(answer, "outcomes", ())))
    names = [name for name in (*INNER, "state", "applied") if hasattr(ours, name)]
    return [fault for name in names for fault in differ(name, getattr(ours, name), getattr(theirs, name))]


VERBS = {
    es.results.Estimate: es.estimate, es.results.SmoothedEstimate: es.smooth, es.results.EstimateBank: es.estimate_bank,
    es.results.ClosedLoop: es.close_loop, es.results.ClosedLoopBank: es.close_loop_bank, float: es.log_likelihood,
}  # fmt: skip


def _called_again(given: dict[str, Any], answer: Any, **changes: Any) -> Any:
    need(type(answer) in VERBS)
    return VERBS[type(answer)](**{**given, **changes})


@way("estimate")
def sample_by_sample(given: dict[str, Any], answer: Any) -> Faults:
    """`online` gives the same last row."""
    algorithm, record = given["algorithm"], given["record"]
    need(len(record) <= LONG and record.arrived is None and not answer.outcome.code and answer.mean is not None)
    need(record.outputs == algorithm.names.outputs and record.inputs == algorithm.names.inputs)
    running = es.online(algorithm, prior=given["prior"], hold=record.hold)
    steps = [None] * len(record) if record.t is None else [*np.diff(record.t), None]
    for k, step in enumerate(steps):
        u = record.u[k] if record.inputs else None
        info = running.correct(record.y[k], u)
        if k + 1 < len(steps):
            u_end = record.u[k + 1] if record.hold == "first_order" and record.inputs else None
            running.predict(u, u_end=u_end, dt=step if running.algorithm.innermost.model.is_continuous else None)
    names = ("mean", "covariance", "gain", "gain_covariance")
    last = {name: value[-1] for name in names if (value := getattr(answer, name)) is not None}
    return [fault for name, row in last.items() for fault in differ(name, row, getattr(info, name))]


@way("estimate")
def in_another_order(given: dict[str, Any], answer: Any) -> Faults:
    """The same model with its states and outputs in reverse order."""
    algorithm, prior, record = given["algorithm"], given["prior"], given["record"]
    need(type(algorithm) is es.Kalman and type(algorithm.model) is StateSpace and not answer.outcome.code)
    m = algorithm.model
    need(m.steps is None and m.operating_point is None and prior.diffuse is None and answer.covariance is not None)
    need(record.outputs == m.outputs and record.inputs == m.inputs and m.B_end is None)
    S = None if m.S is None else m.S[:, ::-1]
    turned = StateSpace(m.A[::-1, ::-1], m.B[::-1], m.C[::-1, ::-1], m.D[::-1], Q=m.Q, R=m.R[::-1, ::-1], G=m.G[::-1], S=S,
                        dt=m.dt, states=m.states[::-1], inputs=m.inputs, outputs=m.outputs[::-1])  # fmt: skip
    start = es.Prior(prior.mean[::-1], prior.covariance[::-1, ::-1])
    other = es.estimate(es.Kalman(turned), record, prior=start)
    pairs = {
        "mean": other.mean[:, ::-1],
        "covariance": other.covariance[:, ::-1, ::-1],
        "log_likelihood": other.log_likelihood,
    }
    return [fault for name, value in pairs.items() for fault in differ(name, getattr(answer, name), value)]


@way("estimate")
def its_log_likelihood(given: dict[str, Any], answer: Any) -> Faults:
    need(np.isfinite(answer.log_likelihood) and not answer.outcome.code)
    value = es.log_likelihood(given["algorithm"], given["record"], prior=given["prior"])
    return differ("log_likelihood", answer.log_likelihood, value)


@way("estimate_bank", "close_loop_bank")
def one_by_one(given: dict[str, Any], answer: Any) -> Faults:
    """Each item is the answer of a call of its own."""
    if isinstance(answer, es.results.ClosedLoopBank):
        need(not given.get("first"))
        alone = {name: value for name, value in given.items() if name not in ("runs", "first")}
        one, other = answer[0], es.close_loop(**alone)
        return [*differ("state", one.state, other.state), *differ("mean", one.mean, other.mean)]
    parts = [given[name] for name in ("algorithms", "records", "prior")]
    item = [
        part[0] if isinstance(part, list | tuple) else part.items if hasattr(part, "items") else part for part in parts
    ]
    need(not any(isinstance(part, es.results.Stacked) for part in parts))
    other = es.estimate(item[0], item[1], prior=item[2], on_failure="keep")
    return [*differ("mean", answer[0].mean, other.mean), *differ("covariance", answer[0].covariance, other.covariance)]


@way("smooth")
def ends_as_the_filter(given: dict[str, Any], answer: Any) -> Faults:
    """The last row uses all samples, and no variance is larger than before."""
    filtered = es.estimate(given["algorithm"], given["record"], prior=given["prior"])
    need(not answer.outcome.code and filtered.diffuse_covariance is None)
    gained = filtered.covariance - answer.covariance
    least = np.linalg.eigvalsh(gained).min() / max(np.abs(filtered.covariance).max(), 1e-300)
    return [
        *differ("mean", answer.mean[-1], filtered.mean[-1]),
        *differ("covariance", answer.covariance[-1], filtered.covariance[-1]),
        *([f"a smoothed variance is larger by {-least:.1e}"] if least < -1e-9 else []),
    ]


@way("forecast")
def one_step_of_the_model(given: dict[str, Any], answer: Any) -> Faults:
    result = given["result"]
    need(result.origin is not None and type(result.origin.algorithm) is es.Kalman and not result.outcome.code)
    model = result.origin.algorithm.model
    need(
        type(model) is StateSpace and not model.is_continuous and model.operating_point is None and model.steps is None
    )
    need(result.diffuse_covariance is None and result.mean is not None and model.S is None)
    mean = model.A @ result.mean[-1] + (model.B @ np.asarray(result.origin.record.u[-1]) if model.m else 0.0)
    covariance = model.A @ result.covariance[-1] @ model.A.T + model.G @ model.Q @ model.G.T
    return [*differ("mean", answer.mean[0], mean), *differ("covariance", answer.info.covariance[0], covariance)]


@way("simulate")
def noises_of_the_right_size(given: dict[str, Any], answer: Any) -> Faults:
    """What is left of the state and of the outputs without the model is noise."""
    model = given["model"]
    need(
        type(model) is StateSpace and not model.is_continuous and model.steps is None and model.operating_point is None
    )
    need(answer.measured is not None and answer.record.hold == "zero_order")
    x, u = answer.state, answer.applied
    drive = u @ model.B.T if model.m else np.zeros_like(x)
    through = u @ model.D.T if model.m else 0.0
    w = x[1:] - x[:-1] @ model.A.T - drive[:-1]
    v = answer.measured - x @ model.C.T - through
    size = np.abs(x).max(initial=1.0) * 1e-12
    sigmas = [np.sqrt(np.diagonal(P)) for P in (model.G @ model.Q @ model.G.T, model.R)]
    return [
        f"{name} is {np.abs(noise).max():.3g}, with a standard deviation of {sigma.max():.3g}"
        for name, noise, sigma in (("the process noise", w, sigmas[0]), ("the output noise", v, sigmas[1]))
        if (np.abs(noise) > SIGMAS * sigma + size).any()
    ]


@way(
    "simulate", "simulate_bank", "close_loop", "monte_carlo", "kalman_gain", "identify", "estimability", "regulability"
)
def the_same_again(given: dict[str, Any], answer: Any) -> Faults:
    """A second call gives the same bits."""
    verbs = {
        es.results.Simulation: es.simulate, es.results.ClosedLoop: es.close_loop, es.results.MonteCarlo: es.monte_carlo,
        es.results.KalmanGain: es.kalman_gain, es.results.Fit: es.identify, es.results.Estimability: es.estimability,
        es.results.Regulability: es.regulability,
    }  # fmt: skip
    need(type(answer) in verbs)
    return same(answer, verbs[type(answer)](**given))


@way("kalman_gain")
def by_scipy(given: dict[str, Any], answer: Any) -> Faults:
    m = given["model"]
    Q, S = m.G @ m.Q @ m.G.T, None if m.S is None else m.G @ m.S
    try:
        if m.is_continuous:
            P = scipy.linalg.solve_continuous_are(m.A.T, m.C.T, Q, m.R, s=S)
        else:
            P = scipy.linalg.solve_discrete_are(m.A.T, m.C.T, Q, m.R, s=S)
    except (np.linalg.LinAlgError, ValueError):
        raise Skip from None
    residual = np.abs(_riccati(m, P)).max() / max(np.abs(P).max(), 1e-300)
    need(residual < 1e-8)  # else SciPy's is not a solution
    return differ("predicted_covariance", answer.predicted_covariance, P, rtol=1e-5, atol=1e-6)


def _riccati(m: StateSpace, P: np.ndarray) -> np.ndarray:
    Q, S = m.G @ m.Q @ m.G.T, np.zeros((m.n, m.p)) if m.S is None else m.G @ m.S
    cross = (P @ m.C.T if m.is_continuous else m.A @ P @ m.C.T) + S
    inner = m.R if m.is_continuous else m.C @ P @ m.C.T + m.R
    gained = cross @ np.linalg.lstsq(inner, cross.T, rcond=None)[0]
    return (m.A @ P + P @ m.A.T + Q if m.is_continuous else m.A @ P @ m.A.T + Q - P) - gained


@way("lqr_gain")
def by_scipy_too(given: dict[str, Any], answer: Any) -> Faults:
    m, L, M = given["model"], *(np.asarray(given[name], float) for name in ("L", "M"))
    N = None if given.get("N") is None else np.asarray(given["N"], float)
    solve = scipy.linalg.solve_continuous_are if m.is_continuous else scipy.linalg.solve_discrete_are
    try:
        X = solve(m.A, m.B, L, M, s=N)
    except (np.linalg.LinAlgError, ValueError):
        raise Skip from None
    return differ("cost", answer.cost, X, rtol=1e-5, atol=1e-6)


@way("filter_covariance")
def by_many_steps(given: dict[str, Any], answer: Any) -> Faults:
    m, K = given["model"], np.asarray(given["filter"], float)
    left = np.eye(m.n) - K @ m.C
    need(m.S is None and np.abs(np.linalg.eigvals(left @ m.A)).max() < 0.99)
    P, noise = np.zeros((m.n, m.n)), left @ m.G @ m.Q @ m.G.T @ left.T + K @ m.R @ K.T
    for _ in range(3000):
        P = left @ m.A @ P @ m.A.T @ left.T + noise
    return differ("covariance", answer, P, rtol=1e-6, atol=1e-8)


@way("StateSpace.discretise")
def by_one_exponential(given: dict[str, Any], answer: Any) -> Faults:
    m, dt = given["self"], given["dt"]
    need(isinstance(dt, float | int) and m.steps is None and answer.B_end is None)
    n, Q = m.n, m.G @ m.Q @ m.G.T
    with np.errstate(all="ignore"):
        block = scipy.linalg.expm(dt * np.block([[-m.A, Q], [np.zeros((n, n)), m.A.T]]))
        drive = scipy.linalg.expm(dt * np.block([[m.A, m.B], [np.zeros((m.m, n + m.m))]]))
    need(np.isfinite(block).all() and np.abs(block).max() < 1e6)
    A = block[n:, n:].T
    return [*differ("A", answer.A, A), *differ("Q", answer.Q, A @ block[:n, n:]), *differ("B", answer.B, drive[:n, n:])]


@way("stability_radius", "rho_margin")
def by_frequencies(given: dict[str, Any], answer: Any) -> Faults:
    """No frequency of a grid has a smaller distance to instability."""
    A, dt = np.asarray(given["A"], float), given["dt"]
    need(given.get("scaling") is None)
    radius = getattr(answer, "stability_radius", None) or answer.margin
    reach = np.abs(A).sum() + 1
    points = 1j * np.linspace(0, reach, 2001) if dt == 0 else np.exp(1j * np.linspace(0, np.pi, 2001))
    least = min(np.linalg.svd(z * np.eye(len(A)) - A, compute_uv=False)[-1] for z in points)
    return [f"the distance is {least:.6g} at a frequency, below {radius:.6g}"] if least < radius * (1 - 1e-6) else []


@way("observability", "reachability")
def by_rank(given: dict[str, Any], answer: Any) -> Faults:
    m = given["model"]
    need(given.get("horizon") is None and given.get("by", "inputs") == "inputs" and m.steps is None)
    A, C = (m.A, m.C) if isinstance(answer, es.results.Observability) else (m.A.T, m.B.T)
    blocks = [C]
    for _ in range(m.n - 1):
        blocks.append(blocks[-1] @ A)
    values = np.linalg.svd(np.vstack(blocks), compute_uv=False)
    values = np.append(values, np.zeros(m.n))[: m.n]
    need(np.isfinite(values).all())
    faults = differ("singular_values", answer.singular_values, values, rtol=1e-6, atol=1e-9)
    full = len(values) == m.n and values[-1] > 1e-6 * values[0] > 0
    return faults + (["a full rank is denied"] if full and answer.verdict == "no" else [])


@way("LeastSquares", "identify")
def by_the_normal_equations(given: dict[str, Any], answer: Any) -> Faults:
    method, record = given.get("method"), given.get("record")
    need(type(method) is es.LeastSquares and isinstance(record, es.Record) and isinstance(answer, es.results.Fit))
    need(len(record.outputs) == len(record.inputs) == 1 and not np.isnan(record.y).any() and record.arrived is None)
    need(answer.undetermined is None and isinstance(method.na, int) and isinstance(method.nb, int))
    need(all(getattr(method, name, None) in (None, "none", False) for name in ("trend", "level")))
    y, u, delay = record.y[:, 0], record.u[:, 0], method.delay
    need(isinstance(delay, int))
    first = max(method.na, delay + method.nb)
    rows = [[*(-y[k - i] for i in range(1, method.na + 1)), *(u[k - delay - i] for i in range(method.nb + 1))]
            for k in range(first, len(y))]  # fmt: skip
    found = np.linalg.lstsq(np.array(rows), y[first:], rcond=None)[0]
    need(len(found) == len(answer.parameters))
    return differ("parameters", answer.parameters, found, rtol=1e-5, atol=1e-6)


@way("alpha_beta_covariance")
def by_the_recursion(given: dict[str, Any], answer: Any) -> Faults:
    α, β, T, qa, rs = (float(given[name]) for name in ("alpha", "beta", "dt", "sigma_a2", "sigma_s2"))
    A, K, c = np.array([[1.0, T], [0.0, 1.0]]), np.array([[α], [β / T]]), np.array([[1.0, 0.0]])
    Q = qa * np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]])
    left = np.eye(2) - K @ c
    need(np.abs(np.linalg.eigvals(left @ A)).max() < 0.995)
    P = np.zeros((2, 2))
    for _ in range(6000):
        P = left @ (A @ P @ A.T + Q) @ left.T + K @ K.T * rs / T
    return differ("covariance", answer, P, rtol=1e-5, atol=1e-9)


@way("diagnostics.nis", "nis")
def by_each_sample(given: dict[str, Any], answer: Any) -> Faults:
    e, S = np.asarray(given["innovation"], float), np.asarray(given["innovation_covariance"], float)
    value = getattr(answer, "mean", None)
    need(value is not None and e.ndim == 2 and not np.isnan(e).any())
    found = np.mean([row @ np.linalg.solve(S[k], row) for k, row in enumerate(e)])
    return differ("mean", value, found)


@way("read_model")
def written_again(given: dict[str, Any], answer: Any) -> Faults:
    """The model file that is written from what was read holds the same."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "model.toml")
        es.write_model(file, answer.model, answer.prior, gain=answer.gain, unknown=answer.unknown, record=answer.record)
        return same(answer, es.read_model(file))


@way("read_record")
def by_pandas(given: dict[str, Any], answer: Any) -> Faults:
    import pandas as pd

    need(str(given["path"]).endswith(".csv") and given.get("time") is None)
    frame = pd.read_csv(given["path"])
    need(set(answer.outputs) <= set(frame.columns))
    return differ("y", answer.y, frame[list(answer.outputs)].to_numpy(float))


@way("replace")
def unchanged(given: dict[str, Any], answer: Any) -> Faults:
    return same(answer, replace(answer))
