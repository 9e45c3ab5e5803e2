"""Poles, zeros and responses of a fitted model, each with its uncertainty from the covariance of the fit."""

from typing import Annotated, NamedTuple

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..frozen import saved
from ..kernels import tangents as kernel
from ..kernels.tangents import Dynamics
from ..models.state_space import StateSpace
from ..results import Fit

ORIGIN = 1e-6  # a pole of smaller modulus is a sample of delay
SETTLED = 0.005  # remainder of the slowest pole at the end of a step response
FEWEST, MOST = 20, 500  # fewest and most samples of a step response
DECADES = 1.5  # by which a frequency response begins below the slowest pole
POINTS = 200
LONGEST = 100_000  # samples of a step response


@saved
class Roots(NamedTuple):
    """The poles or zeros of a fitted model, with their uncertainty.

    - `values` (k,): the poles or zeros in z.
    - `covariance` (k, 2, 2): for each the covariance of its real and imaginary part, NaN where unknown.
    """

    values: Annotated[np.ndarray, "k"]
    covariance: Annotated[np.ndarray, "k 2 2", "symmetric"]


@saved
class Response(NamedTuple):
    """The response of a fitted model in time, with its uncertainty.

    - `at` (K,): the times in seconds.
    - `values` (K, p, m): the response of each output to each input.
    - `sigma` (K, p, m): the standard deviation of each value, NaN where unknown.
    """

    at: Annotated[np.ndarray, "K"]
    values: Annotated[np.ndarray, "K p m"]
    sigma: Annotated[np.ndarray, "K p m"]


@saved
class FrequencyResponse(NamedTuple):
    """The frequency response of a fitted model, with its uncertainty.

    - `frequencies` (K,): in hertz.
    - `values` (K, p, m): the complex response of each output to each input.
    - `log_modulus_sigma` and `phase_sigma` (K, p, m): the standard deviations of the logarithm of the modulus and of the
      phase in radians, NaN where unknown.
    """

    frequencies: Annotated[np.ndarray, "K"]
    values: Annotated[np.ndarray, "K p m"]
    log_modulus_sigma: Annotated[np.ndarray, "K p m"]
    phase_sigma: Annotated[np.ndarray, "K p m"]


@saved
class Spread(NamedTuple):
    """The matrices of a fitted model, and how they change with its uncertainty.

    - `model`: the fitted model, as a state-space model. `dynamics`: its matrices A, B, C, D.
    - `tangents`: for each of r independent directions of the parameters, the change of the matrices (r, ..) by one standard
      deviation. r = 0 if the fit has no covariance.
    """

    model: StateSpace
    dynamics: Dynamics
    tangents: Dynamics

    @property
    def known(self) -> bool:
        """Whether the fit has a covariance."""
        return len(self.tangents.A) > 0


def spread_of(fit: Fit) -> Spread:
    """The matrices of a discrete fitted model, and how uncertain parameters change them.

    The result is a `Spread`. Its `tangents` are the changes of the matrices when the parameters move by one standard
    deviation, along each independent direction of the parameters. There are none if the fit has no covariance, or if the
    records carry no information about some direction.

    >>> u = np.random.default_rng(0).normal(size=50)
    >>> fit = identify(LeastSquares(1, 0), Record(u**2, u, dt=1))
    >>> diagnostics.spread_of(fit).tangents.A.shape
    (2, 1, 1)
    """
    checks.require(fit=(fit, Fit))
    model = fit.model if isinstance(fit.model, StateSpace) else fit.model.to_state_space()
    if model.is_continuous:
        checks.refuse("`fit` must be a fit of a discrete model, as all identifiers return.")
    found = Dynamics(*(np.asarray(getattr(model, name)) for name in "ABCD"))
    given = (fit.extra or {}).get("tangents")
    if given is not None:
        return Spread(model, found, given)
    if fit.covariance is None or fit.undetermined is not None or isinstance(fit.model, StateSpace):
        return Spread(model, found, Dynamics(*(np.zeros((0, *M.shape)) for M in found)))
    return Spread(model, found, _moved(fit))


