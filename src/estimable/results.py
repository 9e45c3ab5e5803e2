"""The records that a step takes and gives, and those that the drivers return."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from .frozen import frozen, static


@frozen
class Sample:
    """One instant of a record: outputs y (p,), the mask of what was seen, the input u (m,) and what of it arrived."""

    y: Any
    seen: Any
    u: Any
    arrived: Any = None


@frozen
class Interval:
    """From one sample to the next: the input at both ends, what of it arrived, and the length in seconds."""

    u: Any
    u_end: Any
    arrived: Any = None
    dt: Any = None


@frozen
class Info:
    """What an algorithm says after one sample, in the user's units; None where it does not apply.

    `mean` (n,) and `covariance` (n, n) use y[0..k]; `diffuse_covariance` (n, n) spans what nothing is known of yet.
    `innovation` (p,) is NaN where not seen; `outcome` is a code of `OUTCOMES`.
    """

    mean: Any = None
    covariance: Any = None
    innovation: Any = None
    innovation_covariance: Any = None
    log_likelihood: Any = None
    gain: Any = None
    gain_covariance: Any = None
    unknown_input: Any = None
    unknown_input_covariance: Any = None
    diffuse_covariance: Any = None
    outcome: Any = None
    extra: Any = None


OUTCOMES = {
    0: "",
    1: "the estimate is not finite any more: the model may be unstable and unobserved, or numbers overflowed",
    2: "an output contradicts a value that is known exactly, or too large to leave the output a digit: give the output or the "
    "state some noise; if the model is unstable, its numbers have run away",
    3: "the outputs that were seen do not tell the unknown input, which Fang's Algorithm 1 needs at every sample: use "
    'method="auto", which waits for the outputs that tell it',
    4: "the estimate is not finite any more: f or h is not defined where it went, the integrator of a continuous model did not "
    "reach the next sample, or truncated moments stopped being a covariance",
}


def outcome_code(contradicted, mean, *factors):
    """The code of a step: 1 where the mean (n,) or the square of a factor (n, k) is not finite, else 2 where a datum was
    contradicted."""
    finite = jnp.isfinite(jnp.sum(mean) + sum(jnp.sum(factor * factor) for factor in factors))
    return jnp.where(finite, jnp.where(contradicted, 2, 0), 1)


class Outcome(NamedTuple):
    """How a run ended: the first code that is not 0, its sample and time, and the sentence that says what happened."""

    code: int
    sample: int | None
    time: float | None
    sentence: str

    @staticmethod
    def of(code: int, sample: int, t: np.ndarray | None) -> "Outcome":
        """The outcome of a run whose first failing sample is given."""
        if code == 0:
            return Outcome(0, None, None, "")
        time = None if t is None else float(t[sample])
        when = f"sample {sample}" + ("" if time is None else f" (t = {time:g} s)")
        return Outcome(code, sample, time, f"At {when}: {OUTCOMES[code]}.")


class Names(NamedTuple):
    """What the columns of a result are called, and the units of the channels that have one.

    Row k of an unknown input is that of row k - `input_delay`; `note` says which samples a row uses, where it must be said.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    gains: tuple[str, ...] = ()
    units: tuple[tuple[str, str], ...] = ()
    unknown_inputs: tuple[str, ...] = ()
    input_delay: int = 0
    note: str = ""

    def labelled(self, channel: str) -> str:
        """The channel with its unit, as on an axis."""
        unit = dict(self.units).get(channel)
        return channel if unit is None else f"{channel} [{unit}]"


