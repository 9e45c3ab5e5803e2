"""The verdicts of analyses of a model, before any data, with directions and numbers."""

from typing import Annotated, Any

from .. import checks
from ..frozen import frozen, static
from ..kernels.reach import DOUBTFUL, ZERO
from ..models.prior import Prior
from ..models.state_space import StateSpace
from .sentences import estimability_sentences, regulability_sentences, structure_sentences


@frozen
class Assessment:
    """The numbers of a verdict; `Estimability` and `Regulability` document them."""

    verdict: str = static()
    filter_verdict: str = static()
    distance: float
    filter_distance: float
    tolerance: tuple[float, float] = static()
    singular_values: Annotated[Any, "n"]
    directions: Annotated[Any, "a n"]
    filter_directions: Annotated[Any, "b n"]
    known_directions: Annotated[Any, "c n"]
    squared_correlations: Annotated[Any, "r"]
    correlation_directions: Annotated[Any, "r n"]
    variance_reduction: Annotated[Any, "n"]
    filter_variance_reduction: Annotated[Any, "n"]
    prior_covariance: Annotated[Any, "n n", "symmetric"]
    covariance: Annotated[Any, "n n", "symmetric"]


@frozen
class Estimability(Assessment):
    """The result of `estimability`: whether past outputs reduce the variance of every direction of the state.

    A direction is a vector g (n,) of norm 1 in the model's own states; it represents the combination g'x. Π is the covariance
    of the state by the model alone, and P the covariance of the error of the estimate. Fields that begin with `filter_` are
    for the filter, which also uses the present output; the others are for the one-step predictor.

    - `verdict` and `filter_verdict`: "yes", "no" or "borderline" (rounding could decide). `estimable` is True if `verdict` is
      "yes".
    - `directions` (a, n): the directions about which past outputs carry no information.
    - `filter_directions` (b, n): those about which the present output carries none either.
    - `known_directions` (c, n): those with prior variance zero.
    - `prior_covariance` (n, n): Π. `covariance` (n, n): P.
    - `variance_reduction` and `filter_variance_reduction` (n,): the reduction of the variance of each state relative to Π,
      from 0 to 1.
    - `squared_correlations` (r,): the squared canonical correlations of state and past outputs, which have no units. They are
      the generalised eigenvalues of the pair (Π - P, Π), in ascending order.
    - `correlation_directions` (r, n): the directions that belong to them, the least known first.
    - `singular_values` (n,): those of the matrix of covariances between the state and all past outputs, in the units of the
      states. For a constant discrete model in steady state and without cross noise this matrix is [A N, A² N, .., A^n N] with
      N = Π C'.
    - `distance` and `filter_distance`: the relative size of the smallest change of the model that hides a direction.
    - `tolerance`: two limits of `distance`. The verdict is "no" below the first and "borderline" below the second.
    - `horizon`: the horizon in steps (in seconds where dt = 0). None: steady state.
    - `states` and `outputs`: the names of the channels.
    """

    states: Annotated[tuple[str, ...], "n"] = static(default=())
    outputs: tuple[str, ...] = static(default=())
    horizon: Any = static(default=None)

    @property
    def estimable(self) -> bool:
        """Whether the verdict is "yes"."""
        return self.verdict == "yes"

    @property
    def sentences(self) -> tuple[str, ...]:
        """The verdict as sentences."""
        return estimability_sentences(self)

    def __repr__(self) -> str:
        return f"Estimability({self.verdict}: {' '.join(self.sentences)})"

    def plot(self):
        """A plotly figure: the reduction of each state's variance by the outputs, and the Gramian's spectrum."""
        from ..figures.verdict_plots import plot_estimability

        return plot_estimability(self)


