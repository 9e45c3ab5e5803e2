"""The question of a covariance analysis for each kind of model, with every fault of the call."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..data.record import Record
from ..kernels.step_factors import noise_factors, semidefinite_factor
from ..models.nonlinear_model import NonlinearModel
from ..models.prior import Prior
from ..models.sampled import sample
from ..models.state_space import StateSpace, refuse_schedule
from ..protocols import JumpingGains
from ..results import CovarianceQuestion
from . import covariance_problem as problem
from .covariance_problem import Question, Stage
from .gain_information import applied, gain_rows
from .trajectories import stages_along

Real = np.ndarray
MOST_STATES = 1000
SILENT = 1e-13  # eigenvalue of R in units of its own diagonal, below which a combination of sensors has no noise


class ArrayQuestion(NamedTuple):
    """A question in arrays; `horizon` is the last step (seconds for continuous outputs), None for no limit.

    `noise_free`: whether a combination of sensors has no noise. `crossed`: whether process and sensor noise are correlated.
    """

    question: Question
    model: StateSpace
    names: tuple[str, ...]
    states: tuple[str, ...]
    outputs: tuple[str, ...]
    requirement: Real
    horizon: float | None
    noise_free: bool
    crossed: bool


def as_dict(given: Mapping[str, Any] | None) -> Any:
    """A mapping as a dict; anything else unchanged, for `ask` to refuse."""
    return dict(given) if isinstance(given, Mapping) else given


def ask(given: CovarianceQuestion) -> ArrayQuestion:
    """The question in arrays. Raises `InputError` with all faults."""
    faults = checks.Faults()
    _check_kinds(given, faults)
    model = _model_of(given, faults)
    faults.finish()
    _check(model, given, faults)
    gains, gain_names = _gains(given)
    states = (*model.states, *gain_names)
    H, names, requirement = _wanted(given, states, faults)
    faults.finish()
    prior = _joint(given.prior, gains)
    rows, horizon, dt = _timed(given, model, faults)
    faults.finish()
    first, stages, noise_names, sensor_names = rows
    noise_free = not (given.dt is None and model.is_continuous) and _noise_free(model, faults)
    faults.finish()
    continuous = model.is_continuous and given.dt is None and given.record is None
    wanted = _required_states(H, requirement)
    size = problem.units(prior, wanted, lambda: _floors(first, prior, continuous))
    L, D = problem.prior_factors(prior, size)
    constant = stages is None
    one = problem.scaled(first, size)
    at = (lambda k: one) if stages is None else (lambda k: problem.scaled(stages(k), size))
    question = Question(one, at, constant, continuous, L, D, H * size, size, dt, noise_names, sensor_names)
    return ArrayQuestion(
        question, model, names, states, model.outputs, requirement, horizon, noise_free, model.S is not None
    )


def _check_kinds(given: CovarianceQuestion, faults: checks.Faults) -> None:
    """The arguments that must be of a kind before anything else can be checked."""
    faults.instance("prior", given.prior, Prior)
    faults.whole("draws", given.draws, 0)
    if given.dt is not None:
        faults.number("dt", given.dt, above=0.0, unit="seconds")
    if given.record is not None:
        faults.instance("record", given.record, Record)
    arrival = None if given.arrival is None else faults.numbers("arrival", given.arrival)
    if arrival is not None and arrival.ndim not in (1, 2):
        faults.add(f"`arrival` must be (T,) or (T, p). Got {arrival.shape}.")
    for name in ("wanted", "requirement"):
        value = getattr(given, name)
        if value is not None and (not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value)):
            faults.add(f"`{name}` must be a mapping of names, such as {{'speed': ..}}. Got {checks.short(value)}.")
    faults.finish()


def _check_nonlinear(model: NonlinearModel, given: CovarianceQuestion, faults: checks.Faults) -> None:
    """A nonlinear model needs a trajectory: inputs, or a horizon where it has none."""
    if given.record is None and given.u is None and (model.m or given.horizon is None):
        what = "`u` or `record`" if model.m else "`horizon` or `record`"
        faults.add(f"{what} must be given: the tangents of a nonlinear model depend on its trajectory.")
    if model.is_continuous and given.dt is None and given.record is None:
        faults.add("`dt` is needed: the model is continuous (dt = 0), and its outputs are samples.")
    if given.parameters is not None and faults.instance("parameters", given.parameters, Prior):
        k = len(model.parameter_names)
        if given.parameters.size != k:
            faults.add(f"`parameters` must be a prior of the {k} parameters of the model. Got {given.parameters.size}.")
    if given.prior.diffuse is not None and given.draws:
        faults.add("`draws` needs a prior without diffuse directions, from which starts can be drawn.")


def _model_of(given: CovarianceQuestion, faults: checks.Faults) -> Any:
    model = given.model
    if isinstance(model, JumpingGains) and isinstance(model.model, StateSpace):
        if given.u is None and given.record is None:
            faults.add("`u` or `record` must be given: what can be known about a gain depends on the input.")
        if given.u is not None and given.record is not None:
            faults.add("`u` and `record` both give the input: give one of them.")
        return model.model
    if isinstance(model, NonlinearModel):
        _check_nonlinear(model, given, faults)
        return model
    if not faults.instance("model", model, StateSpace):
        faults.finish()
    if given.u is not None or given.record is not None:
        faults.add(
            "`u` and `record` are for unknown gains: the sigma of a linear model does not depend on its input. "
            "Leave them out, or give an `UnknownGain`."
        )
    if given.parameters is not None or given.draws:
        faults.add("`parameters` and `draws` are for a `NonlinearModel`: leave them out.")
    plain: Any = model
    return plain


def _check(model: StateSpace, given: CovarianceQuestion, faults: checks.Faults) -> None:
    if isinstance(model, StateSpace):
        refuse_schedule(model)
    if model.R is None:
        faults.add("`model` has no R: give the covariance of the measurement noise, StateSpace(..., R=...).")
    elif model.is_continuous and given.dt is None and given.record is None and isinstance(model, StateSpace):
        _check_continuous(model, given, faults)
    if not model.is_continuous and given.dt not in (None, model.dt):
        faults.add(f"`dt` is for continuous models: this one has dt = {model.dt:g} s. Got {checks.short(given.dt)}.")
    if faults.instance("prior", given.prior, Prior) and given.prior.size != model.n:
        faults.add(f"`prior` must describe n = {model.n} states: the model has as many. Got {given.prior.size}.")
    faults.number("learnt", given.learnt, lower=0.0, upper=1.0)
    if model.n > MOST_STATES:
        faults.add(f"`model` must have at most {MOST_STATES} states. Got {model.n}. Reduce it first.")
    _check_horizon(model, given, faults)


def _check_continuous(model: StateSpace, given: CovarianceQuestion, faults: checks.Faults) -> None:
    """Checks of a model whose R is a density."""
    faults.positive_definite("R", np.asarray(model.R).reshape(-1, model.p, model.p)[0])
    if model.varying:
        faults.add("`dt` is needed: a continuous model with rows in time is analysed at samples.")
    if given.arrival is not None:
        faults.add("`arrival` concerns samples: give `dt`, the step of this continuous model.")


def _check_horizon(model: StateSpace, given: CovarianceQuestion, faults: checks.Faults) -> None:
    if given.horizon is None:
        return
    if model.is_continuous:
        faults.number("horizon", given.horizon, above=0.0, unit="seconds")
        return
    before = len(faults.sentences)
    faults.whole("horizon", given.horizon, 1)
    if len(faults.sentences) == before and model.steps is not None and given.horizon > model.steps:
        faults.add(f"`horizon` may be at most {model.steps}, the rows of the model in time. Got {given.horizon}.")


def _gains(given: CovarianceQuestion) -> tuple[Prior | None, tuple[str, ...]]:
    if isinstance(given.model, StateSpace):
        return None, ()
    algorithm: Any = given.model
    if isinstance(algorithm, NonlinearModel):
        return given.parameters, () if given.parameters is None else algorithm.parameter_names
    return algorithm.gain, algorithm.names.gains


def _joint(state: Prior, gains: Prior | None) -> Prior:
    """The prior of states and gains together."""
    if gains is None:
        return state
    from scipy.linalg import block_diag

    parts = [np.zeros((one.size, 0)) if one.diffuse is None else one.diffuse for one in (state, gains)]
    diffuse = block_diag(*parts)
    mean = np.concatenate([state.mean, gains.mean])
    covariance = block_diag(state.covariance, gains.covariance)
    return Prior(mean, covariance, diffuse=diffuse if diffuse.shape[1] else None)


def _wanted(
    given: CovarianceQuestion, states: tuple[str, ...], faults: checks.Faults
) -> tuple[Real, tuple[str, ...], Real]:
    """The rows of the quantities, their names, and the requirement of each."""
    n = len(states)
    faults.learn("n", n, f"there are {checks.counted(n, 'state')}" + (" and gains" if n > 0 else ""))
    if given.wanted is None:
        H, names = np.eye(n), states
    else:
        rows = [faults.array(f"wanted[{name!r}]", row, "n") for name, row in given.wanted.items()]
        H = np.array([np.zeros(n) if row is None else row for row in rows]).reshape(len(rows), n)
        names = tuple(given.wanted)
        if not names:
            faults.add("`wanted` must name at least one combination: {name: row}.")
    requirement = np.full(len(names), np.nan)
    for name, sigma in (given.requirement or {}).items():
        if name not in names:
            faults.add(f"`requirement` names {name!r}, which is not among {checks.listed(names)}.")
        elif (value := faults.number(f"requirement[{name!r}]", sigma, above=0.0)) is not None:
            requirement[names.index(name)] = value
    return H, names, requirement


def _required_states(H: Real, requirement: Real) -> Real:
    """The requirement of each state that is itself a quantity; 0 for the others."""
    found = np.zeros(H.shape[1])
    for row, r in zip(H, requirement, strict=True):
        entries = np.flatnonzero(row)
        if len(entries) == 1 and np.isfinite(r):
            found[entries[0]] = r / abs(row[entries[0]])
    return found


Steps = tuple[Stage, Callable[[int], Stage] | None, tuple[str, ...], tuple[str, ...]]


def _timed(given: CovarianceQuestion, model: StateSpace, faults: checks.Faults) -> tuple[Steps, float | None, float]:
    """The first stage and the others (None: the same), the names of the sources, the last step, and the time of a step."""
    if isinstance(given.model, NonlinearModel):
        stages, dt = _stages_along(given, given.model, faults)
        noises, sensors = ("process noise",), _sensor_names(model)[0]
    elif not isinstance(given.model, StateSpace):
        stages, dt = _stages_of_gains(given, model, faults)
        noises, sensors = ("process noise", "walk of the gains"), _sensor_names(model)[0]
    elif model.is_continuous and given.dt is None:
        first, noises, sensors = _constant_stage(model, None)
        return (first, None, noises, sensors), given.horizon, 1.0
    else:
        dt = float(given.dt if given.dt is not None else model.dt)
        last = None if given.horizon is None else int(given.horizon) - 1
        if model.is_continuous and given.horizon is not None:
            last = round(given.horizon / dt)
        if not model.varying and given.arrival is None:
            first, noises, sensors = _constant_stage(model, given.dt)
            return (first, None, noises, sensors), last, dt
        stages, noises, sensors = _stages_in_rows(model, given, last, faults)
    if given.arrival is not None:
        stages = _arriving(stages, given.arrival, model.p, faults)
    rows = len(stages) if given.horizon is None else min(len(stages), _samples_in(given, model, dt))
    return (stages[0], lambda k: stages[k + 1], noises, sensors), rows - 1, dt


def _samples_in(given: CovarianceQuestion, model: StateSpace | NonlinearModel, dt: float) -> int:
    """The number of samples in the horizon."""
    horizon = float(given.horizon or 1)
    return round(horizon / dt) + 1 if model.is_continuous else int(horizon)


def _sensor_names(model: StateSpace) -> tuple[tuple[str, ...], list[list[int]]]:
    groups = problem.blocks(np.asarray(model.R))
    return tuple(" and ".join(model.outputs[i] for i in group) for group in groups), groups


def _constant_stage(model: StateSpace, dt: float | None) -> tuple[Stage, tuple[str, ...], tuple[str, ...]]:
    sensors, of_R = _sensor_names(model)
    of_Q = [group for group in problem.blocks(model.Q) if np.any(model.Q[group])]
    A, C, G, V = model.A, model.C, model.G, problem.factors(model.R, of_R)
    g = [G @ half for half in problem.factors(model.Q, of_Q)]
    noises = tuple(problem.noise_name(G, group, model.states) for group in of_Q)
    if dt is not None and model.is_continuous:
        A, g = noise_factors(A, g, dt)
    if model.S is not None:
        A, g = _uncrossed(A, G, model.Q, C, model.R, model.S)
        noises = ("process noise",)
    return Stage(A, g, C, V), noises, sensors


def _uncrossed(A: Real, G: Real, Q: Real, C: Real, R: Real, S: Real) -> tuple[Real, list[Real]]:
    """A and the noise after the part of the process noise that the present sample shows: A - G S R^-1 C, Q - S R^-1 S'."""
    back = S @ np.linalg.pinv(R, hermitian=True)
    return A - G @ back @ C, [G @ semidefinite_factor(Q - back @ S.T)]