class Kept:
    """The arrays of an `Info`, read by name."""

    info: Info

    @property
    def mean(self):
        """Estimated states, (T, n)."""
        return self.info.mean

    @property
    def covariance(self):
        """Their covariances, (T, n, n)."""
        return self.info.covariance

    @property
    def gain(self):
        """Estimated gains, (T, p)."""
        return self.info.gain

    @property
    def gain_covariance(self):
        """Their covariances, (T, p, p)."""
        return self.info.gain_covariance

    @property
    def unknown_input(self):
        """Estimated inputs that nobody measured, (T, d); row k is of the input at row k - `names.input_delay`."""
        return self.info.unknown_input

    @property
    def unknown_input_covariance(self):
        """Their covariances, (T, d, d)."""
        return self.info.unknown_input_covariance

    @property
    def innovation(self):
        """Outputs minus their predictions, (T, p); NaN where not seen."""
        return self.info.innovation

    @property
    def innovation_covariance(self):
        """Covariances of the innovations, (T, p, p), of outputs not seen too."""
        return self.info.innovation_covariance

    @property
    def diffuse_covariance(self):
        """What nothing is known of, (T, n, n): the factor of an infinite variance; None for a proper prior."""
        return self.info.diffuse_covariance

    @property
    def log_likelihood_steps(self):
        """Log-likelihood of each sample given those before it, (T,)."""
        return self.info.log_likelihood

    @property
    def extra(self):
        """What this algorithm alone says, by name."""
        return self.info.extra or {}


class Shown(Kept):
    """A result of one run: printed, as a table, as a figure."""

    log_likelihood: float
    outcome: Outcome
    engine: str
    names: Names

    def __repr__(self) -> str:
        parts = [f"log-likelihood {self.log_likelihood:.6g}", f"engine {self.engine}"]
        for names, values, covariance in (
            (self.names.states, self.mean, self.covariance),
            (self.names.gains, self.gain, self.gain_covariance),
            (self.names.unknown_inputs, self.unknown_input, self.unknown_input_covariance),
        ):
            if values is not None and covariance is not None:
                sigmas = np.sqrt(np.diagonal(covariance[-1]))
                parts += [f"{n} = {x:.4g} ± {s:.3g}" for n, x, s in zip(names, values[-1], sigmas, strict=True)]
        if self.outcome.code:
            parts.append(self.outcome.sentence)
        return f"{type(self).__name__}({', '.join(parts)})"

    def to_pandas(self):
        """A DataFrame, one row a sample, indexed by time: each state, gain and innovation with its standard deviation."""
        from .tables import to_pandas

        return to_pandas(self)

    def to_xarray(self):
        """An xarray Dataset with named dimensions and the full covariances. Needs the extra `xarray`."""
        from .tables import to_xarray

        return to_xarray(self)

    def plot(self):
        """A plotly figure: states and gains with their 2 sigma bands, and innovations with their bounds."""
        from .figures.estimates import plot_estimate

        return plot_estimate(self)


@frozen
class Origin:
    """What an estimate was made of."""

    algorithm: Any
    record: Any
    prior: Any


@frozen
class Estimate(Shown):
    """What `estimate` returns: row k of every array uses the samples 0..k. What does not apply, or was not kept, is None.

    `t` (T,) in seconds (None for a record without time), `log_likelihood` with the 2 pi constant, `outcome`, `engine`
    (which one ran), `names` of the columns; with `keep="last"` the arrays have one row, the last. `origin`: the
    algorithm, record and prior that it was made of.
    """

    info: Info
    t: Any
    log_likelihood: float
    outcome: Outcome = static()
    engine: str = static()
    names: Names = static()
    origin: Any = None
    __repr__ = Shown.__repr__


@frozen
class SmoothedEstimate(Shown):
    """What `smooth` returns: row k uses the samples 0..`used[k]`, and there are no innovations: nothing was predicted.

    Otherwise as `Estimate`; `log_likelihood` is that of the record, and `diffuse_covariance` spans what it leaves unknown.
    """

    info: Info
    t: Any
    log_likelihood: float
    used: Any
    outcome: Outcome = static()
    engine: str = static()
    names: Names = static()
    __repr__ = Shown.__repr__


@frozen
class Forecast(Kept):
    """What `forecast` returns: row i is the i-th sample after the record. `output` (steps, p), its covariance with the noise
    of the measurement; states and gains as in `Estimate`."""

    info: Info
    t: Any
    output: Any
    output_covariance: Any
    names: Names = static()

    def __repr__(self) -> str:
        return f"Forecast({len(self.output)} samples of {', '.join(self.names.outputs)})"


