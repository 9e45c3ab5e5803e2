# pyright: reportUnknownArgumentType=false, reportUnknownLambdaType=false, reportUnknownVariableType=false
"""What the estimating drivers return."""

from typing import Annotated, Any

import numpy as np

from ..frozen import frozen, static
from .steps import Info, Names, Outcome


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
    def extra(self) -> Any:
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
        from ..tables import to_pandas

        return to_pandas(self)

    def to_xarray(self):
        """An xarray Dataset with named dimensions and the full covariances. Needs the extra `xarray`."""
        from ..tables import to_xarray

        return to_xarray(self)

    def plot(self):
        """A plotly figure: states and gains with their 2 sigma bands, and innovations with their bounds."""
        from ..figures.estimate_plots import plot_estimate

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

    info: Annotated[Info, "T"]
    t: Annotated[Any, "T"]
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

    info: Annotated[Info, "T"]
    t: Annotated[Any, "T"]
    log_likelihood: float
    used: Annotated[Any, "T"]
    outcome: Outcome = static()
    engine: str = static()
    names: Names = static()
    __repr__ = Shown.__repr__


@frozen
class Forecast(Kept):
    """What `forecast` returns: row i is the i-th sample after the record. `output` (steps, p), its covariance with the noise
    of the measurement; states and gains as in `Estimate`."""

    info: Annotated[Info, "T"]
    t: Annotated[Any, "T"]
    output: Annotated[Any, "T p"]
    output_covariance: Annotated[Any, "T p p", "symmetric"]
    names: Names = static()

    def __repr__(self) -> str:
        return f"Forecast({len(self.output)} samples of {', '.join(self.names.outputs)})"


@frozen
class EstimateBank(Kept):
    """What `estimate_bank` returns: the arrays of `Estimate` with a leading batch axis; `bank[i]` is one `Estimate`."""

    info: Annotated[Info, "B T"]
    t: Any
    log_likelihood: Annotated[Any, "B"]
    outcomes: Annotated[tuple[Outcome, ...], "B"] = static()
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
