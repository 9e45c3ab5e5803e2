"""The information that an input gives about a gain, before any data."""

from typing import Any

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..data.record import Record, match
from ..errors import AssumptionError
from ..kernels.gain_fisher_information import information_factor
from ..models import gain_blocks
from ..models.nonlinear_model import NonlinearModel
from ..models.prior import Prior
from ..models.sampled import Clock, SampledModel, sample
from ..models.state_space import StateSpace
from ..results import GainInformation


def gain_information(
    model: StateSpace,
    u: Numbers | Record,
    *,
    directions: Numbers | str | None = None,
    feedthrough: Numbers | str | None = None,
    state: Prior | None = None,
    gain: Prior | None = None,
    dither: Numbers | None = None,
    dt: float | None = None,
) -> GainInformation:
    """The accuracy with which an input determines unknown gains, and the combinations of gains that it leaves undetermined.

    Model: that of `UnknownGain`, x[k+1] = A x[k] + B(θ) u[k] + G w[k], y[k] = C x[k] + D(θ) u[k] + v[k], with constant gains
    θ (p,).

    For a given u the outputs are linear in (x[0], θ). The information about (x[0], θ) therefore does not depend on their
    values, and the Cramér-Rao bound is exact: the best unbiased estimate of θ has the covariance of the θ block of the
    inverse information.

    `u`: the input (T, m), or a `Record` with its inputs, times and missing outputs. `directions` and `feedthrough`: as in
    `UnknownGain`; None: one gain on all of B. `state` and `gain`: the `Prior`s of x[0] and θ; None: nothing is known. `dt`:
    the step of a continuous model, in seconds. `dither` (T, m): the shape of an input that is added to u.

    Returns a `GainInformation` for u without the dither. Its method `at(a)` gives the bound with the dither multiplied by
    `a`, and `amplitude_for(sigma)` gives the amplitude that is needed for the standard deviation `sigma`.

    Cost: one run of a filter with n states and n + 2 p columns of sensitivities, in a NumPy loop over the T samples.

    Raises `InputError`; `AssumptionError` where an output has no noise, so that its information about x[0] is infinite.

    Reference: B. Friedland, IEEE TAC 14 (1969) 359-367 (sensitivities); M. Pachter (1999), (42)-(49).

    >>> model = StateSpace([[0.5]], [[1.0]], [[1.0]], Q=[[0.0]], R=[[0.01]], dt=1)
    >>> known = Prior([0.0], [[0.0]])
    >>> found = gain_information(model, np.ones((4, 1)), state=known, gain=Prior([1.0], [[1.0]]))
    >>> float(round(1 / found.covariance[0, 0], 9))  # 1 + (1² + 1.5² + 1.75²) / 0.01
    632.25
    """
    faults = checks.Faults()
    if not faults.instance("model", model, StateSpace):
        faults.finish()
    given = gain_blocks.read_directions(directions, model, faults)
    p = faults.sizes.get("p", 0)
    passing = gain_blocks.read_feedthrough(feedthrough, directions, faults)
    _check_prior("state", state, model.n, "state", faults)
    _check_prior("gain", gain, p, "gain", faults)
    inputs, seen, clock = applied(model, u, dt, faults)
    added = None if dither is None else faults.array("dither", dither, "T m")
    for name, given_input in (("u", inputs), ("dither", added)):
        if given_input is not None and np.abs(given_input).max(initial=0.0) > checks.HUGE:
            faults.add(f"`{name}` must hold numbers of at most {checks.HUGE:g}, whose squares are finite.")
    faults.finish()
    blocks = gain_blocks.in_blocks(model, p, directions=given, feedthrough=passing)
    rows = gain_rows(sample(blocks, clock), inputs, added, seen, p)
    try:
        factor = information_factor(rows, model.n, model.n + p * (1 if dither is None else 2))
    except np.linalg.LinAlgError:
        raise AssumptionError(
            "an output has no noise, so that its information is infinite: give it a small variance in R."
        ) from None
    gains = gain_blocks.gain_names(given, p, model)
    return GainInformation.of_factor(factor, gains, state, gain, n=model.n, amplitude=0.0)


def _check_prior(name: str, prior: Prior | None, size: int, what: str, faults: checks.Faults) -> None:
    if prior is not None and faults.instance(name, prior, Prior) and prior.size != size and size:
        faults.add(f"`{name}` must be a prior of {checks.counted(size, what)}. Got {prior.size}.")


