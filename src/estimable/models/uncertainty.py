"""Uncertain entries of the matrices of a model or parameters of a nonlinear one, and what they move in the sampled form."""

from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array
from ..frozen import frozen, replace, set_field, static
from .complex_step import along_each, slope_of
from .nonlinear_model import NonlinearModel
from .sampled import Clock, SampledModel, sample
from .state_space import StateSpace

TREATMENTS = ("considered", "estimated")
MATRICES = ("A", "B", "C")


@frozen
class ModelUncertainty:
    """Standard deviations of the entries of A, B and C of a model, or of the parameters of a nonlinear one.

    For `Kalman`, `UnknownGain` and the nonlinear filters. The errors are independent, Gaussian and constant, φ ~ N(0, diag(sd²)).
    They join the state in the filter.

    - `A` (n, n), `B` (n, m), `C` (p, n): the standard deviation of each entry, 0 where it is known; of the continuous matrices if
      the model is continuous. None: known.
    - `parameters`: of a `NonlinearModel`, {name: standard deviation} of the parameters that are uncertain.
    - `relative`: instead, a fraction of each entry of A and of B other than 0 and ±1, which are usually exact (kinematics); of a
      `NonlinearModel`, of each parameter other than 0.
    - `treat`: "considered" (default): the uncertainty is in every covariance, but the record does not change φ (Schmidt). That is
      sound for any record. "estimated": φ is estimated with the state, by an extended Kalman filter. It is sharper, but a gain
      and the scale of B are one number: it is refused where B is uncertain and the prior of the gain is wider than .05. The
      parameters of a `NonlinearModel` are estimated as `parameters` of the filter.

    Measured on the F-16 with A and B wrong by 10 % and a gain that drops to .5: without it the error of the gain is 28 times the
    reported standard deviation at full command, with it 1.1 times.

    Reference: S. F. Schmidt, Advances in Control Systems 3 (1966) 293-340; G. J. Bierman, Factorization Methods (1977), ch. VIII.

    >>> model = StateSpace([[-1.0]], [[2.0]], Q=[[0.0]], R=[[0.01]], dt=0)
    >>> UnknownGain(model, Prior([1.0], [[0.1]]), uncertainty=ModelUncertainty(relative=0.1)).uncertainty.treat
    'considered'
    """

    A: Any = None
    B: Any = None
    C: Any = None
    treat: str = static(default="considered")
    relative: Any = None
    parameters: Any = None

    def __post_init__(self):
        faults = checks.Faults()
        faults.choice("treat", self.treat, TREATMENTS)
        for name in MATRICES:
            value = getattr(self, name)
            sd = (
                None
                if value is None
                else faults.array(name, value, "rows columns" if name == "A" else f"rows_{name} columns_{name}")
            )
            if sd is not None and np.any(sd < 0):
                faults.add(f"`{name}` must be standard deviations, at least 0. Got {checks.short(value)}.")
            set_field(self, **{name: sd})
        if self.relative is not None:
            set_field(self, relative=faults.number("relative", self.relative, above=0.0))
        if self.parameters is not None:
            set_field(self, parameters=_read_parameters(self.parameters, faults))
        if all(getattr(self, name) is None for name in (*MATRICES, "relative", "parameters")):
            faults.add(
                "nothing is uncertain: give standard deviations of `A`, `B`, `C` or `parameters`, or `relative`."
            )
        faults.finish()

    def of(self, model: StateSpace) -> dict[str, np.ndarray]:
        """The standard deviations of each uncertain matrix of a model, which fit it."""
        found = {}
        for name in MATRICES:
            value, M = getattr(self, name), np.asarray(getattr(model, name))
            if value is None and self.relative is not None and name != "C":
                M = np.abs(M.reshape(-1, *M.shape[-2:])).max(axis=0)
                value = np.where((M != 0) & (M != 1), self.relative * M, 0.0)
                value[_disturbances(model)] = 0.0
            if value is not None and np.any(value):
                found[name] = value
        return found

    def of_parameters(self, model: NonlinearModel) -> dict[str, float]:
        """The standard deviation of each uncertain parameter of a model, in its order."""
        values = np.abs(np.asarray(model.parameters).reshape(-1, len(model.parameter_names))).max(axis=0)
        found = dict(zip(model.parameter_names, (self.relative or 0.0) * values, strict=True)) | (self.parameters or {})
        return {name: float(sd) for name, sd in found.items() if np.any(sd)}

    def check(self, model: Any, faults: checks.Faults) -> None:
        """Report a fault if it does not fit the model."""
        if isinstance(model, NonlinearModel):
            self._check_parameters(model, faults)
            return
        if self.parameters is not None:
            faults.add(
                "`uncertainty.parameters` names parameters of a NonlinearModel. For a StateSpace give `A`, `B` or `C`."
            )
            return
        for name in MATRICES:
            value, shape = getattr(self, name), np.shape(getattr(model, name))[-2:]
            if value is not None and np.shape(value) != shape:
                faults.add(f"`uncertainty.{name}` must have the shape of {name}, {shape}. Got {np.shape(value)}.")
        if model.schedule:
            faults.add(
                "`uncertainty` needs a model without a `schedule`: give its standard deviations to `model.along(..)`."
            )
        if not faults.sentences and not self.of(model):
            faults.add("`uncertainty` names no entry: all its standard deviations are 0 in this model.")

    def _check_parameters(self, model: NonlinearModel, faults: checks.Faults) -> None:
        given = [name for name in MATRICES if getattr(self, name) is not None]
        if given:
            faults.add(
                f"`uncertainty.{given[0]}` is that of a StateSpace. For a NonlinearModel give `parameters`, such as "
                "{'drag': 0.03}."
            )
        if self.treat == "estimated":
            faults.add(
                'treat = "estimated" is that of a StateSpace. For a NonlinearModel give the filter a prior of its '
                "`parameters`: they are then estimated."
            )
        for name in set(self.parameters or ()) - set(model.parameter_names):
            faults.add(
                f"`uncertainty.parameters` names {name!r}, which is no parameter of the model "
                f"({checks.listed(model.parameter_names)}).{checks.suggestion(name, model.parameter_names)}"
            )
        if not faults.sentences and not self.of_parameters(model):
            faults.add("`uncertainty` names no parameter: all its standard deviations are 0 in this model.")


