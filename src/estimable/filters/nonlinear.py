"""The steps that the nonlinear filters share: a Gaussian belief about (x, θ), and an expansion of the model about it."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array, Numbers
from ..frozen import replace, set_field
from ..kernels import expansion, flow
from ..kernels.expansion import jacobian
from ..kernels.joint_gain import block_diagonal
from ..kernels.kalman import Measurement, Posterior, Transition
from ..kernels.kalman import predict as predict_linear
from ..kernels.rounding import MEMORY
from ..kernels.small import apply, factor, factors, gram, product, triangularise
from ..kernels.smoothing import Instant
from ..models.nonlinear_model import NonlinearModel
from ..models.plant import Functions, Matrices, plant
from ..models.prior import Prior
from ..models.sampled import Clock
from ..models.state_space import StateSpace
from ..models.uncertainty import ModelUncertainty
from ..results import Info, Interval, Names, Sample, outcome_code
from . import sample_noise, uncertain
from .belief import Belief, believe, posterior, side_by_side
from .input_noise import refuse_wandering_input

MOST_ITERATIONS = 100  # of a linearisation at one sample: each is traced by itself


def check(algorithm: Any) -> None:
    """The settings that the nonlinear filters share; sets `walk` to a covariance per second."""
    faults, model, parameters = checks.Faults(), algorithm.model, algorithm.parameters
    if not isinstance(model, NonlinearModel | StateSpace):
        faults.add(f"`model` must be a NonlinearModel or a StateSpace. Got {checks.short(model)}.")
    elif isinstance(model, StateSpace) and model.S is not None:
        faults.add("the model has cross noise S, which the nonlinear filters do not support: use Kalman(model).")
    if parameters is not None and faults.instance("parameters", parameters, Prior) and not faults.sentences:
        names = _estimated(algorithm)
        if parameters.size != len(names):
            faults.add(
                f"`parameters` must be a prior of the model's {checks.counted(len(names), 'parameter')} "
                f"({checks.listed(names)}). Got {parameters.size}."
            )
    given = algorithm.uncertainty
    if given is not None and not faults.sentences and faults.instance("uncertainty", given, ModelUncertainty):
        given.check(model, faults)
    walk = read_walk(algorithm, algorithm.walk, faults)
    faults.finish()
    set_field(algorithm, walk=walk)


def _estimated(algorithm: Any) -> tuple[str, ...]:
    """The parameters of the model that can be estimated: all but the considered ones."""
    model, given = algorithm.model, algorithm.uncertainty
    if not isinstance(model, NonlinearModel):
        return ()
    considered = given.of_parameters(model) if isinstance(given, ModelUncertainty) else ()
    return tuple(name for name in model.parameter_names if name not in considered)


def read_walk(self: Any, given: Numbers, faults: checks.Faults) -> Any:
    """A walk of the parameters as a covariance per second, (k, k), from one variance, k of them, or a covariance."""
    k = 0 if self.parameters is None else getattr(self.parameters, "size", 0)
    if checks.is_traced(given) or (checks.depth(given) == 2 and np.shape(given) == (k, k)):
        return given if checks.is_traced(given) else faults.covariance("walk", given, "k k")
    faults.learn("k", k, f"{checks.counted(k, 'parameter')} {'is' if k == 1 else 'are'} estimated")
    variances = faults.array("walk", [given] * k if checks.depth(given) == 0 else given, "k")
    if variances is not None and np.any(variances < 0):
        faults.add(f"`walk` must be variances per second, at least 0. Got {checks.short(given)}.")
    return None if variances is None else np.diag(variances)


def gain(self: Any) -> Prior | None:
    """The prior of the estimated parameters, which are reported as gains."""
    return self.parameters


def names(self: Any) -> Names:
    """Names of states, inputs, outputs, and of the estimated parameters, as gains."""
    model = self.model
    parameters = () if self.parameters is None else _estimated(self)
    return Names(model.states, model.inputs, model.outputs, parameters)


def sampled(self: Any, clock: Clock) -> Any:
    """The same filter with its model prepared for the steps of `clock`, and its noises factored."""
    ready = plant(self.model, clock, self.uncertainty)
    return replace(self, ready=ready, walk_factor=factors(self.walk), model=None)


def at(self: Any, k: int | Array) -> Any:
    """The filter at row k."""
    algorithm = ready_of(self)
    return replace(algorithm, ready=algorithm.ready.at(k))


def ready_of(algorithm: Any) -> Any:
    """The prepared filter. Without `sampled`, a step called by hand uses the model's own step."""
    return algorithm if algorithm.ready is not None else sampled(algorithm, Clock.every(algorithm.model.dt))


