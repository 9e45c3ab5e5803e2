"""What analyses of a model find, before any data: whether, along which directions, and by how much."""

from typing import Annotated, Any

from .. import checks
from ..frozen import frozen, static
from ..kernels.reach import DOUBTFUL, ZERO
from ..models.prior import Prior
from ..models.state_space import StateSpace
from .sentences import estimability_sentences, regulability_sentences, structure_sentences


@frozen
class Assessment:
    """The numbers of a verdict; `Estimability` and `Regulability` say what they mean."""

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
    """What `estimability` found. Directions are rows (.., n) in the model's own states, of norm 1.

    `verdict` "yes", "no" or "borderline" (rounding could decide) for the one-step predictor, and `estimable` whether it
    is "yes"; `filter_verdict` for the filter, which has the present output too.
    `directions`: those about which past outputs carry no information (`filter_directions`: present ones neither);
    `known_directions`: those that have no variance to begin with.
    `singular_values` (n,): of the covariances of the state with all past outputs, in the states' units; constant model in
    steady state: of [F N, F² N, .., F^n N]. `distance`: relative size of the smallest change found that hides a direction;
    a verdict is "no" below `tolerance[0]`, "borderline" below `tolerance[1]`.
    `squared_correlations` (r,), ascending: eigenvalues of (Π - P, Π), the squared canonical correlations of state and past
    outputs, without units; `correlation_directions` (r, n) goes with them, the least known first.
    `variance_reduction` (n,): by how much of itself each state's variance shrinks, 0 to 1; `filter_variance_reduction`.
    `prior_covariance` Π and `covariance` P (n, n); `horizon`: steps (seconds where dt = 0), None in steady state.
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
        """The verdict in words."""
        return estimability_sentences(self)

    def __repr__(self) -> str:
        return f"Estimability({self.verdict}: {' '.join(self.sentences)})"

    def plot(self):
        """A plotly figure: how much of each state's variance the outputs take away, and the Gramian's spectrum."""
        from ..figures.verdict_plots import plot_estimability

        return plot_estimability(self)


@frozen
class Regulability(Assessment):
    """What `regulability` found; the fields of `Estimability`, read of the dual problem.

    `verdict`, and `regulable` whether it is "yes"; `directions` (.., n): states x0 from which control cannot lower the
    cost; `known_directions`: those that cost nothing to begin with. `prior_covariance` (n, n): the cost without control is
    x0' Ψ x0; `covariance`: with the best control. `variance_reduction` (n,): by how much of itself the cost of each state
    alone shrinks; `squared_correlations`, `correlation_directions`: the same for the directions in which it shrinks
    least, first, to most. `singular_values`: of [F'S, F'²S, .., F'^n S] in steady state, S = Ψ G.
    The `filter_` fields are of cost-to-go before the first control acts on it, (F', S).
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
        """The verdict in words."""
        return regulability_sentences(self)

    def __repr__(self) -> str:
        return f"Regulability({self.verdict}: {' '.join(self.sentences)})"


@frozen
class _Structure:
    """What `Observability` and `Reachability` have in common."""

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
        """The verdict in words."""
        return structure_sentences(self)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.verdict}: {' '.join(self.sentences)})"


@frozen
class Observability(_Structure):
    """What `observability` found. `directions` (k, n): states that never show in an output, of norm 1.

    `verdict` "yes", "no" or "borderline"; `observable`: whether it is "yes"; `detectable`: whether what is hidden dies out
    (None over a horizon). `hidden_modes` (k,): eigenvalues of what is hidden; `unstable_directions`: those that do not die
    out. `distance`: relative size of the smallest change of (A, C) found that hides a direction (over a horizon, of the
    outputs it would give). `singular_values` (n,) of [C; C A; ..; C A^(n-1)], or of the outputs over the horizon;
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
    """What `reachability` found. `directions` (k, n): combinations g'x that nothing moves, of norm 1.

    The fields are those of `Observability`, of (A, B): `reachable`, and `stabilisable`, whether what is not moved dies out.
    `gramian` (n, n): the covariance that unit white inputs make.
    """

    __repr__ = _Structure.__repr__

    @property
    def reachable(self) -> bool:
        """Whether every state can be moved to."""
        return self.verdict == "yes"

    @property
    def stabilisable(self) -> bool | None:
        """Whether every direction that is not moved dies out."""
        return None if self.horizon is not None else len(self.unstable_directions) == 0


@frozen
class UnknownInputExistence:
    """What `unknown_input_existence` returns.

    `exists`: every unknown input can be estimated, and the errors die out. `method`: which case the ranks make it; `delay`:
    after how many samples an input is known (None: never); `rank_D`, `rank_next` (of [C B N, D] with N the null space of
    D, at most twice as many as inputs) and `normal_rank` of the transfer function. `zeros`: the invariant zeros;
    `unstable_zeros`: those not inside the unit circle, along which an input acts unseen forever. `spectral_radius`: of
    the error of the steady filter; `fang_spectral_radius`: of Fang's Algorithm 1, where it applies. With `seen`:
    `input_delay` (T, d), NaN where the pattern never reveals the input, and `state_known` (T,).
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
    """What `reduce` found: a `model` of r states z = `to` x, with `to` (r, n); x is near `back` z, with `back` (n, r).

    `prior`: of z in steady state, for the Kalman filter of `model` (None for an unstable model). `error_bound`: of the
    gain from inputs and unit white noise to outputs, at any frequency; 0 where nothing but what does not count was left
    out. `hankel_singular_values` (n,), descending, of a balanced truncation; else None.
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