def _stages_in_rows(
    model: StateSpace, given: CovarianceQuestion, last: int | None, faults: checks.Faults
) -> tuple[list[Stage], tuple[str, ...], tuple[str, ...]]:
    if not model.varying:
        first, noises, sensors = _constant_stage(model, given.dt)
        return [first] * (np.shape(given.arrival)[0] if last is None else last + 1), noises, sensors
    if model.is_continuous:
        model = model.discretise(float(given.dt or 1.0))
    sensors, of_R = _sensor_names(model)
    of_Q = problem.blocks(np.asarray(model.Q))
    T = model.steps or 1
    at = {name: _over_time(getattr(model, name), T) for name in "AGQCRS"}
    noises = tuple(problem.noise_name(at["G"][0], group, model.states) for group in of_Q)
    stages = []
    for k in range(T):
        before = max(k - 1, 0)  # row k - 1 leads to sample k
        A, G, Q = at["A"][before], at["G"][before], at["Q"][before]
        g = [G @ half for half in problem.factors(Q, of_Q)]
        if model.S is not None:
            A, g = _uncrossed(A, G, Q, at["C"][before], at["R"][before], at["S"][before])
        stages.append(Stage(A, g, at["C"][k], problem.factors(at["R"][k], of_R)))
    return stages, ("process noise",) if model.S is not None else noises, sensors


