"""Whether outputs improve the estimate of the state over the model alone."""

import numpy as np

from .. import checks
from ..errors import AssumptionError
from ..kernels.riccati import clyap, dlyap
from ..models.constant import check_noise
from ..models.prior import Prior
from ..models.state_space import StateSpace
from ..results import Estimability
from .assessment import assess
from .moments import Problem, StateMoments, over_steps, stationary
from .tolerance import check_size


def estimability(model: StateSpace, *, horizon: float | None = None, prior: Prior | None = None) -> Estimability:
    """Whether past outputs carry information about every direction of the state: whether P < Π.

    Π is the covariance of the state by the model alone. P is the covariance of the error of the Kalman predictor. The model
    is estimable if g'P g < g'Π g for every nonzero vector g. Observability does not imply this, nor does reachability, and
    estimability implies neither. For a discrete model there are two verdicts: of the optimal one-step predictor, and of the
    filter, which also uses the present output. A model with a delay (a singular A) is never estimable by the predictor.

    `horizon`: judge after so many samples (seconds where dt = 0). None: judge in steady state, which only a stable model has.
    A model that varies in time is judged after its last row; the filter's numbers are then those of its last sample.
    `prior`: the `Prior` of the state at the start of the horizon. None: the stationary covariance if it exists, otherwise
    zero (a known state). R is the covariance of a sample; for a continuous model it is a density, as Q.

    Over a horizon in which the model grows more than a thousandfold, the verdict is that of the canonical correlations, and
    `distance` is the smallest of them. `covariance_analysis` shows the sigma of each state over time.

    Returns an `Estimability`. Raises `AssumptionError` for an unstable model without a horizon. Raises `InputError` for a
    model without R (where dt = 0 also for a singular R), for a horizon that is not positive, for a prior of another size or
    with diffuse directions, and for more than 500 states.

    Cost: about 300 n³ multiplications in steady state (0.6 s at n = 200), and 30 n³ per step over a horizon.

    Reference: Y. Baram, T. Kailath, NASA TM-89427 (1987), Theorem 2.1 and Corollaries 2.1-2.4. We correct the source, in
    its notation: λ is conjugate in (2.10), whole eigenspaces count, and H replaces H* in (2.14).

    >>> model = StateSpace([[0.7, -0.1], [1, 0]], C=[[1, -2]], G=[[1], [0]], Q=[[1]], R=[[0.3]], dt=1)
    >>> found = estimability(model)
    >>> found.estimable, found.sentences[0]
    (False, '0.98 x1 - 0.2 x2 is not revealed by y1.')
    """
    faults = checks.Faults()
    if faults.instance("model", model, StateSpace):
        check_noise(model, faults)
        horizon = read_horizon(model, horizon, faults)
        check_size(model.n, faults, steps=0 if horizon is None or model.is_continuous else int(horizon))
        if prior is not None:
            read_prior(prior, model.n, faults)
    faults.finish()
    moments = moments_of(problem_of(model), None if prior is None else prior.covariance, horizon, model.is_continuous)
    return Estimability(**assess(moments), states=model.states, outputs=model.outputs, horizon=horizon)


def problem_of(model: StateSpace) -> Problem:
    """The model as the letters of the paper."""
    G = model.G
    Q = G @ model.Q @ np.swapaxes(G, -1, -2)
    J = np.zeros((model.n, model.p)) if model.S is None else G @ model.S
    return Problem(model.A, Q, model.C, model.R, J)


def moments_of(problem: Problem, start: np.ndarray | None, horizon: float | None, continuous: bool) -> StateMoments:
    """In steady state (`horizon` None), or over a horizon from the covariance `start`."""
    if horizon is None:
        longest = "horizon=10.0 (seconds)" if continuous else f"horizon={2 * len(problem.F)}"
        refuse_unstable(problem.F, continuous, f"give a horizon, such as {longest}")
        return stationary(problem, continuous=continuous)
    if start is None:
        start = start_of(problem, continuous, otherwise=np.zeros(problem.F.shape[-2:]))
    if continuous:
        from .moments_in_time import over_time

        return over_time(problem, start, horizon)
    return over_steps(problem, start, int(horizon))


def start_of(problem: Problem, continuous: bool, *, otherwise: np.ndarray) -> np.ndarray:
    """The stationary covariance where there is one."""
    if problem.F.ndim == 3 or problem.Q.ndim == 3:
        return otherwise
    try:
        return (clyap if continuous else dlyap)(problem.F, problem.Q)
    except AssumptionError:
        return otherwise


def refuse_unstable(F: np.ndarray, continuous: bool, remedy: str) -> None:
    """Raise an error for an unstable model, which has no steady state; `remedy` says what to do."""
    λ = np.linalg.eigvals(F)
    worst = λ[np.argmax(λ.real if continuous else np.abs(λ))]
    size, limit = (worst.real, 0.0) if continuous else (abs(worst), 1.0)
    if size >= limit:
        shown = f"{worst.real:.6g}" if worst.imag == 0 else f"{worst.real:.6g} ± {abs(worst.imag):.6g}i"
        rule = "real parts below 0" if continuous else "moduli below 1"
        raise AssumptionError(f"a steady state needs eigenvalues of A with {rule}, but one is {shown}: {remedy}.")


def read_horizon(model: StateSpace, horizon: float | None, faults: checks.Faults) -> float | None:
    """Steps, or seconds where dt = 0; for a model that varies, its rows where none is given."""
    if model.is_continuous:
        if horizon is None and model.varying:
            faults.add("`horizon` must be given: the total duration, in seconds, of the rows of this continuous model.")
        return None if horizon is None else faults.number("horizon", horizon, above=0.0, unit="seconds")
    if horizon is None:
        return model.steps
    before = len(faults.sentences)
    faults.whole("horizon", horizon, 1)
    if len(faults.sentences) == before and model.steps is not None and horizon > model.steps:
        faults.add(f"`horizon` may be at most {model.steps}, the number of rows of the model in time. Got {horizon}.")
    return None if len(faults.sentences) > before else int(horizon)


def read_prior(prior: Prior | str | None, n: int, faults: checks.Faults) -> None:
    """Check that a prior has a finite covariance of this many states."""
    if not isinstance(prior, Prior):
        faults.instance("prior", prior, Prior)
        return
    if prior.diffuse is not None:
        faults.add("`prior` must have a finite covariance: the reduction of an infinite variance is not defined.")
    if np.shape(prior.covariance) != (n, n):
        faults.add(f"`prior` must describe n = {n} states: the model has as many. Got {np.shape(prior.covariance)[0]}.")