def _moved(fit: Fit) -> Dynamics:
    """Half the differences of the matrices at ± one standard deviation: exact, since they are quadratic in θ."""
    θ, moves = np.asarray(fit.parameters), []
    columns = kernel.root(np.asarray(fit.covariance)).T
    for column in columns if len(columns) else np.zeros((1, len(θ))):  # known without error: one move, of nothing
        up, down = (fit.model.with_parameters(θ + side * column).to_state_space() for side in (1, -1))
        moves.append([(np.asarray(getattr(up, name)) - np.asarray(getattr(down, name))) / 2 for name in "ABCD"])
    return Dynamics(*(np.stack(column) for column in zip(*moves, strict=True)))


def poles(fit: Fit) -> Roots:
    """The poles of a fitted model in z, and their covariances to first order. The poles at zero that represent a delay are
    omitted.

    >>> u = np.random.default_rng(0).normal(size=400)
    >>> record = simulate(OutputError([-0.5], [1.0], noise_variance=0.01, dt=1), u, seed=0).record
    >>> found = diagnostics.poles(identify(OutputErrorML(1, 0), record))
    >>> found.values.real.round(2).tolist(), bool(0 < found.covariance[0, 0, 0] < 1e-4)
    ([0.5], True)
    """
    spread = spread_of(fit)
    return _roots(*kernel.pole_moves(spread.dynamics.A, spread.tangents.A), spread.known)


def zeros(fit: Fit, output: int = 0, input: int = 0) -> Roots:
    """The finite zeros in z of a fitted model, from one input to one output, and their covariances to first order.

    Zeros at the origin are omitted. So are zeros that cancel a pole that the input does not move or the output does not show.
    """
    spread = spread_of(fit)
    faults = checks.Faults()
    faults.whole("output", output, 0, spread.model.p - 1)
    faults.whole("input", input, 0, spread.model.m - 1)
    faults.finish()
    one = _channel(spread.dynamics, output, input, 0)
    values, moves = kernel.zero_moves(one, _channel(spread.tangents, output, input, 1))
    eigenvalues = np.linalg.eigvals(one.A)
    hidden = np.array([_is_hidden(one, z, eigenvalues) for z in values], bool)
    return _roots(values[~hidden], moves[:, ~hidden], spread.known)


def _channel(of: Dynamics, output: int, input: int, axis: int) -> Dynamics:
    lead = (slice(None),) * axis
    rows, columns = slice(output, output + 1), slice(input, input + 1)
    return Dynamics(of.A, of.B[(*lead, slice(None), columns)], of.C[(*lead, rows)], of.D[(*lead, rows, columns)])


def _is_hidden(one: Dynamics, z: complex, eigenvalues: np.ndarray) -> bool:
    """Whether a zero belongs to a mode that the input does not excite or the output does not show."""
    if np.abs(eigenvalues - z).min(initial=np.inf) > 1e-6:
        return False
    N, n = one.A - z * np.eye(len(one.A)), len(one.A)
    ranks = (np.linalg.matrix_rank(M, tol=1e-6) for M in (np.hstack([N, one.B]), np.vstack([N, one.C])))
    return min(ranks) < n


def _roots(values: np.ndarray, moves: np.ndarray, known: bool) -> Roots:
    far = np.abs(values) > ORIGIN
    values, moves = values[far], moves[:, far]
    parts = np.stack([np.real(moves), np.imag(moves)], axis=-1)  # (r, k, 2)
    Σ = np.einsum("rki,rkj->kij", parts, parts)
    return Roots(values, Σ if known else np.full_like(Σ, np.nan))