def _over_time(M: Real | None, T: int) -> Real:
    return np.zeros(T) if M is None else np.broadcast_to(M, (T, *M.shape)) if M.ndim == 2 else M


def _arriving(stages: list[Stage], arrival: checks.Given, p: int, faults: checks.Faults) -> list[Stage]:
    """The stages with the channels that arrive only."""
    given = faults.numbers("arrival", arrival)
    if given is None:
        return stages
    mask = given[:, None] * np.ones(p) if given.ndim == 1 else given
    if mask.ndim != 2 or mask.shape != (len(stages), p):
        faults.add(f"`arrival` must be (T,) or (T, p) with T = {len(stages)} samples and p = {p}. Got {given.shape}.")
    elif not np.all((mask == 0) | (mask == 1)):
        faults.add("`arrival` must hold 1 for what arrives and 0 for what is lost.")
    else:
        seen = mask > 0
        return [Stage(one.A, one.g, one.C[now], [V[now] for V in one.V]) for one, now in zip(stages, seen, strict=True)]
    return stages


def _stages_of_gains(given: CovarianceQuestion, model: StateSpace, faults: checks.Faults) -> tuple[list[Stage], float]:
    """The states (x, θ): the effect of each gain is a column of u."""
    algorithm: Any = given.model
    p, n = algorithm.gain.size, model.n
    faults.learn("m", model.m, f"the model has {checks.counted(model.m, 'input')}")
    source: Any = given.u if given.record is None else given.record
    u, seen, clock = applied(model, source, given.dt, faults)
    faults.finish()
    step = float(np.max(clock.lengths))
    walk = semidefinite_factor(np.asarray(algorithm.walk) * step)
    blocks = algorithm.in_blocks()
    stages, move = [], None
    of_R = _sensor_names(model)[1]
    for A, N, C, M, Q, R, _, now in gain_rows(sample(blocks, clock), u, None, seen, p):
        at_sample = np.hstack([C, M[:, n:]])[now], [V[now] for V in problem.factors(R, of_R)]
        A_x, g_x = move if move is not None else (np.eye(n, n + p), np.zeros((n, 0)))
        whole = np.vstack([A_x, np.eye(p, n + p, n)])
        g = [np.vstack([g_x, np.zeros((p, g_x.shape[1]))]), np.vstack([np.zeros((n, walk.shape[1])), walk])]
        stages.append(Stage(whole, g, *at_sample))
        move = np.hstack([A, N[:, n:]]), semidefinite_factor(Q)
    return stages, step


