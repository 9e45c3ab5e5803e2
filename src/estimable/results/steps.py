"""The arguments and results of a step, and the outcome of a run."""

from typing import Annotated, Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from ..annotations import Array
from ..frozen import frozen, saved


@frozen
class Sample:
    """One instant of a record, as an algorithm reads it.

    - `y` (p,): the outputs.
    - `seen` (p,): the mask of the outputs that were measured.
    - `u` (m,): the input at this instant, for models in which the input enters y directly.
    - `arrived` (m,): 1 where the input was applied, 0 where it was lost, NaN where that is unknown.
    - `sigma` (p,): the standard deviation of the noise of each output of this sample, NaN where it is that of the model. None: it
      always is.
    - `extra`: further data by name, which a function such as `estimate` passes to an algorithm that can use them.
    """

    y: Annotated[Any, "p"]
    seen: Annotated[Any, "p"]
    u: Annotated[Any, "m"]
    arrived: Annotated[Any, "m"] = None
    extra: Any = None
    sigma: Annotated[Any, "p"] = None


@frozen
class Interval:
    """The time from one sample to the next, as an algorithm reads it.

    - `u` (m,) and `u_end` (m,): the input at the start and at the end of the interval.
    - `arrived` (m,): 1 where the input was applied, 0 where it was lost, NaN where that is unknown.
    - `dt`: the length of the interval in seconds.
    - `u_covariance` (m, m): the covariance of an input error that is constant over the interval. None: no such error.
    - `u_diffusion` (m,): the variance per second of an input error that is a Brownian motion. The error is zero at the start
      of the interval; where the input moves linearly between samples, it is zero at the end as well. None: no such error.
    - `restart`: whether the state at the end does not follow from that at the start. None: it always does.
    """

    u: Annotated[Any, "m"]
    u_end: Annotated[Any, "m"]
    arrived: Annotated[Any, "m"] = None
    dt: Annotated[Any, ""] = None
    u_covariance: Annotated[Any, "m m", "symmetric"] = None
    u_diffusion: Annotated[Any, "m"] = None
    restart: Annotated[Any, ""] = None


@frozen
class Info:
    """The report of an algorithm after sample k. A field that does not apply is None. All values are in the units of the
    user.

    - `mean` (n,) and `covariance` (n, n): the estimated state and the covariance of its error, given y[0..k].
    - `diffuse_covariance` (n, n): its columns span the directions of the state that the samples have not yet determined.
    - `innovation` (p,) and `innovation_covariance` (p, p): the outputs minus their predictions, NaN for a missing output.
    - `log_likelihood`: the log-likelihood of this sample, given the earlier ones.
    - `gain` (g,) and `gain_covariance` (g, g): the estimated gains.
    - `gain_quantiles` (g, 5): the quantiles .025, .16, .5, .84 and .975 of gains whose distribution is not Gaussian.
    - `jump_probability`: the probability that a gain has jumped and the jump has not been detected.
    - `unknown_input` (d,) and `unknown_input_covariance` (d, d): the estimated unmeasured inputs.
    - `outcome`: 0, or a failure code of `OUTCOMES`.
    - `extra`: results that only this algorithm has, by name.
    """

    mean: Annotated[Any, "n"] = None
    covariance: Annotated[Any, "n n", "symmetric"] = None
    innovation: Annotated[Any, "p"] = None
    innovation_covariance: Annotated[Any, "p p", "symmetric"] = None
    log_likelihood: Annotated[Any, ""] = None
    gain: Annotated[Any, "g"] = None
    gain_covariance: Annotated[Any, "g g", "symmetric"] = None
    unknown_input: Annotated[Any, "d"] = None
    unknown_input_covariance: Annotated[Any, "d d", "symmetric"] = None
    diffuse_covariance: Annotated[Any, "n n", "symmetric"] = None
    gain_quantiles: Annotated[Any, "g 5"] = None
    jump_probability: Any = None
    outcome: Annotated[Any, ""] = None
    extra: Any = None


@saved
class Outputs(NamedTuple):
    """Outputs of a result: `mean` (T, p), and their `covariance` (T, p, p); None where the result has none."""

    mean: Annotated[Any, "T p"]
    covariance: Annotated[Any, "T p p", "symmetric"]


