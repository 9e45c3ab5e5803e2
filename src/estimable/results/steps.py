"""The arguments and results of a step, and the outcome of a run."""

from typing import Annotated, Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from ..annotations import Array
from ..frozen import frozen, saved


@frozen
class Sample:
    """One instant of a record: outputs y (p,), the mask `seen` (p,), and the input u (m,), where it enters y directly.

    `arrived` (m,): 1 where the input was applied, 0 where it was lost, NaN where that is unknown. `extra`: data that a driver
    passes to its own algorithm, by name.
    """

    y: Annotated[Any, "p"]
    seen: Annotated[Any, "p"]
    u: Annotated[Any, "m"]
    arrived: Annotated[Any, "m"] = None
    extra: Any = None


@frozen
class Interval:
    """From one sample to the next: the input at both ends, whether it arrived, and the length in seconds.

    Errors of the input: `u_covariance` (m, m), of an error that is constant over the interval; `u_diffusion` (m,), variance per
    second of a Brownian motion that is zero at the sample, and also at the next one where the input moves linearly between
    them. None: the input is known.
    """

    u: Annotated[Any, "m"]
    u_end: Annotated[Any, "m"]
    arrived: Annotated[Any, "m"] = None
    dt: Annotated[Any, ""] = None
    u_covariance: Annotated[Any, "m m", "symmetric"] = None
    u_diffusion: Annotated[Any, "m"] = None


@frozen
class Info:
    """The report of an algorithm after one sample, in the user's units; a field that does not apply is None.

    `mean` (n,) and `covariance` (n, n) use y[0..k]; `diffuse_covariance` (n, n) spans the directions still undetermined.
    `innovation` (p,) is NaN where not seen; `outcome` is a code of `OUTCOMES`. `gain_quantiles` (g, 5) at .025, .16, .5, .84
    and .975, and `jump_probability`, that a gain has jumped undetected, for algorithms whose gains are not Gaussian. `extra`:
    results specific to this algorithm, by name.
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


OUTCOMES = {
    0: "",
    1: "the estimate is no longer finite: the model may be unstable and unobserved, or numbers overflowed",
    2: "an output contradicts a value that is known exactly, or one so large that the output is lost in its rounding: give the "
    "output or the state some noise; if the model is unstable, its state has diverged",
    3: "the seen outputs do not determine the unknown input, which Fang's Algorithm 1 needs at every sample: use "
    'method="auto", which waits for outputs that determine it',
    4: "the estimate is no longer finite: f or h is not defined at the estimate, the integrator of a continuous model did not "
    "reach the next sample, or truncated moments are no longer a covariance",
}


def outcome_code(contradicted: Array | bool, mean: Array, *factors: Array):
    """The code of a step: 1 where the mean (n,) or the square of a factor (n, k) is not finite, else 2 where a datum was
    contradicted."""
    finite = jnp.isfinite(jnp.sum(mean) + sum(jnp.sum(factor * factor) for factor in factors))
    return jnp.where(finite, jnp.where(contradicted, 2, 0), 1)


@saved
class Outcome(NamedTuple):
    """The outcome of a run: the first nonzero code, its sample and time, and a sentence that explains it."""

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


@saved
class Names(NamedTuple):
    """The names of the columns of a result, and the units of its channels, where given.

    Row k of a result holds the unknown input of row k - `input_delay`. `note` says which samples a row uses, where that is not
    obvious.
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
        """The channel with its unit, as an axis label."""
        unit = dict(self.units).get(channel)
        return channel if unit is None else f"{channel} [{unit}]"
