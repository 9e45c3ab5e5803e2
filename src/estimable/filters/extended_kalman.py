"""The extended Kalman filter."""

from dataclasses import KW_ONLY, field
from typing import Any

from .. import checks
from ..frozen import frozen, static
from ..kernels.expansion import first_order
from ..models.prior import Prior
from ..models.uncertainty import ModelUncertainty
from ..protocols import JumpingGains
from ..results import Names
from . import nonlinear
from .belief import Belief
from .linearised import Linearised


@frozen
class ExtendedKalman(JumpingGains[Belief], Linearised):
    """The extended Kalman filter: it linearises a nonlinear model at the estimate. It can also estimate parameters of the
    model.

    Model: `NonlinearModel`: x[k+1] = f(x[k], u[k], θ) + G w[k], or its continuous form between samples,
    and y[k] = h(x[k], u[k], θ) + v[k]. Outputs may be missing channel by channel. The prior may be exact, proper or diffuse.
    For a `StateSpace` the filter equals `Kalman`.

    Assumes that f and h are nearly linear over one standard deviation of the estimate. Where they are not, the mean is biased
    and the covariance too small, and the filter does not report it: `diagnostics.nonlinearity` measures it, and
    `SecondOrderKalman` or `UnscentedKalman` correct it.

    Settings: `model`; `parameters`: a `Prior` of the parameters θ (k,), which are then estimated together with the state and
    reported as `gain` (None: the values in the model); `walk`: the variance per second of each parameter, (k,) or one number, or
    a covariance (k, k) per second; `uncertainty`: a `ModelUncertainty` of the matrices of a `StateSpace`, or of parameters of
    the model, which are then considered and not among those of `parameters`; `iterations`: how often h is linearised at a
    sample. With more than 1 this is the iterated filter, for outputs that are accurate compared with the curvature of h.

    Cost: that of `Kalman`, and the n first derivatives of f and of h, one for each state.

    Reference: A. H. Jazwinski, Stochastic Processes and Filtering Theory (1970), §8.3 (8.43)-(8.47), iterated (8.47 ff.).

    >>> import jax.numpy as jnp
    >>> model = NonlinearModel(lambda x, u, θ: x, lambda x, u, θ: jnp.sin(x), Q=[[0.0]], R=[[0.01]], dt=1)
    >>> result = estimate(ExtendedKalman(model), Record([0.5, 0.48], dt=1), prior=Prior([0.4], [[0.1]]))
    >>> bool(abs(result.mean[-1, 0] - np.arcsin(0.49)) < 0.02)
    True
    """

    model: Any
    _: KW_ONLY
    parameters: Prior | None = None
    walk: Any = 0.0
    uncertainty: ModelUncertainty | None = None
    iterations: int = static(default=1)
    ready: Any = field(default=None, init=False)
    walk_factor: Any = field(default=None, init=False)

    truncated = curved = False
    between = "moments"
    expand = staticmethod(first_order)

    def __post_init__(self):
        faults = checks.Faults()
        faults.whole("iterations", self.iterations, 1, nonlinear.MOST_ITERATIONS)
        faults.finish()
        nonlinear.check(self)

    @property
    def names(self) -> Names:
        """Names of states, inputs, outputs, and of the parameters that are estimated, as gains."""
        return nonlinear.names(self)

    gain, takes_uncertain_inputs = property(nonlinear.gain), True
    uncertain_entries = property(nonlinear.uncertain_entries)
    sampled, at, init = nonlinear.sampled, nonlinear.at, nonlinear.init
    condition, correct, predict, tell = nonlinear.condition, nonlinear.correct, nonlinear.predict, nonlinear.tell
    constant, read_walk, instant_about = nonlinear.constant, nonlinear.read_walk, nonlinear.instant_about
