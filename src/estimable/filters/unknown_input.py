"""The state and the unmeasured inputs, estimated together."""

from dataclasses import KW_ONLY, field
from typing import Any, Self

import jax.numpy as jnp
import numpy as np

from .. import checks
from ..analysis.unknown_input_existence import unknown_columns
from ..annotations import Array, Numbers
from ..frozen import frozen, replace, set_field, static
from ..kernels import diffuse_input as kernel
from ..kernels.joint_gain import block_diagonal
from ..kernels.kalman import Measurement, Transition
from ..kernels.small import apply, factors, gram, product
from ..kernels.smoothing import Instant
from ..models.complex_step import value_of
from ..models.prior import Prior
from ..models.sampled import Clock, SampledModel, sample
from ..models.state_space import StateSpace
from ..protocols import Smoothable
from ..results import Info, Interval, Names, Sample, outcome_code
from . import belief, fang_steps, levels
from .belief import Belief
from .input_noise import with_input_noise
from .sample_noise import noise_of
from .unknown_layout import METHODS, Layout, lay_out, pick


@frozen
class UnknownInput(Smoothable[Any]):
    """A filter that estimates the state and unmeasured inputs, as far as the outputs determine them.

    Model: x[k+1] = A x[k] + B u[k] + G w[k], y[k] = C x[k] + D u[k] + v[k], constant or time-varying, possibly with cross
    noise S. The d inputs named in `unknown` are unmeasured; the others are in the record, by name. Outputs may be missing
    channel by channel. The prior may be exact, proper or diffuse, as in `Kalman`.

    Assumes that the model is right except for those inputs. Nothing is assumed about them: not their size, their spectrum, or
    whether they depend on the state. With fewer outputs than unknown inputs, or with an invariant zero that is not inside the
    unit circle, the outputs do not determine them, and a run is an error (`unknown_input_existence` gives the reason). If
    something is known about the input, give `variance`, `walk` or `levels`: the errors are smaller, and no such condition is
    needed. An error of the model looks like an input.

    Settings:

    - `unknown`: names of inputs, or their columns.
    - `method`: "auto" conditions exactly on the outputs. It equals Gillijns & De Moor's filter with feedthrough
      (D of full column rank) or without (D = 0), or a case between; the result reports which and why. "feedthrough",
      "no_feedthrough", "partial" and "delayed" request one of these. "exact" is "auto" without the check that the input can
      be estimated. "fang" is Fang's Algorithm 1, with almost optimal gains.
    - `variance`: the variance of each unknown input about the operating point, white in time (a number, (d,) or (d, d)).
      None: infinite. `walk`: its variance per second as a random walk (the same shapes). Both range from 0
      (known, or constant) to infinity (unknown).
    - `levels`: the values that the input can take, (q,) or (q, d), equally likely. After each sample the belief is the sum over
      them, each with its probability; its mean and covariance are carried on. `extra["level"]` is the likeliest.
    - `delay`: the number of samples after which an input is reported. None: as many as it takes where nothing is missing.

    Row k of a result uses the samples 0 to k, and its `unknown_input` is the input of row k - `names.input_delay`. (With
    "fang", row k of `mean` is predicted from the samples 0 to k - 1.) Undetermined directions are in `diffuse_covariance` and
    in `extra["unknown_input_diffuse_covariance"]`. `innovation` is that of each output given the outputs before it in the
    same sample. It is NaN where an output only determined an unknown input; the other innovations can be used to test the
    model.

    Cost: measured as machine code, 1.1 to 1.7 times `Kalman` where every output is seen and the prior is proper. Otherwise
    n + d (delay + 1) undetermined directions are carried: 4 times with one unknown input, 5 times with two.

    Reference: S. Gillijns, B. De Moor, Automatica 43 (2007) 111-116 and 934-937; H. Fang (2009), ch. 2, Algorithm 1.

    >>> model = StateSpace([[0.5]], [[1.0]], [[1.0], [1.0]], [[1.0], [0.0]], Q=[[0.1]], R=np.eye(2), dt=1)
    >>> result = estimate(UnknownInput(model, unknown=["u1"]), Record([[3.0, 1.0]], dt=1), prior=Prior([1.0], [[0.0]]))
    >>> result.unknown_input.round(6).tolist()
    [[2.0]]
    """

    model: StateSpace
    _: KW_ONLY
    unknown: Any = static()
    method: str = static(default="auto")
    variance: Any = None
    walk: Any = None
    levels: Any = None
    delay: int | None = static(default=None)
    ready: Any = field(default=None, init=False)
    freedom: Any = field(default=None, init=False)
    layout: Any = static(default=None, init=False)

    def __post_init__(self):
        faults = checks.Faults()
        faults.instance("model", self.model, StateSpace)
        faults.finish()
        columns = unknown_columns(self.model, self.unknown, faults)
        known = faults.choice("method", self.method, METHODS)
        if self.delay is not None:
            faults.whole("delay", self.delay, 0, checks.LARGEST_ORDER)
        faults.learn("d", len(columns), f"`unknown` names {checks.counted(len(columns), 'input')}")
        variance, walk = (_covariance(name, getattr(self, name), faults) for name in ("variance", "walk"))
        values = self.levels if self.levels is None else levels.read(self.levels, faults)
        if known and self.method == "fang" and not (variance is walk is values is None and self.delay in (None, 0)):
            faults.add(
                '`method` = "fang" takes no `variance`, `walk`, `levels` or `delay`: leave `method` out to use them.'
            )
        faults.finish()
        names = tuple(self.model.inputs[i] for i in columns)
        set_field(self, unknown=names, variance=variance, walk=walk, levels=values)
        if not self.model.is_continuous:
            set_field(self, layout=lay_out(self, self.model))

    @property
    def names(self) -> Names:
        """Names of states, known inputs, outputs and unknown inputs."""
        known = tuple(name for name in self.model.inputs if name not in self.unknown)
        return Names(self.model.states, known, self.model.outputs, unknown_inputs=self.unknown)

    def sampled(self, clock: Clock) -> Self:
        """The same filter with its model discretised, its noises factored, and its method chosen from the ranks."""
        layout = self.layout if self.layout is not None else lay_out(self, value_of(self.model), clock)
        given = self.walk if layout.freedom == "walk" else self.variance
        return replace(
            self, ready=sample(self.model, clock), layout=layout, model=None,
            freedom=None if given is None else factors(given),
        )  # fmt: skip

    @property
    def where_all_is_seen(self) -> Self:
        """The sampled filter for a record without missing outputs and a proper prior: the same result, faster."""
        constant = self.ready is not None and not self.ready.varying
        return replace(self, layout=self.layout.complete) if constant and self.layout is not None else self

    @property
    def result_names(self) -> dict[str, Any]:
        """What the rows of a result refer to, once the model is sampled: which input, which samples, and which method."""
        return {} if self.layout is None else {"input_delay": self.layout.delay, "note": self.layout.note}

    def at(self, k: int | Array) -> Self:
        """The filter at row k of a time-varying model."""
        ready = self._ready
        return replace(ready, ready=ready.ready.at(k))

    @property
    def _ready(self) -> Any:
        return self.sampled(Clock.every(self.model.dt)) if self.ready is None else self

    def init(self, prior: Prior) -> Any:
        """The belief about x[0] and the unknown inputs, before y[0]."""
        ready = self._ready
        if ready.layout.method == "fang":
            return fang_steps.init(prior, ready.ready)
        x = belief.believe(prior, ready.ready.point.states, ready.ready.added)
        return _with_inputs(x, ready)

    def correct(self, state: Any, sample: Sample) -> tuple[Any, Info]:
        """Update the belief with one sample."""
        ready = self._ready
        layout, model = ready.layout, ready.ready
        if layout.method == "fang":
            return fang_steps.correct(state, model, layout, sample)
        measurement = _measurement(model, layout, sample)
        s, post = belief.correct(state, measurement, sample, independently=model.independent)
        decided, log_likelihood = {}, post.log_likelihood
        if ready.levels is not None:
            s, decided, gained = levels.weigh(
                s, ready.levels - pick(model.point.inputs, layout.unknown)[None, :], layout
            )
            log_likelihood = log_likelihood + gained
        innovation, innovation_covariance = post.innovation, post.innovation_covariance
        if layout.freedom == "none":
            innovation, innovation_covariance = post.error, jnp.where(jnp.eye(len(innovation)) > 0, post.variance, 0.0)
        info = ready.tell(s)
        return s, replace(
            info,
            innovation=innovation,
            innovation_covariance=innovation_covariance,
            log_likelihood=log_likelihood,
            outcome=outcome_code(post.contradicted, s.mean, s.factor, s.diffuse),
            extra=info.extra | decided,
        )

    def tell(self, state: Belief) -> Info:
        """Mean and covariance of the state and of the oldest input in a belief, in the user's units."""
        ready = self._ready
        layout, point, n = ready.layout, ready.ready.point, ready.layout.n
        at, extra, diffuse = slice(n, n + layout.d), {}, None
        if state.diffuse.shape[1]:
            diffuse = gram(state.diffuse[:n])
            extra["unknown_input_diffuse_covariance"] = gram(state.diffuse[at])
        return Info(
            mean=state.mean[:n] + point.states,
            covariance=gram(state.factor[:n]),
            unknown_input=state.mean[at] + pick(point.inputs, layout.unknown),
            unknown_input_covariance=gram(state.factor[at]),
            diffuse_covariance=diffuse,
            extra=extra,
        )

    def predict(self, state: Any, interval: Interval) -> Any:
        """Move to the next sample."""
        ready = self._ready
        layout, model = ready.layout, ready.ready
        if layout.method == "fang":
            return fang_steps.predict(state, model, layout, interval)
        transition, E = ready._transition(interval)
        if layout.freedom != "none":
            return belief.predict(state, transition, _grown(model.Ω, layout))
        finite = replace(state, diffuse=state.diffuse[:, :0])
        X, log_scale = E, state.log_scale
        if layout.leftover:
            X, log_scale = kernel.spread(state.diffuse, transition.F, E, state.log_scale)
        return replace(belief.predict(finite, transition, _grown(model.Ω, layout)), diffuse=X, log_scale=log_scale)

    def _transition(self, interval: Interval) -> tuple[Transition, Any]:
        """s+ = F s + c + E δ + W e', and E: δ is the new input, part of W where it is noise or a random walk."""
        layout, model = self.layout, self.ready
        n, d, older = layout.n, layout.d, layout.slots - 1
        B, B_end = pick(model.B, layout.unknown), pick(model.B_end, layout.unknown)
        F = kernel.transition(model.A, B if layout.now else None, layout.slots, d)
        E = kernel.entrance(B_end if layout.now else B, n, layout.slots, d)
        noise = _with_input_noise(model, layout, interval)
        W = jnp.concatenate([noise, jnp.zeros((d * layout.slots, noise.shape[1]))])
        if layout.freedom == "walk":
            F = F + jnp.concatenate([jnp.zeros((layout.size, n + d * older)), E], axis=1)
            W = jnp.concatenate([W, product(E, self.freedom) * jnp.sqrt(interval.dt)], axis=1)
        if layout.freedom == "variance":
            W = jnp.concatenate([W, product(E, self.freedom)], axis=1)
        c = jnp.concatenate([_drive(model, layout, interval), jnp.zeros(d * layout.slots)])
        return Transition(F, c, W), E

    @property
    def for_smoothing(self) -> Self:
        """The same filter with the input of each row reported in that row. Raises `InputError` where it cannot be smoothed."""
        if self.method == "fang" or self.levels is not None:
            which = 'method = "fang"' if self.method == "fang" else "levels"
            checks.refuse(
                f"smooth needs a linear Gaussian model throughout, and {which} is not linear Gaussian: leave it out."
            )
        again = replace(self, delay=0, layout=None)
        return again if self.model.is_continuous else replace(again, layout=lay_out(again, self.model))

    def instant(self, sample: Sample, interval: Interval) -> Instant:
        """This row of the model, for the smoother."""
        ready = self._ready
        layout, model = ready.layout, ready.ready
        transition, E = ready._transition(interval)
        return Instant(transition, _measurement(model, layout, sample), E if layout.freedom == "none" else None)