def init(self: Any, prior: Prior) -> Belief:
    """The belief about (x[0], θ) before y[0]."""
    if self.curved:
        refuse_diffuse(self, prior)
    ready = ready_of(self).ready
    belief = believe(prior, ready.origin, ready.added)
    if ready.uncertain:
        belief = uncertain.with_entries(
            belief, jnp.asarray(ready.sigma), jnp.asarray(ready.θ)[np.array(ready.uncertain)]
        )
    return belief if self.parameters is None else side_by_side(belief, believe(self.parameters))


def refuse_diffuse(algorithm: Any, prior: Prior) -> None:
    """Raise an error for a diffuse prior: second-order moments need a variance."""
    for what, given in (("prior", prior), ("parameters", algorithm.parameters)):
        if given is not None and given.diffuse is not None:
            checks.refuse(
                f"`{what}` must not have diffuse directions for {type(algorithm).__name__}: a nonlinear function of a quantity "
                "with infinite variance has no mean. Give a large but realistic variance, or use ExtendedKalman."
            )


def split(z: Array, ready: Functions | Matrices):
    """x and θ of z = (x, φ, estimated parameters), with φ the considered ones. What z does not hold is the model's own."""
    n, φ, θ = ready.n, ready.uncertain, ready.θ
    if z.shape[0] == n:
        return z, θ
    order = [*φ, *(i for i in range(len(θ)) if i not in φ)]
    held = z.shape[0] - n
    values = z[n:] if held == len(θ) else jnp.concatenate([z[n:], jnp.asarray(θ)[np.array(order[held:])]])
    return z[:n], (values[np.argsort(order)] if φ and order != sorted(order) else values)


def considered(algorithm: Any) -> slice | None:
    """The places in z of what is considered; None where nothing is."""
    ready, given = ready_of(algorithm).ready, algorithm.uncertainty
    if given is None or given.treat == "estimated":
        return None
    return slice(ready.n, ready.n + len(ready.uncertain))


def uncertain_entries(self: Any) -> int:
    """The number of uncertain entries or parameters in z."""
    return len(ready_of(self).ready.uncertain)


def output_of(ready: Functions | Matrices, sample: Sample) -> Callable:
    """z -> y without noise."""
    return lambda z: ready.output(*split(z, ready), sample.u)


def turn(period: tuple[float, ...] | None, parameters: int = 0) -> Any:
    """The periods as an array, with zeros for the parameters; None where nothing is an angle."""
    return None if period is None else np.array([*period, *[0.0] * parameters])


def move_of(ready: Functions | Matrices, interval: Interval) -> Callable:
    """z -> z at the next sample without noise; parameters are constant."""
    return lambda z: jnp.concatenate([ready.next_state(*split(z, ready), interval), z[ready.n :]])


def tell(self: Any, state: Belief) -> Info:
    """Mean and covariance of a belief about (x, θ), in the user's units."""
    ready = ready_of(self).ready
    n, covariance = ready.n, state.covariance
    end = n + len(ready.uncertain)
    has_parameters = state.mean.shape[0] > end
    return Info(
        mean=state.mean[:n] + ready.origin,
        covariance=covariance[:n, :n],
        gain=state.mean[end:] if has_parameters else None,
        gain_covariance=covariance[end:, end:] if has_parameters else None,
        diffuse_covariance=gram(state.diffuse)[:n, :n] if state.diffuse.shape[1] else None,
        extra={"state_gain_covariance": covariance[:n, end:]} if has_parameters else {},
    )