def _stages_along(given: CovarianceQuestion, model: NonlinearModel, faults: checks.Faults) -> tuple[list[Stage], float]:
    """The states (x, θ) of a nonlinear model, along the path from the means of the priors."""
    if given.record is None:
        dt = float(given.dt or model.dt)
        faults.learn("m", model.m, f"the model has {checks.counted(model.m, 'input')}")
        u = faults.array("u", np.zeros((_samples_in(given, model, dt), 0)) if given.u is None else given.u, "T m")
        seen = None if u is None else np.ones((len(u), model.p), bool)
    else:
        u, seen, clock = applied(model, given.record, None, faults)
        dt = float(np.max(clock.lengths))
    faults.finish()
    free = given.parameters is not None
    θ = np.asarray(model.parameters if given.parameters is None else given.parameters.mean)
    return stages_along(model, np.asarray(given.prior.mean), θ, np.asarray(u), np.asarray(seen), dt, free=free), dt


def _floors(first: Stage, prior: Prior, continuous: bool) -> tuple[Real, Real]:
    return problem.floors(first.A, first.noise, first.C, first.sensors, prior, continuous=continuous)


def _noise_free(model: StateSpace, faults: checks.Faults) -> bool:
    """Whether R is singular in some row; noise-free sensors that repeat another are a fault."""
    R = np.asarray(model.R).reshape(-1, model.p, model.p)
    C = (
        np.asarray(model.C).reshape(-1, model.p, model.n)[0]
        if isinstance(model, StateSpace)
        else np.zeros((model.p, 0))
    )
    exact = [i for i in range(model.p) if R[0, i, i] == 0]
    for a, i in enumerate(exact):
        for j in exact[a + 1 :]:
            if np.any(C[i]) and np.linalg.matrix_rank(np.vstack([C[i], C[j]])) < 2:
                first, second = model.outputs[i], model.outputs[j]
                faults.add(
                    f"`R`: {first} and {second} repeat each other and have no noise: leave one out, or give noise."
                )
    for one in R:
        size = np.sqrt(np.diagonal(one))
        if np.any(size == 0) or np.linalg.eigvalsh(one / size[:, None] / size)[0] <= SILENT:
            return True
    return False