@frozen
class Regulability(Assessment):
    """The result of `regulability`: whether control lowers the cost from every initial state x0.

    The cost of a state x0 is x0' Ψ x0 without control, and x0' P x0 with the optimal control. The problem is the dual of
    estimability, so the fields have the names of `Estimability`. Fields that begin with `filter_` refer to the cost before
    the first control acts.

    - `verdict` and `filter_verdict`: "yes", "no" or "borderline" (rounding could decide). `regulable` is True if `verdict` is
      "yes".
    - `directions` (a, n) and `filter_directions` (b, n): states x0 of norm 1 from which control cannot lower the cost.
    - `known_directions` (c, n): states x0 of norm 1 that cost nothing even without control.
    - `prior_covariance` (n, n): Ψ. `covariance` (n, n): P.
    - `variance_reduction` and `filter_variance_reduction` (n,): for each state alone, the share of its cost that control
      saves.
    - `squared_correlations` (r,): the same share for each of the states `correlation_directions` (r, n), the smallest first.
    - `singular_values` (n,): in steady state those of [A'S, A'²S, .., A'^n S] with S = Ψ B.
    - `distance` and `filter_distance`: the relative size of the smallest change of the model that creates such a direction.
    - `tolerance`: two limits of `distance`. The verdict is "no" below the first and "borderline" below the second.
    - `horizon`: the horizon in steps (in seconds where dt = 0). None: unlimited.
    - `states` and `inputs`: the names of the channels.
    """

    states: Annotated[tuple[str, ...], "n"] = static(default=())
    inputs: tuple[str, ...] = static(default=())
    horizon: Any = static(default=None)

    @property
    def regulable(self) -> bool:
        """Whether the verdict is "yes"."""
        return self.verdict == "yes"

    @property
    def sentences(self) -> tuple[str, ...]:
        """The verdict as sentences."""
        return regulability_sentences(self)

    def __repr__(self) -> str:
        return f"Regulability({self.verdict}: {' '.join(self.sentences)})"


@frozen
class _Structure:
    """The common part of `Observability` and `Reachability`."""

    verdict: str = static()
    distance: float
    singular_values: Annotated[Any, "s"]
    gramian: Annotated[Any, "n n", "symmetric"]
    directions: Annotated[Any, "k n"]
    hidden_modes: Annotated[Any, "k"]
    unstable_directions: Annotated[Any, "u n"]
    states: Annotated[tuple[str, ...], "n"] = static()
    channels: Annotated[tuple[str, ...], "c"] = static()
    tolerance: tuple[float, float] = static(default=(ZERO, DOUBTFUL))
    horizon: Any = static(default=None)

    @property
    def sentences(self) -> tuple[str, ...]:
        """The verdict as sentences."""
        return structure_sentences(self)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.verdict}: {' '.join(self.sentences)})"


@frozen
class Observability(_Structure):
    """The result of `observability`: whether the noise-free outputs show every state.

    A hidden direction is an initial state of norm 1 whose response is zero in every output.

    - `verdict`: "yes", "no" or "borderline" (rounding could decide). `observable` is True if it is "yes".
    - `detectable`: whether every hidden direction dies out by itself. None over a finite horizon.
    - `directions` (k, n): a basis of the hidden directions.
    - `hidden_modes` (k,): the eigenvalues of the hidden part of the model.
    - `unstable_directions` (u, n): the hidden directions that do not die out.
    - `distance`: the relative size of the smallest change of (A, C) that hides a direction. Over a horizon, of the change of
      the outputs.
    - `tolerance`: two limits of `distance`. The verdict is "no" below the first and "borderline" below the second.
    - `singular_values`: those of [C; C A; ..; C A^(n-1)], or over a horizon those of the map from the state to its outputs.
    - `gramian` (n, n): x0' gramian x0 is the sum of the squared outputs from the initial state x0
      (the integral where dt = 0). None for an unstable model without a horizon.
    - `horizon`: the horizon in steps (in seconds where dt = 0). None: unlimited.
    - `states` and `channels`: the names of the states and of the outputs.
    """

    __repr__ = _Structure.__repr__

    @property
    def observable(self) -> bool:
        """Whether every state shows in an output."""
        return self.verdict == "yes"

    @property
    def detectable(self) -> bool | None:
        """Whether every state that does not show in an output dies out."""
        return None if self.horizon is not None else len(self.unstable_directions) == 0


