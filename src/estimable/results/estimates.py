# pyright: reportUnknownArgumentType=false, reportUnknownLambdaType=false, reportUnknownVariableType=false
"""The results of the estimating drivers."""

from functools import cached_property
from typing import Annotated, Any, NamedTuple

import numpy as np

from .. import checks
from ..frozen import frozen, saved, static
from .steps import Gap, Info, Names, Outcome, Outputs

WIDTH = 2 * 1.959963984540054  # standard deviations in the 95 % interval of a Gaussian


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
    def gain_quantiles(self):
        """The quantiles .025, .16, .5, .84 and .975 of the gains, (T, p, 5); None where they are Gaussian."""
        return self.info.gain_quantiles

    @property
    def jump_probability(self):
        """The probability of a jump of a gain that has raised no alarm, (T,); None without a detector."""
        return self.info.jump_probability

    @property
    def gain_standing(self) -> tuple[np.ndarray, np.ndarray]:
        """The gains as they are printed: the median, and the width of the 95 % interval over 3.92, (T, p) each.

        For a Gaussian these are the mean and the standard deviation. Both are NaN for an undetermined gain.
        """
        from ..tables import standard_deviation

        if self.gain_quantiles is not None:
            quantiles = np.asarray(self.gain_quantiles)
            return quantiles[..., 2], (quantiles[..., 4] - quantiles[..., 0]) / WIDTH
        sigma = standard_deviation(self.gain_covariance, self.extra.get("gain_diffuse_covariance"))
        known = np.isfinite(sigma)
        return np.where(known, self.gain, np.nan), np.where(known, sigma, np.nan)

    @property
    def unknown_input(self):
        """Estimates of unmeasured inputs, (T, d); row k is the input at row k - `names.input_delay`."""
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
        """Covariances of the innovations, (T, p, p), also of missing outputs."""
        return self.info.innovation_covariance

    @property
    def diffuse_covariance(self):
        """The diffuse directions, (T, n, n): the factor of an infinite variance; None for a proper prior."""
        return self.info.diffuse_covariance

    @property
    def log_likelihood_steps(self):
        """Log-likelihood of each sample given those before it, (T,)."""
        return self.info.log_likelihood

    @property
    def extra(self) -> Any:
        """Results specific to this algorithm, by name."""
        return self.info.extra or {}


class Shown(Kept):
    """A result of one run, with its printed form, table and figure; `kind` names its outputs in a table."""

    kind = "filtered"
    log_likelihood: float
    outcome: Outcome
    engine: str
    names: Names
    origin: Any

    def __repr__(self) -> str:
        parts = [f"log-likelihood {self.log_likelihood:.6g}", f"engine {self.engine}"]
        for names, values, covariance in (
            (self.names.states, self.mean, self.covariance),
            (self.names.gains, self.gain, self.gain_covariance),
            (self.names.unknown_inputs, self.unknown_input, self.unknown_input_covariance),
        ):
            if values is not None and covariance is not None:
                last, sigmas = values[-1], np.sqrt(np.diagonal(covariance[-1]))
                if values is self.gain and self.gain_quantiles is not None:
                    last, sigmas = (of_all[-1] for of_all in self.gain_standing)
                parts += [f"{n} = {x:.4g} ± {s:.3g}" for n, x, s in zip(names, last, sigmas, strict=True)]
        if self.outcome.code:
            parts.append(self.outcome.sentence)
        return f"{type(self).__name__}({', '.join(parts)})"

    def outputs(self, *, predictive: bool = False) -> Outputs:
        """The outputs that the estimated states imply, C x + D u, in every row, also of outputs that were not seen.

        Their covariance is that of the estimate; `predictive=True` adds the noise of the sensors. It is NaN where the prior is
        diffuse and the outputs have not yet determined the state.
        """
        checks.require(predictive=(predictive, bool))
        return self._predictive if predictive else self._outputs

    @cached_property
    def _outputs(self) -> Outputs:
        from ..estimation.outputs import outputs_of

        return outputs_of(self, False)

    @cached_property
    def _predictive(self) -> Outputs:
        from ..estimation.outputs import outputs_of

        return outputs_of(self, True)

    @property
    def output(self):
        """The outputs that the estimated states imply, C x + D u, (T, p), also where an output was not seen."""
        return self._outputs.mean

    @property
    def output_covariance(self):
        """Their covariances, (T, p, p), without the noise of the sensors."""
        return self._outputs.covariance

    def to_pandas(self, *, predictive: bool = False):
        """A DataFrame, one row per sample, indexed by time: each state, gain, innovation and output with its standard deviation.

        An output has the columns NAME_filtered and NAME_filtered_sigma (NAME_smoothed of a smoother); `predictive` as in
        `outputs`.
        """
        from ..tables import to_pandas

        return to_pandas(self, self.outputs(predictive=predictive))

    def to_xarray(self, *, predictive: bool = False):
        """An xarray Dataset with named dimensions and the full covariances. Needs the extra `xarray`."""
        from ..tables import to_xarray

        return to_xarray(self, self.outputs(predictive=predictive))

    def plot(self):
        """A plotly figure: states and gains with their 2 sigma bands, and innovations with their bounds."""
        from ..figures.estimate_plots import plot_estimate

        return plot_estimate(self)