def tell_sample(algorithm: Any, state: Belief, post: Posterior, bias: Array | None) -> Info:
    """The report after a sample, with an outcome code for non-finite values."""
    reported, code = tell(algorithm, state), outcome_code(post.contradicted, state.mean, state.factor, state.diffuse)
    return replace(
        reported,
        innovation=post.innovation,
        innovation_covariance=post.innovation_covariance,
        log_likelihood=post.log_likelihood,
        outcome=jnp.where(code == 1, 4, code),
        extra=({} if bias is None else {"output_bias": bias}) | reported.extra,
    )


def noise_of(line: expansion.Expansion, V: Array, truncated: bool):
    """The factor of the residual of y after the linear fit: V V' + E E', or V V' - b b' where fourth moments are neglected."""
    if truncated:
        return expansion.lessened(V, line.bias)
    return triangularise(jnp.concatenate([V, line.rest], axis=1)) if line.rest.shape[1] else V


def correct(self: Any, state: Belief, sample: Sample) -> tuple[Belief, Info]:
    """Condition on y with h expanded about the belief, and again about the result, `iterations` times in all.

    Each pass conditions the same prior belief on a better linearisation of h: the iterated extended filter
    (Jazwinski §8.3) where the expansion is of the first order, posterior linearisation (García-Fernández et al., IEEE TSP
    63 (2015) 5561-5573) where it is of the second.
    """
    line, first = _condition(self, state, sample, state.mean, state.factor)
    post = first
    for _ in range(self.iterations - 1):
        post = _condition(self, state, sample, post.state.m, post.state.Z)[1]
    after = Belief(*post.state)
    first = first._replace(contradicted=post.contradicted)  # innovation and likelihood refer to the prediction
    return after, tell_sample(self, after, first, line.bias if self.curved else None)


def condition(self: Any, state: Belief, sample: Sample, about: Belief | None = None) -> tuple[Belief, Any]:
    """The belief about (x, θ) after one sample, with h linearised at `about` (None: the belief itself)."""
    about = state if about is None else about
    post = _condition(self, state, sample, about.mean, about.factor)[1]
    return Belief(*post.state), post


def _condition(algorithm: Any, b: Belief, sample: Sample, mean: Array, L: Array):
    """The belief b conditioned on y, with h linearised at a mean and a factor of its covariance."""
    line, measurement = measurement_about(algorithm, sample, mean, L)
    ready = ready_of(algorithm).ready
    plain = not line.rest.shape[1] and not algorithm.truncated
    update = posterior(
        b, measurement, sample, independently=ready.independent and plain, considered=considered(algorithm)
    )
    return line, update


def measurement_about(self: Any, sample: Sample, mean: Array, L: Array) -> tuple[expansion.Expansion, Measurement]:
    """h linearised at a mean and a factor of its covariance."""
    ready = ready_of(self).ready
    line = self.expand(output_of(ready, sample), mean, L)
    d = line.mean - jnp.sum(line.slope * mean[None, :], axis=1)
    V = noise_of(line, sample_noise.noise_of(ready.V, sample), self.truncated)
    return line, Measurement(line.slope, d, V, None, turn(ready.period))


def instant_about(self: Any, sample: Sample, interval: Interval, predicted: Belief, filtered: Belief) -> Instant:
    """A row of the model for the smoother: h linearised as in `correct`, and the step to the next sample as in `predict`."""
    about = predicted
    for _ in range(self.iterations - 1):
        about = condition(self, predicted, sample, about)[0]
    measurement = measurement_about(self, sample, about.mean, about.factor)[1]
    return Instant(transition_about(self, filtered, interval), measurement)


