"""On-line estimation of the parameters of a nonlinear model, started from a linear model of the record (RANSID)."""

from collections.abc import Sequence
from dataclasses import KW_ONLY
from typing import Any

import numpy as np

from .. import checks
from ..annotations import Array
from ..data.record import Record
from ..filters.change_detection import ChangeDetection
from ..filters.second_order_kalman import MOMENTS, SecondOrderKalman
from ..frozen import frozen, replace, set_field, static
from ..models.nonlinear_model import NonlinearModel
from ..models.prior import Prior
from ..protocols import FilterIdentifier
from .ho_kalman import HoKalman
from .linear_start import Start, at_rest, deviation, levels, matched
from .subspace import Subspace

STARTS = ("ho-kalman", "subspace", "none")
REFINEMENTS = ("none", "likelihood")


@frozen
class AdaptiveIdentification(FilterIdentifier):
    """The parameters of a nonlinear model, estimated by a second-order filter that starts from a linear model of the record.

    Model: `NonlinearModel` with parameters θ (k,). First, a linear model is identified from the deviations of the record from
    its means. θ starts at the values for which the linearised model, at equilibrium under the mean input, responds as this
    linear model does. `SecondOrderKalman` then estimates θ together with the state, sample by sample, with covariances. The
    parameters may be random walks, and may jump where `jump` is given.

    Assumes a right model, and a start from which the filter converges. The linear model gives such a start where the record
    stays near one equilibrium. For other records set start = "none" and give `parameters`. Q and R must be right, as for any
    filter: with too small a Q the covariance is too small.

    Settings:

    - `model`: the nonlinear model. `state_prior`: the `Prior` of x[0].
    - `parameters`: the `Prior` of θ. None: θ starts from the linear model alone, which must determine every parameter.
    - `start`: the identifier of the linear model, "ho-kalman" or "subspace"; or "none". `length`: the length of the impulse
      response of "ho-kalman" (None: its own default); the response must have died out by then.
    - `accuracy`: the assumed error of the linear response, as a fraction of its largest entry. It determines the initial
      covariance of the filter.
    - `walk`: the variance per second of each parameter. `moments`: as in `SecondOrderKalman`.
    - `jump`: the variance of a jump of each parameter, (k,) or one number (None: no jumps). `onsets` is the `length` of
      `ChangeDetection`; `seconds_between_false_alarms` and `persistence` are as there.
    - `refinement`: "likelihood" continues from the filter's estimate to the constant parameters of maximum likelihood.

    `fit.path` is the filter's estimate, row by row (`diagnostics.changes(fit.path)` lists jumps). `fit.extra` holds the
    `start`, its covariance, and the `linear` model. The filter processes several records one after the other, each from
    `state_prior`.

    Cost: one fit of a linear model and one run of the filter. The likelihood adds some tens of its gradients.

    Reference: R. W. Bass (2005), RANSID; B. L. Ho, R. E. Kálmán (1966); A. H. Jazwinski (1970), §9.3.

    >>> import jax.numpy as jnp
    >>> tank = NonlinearModel(lambda x, u, θ: x + θ[1] * u - θ[0] * jnp.sqrt(jnp.maximum(x, 1e-6)), lambda x, u, θ: x, dt=1,
    ...                       Q=[[1e-6]], R=[[1e-4]], inputs=["pump"], parameters={"outflow": 0.2, "inflow": 0.5})
    >>> pump = 0.5 + 0.2 * np.random.default_rng(0).normal(size=(400, 1))
    >>> record = simulate(tank, pump, seed=1, prior=Prior([1.5], [[0.0]])).record
    >>> fit = identify(AdaptiveIdentification(tank, Prior([1.5], [[0.1]])), record)
    >>> bool(np.all(abs(fit.parameters - [0.2, 0.5]) < 3 * fit.sigma)), bool(np.all(fit.sigma < 0.02))
    (True, True)
    """

    model: NonlinearModel
    state_prior: Prior
    _: KW_ONLY
    parameters: Prior | None = None
    start: str = static(default="ho-kalman")
    length: int | None = static(default=None)
    accuracy: float = static(default=0.1)
    walk: Any = 0.0
    moments: str = static(default="gaussian")
    jump: Any = None
    onsets: int = static(default=60)
    seconds_between_false_alarms: Any = 3600.0
    persistence: float = static(default=1.0)
    refinement: str = static(default="none")

    def __post_init__(self):
        faults = checks.Faults()
        faults.instance("model", self.model, NonlinearModel)
        faults.instance("state_prior", self.state_prior, Prior)
        if self.parameters is not None:
            faults.instance("parameters", self.parameters, Prior)
        known = faults.choice("start", self.start, STARTS)
        faults.choice("moments", self.moments, MOMENTS)
        faults.choice("refinement", self.refinement, REFINEMENTS)
        if self.length is not None:
            faults.whole("length", self.length, 2, checks.LARGEST_ORDER)
        accuracy = faults.number("accuracy", self.accuracy, above=0.0, upper=1.0)
        seconds = faults.number("seconds_between_false_alarms", self.seconds_between_false_alarms, above=0.0)
        if known and self.start == "none" and self.parameters is None:
            faults.add(
                '`parameters` must be a Prior where start = "none": no linear model provides their initial values.'
            )
        if isinstance(self.model, NonlinearModel) and not self.model.parameter_names:
            faults.add("`model` has no parameters to identify: give it `parameters={name: value}`.")
        faults.finish()
        set_field(self, accuracy=accuracy, seconds_between_false_alarms=seconds)
        self._check_prior(faults)
        θ = self.model.parameters
        self.tracker(self.parameters or Prior(θ, np.eye(len(θ))))  # its settings are checked there

    def _check_prior(self, faults: checks.Faults) -> None:
        if self.state_prior.size != self.model.n:
            faults.add(
                f"`state_prior` must describe n = {self.model.n} states: {self.model.size_source}. Got {self.state_prior.size}."
            )
        for name in ("state_prior", "parameters"):
            prior = getattr(self, name)
            if prior is not None and prior.diffuse is not None:
                faults.add(
                    f"`{name}` must not have diffuse directions: a nonlinear function of an infinite variance has no mean."
                )
        faults.finish()

    @property
    def varies(self) -> bool:
        """Whether parameters may change in time."""
        return self.jump is not None or bool(np.any(np.asarray(self.walk)))

    def begin(self, records: Sequence[Record]) -> Start:
        """The start of the parameters, from the linear model of the records; the records have the model's channels."""
        if self.start == "none":
            assert self.parameters is not None
            return Start(self.parameters, None)
        about = levels(records)
        deviations = [deviation(one, about) for one in records]
        n = self.model.n
        method = Subspace(n) if self.start == "subspace" else HoKalman(n, length=self.length)
        linear = method.fit(deviations).model
        rest, _ = at_rest(self.model, self.state_prior.mean, about[0], self.model.parameters)
        return matched(self.model, linear, rest, records[0], self.parameters, self.accuracy, about[0])

    def tracker(self, parameters: Prior) -> Any:
        """The filter of the state and the parameters."""
        tracker = SecondOrderKalman(self.model, parameters=parameters, walk=self.walk, moments=self.moments)
        if self.jump is None:
            return tracker
        return ChangeDetection(
            tracker, jump=self.jump, slots=self.onsets, levels=1, walk=self.walk, persistence=self.persistence,
            seconds_between_false_alarms=self.seconds_between_false_alarms,
        )  # fmt: skip

    def known(self, parameters: Array) -> SecondOrderKalman:
        """The filter of the state alone, with known parameters (k,)."""
        return SecondOrderKalman(replace(self.model, parameters=parameters), moments=self.moments)
