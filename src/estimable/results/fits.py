# pyright: reportUnknownArgumentType=false
"""The results of identification: a model, its parameters with their errors, and the checked assumptions."""

from typing import Annotated, Any, NamedTuple

import numpy as np

from ..frozen import frozen, saved, static
from .steps import Outcome

FREE = 1e-6  # component along an undetermined direction, above which a parameter is not known


@saved
class Check(NamedTuple):
    """One checked assumption: whether it holds, the number that shows it, its limit, and a sentence that says what to do."""

    name: str
    passed: bool
    value: float
    limit: float
    sentence: str


@saved
class Validation(NamedTuple):
    """How well a fitted model explains the records it was fitted to.

    `residuals`: one (T, p) per record, NaN where not seen. `fit` (p,): per cent, 100 (1 - |y - model| / |y - mean|) over the seen
    samples. `checks`: the checked assumptions. `one_step_fit`, `one_step_residuals`: of predictions from the previous sample.
    """

    residuals: tuple[Any, ...]
    fit: Any
    checks: tuple[Check, ...] = ()
    one_step_fit: Any = None
    one_step_residuals: Any = None

    @property
    def passed(self) -> bool:
        """Whether every checked assumption holds."""
        return all(check.passed for check in self.checks)

    @property
    def sentences(self) -> tuple[str, ...]:
        """The sentences of the checks."""
        return tuple(check.sentence for check in self.checks)


@frozen
class Fit:
    """The result of `identify`: the `model`, its `parameters` (d,) with their `names`, and their `covariance` (d, d).

    `validation`: how well the model explains its records, None where that does not apply. `path` is the `Estimate` of a
    recursive method (row k: the parameters after sample k), `log_likelihood` that of the records under the model,
    `undetermined` (d, r) a basis of the directions without information (None: there are none), `extra` results of this method.
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
        """Standard deviations (d,); infinite for undetermined parameters, NaN where the method gives none."""
        variances = np.nan if self.covariance is None else np.diagonal(np.asarray(self.covariance))
        sigma = np.sqrt(np.broadcast_to(variances, np.shape(self.parameters)))
        if self.undetermined is None:
            return sigma
        return np.where(np.abs(self.undetermined).max(axis=1) > FREE, np.inf, sigma)

    def __repr__(self) -> str:
        values = zip(self.names, np.asarray(self.parameters), self.sigma, strict=True)
        return f"Fit({', '.join(f'{name} = {_with_spread(x, s)}' for name, x, s in values)})"


@frozen
class NoiseFit:
    """The result of `fit_noise`: the `algorithm` with its tuned noises, and the `parameters` (d,) with their `names`.

    `covariance` (d, d) is the inverse of the observed information, in the units of the parameters; `at_zero` names the
    variances that the likelihood drives to zero: their errors are one-sided and not in `covariance` (zero there).
    """

    algorithm: Any
    parameters: Annotated[Any, "d"]
    covariance: Annotated[Any, "d d", "symmetric"]
    log_likelihood: float
    names: Annotated[tuple[str, ...], "d"] = static()
    at_zero: tuple[str, ...] = static(default=())
    iterations: int = static(default=0)

    @property
    def model(self) -> Any:
        """The model inside the algorithm."""
        return self.algorithm.innermost.model

    @property
    def sigma(self) -> np.ndarray:
        """Standard deviations of the parameters, (d,)."""
        return np.sqrt(np.diagonal(self.covariance))

    def __repr__(self) -> str:
        values = zip(self.names, self.parameters, self.sigma, strict=True)
        shown = (
            f"{name} = 0, the likelihood's limit" if name in self.at_zero else f"{name} = {x:.4g} ± {s:.3g}"
            for name, x, s in values
        )  # fmt: skip
        return f"NoiseFit({', '.join(shown)})"


def _with_spread(value: float, sigma: float) -> str:
    """A number and its standard deviation; "not known" where that is infinite."""
    if np.isinf(sigma):
        return "not known"
    return f"{value:.4g}" + ("" if np.isnan(sigma) else f" ± {sigma:.3g}")