def constant(self: Any, walk: Array, persistence: Array) -> Any:
    """The same filter with parameters that walk by `walk` per second only, and `persistence` times its process noise."""
    return replace(self, walk=walk, model=replace(self.model, Q=persistence * self.model.Q))


def walk_columns(algorithm: Any, b: Belief, interval: Interval) -> Any:
    """The factor of the random walk of the parameters in a step, (n + k, k), and of the effect of an unknown input."""
    refuse_wandering_input(interval)
    walk = block_diagonal(
        jnp.zeros((algorithm.ready.n + len(algorithm.ready.uncertain), 0)),
        algorithm.walk_factor * jnp.sqrt(interval.dt),
    )
    if interval.u_covariance is None:
        return walk
    known = replace(interval, u_covariance=None)
    slope = jacobian(lambda e: _moved_by_input(algorithm.ready, b, known, e), jnp.zeros(interval.u.shape[0]))[1]
    return jnp.concatenate([walk, product(slope, factor(jnp.asarray(interval.u_covariance)))], axis=1)


def _moved_by_input(ready: Functions | Matrices, b: Belief, interval: Interval, e: Array):
    """z at the next sample without noise, from the mean, with e added to the input."""
    shifted = replace(interval, u=interval.u + e, u_end=interval.u_end + e)
    if not isinstance(ready, Functions) or not ready.continuous:
        return move_of(ready, shifted)(b.mean)
    f, _ = augmented(ready, b, shifted)
    return flow.integrate(lambda t, z: f(z, t), b.mean, interval.dt, ready.substeps)[0]


def predict(self: Any, state: Belief, interval: Interval) -> Belief:
    """Move to the next sample, with f expanded about the belief."""
    algorithm, b = ready_of(self), state
    walk = walk_columns(algorithm, b, interval)
    if algorithm.ready.continuous and self.between == "moments":
        return flowed(algorithm, b, interval, walk)
    L, transition, bias = _expanded(algorithm, b, interval, walk)
    moved = Belief(*predict_linear(b.gaussian._replace(Z=L), transition))
    return moved if bias is None else replace(moved, factor=expansion.lessened(moved.factor, bias))


def transition_about(self: Any, b: Belief, interval: Interval) -> Transition:
    """The step to the next sample as `predict` linearises it at a belief."""
    algorithm = ready_of(self)
    walk = walk_columns(algorithm, b, interval)
    if algorithm.ready.continuous and self.between == "moments":
        return _flow_of(algorithm.ready, 2 if self.curved else 1, b, interval, walk)
    return _expanded(algorithm, b, interval, walk)[1]


def _expanded(algorithm: Any, b: Belief, interval: Interval, walk: Array) -> tuple[Array, Transition, Array | None]:
    """The factor of the belief, its step, and the bias to subtract from the covariance where fourth moments are neglected."""
    ready, expand = algorithm.ready, algorithm.expand
    if ready.continuous:
        return mapped(algorithm, b, interval, walk)
    L = triangularise(b.factor) if algorithm.curved else b.factor
    f = move_of(ready, interval)
    if ready.noise_input is None:
        line = expand(f, b.mean, L)
        W = padded(ready.noise(*split(b.mean, ready), interval.u), b)
        slope, rest = line.slope, line.rest
    else:
        line, slope, W = _with_noise_input(ready, b, L, interval, f, expand)
        rest = line.rest
    c = line.mean - jnp.sum(slope * b.mean[None, :], axis=1)
    transition = Transition(slope, c, jnp.concatenate([W, rest, walk], axis=1))
    return L, transition, line.bias if algorithm.truncated else None


def _with_noise_input(ready: Functions, b: Belief, L: Array, interval: Interval, f: Callable, expand: Callable):
    """f(z) + W(z) e expanded over (z, e), for a noise input that depends on the state."""
    size, q = b.mean.shape[0], ready.white.shape[0]
    line = expand(noisy(ready, b, f, interval), jnp.concatenate([b.mean, jnp.zeros(q)]), block_diagonal(L, jnp.eye(q)))
    return line, line.slope[:, :size], line.slope[:, size:]