def applied(model: StateSpace | NonlinearModel, u: Numbers | Record, dt: float | None, faults: checks.Faults) -> Any:
    """The applied inputs (T, m), the mask of seen outputs (T, p), and the steps."""
    if isinstance(u, Record):
        return _from_record(model, u, dt, faults)
    inputs = faults.array("u", u, "T m")
    if dt is None and model.is_continuous:
        faults.add("`dt` is needed: the model is continuous (dt = 0), and `u` has no times.")
    dt = model.dt if dt is None else faults.number("dt", dt, above=0.0, unit="seconds")
    if dt and not model.is_continuous and dt != model.dt:
        faults.add(f"`dt` must be the model's own step, {model.dt:g} s. Got {dt:g}.")
    _check_length(model, inputs, faults)
    seen = None if inputs is None else np.ones((len(inputs), model.p), bool)
    return inputs, seen, Clock.every(dt or 1.0)


def _from_record(model: StateSpace | NonlinearModel, record: Record, dt: float | None, faults: checks.Faults) -> Any:
    if dt is not None:
        faults.add("`dt` is for inputs without times, but the record has its own: leave it out.")
    columns = []
    for names, given, what in ((model.inputs, record.inputs, "input"), (model.outputs, record.outputs, "output")):
        default = any(all(name[1:].isdigit() for name in some) for some in (names, given)) and len(names) == len(given)
        columns.append(match(names, default, given, what, faults))
    if not model.is_continuous and record.dt is not None and not np.isclose(record.dt, model.dt, rtol=1e-6):
        faults.add(f"the record's step is {record.dt:g} s, the model's dt = {model.dt:g} s: they must be equal.")
    if not model.is_continuous and record.dt is None and record.t is not None and len(record) > 1:
        faults.add("the record's steps vary, but the model is discrete: give a continuous model (dt = 0).")
    faults.finish()
    u = record.applied()[:, columns[0]]
    if np.isnan(u).any():
        faults.add("`u` must be known in every row: the record has inputs whose arrival is unknown.")
    faults.learn("T", len(u), f"the record has {checks.counted(len(u), 'row')}")
    _check_length(model, u, faults)
    return u, record.seen[:, columns[1]], record.clock(model.dt or None)


def _check_length(model: StateSpace | NonlinearModel, u: np.ndarray | None, faults: checks.Faults) -> None:
    if u is not None and len(u) == 0:
        faults.add("`u` must have at least one row.")
    if u is not None and model.steps not in (None, len(u)):
        faults.add(f"`u` must have {model.steps} rows, as many as the time-varying model. Got {len(u)}.")


def gain_rows(ready: SampledModel, u: np.ndarray, dither: np.ndarray | None, seen: np.ndarray, p: int) -> Any:
    """(A, N, C, M, Q, R, Ω V', seen) of every row, with columns for (x[0], θ by u, θ by the dither)."""
    n, point = ready.A.shape[-1], np.asarray(ready.point.inputs)
    acts = [u - point] if dither is None else [u - point, np.asarray(dither)]
    still = np.zeros((n, n)), np.zeros((seen.shape[1], n))
    after = [np.concatenate([a[1:], a[-1:]]) for a in acts]
    for k in range(len(u)):
        now = _Instant(ready, k)
        N = [now.effects("B", a[k], p) for a in acts]
        if ready.B_end is not None:
            N = [b + now.effects("B_end", a[k], p) for b, a in zip(N, after, strict=True)]
        M = [now.effects("D", a[k], p) for a in acts]
        yield now("A"), np.hstack([still[0], *N]), now("C"), np.hstack([still[1], *M]), *now.noises(), seen[k]


class _Instant:
    """The matrices of a sampled model at row k."""

    def __init__(self, ready: SampledModel, k: int):
        self.ready, self.row = ready, k if ready.rows is None else int(np.asarray(ready.rows)[k])

    def __call__(self, name: str) -> np.ndarray:
        M = np.asarray(getattr(self.ready, name))
        return M[self.row] if name in self.ready.varying else M

    def effects(self, name: str, u: np.ndarray, p: int) -> np.ndarray:
        """The effect of each gain, (n, p)."""
        M = self(name)
        return (M.reshape(len(M), p + 1, len(u)) @ u)[:, 1:]

    def noises(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Q, R and Ω V'."""
        V, W = self("V"), self("W")
        if self.ready.Ω is None:
            return W @ W.T, V @ V.T, np.zeros((len(W), len(V)))
        Ω = self("Ω")
        return W @ W.T + Ω @ Ω.T, V @ V.T, Ω @ V.T