@frozen
class EstimateBank(Kept):
    """What `estimate_bank` returns: the arrays of `Estimate` with a leading batch axis; `bank[i]` is one `Estimate`."""

    info: Info
    t: Any
    log_likelihood: Any
    outcomes: tuple[Outcome, ...] = static()
    engine: str = static()
    names: Names = static()

    def __repr__(self) -> str:
        failed = sum(outcome.code != 0 for outcome in self.outcomes)
        return f"EstimateBank({len(self)} runs, {failed} failed, engine {self.engine})"

    def __len__(self) -> int:
        return len(self.outcomes)

    def __getitem__(self, i: int) -> Estimate:
        import jax

        one = jax.tree_util.tree_map(lambda leaf: leaf[i], self.info)
        t = self.t if self.t is None or np.ndim(self.t) == 1 else self.t[i]
        return Estimate(one, t, float(self.log_likelihood[i]), self.outcomes[i], self.engine, self.names)


@frozen
class Simulation:
    """What `simulate` returns: the `record` that arrives, and what is behind it.

    The true `state` (T, n); `applied` (T, m), what the actuator did; `measured` (T, p), what the sensors gave before the
    network; `input_delay` and `output_delay` (T, c): of each packet, in steps, infinite where it was lost (None: no link).
    `Trace(delay)` is a link that does the same again.
    """

    record: Any
    state: Any
    applied: Any = None
    measured: Any = None
    input_delay: Any = None
    output_delay: Any = None


class Check(NamedTuple):
    """One assumption looked at: whether it holds, the number that shows it, its limit, and what to do, in words."""

    name: str
    passed: bool
    value: float
    limit: float
    sentence: str


class Excitation(NamedTuple):
    """How much a record tells of each direction of the parameters.

    `information` (d, d) of θ, block by output; `eigenvalues` (K,): the smallest of the information gathered up to the rows
    `samples` (K,), scaled so that its diagonal at the end is 1; `directions` (d, r): an orthonormal basis of what is not
    told of; `check`: the verdict.
    """

    information: Any
    samples: Any
    eigenvalues: Any
    directions: Any
    check: Check

    def plot(self):
        """A plotly figure: the smallest eigenvalue over time, which must stay away from zero."""
        from .figures.identification import plot_excitation

        return plot_excitation(self)


class Validation(NamedTuple):
    """How a fitted model stands to the records it was fitted to.

    `residuals`: one (T, p) a record, NaN where not seen. `fit` (p,): per cent, 100 (1 - |y - model| / |y - mean|) over what
    was seen. `checks`: the assumptions looked at. `one_step_fit`, `one_step_residuals`: of predictions from the sample before.
    """

    residuals: tuple[Any, ...]
    fit: Any
    checks: tuple[Check, ...] = ()
    one_step_fit: Any = None
    one_step_residuals: Any = None

    @property
    def passed(self) -> bool:
        """Whether every assumption that was looked at holds."""
        return all(check.passed for check in self.checks)

    @property
    def sentences(self) -> tuple[str, ...]:
        """What was found, in words."""
        return tuple(check.sentence for check in self.checks)


@frozen
class Fit:
    """What `identify` returns: the `model`, its `parameters` (d,) called `names`, and their `covariance` (d, d).

    `validation` is how the model stands to its records, None where that does not apply. `path` is the `Estimate` of a
    recursive method (row k: the parameters after sample k), `log_likelihood` that of the records under the model,
    `undetermined` (d, r) a basis of what the records tell nothing of (None: something of all), `extra` what this method says.
    """

    model: Any
    parameters: Any
    covariance: Any
    names: tuple[str, ...] = static()
    validation: Any = None
    path: Any = None
    log_likelihood: Any = None
    undetermined: Any = None
    outcome: Outcome = static(default=Outcome(0, None, None, ""))
    method: str = static(default="")
    engine: str = static(default="")
    extra: Any = None

    @property
    def sigma(self) -> np.ndarray:
        """Standard deviations of the parameters, (d,); NaN where the method tells none."""
        variances = np.nan if self.covariance is None else np.diagonal(np.asarray(self.covariance))
        return np.sqrt(np.broadcast_to(variances, np.shape(self.parameters)))

    def __repr__(self) -> str:
        values = zip(self.names, np.asarray(self.parameters), self.sigma, strict=True)
        return f"Fit({', '.join(f'{name} = {x:.4g}' + (f' ± {s:.3g}' if s == s else '') for name, x, s in values)})"