def noisy(ready: Functions | Matrices, b: Belief, f: Callable, interval: Interval) -> Callable:
    """(z, e) -> f(z) + W(z) e."""
    size = b.mean.shape[0]

    def g(ze: Array):
        W = padded(ready.noise(*split(ze[:size], ready), interval.u), b)
        return f(ze[:size]) + jnp.sum(W * ze[None, size:], axis=1)

    return g


def padded(W: Array, belief: Belief):
    """The noise of the states, with zero rows for the parameters."""
    rest = belief.mean.shape[0] - W.shape[0]
    return jnp.concatenate([W, jnp.zeros((rest, W.shape[1]))]) if rest else W


def augmented(ready: Functions, b: Belief, interval: Interval) -> tuple[Callable, Callable]:
    """f(z, t) and W(z, t) of z = (x, θ), with constant θ."""
    n, derivative = ready.n, ready.derivative(interval)

    def f(z: Array, t: Array | float):
        x, θ = split(z, ready)
        return jnp.concatenate([derivative(x, θ, t), jnp.zeros(z.shape[0] - n)])

    return f, lambda z, t: padded(ready.noise(*split(z, ready), interval.u), b)


def flowed(algorithm: Any, b: Belief, interval: Interval, walk: Array) -> Belief:
    """The belief propagated by its moment equations."""
    size, r = b.mean.shape[0], b.diffuse.shape[1]
    mean, Y, noise = _flow(algorithm.ready, 2 if algorithm.curved else 1, b, interval, b.diffuse)
    Z = triangularise(jnp.concatenate([Y[:, :size], noise, walk], axis=1))
    return Belief(mean, Z, Y[:, size : size + r], jnp.maximum(jnp.abs(mean), MEMORY * b.size), b.log_scale)


def _flow_of(ready: Functions, order: int, b: Belief, interval: Interval, walk: Array) -> Transition:
    """The moment equations as a step: tangents that start as unit vectors end as its slope."""
    size = b.mean.shape[0]
    mean, Y, noise = _flow(ready, order, b, interval, jnp.eye(size))
    F = Y[:, size:]
    return Transition(F, mean - apply(F, b.mean), jnp.concatenate([noise, walk], axis=1))


def _flow(ready: Functions, order: int, b: Belief, interval: Interval, tangents: Array):
    """The mean, the factor of the belief and other tangents at the next sample, and the factor of the noise between."""
    size, L = b.mean.shape[0], triangularise(b.factor)
    start = flow.Moments(b.mean, jnp.concatenate([L, tangents], axis=1), jnp.zeros((size, size)))
    moments = flow.moment_derivative(*augmented(ready, b, interval), order, factor_columns=size)
    end, reached = flow.integrate(moments, start, interval.dt, ready.substeps)
    return jnp.where(reached, end.m, jnp.nan), end.Y, factor(end.N)


def mapped(algorithm: Any, b: Belief, interval: Interval, walk: Array) -> tuple[Array, Transition, None]:
    """The expansion of the map from one sample to the next, as for a discrete model.

    The process noise between the samples is propagated by the tangents along the mean.
    """
    ready, size = algorithm.ready, b.mean.shape[0]
    f, W = augmented(ready, b, interval)

    def move(z: Array):
        return flow.integrate(lambda t, z: f(z, t), z, interval.dt, ready.substeps)[0]

    L = triangularise(b.factor)
    line = algorithm.expand(move, b.mean, L)
    start = flow.Moments(b.mean, jnp.zeros((size, 0)), jnp.zeros((size, size)))
    along, _ = flow.integrate(flow.moment_derivative(f, W, 1), start, interval.dt, ready.substeps)
    c = line.mean - jnp.sum(line.slope * b.mean[None, :], axis=1)
    noise = jnp.concatenate([factor(along.N), line.rest, walk], axis=1)
    return L, Transition(line.slope, c, noise), None
