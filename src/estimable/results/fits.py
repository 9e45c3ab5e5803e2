# pyright: reportUnknownArgumentType=false
"""The results of identification: a model, its parameters with their errors, and the checked assumptions."""

from typing import Annotated, Any, NamedTuple

import numpy as np

from ..frozen import frozen, saved, static
from .steps import Outcome

FREE = 1e-6  # component along an undetermined direction, above which a parameter is not known


@saved
class Check(NamedTuple):
    """One checked assumption of a fit.

    - `name`: the name of the assumption.
    - `passed`: whether it holds.
    - `value` and `limit`: the number that decides, and its limit.
    - `sentence`: the verdict, and what to do where the assumption does not hold.
    """

    name: str
    passed: bool
    value: float
    limit: float
    sentence: str


@saved
class Validation(NamedTuple):
    """How well a fitted model explains the records to which it was fitted.

    - `residuals`: an array (T, p) for each record, the outputs minus the outputs of the model, NaN where an output is
      missing.
    - `fit` (p,): for each output, the percentage 100 (1 - |y - model| / |y - mean|) over the seen samples: 100 for a perfect
      model, 0 for one no better than the mean.
    - `one_step_fit` and `one_step_residuals`: the same for predictions from the previous sample. They are None where a method
      has none.
    - `checks`: the checked assumptions.
    - `scores`: tests of single assumptions about the link and the plant (what the actuator does without an input, which samples
      are lost, a nonlinear plant). `value` is in standard deviations. The check "scores" reports the largest.
    """

    residuals: tuple[Any, ...]
    fit: Any
    checks: tuple[Check, ...] = ()
    one_step_fit: Any = None
    one_step_residuals: Any = None
    scores: tuple[Check, ...] = ()

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
    """The result of `identify`: a fitted model with its parameters and their uncertainty.

    - `model`: the fitted model.
    - `parameters` (d,) and `names` (d,): the estimated parameters and their names.
    - `covariance` (d, d): the covariance of the errors of the parameters. Fits by prediction or output errors take it from the
      spectrum of the residuals; `covariance_white` (d, d) is the usual one, which assumes white residuals. None: not computed.
    - `undetermined` (d, r): a basis of the directions of the parameters about which the records carry no information. None:
      there is no such direction.
    - `validation`: how well the model explains its records. None where that cannot be judged.
    - `path`: for a recursive method, an `Estimate` whose row k holds the parameters after sample k.
    - `log_likelihood`: the log-likelihood of the records under the model.
    - `outcome`: whether the run of a recursive method failed.
    - `method` and `engine`: the name of the method, and the engine that ran.
    - `rivals` (k, d): other parameters that fit the records equally well (outputs seen at every n-th row). None: none found.
    - `extra`: results that only this method has, by name.
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
    covariance_white: Annotated[Any, "d d", "symmetric"] = None
    rivals: Annotated[Any, "k d"] = None

    @property
    def sigma(self) -> np.ndarray:
        """The standard deviations of the parameters, (d,). They are infinite for undetermined parameters, and NaN where the
        method gives none.
        """
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
    """The result of `fit_noise`: an algorithm with fitted noise covariances.

    - `algorithm`: the given algorithm with the fitted covariances.
    - `parameters` (d,) and `names` (d,): the fitted variances and covariances, with their names.
    - `covariance` (d, d): the covariance of the errors of the parameters, the inverse of Fisher's information.
    - `at_zero`: the names of the variances for which the likelihood is largest at zero. Their errors are one-sided, so their
      entries in `covariance` are zero.
    - `log_likelihood`: the log-likelihood of the records with the fitted covariances.
    - `iterations`: the number of iterations of the search.
    - `converged`: whether the search reached the maximum. If it did not, the parameters are not the most likely ones, and their
      standard errors do not hold; `sentence` says so.
    """

    algorithm: Any
    parameters: Annotated[Any, "d"]
    covariance: Annotated[Any, "d d", "symmetric"]
    log_likelihood: float
    names: Annotated[tuple[str, ...], "d"] = static()
    at_zero: tuple[str, ...] = static(default=())
    iterations: int = static(default=0)
    converged: bool = static(default=True)

    @property
    def sentence(self) -> str:
        """What the search did not do; empty where it reached the maximum."""
        return "" if self.converged else not_converged(self.iterations)

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
        return f"NoiseFit({self.sentence}{', '.join(shown)})"


def not_converged(steps: int) -> str:
    """The sentence about a search that has not reached the maximum."""
    return (
        f"The search stopped after {steps} steps below the maximum of the likelihood: do not use the numbers or their "
        "standard errors. Start nearer, free fewer entries, or check that the model describes the record. "
    )


def _with_spread(value: float, sigma: float) -> str:
    """A number and its standard deviation; "not known" where that is infinite."""
    if np.isinf(sigma):
        return "not known"
    return f"{value:.4g}" + ("" if np.isnan(sigma) else f" ± {sigma:.3g}")