@frozen
class Origin:
    """The arguments from which an estimate was made: the algorithm, the record and the prior."""

    algorithm: Any
    record: Any
    prior: Any


@frozen
class Estimate(Shown):
    """The result of `estimate`: T rows, one for each sample of the record.

    Row k of each array uses the samples 0 to k. The arrays are the properties `mean`, `covariance`, `gain`, `innovation` and
    others. An array is None where the algorithm does not estimate it, or where `keep` did not select it. With `keep="last"`
    the arrays have one row: the last.

    - `t` (T,): the times of the samples in seconds. It is None for a record without time.
    - `log_likelihood`: the log-likelihood of the whole record, with its constant (the term in 2 pi).
    - `outcome`: whether the run failed, at which sample, and why.
    - `engine`: the engine that ran, "native" or "xla".
    - `names`: the names of the columns of each array.
    - `origin`: the algorithm, the record and the prior of the run.
    - `gaps`: what was done in each gap of the record, a `Gap` for each.
    - `info`: the record that holds the arrays.

    `output` (T, p) and `output_covariance` (T, p, p) are the outputs that the estimated states imply (`outputs`).
    """

    info: Annotated[Info, "T"]
    t: Annotated[Any, "T"]
    log_likelihood: float
    outcome: Outcome = static()
    engine: str = static()
    names: Names = static()
    origin: Any = None
    gaps: tuple[Gap, ...] = static(default=())
    __repr__ = Shown.__repr__


@frozen
class SmoothedEstimate(Shown):
    """The result of `smooth`: T rows, one for each sample of the record.

    Row k of each array uses the samples 0 to `used[k]`, hence also later samples than k. The arrays and the other fields are
    those of `Estimate`, with three differences:

    - The arrays of innovations are None, because a smoother does not predict outputs.
    - `log_likelihood` is that of the record, as in `estimate`.
    - `diffuse_covariance` spans the directions of the state that the used samples do not determine.
    """

    info: Annotated[Info, "T"]
    t: Annotated[Any, "T"]
    log_likelihood: float
    used: Annotated[Any, "T"]
    outcome: Outcome = static()
    engine: str = static()
    names: Names = static()
    origin: Any = None
    gaps: tuple[Gap, ...] = static(default=())
    kind = "smoothed"
    __repr__ = Shown.__repr__


@saved
class BatchGain(NamedTuple):
    """The result of `batch_gain`: the state x[0] and the gains, given the whole record.

    - `mean` (n,) and `covariance` (n, n): of x[0].
    - `gain` (g,) and `gain_covariance` (g, g): of the gains.
    - `noise_covariance` (T p, T p): the covariance of the errors of all outputs, row by row.
    - `names`: the names of the columns.
    """

    mean: Annotated[Any, "n"]
    covariance: Annotated[Any, "n n", "symmetric"]
    gain: Annotated[Any, "g"]
    gain_covariance: Annotated[Any, "g g", "symmetric"]
    noise_covariance: Annotated[Any, "N N", "symmetric"]
    names: Names


@frozen
class Forecast(Kept):
    """The result of `forecast`: the predicted rows after the end of a record. Row i is the i-th sample after the record.

    - `mean`, `covariance`, `gain`: the predicted states and gains with their covariances, as in `Estimate`.
    - `output` (steps, p): the predicted outputs.
    - `output_covariance` (steps, p, p): the covariance of a future measurement about its prediction. It includes the
      measurement noise.
    - `t` (steps,): the times of the rows in seconds.
    - `names`: the names of the columns.
    """

    info: Annotated[Info, "T"]
    t: Annotated[Any, "T"]
    output: Annotated[Any, "T p"]
    output_covariance: Annotated[Any, "T p p", "symmetric"]
    names: Names = static()

    def __repr__(self) -> str:
        return f"Forecast({len(self.output)} samples of {', '.join(self.names.outputs)})"


@frozen
class EstimateBank(Kept):
    """The result of `estimate_bank` and `smooth_bank`: B runs of an estimator.

    The arrays are those of `Estimate` with a leading axis of length B, one entry for each run. `bank[i]` is the `Estimate` of
    run i. `log_likelihood` (B,) and `outcomes` hold one entry for each run.
    """

    info: Annotated[Info, "B T"]
    t: Any
    log_likelihood: Annotated[Any, "B"]
    outcomes: Annotated[tuple[Outcome, ...], "B"] = static()
    engine: str = static()
    names: Names = static()
    gaps: tuple[Gap, ...] = static(default=())

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