def _read_parameters(given: Mapping[str, float], faults: checks.Faults) -> Any:
    if not isinstance(given, Mapping) or not all(isinstance(name, str) for name in given):
        faults.add(
            f"`parameters` must be a mapping of names to standard deviations, such as {{'drag': 0.03}}. "
            f"Got {checks.short(given)}."
        )
        return given
    return {name: faults.number(f"parameters[{name!r}]", sd, lower=0.0) for name, sd in given.items()}


def _disturbances(model: StateSpace) -> tuple[slice, slice]:
    """The rows of the disturbances, which are not uncertain in this sense."""
    count = 0 if model.disturbance is None else len(model.disturbance.at)
    return slice(model.n - count, model.n), slice(None)


@frozen
class Tangents:
    """The derivatives of the sampled matrices with respect to each of q uncertain entries, and the entries' deviations (q,).

    Those that vary have a time axis in front; `rows` as in `SampledModel`. `skew`: B is uncertain, so that a gain
    that multiplies it has the errors of a quotient.
    """

    A: Any
    B: Any
    B_end: Any
    C: Any
    sigma: Any
    rows: Any = None
    varying: tuple[str, ...] = static(default=())
    skew: bool = static(default=False)

    @property
    def count(self) -> int:
        """q."""
        return self.sigma.shape[-1]

    def moved(self, model: SampledModel, φ: Array) -> SampledModel:
        """The model with the entries φ (q,)."""

        def of(M: Array, dM: Array) -> Array:
            return M + jnp.sum(φ[:, None, None] * dM, axis=0)

        B_end = None if model.B_end is None else of(model.B_end, self.B_end)
        return replace(model, A=of(model.A, self.A), B=of(model.B, self.B), B_end=B_end, C=of(model.C, self.C))

    def at(self, k: int | Array) -> "Tangents":
        """Those at row k."""
        row = k if self.rows is None else self.rows[k]
        instant = {
            name: jax.lax.dynamic_index_in_dim(getattr(self, name), row, keepdims=False) for name in self.varying
        }
        return replace(self, rows=None, varying=(), **instant)


def tangents(
    model: StateSpace, uncertainty: ModelUncertainty, clock: Clock, blocks: Callable[[StateSpace], StateSpace]
) -> Tangents:
    """The derivatives of `sample(blocks(model), clock)` with respect to each uncertain entry, by a complex step."""
    entries = [(name, at) for name, sd in uncertainty.of(model).items() for at in np.argwhere(sd)]
    sigma = np.array([sd for found in uncertainty.of(model).values() for sd in found[found > 0]])

    def moved(φ: np.ndarray) -> SampledModel:
        changed = {name: np.asarray(getattr(model, name)).astype(φ.dtype) for name in MATRICES}
        for (name, (i, j)), step in zip(entries, φ, strict=True):
            changed[name][..., i, j] += step
        return sample(blocks(replace(model, **changed)), clock)

    found = slope_of(along_each(moved, np.zeros(len(entries))))
    varying = tuple(name for name in found.varying if name in ("A", "B", "B_end", "C"))
    own = {name: getattr(found, name) for name in ("A", "B", "B_end", "C")}
    own |= {name: np.moveaxis(own[name], 0, 1) for name in varying}
    return Tangents(
        **own,
        sigma=sigma,
        rows=None if found.rows is None else found.rows[0],
        varying=varying,
        skew=any(name == "B" for name, _ in entries),
    )


def skewed(quantiles: Array) -> Array:
    """The quantiles (.., 5) of a gain with the errors of a quotient: K^ exp((K - K^) / K^), where it is known to a third."""
    middle = quantiles[..., 2:3]
    size = jnp.where(middle == 0, 1.0, middle)
    known = jnp.abs(quantiles[..., 4:] - quantiles[..., :1]) < KNOWN * jnp.abs(middle)
    return jnp.where(known, middle * jnp.exp((quantiles - middle) / size), quantiles)


KNOWN = 2 * 1.96 / 3  # width of the 95 % interval of a gain whose standard deviation is a third of it