def frequency_response(fit: Fit, frequencies: Numbers | None = None) -> FrequencyResponse:
    """The frequency response of a fitted model, and its uncertainty to first order.

    `frequencies` (K,) in hertz. None: frequencies up to the Nyquist frequency. Returns a `FrequencyResponse`.

    >>> u = np.random.default_rng(0).normal(size=400)
    >>> record = simulate(OutputError([-0.5], [1.0], noise_variance=0.01, dt=1), u, seed=0).record
    >>> found = diagnostics.frequency_response(identify(OutputErrorML(1, 0), record), [0.0])
    >>> abs(found.values).round(1).ravel().tolist(), bool(found.log_modulus_sigma < 0.01)
    ([2.0], True)
    """
    spread = spread_of(fit)
    dt = spread.model.dt
    faults = checks.Faults()
    f = _frequencies(spread) if frequencies is None else faults.numbers("frequencies", frequencies)
    faults.finish()
    assert f is not None
    f = np.atleast_1d(f)
    if f.ndim != 1:
        checks.refuse(f"`frequencies` must be (K,), in hertz. Got {f.shape}.")
    G, moves = kernel.frequency_moves(spread.dynamics, spread.tangents, np.exp(2j * np.pi * f * dt))
    relative = moves / np.where(G == 0, np.nan, G)
    logs, phases = (_size(part, spread.known) for part in (relative.real, relative.imag))
    return FrequencyResponse(f, G, logs, phases)


def _frequencies(spread: Spread) -> np.ndarray:
    dt = spread.model.dt
    moduli = np.abs(np.log(_slow(spread)))
    lowest = max(float(moduli.min(initial=np.pi)) / 10**DECADES, np.pi * 1e-4)
    return np.geomspace(lowest, np.pi, POINTS) / (2 * np.pi * dt)


def _slow(spread: Spread) -> np.ndarray:
    """The poles other than delays and poles at 1."""
    λ = np.linalg.eigvals(spread.dynamics.A).astype(complex)
    return λ[(np.abs(λ) > ORIGIN) & (np.abs(λ - 1) > ORIGIN)]


def step_response(fit: Fit, steps: int | None = None) -> Response:
    """The response of a fitted model to a unit step of each input, and its uncertainty to first order.

    `steps`: the number of samples after the step. None: until the response has settled. Returns a `Response`.

    >>> u = np.random.default_rng(0).normal(size=400)
    >>> record = simulate(OutputError([-0.5], [1.0], noise_variance=0.01, dt=1), u, seed=0).record
    >>> found = diagnostics.step_response(identify(OutputErrorML(1, 0), record), 2)
    >>> found.values.ravel().round(1).tolist(), bool(found.sigma.max() < 0.02)
    ([1.0, 1.5, 1.8], True)
    """
    spread = spread_of(fit)
    faults = checks.Faults()
    if steps is not None:
        faults.whole("steps", steps, 0, LONGEST)
    faults.finish()
    steps = _length(spread) if steps is None else steps
    M, dM = kernel.impulse_moves(spread.dynamics, spread.tangents, steps)
    values, moves = np.cumsum(M, axis=0), np.cumsum(dM, axis=1)
    return Response(spread.model.dt * np.arange(steps + 1), values, _size(moves, spread.known))


def _length(spread: Spread) -> int:
    slowest = float(np.abs(_slow(spread)).max(initial=0.0))
    delays = len(spread.dynamics.A)
    if not 0 < slowest < 1:
        return FEWEST if slowest == 0 else 3 * FEWEST
    return int(np.clip(delays + np.log(SETTLED) / np.log(slowest), FEWEST, MOST))


def simulation_sigma(fit: Fit, u: Numbers, state: Numbers) -> np.ndarray:
    """The standard deviations (T, p) of simulated outputs that come from the uncertainty of a fitted model.

    `u` (T, m): the inputs. The initial state is given and counts as known.
    """
    spread = spread_of(fit)
    faults = checks.Faults()
    inputs, start = (
        faults.array("u", u, f"T {spread.model.m}", nan=True),
        faults.array("state", state, f"{spread.model.n}"),
    )
    faults.finish()
    moves = kernel.output_moves(spread.dynamics, spread.tangents, inputs, start)
    return _size(moves, spread.known)


def _size(moves: np.ndarray, known: bool) -> np.ndarray:
    size = np.sqrt(np.sum(moves**2, axis=0))
    return size if known else np.full_like(size, np.nan)
