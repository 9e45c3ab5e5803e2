"""What simulations and identifiers return."""

from typing import Annotated, Any, NamedTuple

import numpy as np

from ..frozen import frozen, saved, static
from .steps import Outcome

FREE = 1e-6  # component along a direction that the records do not tell of, from which a parameter is not known


@frozen
class Simulation:
    """What `simulate` returns: the `record` that arrives, and what is behind it.

    The true `state` (T, n); `applied` (T, m), what the actuator did; `measured` (T, p), what the sensors gave before the
    network; `input_delay` and `output_delay` (T, c): of each packet, in steps, infinite where it was lost (None: no link).
    `Trace(delay)` is a link that does the same again.
    """

    record: Any
    state: Annotated[Any, "T n"]
    applied: Annotated[Any, "T m"] = None
    measured: Annotated[Any, "T p"] = None
    input_delay: Annotated[Any, "T m"] = None
    output_delay: Annotated[Any, "T p"] = None


@saved
class Check(NamedTuple):
    """One assumption looked at: whether it holds, the number that shows it, its limit, and what to do, in words."""

    name: str
    passed: bool
    value: float
    limit: float
    sentence: str


@saved
class Excitation(NamedTuple):
    """How much a record tells of each direction of the parameters.

    `information` (d, d) of θ, block by output; `eigenvalues` (K,): the smallest of the information gathered up to the rows
    `samples` (K,), scaled so that its diagonal at the end is 1; `directions` (d, r): an orthonormal basis of what is not
    told of; `check`: the verdict.
    """

    information: Annotated[Any, "d d", "symmetric"]
    samples: Annotated[Any, "K"]
    eigenvalues: Annotated[Any, "K"]
    directions: Annotated[Any, "d r"]
    check: Check

    def plot(self):
        """A plotly figure: the smallest eigenvalue over time, which must stay away from zero."""
        from ..figures.identification_plots import plot_excitation

        return plot_excitation(self)


@saved
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
    parameters: Annotated[Any, "d"]
    covariance: Annotated[Any, "d d", "symmetric"]
    names: Annotated[tuple[str, ...], "d"] = static()
    validation: Any = None
    path: Any = None
    log_likelihood: Any = None
    undetermined: Annotated[Any, "d r"] = None
    outcome: Outcome = static(default=Outcome(0, None, None, ""))
    method: str = static(default="")
    engine: str = static(default="")
    extra: Any = None

    @property
    def sigma(self) -> np.ndarray:
        """Standard deviations (d,); infinite of parameters that the records do not fix, NaN where the method tells none."""
        variances = np.nan if self.covariance is None else np.diagonal(np.asarray(self.covariance))
        sigma = np.sqrt(np.broadcast_to(variances, np.shape(self.parameters)))
        if self.undetermined is None:
            return sigma
        return np.where(np.abs(self.undetermined).max(axis=1) > FREE, np.inf, sigma)

    def __repr__(self) -> str:
        values = zip(self.names, np.asarray(self.parameters), self.sigma, strict=True)
        return f"Fit({', '.join(f'{name} = {_with_spread(x, s)}' for name, x, s in values)})"


def _with_spread(value: float, sigma: float) -> str:
    """A number and its standard deviation; "not known" where that is infinite."""
    if np.isinf(sigma):
        return "not known"
    return f"{value:.4g}" + ("" if np.isnan(sigma) else f" ± {sigma:.3g}")