def _covariance(name: str, value: Numbers, faults: checks.Faults) -> Any:
    """A covariance (d, d) from a number, variances (d,) or itself."""
    if value is None or checks.is_traced(value):
        return value
    d = faults.sizes["d"]
    given = [value] * d if isinstance(value, int | float) else value
    if np.ndim(np.asarray(given, object)) == 2:
        return faults.covariance(name, given, "d d")
    variances = faults.array(name, given, "d")
    if variances is not None and np.any(variances < 0):
        faults.add(f"`{name}` must be variances, at least 0. Got {checks.short(value)}.")
    return None if variances is None else np.diag(variances)


def _with_inputs(x: Belief, ready: UnknownInput) -> Belief:
    """The belief about x and its unknown inputs: diffuse, their prior variance, or the start of a walk."""
    layout: Any = ready.layout
    n, d, slots = layout.n, layout.d, layout.slots
    size = d * slots
    r, diffuse = x.diffuse.shape[1], x.diffuse
    spread = jnp.zeros((size, size))
    if layout.freedom == "variance":
        spread = jnp.kron(jnp.eye(slots), ready.freedom)
    if layout.freedom == "walk":
        start = jnp.eye(d) if ready.variance is None else factors(ready.variance)
        column = jnp.concatenate([start] * slots)
        if ready.variance is None:
            diffuse = block_diagonal(diffuse, column)
        else:
            spread = jnp.concatenate([column, jnp.zeros((size, size - d))], axis=1)
    if layout.freedom == "none":
        core = jnp.concatenate([diffuse, jnp.zeros((n, n - r if layout.leftover else 0))], axis=1)
        diffuse = block_diagonal(core, jnp.eye(size))
    elif diffuse.shape[0] == n:
        diffuse = jnp.concatenate([diffuse, jnp.zeros((size, r))])
    nothing = jnp.zeros(size)
    return Belief(
        jnp.concatenate([x.mean, nothing]), block_diagonal(x.factor, spread), diffuse,
        jnp.concatenate([x.size, nothing]), x.log_scale,
    )  # fmt: skip


