"""The second-order Kalman filters."""

from dataclasses import KW_ONLY, field
from typing import Any, Self

from .. import checks
from ..frozen import frozen, static
from ..kernels.expansion import bias_only, second_order
from ..models.prior import Prior
from ..models.uncertainty import ModelUncertainty
from ..protocols import JumpingGains
from ..results import Names
from . import nonlinear
from .belief import Belief
from .linearised import Linearised
from .uncertain import refuse_smoothing

MOMENTS = ("gaussian", "bias_only", "truncated")
BETWEEN = ("moments", "map")


@frozen
class SecondOrderKalman(JumpingGains[Belief], Linearised):
    """The Gaussian second-order filter: it uses f and h of a nonlinear model up to their second derivatives, found
    automatically.

    Model: that of `ExtendedKalman`, discrete (Athans-Wishner-Bertolini, Sage-Melsa) or continuous between samples
    (Bass-Norum-Schwartz, Jazwinski). Let h_i' and h_i'' be the first and second derivatives of output i, and P the covariance
    of the state. Then the mean of output i is h_i + ½ tr(h_i'' P), and the covariance of the outputs i and j is
    h_i' P h_j' + ½ tr(h_i'' P h_j'' P) + R_ij. The same holds for f. Mean and covariance are exact where f and h are quadratic.

    Assumes that the belief is nearly Gaussian and that third derivatives are small over it. A belief with two peaks is
    represented by one peak with the right variance. The prior may not be diffuse: a nonlinear function of a quantity with
    infinite variance has no mean.

    Settings:

    - `model`, `parameters`, `walk`, `uncertainty`, `iterations`: as in `ExtendedKalman`. With more than 1 iteration h is
      expanded about the posterior mean, with the posterior covariance.
    - `moments`: "gaussian", as above; "bias_only": the second-order mean with the first-order covariance; "truncated": fourth
      moments are neglected, S = h' P h + R - b b' with b the second-order term of the mean. S can then become indefinite, and
      the run ends with outcome 4.
    - `between`: for a continuous model. "moments": the equations of Bass, Norum & Schwartz, with the covariance propagated by
      first derivatives. "map": the map from one sample to the next is expanded like that of a discrete model, so that the
      covariance includes its curvature. "map" is better where samples are sparse, at the cost of second derivatives through
      all `substeps`.

    Cost: that of `ExtendedKalman`, and n (n + 1) / 2 second derivatives of f and of h, with n counting estimated parameters.

    Reference: A. H. Jazwinski (1970), §9.3; M. Athans, R. P. Wishner, A. Bertolini, IEEE TAC 13 (1968) 504-514; R. W. Bass,
    V. D. Norum, L. Schwartz, J. Math. Anal. Appl. 16 (1966) 152-164; T. S. Bass (2005), second-order filters.

    >>> model = NonlinearModel(lambda x, u, θ: x, lambda x, u, θ: x**2, Q=[[0.0]], R=[[0.1]], dt=1)
    >>> result = estimate(SecondOrderKalman(model), Record([5.0], dt=1), prior=Prior([2.0], [[1.0]]))
    >>> float(result.innovation[0, 0]), float(result.innovation_covariance[0, 0, 0].round(6))  # 5 - (2² + 1), 4 · 2² + 2 + .1
    (0.0, 18.1)
    """

    model: Any
    _: KW_ONLY
    parameters: Prior | None = None
    walk: Any = 0.0
    uncertainty: ModelUncertainty | None = None
    iterations: int = static(default=1)
    moments: str = static(default="gaussian")
    between: str = static(default="moments")
    ready: Any = field(default=None, init=False)
    walk_factor: Any = field(default=None, init=False)

    curved = True

    def __post_init__(self):
        faults = checks.Faults()
        faults.whole("iterations", self.iterations, 1, nonlinear.MOST_ITERATIONS)
        faults.choice("moments", self.moments, MOMENTS)
        known = faults.choice("between", self.between, BETWEEN)
        if (
            known
            and self.between == "map"
            and getattr(self.model, "is_continuous", False)
            and not getattr(self.model, "substeps", 1)
        ):
            faults.add(
                'between = "map" differentiates the trajectory from one sample to the next: give the model `substeps`.'
            )
        faults.finish()
        nonlinear.check(self)

    @property
    def truncated(self) -> bool:
        """Whether fourth moments are neglected."""
        return self.moments == "truncated"

    @property
    def expand(self):
        """The expansion of f and h."""
        return second_order if self.moments == "gaussian" else bias_only

    @property
    def names(self) -> Names:
        """Names of states, inputs, outputs, and of the estimated parameters, as gains."""
        return nonlinear.names(self)

    gain, takes_uncertain_inputs = property(nonlinear.gain), True
    uncertain_entries = property(nonlinear.uncertain_entries)
    sampled, at, init = nonlinear.sampled, nonlinear.at, nonlinear.init
    condition, correct, predict, tell = nonlinear.condition, nonlinear.correct, nonlinear.predict, nonlinear.tell
    constant, read_walk, instant_about = nonlinear.constant, nonlinear.read_walk, nonlinear.instant_about

    @property
    def for_smoothing(self) -> Self:
        """The filter itself. Raises `InputError` where its moments are truncated, or its model is uncertain."""
        refuse_smoothing(self.uncertainty)
        if self.truncated:
            checks.refuse(
                'smooth needs the covariance of each noise, and moments = "truncated" subtracts from it: use '
                'moments = "gaussian" or "bias_only".'
            )
        return self
