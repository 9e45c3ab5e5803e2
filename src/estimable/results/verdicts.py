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
    """The result of `estimability`. Directions are rows (.., n) in the model's own states, of norm 1.

    `verdict` is "yes", "no" or "borderline" (rounding could decide), for the one-step predictor. `estimable` is True if it is
    "yes". `filter_verdict` is the same for the filter, which also uses the present output.
    `directions`: combinations of states about which past outputs carry no information. `filter_directions`: those about which
    the present output carries none either. `known_directions`: those whose prior variance is zero.
    `singular_values` (n,): of the matrix of covariances between the state and all past outputs, in the states' units. For a
    constant discrete model in steady state, without cross noise, that is [F N, F² N, .., F^n N] with F = A and N = Π C'.
    `distance`: relative size of the smallest change of the model found that hides a direction. A verdict is "no" below
    `tolerance[0]`, "borderline" below `tolerance[1]`.
    `squared_correlations` (r,), ascending: eigenvalues of (Π - P, Π), the squared canonical correlations of state and past
    outputs, without units; `correlation_directions` (r, n) are the corresponding directions, the least known first.
    `variance_reduction` (n,): the relative reduction of each state's variance, 0 to 1. `filter_variance_reduction`: the same
    for the filter. `prior_covariance` Π and `covariance` P (n, n); `horizon`: steps (seconds where dt = 0), None in steady state.
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
    """The result of `regulability`; the fields of `Estimability`, for the dual problem.

    `verdict` is "yes", "no" or "borderline", and `regulable` is True if it is "yes". `directions` (.., n): states x0 from which
    control cannot lower the cost. `known_directions`: states x0 that cost nothing even without control.
    `prior_covariance` Ψ (n, n): the cost without control is x0' Ψ x0. `covariance` (n, n): the same matrix for the cost with the
    optimal control. `variance_reduction` (n,): the share of its cost that control saves, for each state alone.
    `squared_correlations`: that share for each of `correlation_directions`, the smallest first. `singular_values`: in steady
    state those of [F'S, F'²S, .., F'^n S], with F = A and S = Ψ B.
    The `filter_` fields refer to the cost-to-go before the first control acts: the pair is (F', S).
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
    """The result of `observability`. `directions` (k, n): states that never show in an output, of norm 1.

    `verdict` "yes", "no" or "borderline"; `observable`: whether it is "yes"; `detectable`: whether the hidden part dies out
    (None over a horizon). `hidden_modes` (k,): eigenvalues of the hidden part; `unstable_directions`: those that do not die
    out. `distance`: relative size of the smallest change of (A, C) found that hides a direction (over a horizon, of the
    resulting outputs). `singular_values` (n,) of [C; C A; ..; C A^(n-1)], or of the outputs over the horizon;
    `gramian` (n, n): x0' gramian x0 is the sum (dt = 0: the integral) of squared outputs; None for an unstable model
    without a horizon.
    """

    __repr__ = _Structure.__repr__

    @property
    def observable(self) -> bool:
        """Whether every state shows."""
        return self.verdict == "yes"

    @property
    def detectable(self) -> bool | None:
        """Whether every state that does not show dies out."""
        return None if self.horizon is not None else len(self.unstable_directions) == 0


@frozen
class Reachability(_Structure):
    """The result of `reachability`. `directions` (k, n): vectors g of norm 1 such that the inputs do not move g'x.

    With `by="noise"` the noise replaces the inputs. The other fields are as in `Observability`, for (A, B). `reachable` replaces
    `observable`, and `stabilisable` replaces `detectable`: whether the part that is not moved dies out.
    `gramian` (n, n): the covariance due to unit white inputs.
    """

    __repr__ = _Structure.__repr__

    @property
    def reachable(self) -> bool:
        """Whether every state can be reached."""
        return self.verdict == "yes"

    @property
    def stabilisable(self) -> bool | None:
        """Whether every unmoved direction dies out."""
        return None if self.horizon is not None else len(self.unstable_directions) == 0


@frozen
class UnknownInputExistence:
    """The result of `unknown_input_existence`.

    `exists`: every unknown input can be estimated, and the errors die out. `method`: the case, by the ranks; `delay`: the
    number of samples after which an input is known (None: never); `rank_D`, `rank_next` (of [C B N, D] with N the null space of
    D, at most twice the number of inputs) and `normal_rank` of the transfer function. `zeros`: the invariant zeros;
    `unstable_zeros`: those not inside the unit circle, along which an input has no effect on the outputs, forever.
    `spectral_radius`: of the error of the steady filter; `fang_spectral_radius`: of Fang's Algorithm 1, where it applies. With
    `seen`: `input_delay` (T, d), NaN where the pattern never reveals the input, and `state_known` (T,).
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
    """The result of `reduce`: a `model` of r states z = `to` x, with `to` (r, n); x is near `back` z, with `back` (n, r).

    `prior`: of z in steady state, for the Kalman filter of `model` (None for an unstable model). `error_bound`: on the gain
    from inputs and unit white noise to outputs, at any frequency; 0 where the omitted states have no effect.
    `hankel_singular_values` (n,), descending, of a balanced truncation; else None.
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