def _measurement(model: SampledModel, layout: Layout, sample: Sample) -> Measurement:
    """y = C s + d + V e, where an input that enters y at once is the newest, and d comes from the known inputs."""
    d, p = layout.d, model.C.shape[0]
    D = pick(model.D, layout.unknown) if layout.now else jnp.zeros((p, d))
    C = jnp.concatenate([model.C, jnp.zeros((p, d * (layout.slots - 1))), D], axis=1)
    known = model.point.outputs + apply(pick(model.D, layout.known), sample.u - pick(model.point.inputs, layout.known))
    return Measurement(C, known, noise_of(model.V, sample), _grown(model.Ω, layout), model.turn)


def _grown(Ω: Array | None, layout: Layout) -> Any:
    """Ω of s: the inputs are independent of the noise of the outputs."""
    return None if Ω is None else jnp.concatenate([Ω, jnp.zeros((layout.d * layout.slots, Ω.shape[1]))])


def _with_input_noise(model: SampledModel, layout: Layout, interval: Interval) -> Any:
    """The factor of the noise of the next state, with that of the known inputs."""
    known = replace(model, **{name: pick(getattr(model, name), layout.known) for name in ("B", "B_end", "wandering")})
    return with_input_noise(model.W, known, interval, jnp.ones((1, 1)))


def _drive(model: SampledModel, layout: Layout, interval: Interval) -> Any:
    """The part of the next state due to the known inputs."""
    c = apply(pick(model.B, layout.known), interval.u - pick(model.point.inputs, layout.known))
    if model.B_end is not None:
        c = c + apply(pick(model.B_end, layout.known), interval.u_end - pick(model.point.inputs, layout.known))
    return c