@frozen
class Reachability(_Structure):
    """The result of `reachability`: whether the inputs can move every state. With `by="noise"` the process noise replaces the
    inputs.

    An unmoved direction is a vector g of norm 1 for which the inputs do not change g'x.

    - `verdict`: "yes", "no" or "borderline" (rounding could decide). `reachable` is True if it is "yes".
    - `stabilisable`: whether every unmoved direction dies out by itself. None over a finite horizon.
    - `directions` (k, n): a basis of the unmoved directions.
    - `gramian` (n, n): the covariance of the state under white inputs of unit variance. None for an unstable model without a
      horizon.
    - `hidden_modes`, `unstable_directions`, `distance`, `tolerance`, `singular_values`, `horizon`: as in `Observability`,
      with (A, B) instead of (A, C).
    - `states` and `channels`: the names of the states and of the inputs.
    """

    __repr__ = _Structure.__repr__

    @property
    def reachable(self) -> bool:
        """Whether every state can be reached."""
        return self.verdict == "yes"

    @property
    def stabilisable(self) -> bool | None:
        """Whether every direction that the inputs do not move dies out."""
        return None if self.horizon is not None else len(self.unstable_directions) == 0


@frozen
class UnknownInputExistence:
    """The result of `unknown_input_existence`: whether the outputs determine the unknown inputs.

    Model: x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k], where u holds the unknown inputs, and B and D are their columns.

    - `exists`: True if every unknown input can be estimated and the errors die out.
    - `sentence`: the verdict, with the ranks and zeros that decide.
    - `method`: the filter that applies, as the ranks determine it.
    - `delay`: the number of samples after which an unknown input is known. None: never.
    - `rank_D`: the rank of D. `rank_next`: the rank of [C B N, D], where the columns of N span the null space of D; it is at
      most twice the number of unknown inputs. `normal_rank`: the rank of the transfer function from u to y.
    - `zeros`: the invariant zeros. `unstable_zeros`: those that are not inside the unit circle. An input along such a zero
      has no effect on the outputs at any time.
    - `spectral_radius`: the factor per sample by which the errors of the filter shrink in steady state.
      `fang_spectral_radius`: the same for Fang's Algorithm 1, where it applies.
    - `input_delay` (T, d): where `seen` was given, the delay of each of the d unknown inputs at each sample, NaN where it is
      never known.
    - `state_known` (T,): where `seen` was given, whether the state of each sample is known.
    """

    exists: bool = static()
    method: str | None = static()
    delay: int | None = static()
    rank_D: int = static()  # noqa: N815  of the matrix D
    rank_next: int = static()
    normal_rank: int | None = static()
    zeros: Any
    unstable_zeros: Any
    spectral_radius: float | None
    fang_spectral_radius: float | None
    sentence: str = static()
    input_delay: Any = None
    state_known: Any = None

    def __repr__(self) -> str:
        return f"UnknownInputExistence({self.sentence})"


@frozen
class Reduction:
    """The result of `reduce`: a model with r states z that replaces one with n states x.

    - `model`: the reduced model.
    - `to` (r, n): z = to x.
    - `back` (n, r): back z is close to x.
    - `prior`: the stationary distribution of z, as the prior for a Kalman filter of `model`. None for an unstable model.
    - `error_bound`: at every frequency, the gain from inputs and unit white noise to the outputs changes by at most this
      number. It is 0 where the omitted states have no effect.
    - `hankel_singular_values` (n,): for the method "balanced", in descending order. None for the other methods.
    - `method`: the method.
    """

    model: StateSpace
    to: Annotated[Any, "r n"]
    back: Annotated[Any, "n r"]
    prior: Prior | None
    error_bound: float
    hankel_singular_values: Annotated[Any, "n"] = None
    method: str = static(default="output_process")

    def __repr__(self) -> str:
        n, r = self.back.shape
        return f"Reduction({self.method}: {n} to {checks.counted(r, 'state')}, error bound {self.error_bound:.3g})"