OUTCOMES = {
    0: "",
    1: "the estimate is no longer finite: the model may be unstable and unobserved, or numbers overflowed",
    2: "an output contradicts a value that is known exactly, or one so large that the output is lost in its rounding: give the "
    "output or the state some noise; if the model is unstable, its state has diverged",
    3: "the seen outputs do not determine the unknown input, which Fang's Algorithm 1 needs at every sample: use "
    'method="auto", which waits for outputs that determine it',
    4: "the estimate is no longer finite: f or h is not defined at the estimate, the integrator of a continuous model did not "
    "reach the next sample, or truncated moments are no longer a covariance",
    5: "the iterations of smooth have not converged: the last one moved the states of this sample by more than 1e-10 of their "
    "standard deviations. Give more `iterations`, or check that the outputs determine the states",
}


def outcome_code(contradicted: Array | bool, mean: Array, *factors: Array):
    """The outcome code of one step, from `mean` (n,), square roots `factors` (n, k) of covariances, and `contradicted`.

    The code is 1 where the mean or a covariance is not finite. It is 2 where `contradicted` is True: an output contradicts a
    value that is known exactly. Otherwise it is 0.
    """
    finite = jnp.isfinite(jnp.sum(mean) + sum(jnp.sum(factor * factor) for factor in factors))
    return jnp.where(finite, jnp.where(contradicted, 2, 0), 1)


@saved
class Outcome(NamedTuple):
    """The outcome of a run.

    - `code`: 0 for a run without a failure, otherwise the code of the first failure (a key of `OUTCOMES`).
    - `sample` and `time`: the sample and the time in seconds at which the run failed; None without a failure.
    - `sentence`: an explanation of the failure, empty without one.
    """

    code: int
    sample: int | None
    time: float | None
    sentence: str

    @staticmethod
    def of(code: int, sample: int, t: np.ndarray | None) -> "Outcome":
        """The outcome of a run that first failed at `sample` with `code`; `t` (T,) are the times of the samples."""
        if code == 0:
            return Outcome(0, None, None, "")
        time = None if t is None else float(t[sample])
        when = f"sample {sample}" + ("" if time is None else f" (t = {time:g} s)")
        return Outcome(code, sample, time, f"At {when}: {OUTCOMES[code]}.")


@saved
class Names(NamedTuple):
    """The names of the columns of a result.

    - `states`, `inputs`, `outputs`, `gains`, `unknown_inputs`: the names of each kind of column.
    - `units`: pairs of a channel and its unit, for the channels with a given unit.
    - `input_delay`: the number of samples after which an unknown input is reported. Row k of the result holds the unknown
      input of row k - `input_delay`.
    - `note`: the samples that a row uses, where this is not obvious.
    - `angles`: (name, lower end of the range, period) of each state and output which is an angle.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    gains: tuple[str, ...] = ()
    units: tuple[tuple[str, str], ...] = ()
    unknown_inputs: tuple[str, ...] = ()
    input_delay: int = 0
    note: str = ""
    angles: tuple[tuple[str, float, float], ...] = ()

    def labelled(self, channel: str) -> str:
        """The channel with its unit, as an axis label."""
        unit = dict(self.units).get(channel)
        return channel if unit is None else f"{channel} [{unit}]"


@saved
class Gap(NamedTuple):
    """A gap of a record in which an input was not recorded, or before whose end nothing connects, and what was done there.

    - `row` and `end`: the last row before it, and the first after it.
    - `start` and `seconds`: its time and its length.
    - `done`: "bridge" or "break".
    - `why`: the reason, empty where it was asked for.
    """

    row: int
    end: int
    start: float
    seconds: float
    done: str
    why: str = ""

    @property
    def sentence(self) -> str:
        """What was done where, as a sentence."""
        because = f": {self.why}" if self.why else ""
        done = "bridged" if self.done == "bridge" else "the state restarts after it"
        return f"rows {self.row} to {self.end}, {self.seconds:.3g} s from t = {self.start:g} s: {done}{because}"
