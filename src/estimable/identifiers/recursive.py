"""Shared by the recursive identifiers of output-error models: orders, channels, and the prior belief about θ."""

import dataclasses
from collections.abc import Sequence
from math import comb
from typing import Any, TypeVar

import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array, Numbers
from ..models.output_error import OutputError, parameter_names, read_variance
from ..models.prior import Prior
from ..results import Names, Sample
from .channels import Channels

Identified = TypeVar("Identified", bound=Any)
VAGUE = 1e6  # prior variance of an entry of b where none is given, in squared units of output over input


def read(method: Any, faults: checks.Faults) -> dict[str, Any]:
    """The noise variance and the names of the channels, checked with the orders and the prior."""
    for name in ("na", "nb", "delay"):
        faults.whole(name, getattr(method, name), 0, checks.LARGEST_ORDER)
    inputs, outputs = _names(method.inputs, "inputs", faults), _names(method.outputs, "outputs", faults)
    if outputs is not None:
        faults.learn("p", len(outputs), f"`outputs` holds {checks.counted(len(outputs), 'name')}")
    noise = _read_noise(method.noise_variance, faults)
    if method.prior is not None and faults.instance("prior", method.prior, Prior) and method.prior.diffuse is not None:
        faults.add("`prior` must not have diffuse directions: leave it out where the parameters are unknown.")
    return {"noise_variance": noise, "inputs": inputs, "outputs": outputs}


def check_prior(method: Any) -> None:
    """Check that the prior describes θ; raises `InputError`."""
    wanted = len(method.names.states)
    if method.prior is None or np.shape(method.prior.mean)[-1] == wanted:
        return
    known = channels(method)
    of = f"{checks.counted(known.p, 'output')} and {checks.counted(known.m, 'input')}"
    numbers = f"na = {method.na}, nb = {method.nb} with {of} have {checks.counted(wanted, 'parameter')}"
    checks.refuse(f"`prior` must describe θ: {numbers}. Got {np.shape(method.prior.mean)[-1]}.")


def channels(method: Any) -> Channels:
    """The channels: those named, else one input, and an output for each noise variance."""
    default = tuple(f"y{i + 1}" for i in range(np.shape(method.noise_variance)[-1]))
    return Channels(method.inputs or ("u1",), method.outputs or default, method.delay == 0)


def names(method: Any) -> Names:
    """Names of the parameters (as states), inputs and outputs."""
    known = channels(method)
    return Names(parameter_names(method.na, method.nb, known.inputs, known.outputs), known.inputs, known.outputs)


def for_channels(self: Identified, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> Identified:
    """The same identifier with the names of a record, where it has no names. Raises `InputError`."""
    outputs, noise = self.outputs or outputs, np.ravel(self.noise_variance)
    noise = np.broadcast_to(noise, (len(outputs),)) if len(noise) == 1 else noise
    return dataclasses.replace(self, noise_variance=noise, inputs=self.inputs or inputs, outputs=outputs)


def fitted(self: Any, parameters: Array, dt: float) -> OutputError:
    """The model of a parameter vector."""
    known = channels(self)
    return OutputError.of_parameters(
        parameters, na=self.na, nb=self.nb, delay=self.delay, noise_variance=self.noise_variance, dt=dt,
        inputs=known.inputs, outputs=known.outputs,
    )  # fmt: skip


def believed(method: Any, bounded: bool = True) -> tuple[Any, Any]:
    """Mean (p, d) and covariance (p, d, d) of the prior. Where `bounded`, the variance of a is limited by the stability of A."""
    known = channels(method)
    d = method.na + known.m * (method.nb + 1)
    bounds = np.array([comb(method.na, i + 1) for i in range(method.na)] + [np.inf] * (d - method.na), float)
    if method.prior is None:
        variance = np.minimum(bounds**2, VAGUE)
        return jnp.zeros((known.p, d)), jnp.broadcast_to(np.diag(variance), (known.p, d, d))
    rows = [slice(i * d, (i + 1) * d) for i in range(known.p)]
    P = jnp.concatenate([jnp.asarray(method.prior.covariance)[row, row][None] for row in rows])
    mean = jnp.asarray(method.prior.mean).reshape(known.p, d)
    if not bounded:
        return mean, P
    variance = jnp.sum(P * jnp.eye(d)[None], axis=2)
    scale = jnp.where(
        variance > bounds[None] ** 2, bounds[None] / jnp.sqrt(jnp.where(variance > 0, variance, 1.0)), 1.0
    )
    return mean, P * scale[:, :, None] * scale[:, None, :]


def window(lags: Array, u: Array, delay: int) -> Any:
    """The inputs of φ, input by input: u[k - delay] .. u[k - delay - nb], from earlier inputs (m, nb + delay) and u[k] (m,)."""
    return jnp.concatenate([jnp.asarray(u)[:, None], lags], axis=1)[:, delay:].ravel()


def noise_of(method: Any, sample: Sample) -> Any:
    """The variance of the noise of each output (p,): that of the sample where it is given."""
    r = jnp.asarray(method.noise_variance)
    if sample.sigma is None:
        return r
    sigma = jnp.asarray(sample.sigma)
    return jnp.where(jnp.isnan(sigma), r, sigma * sigma)


def delayed(values: Array, m: int, delay: int) -> Any:
    """The rows that enter φ, of rows input by input, newest first."""
    size = values.shape[0] // m
    return jnp.concatenate([values[j * size + delay : (j + 1) * size] for j in range(m)])


def block_diagonal(blocks: Array) -> Any:
    """The covariance (p d, p d) of the parameters of all outputs, from the covariance (p, d, d) of each."""
    p, d = blocks.shape[:2]
    return (jnp.eye(p)[:, None, :, None] * blocks[:, :, None, :]).reshape(p * d, p * d)


def _names(given: Sequence[str] | None, argument: str, faults: checks.Faults) -> tuple[str, ...] | None:
    return None if given is None else faults.names(argument, given, argument, argument[0])


def _read_noise(value: Numbers, faults: checks.Faults) -> Any:
    noise = read_variance("noise_variance", value, faults)
    if noise is not None and not checks.is_traced(noise) and np.any(noise <= 0):
        faults.add(
            f"`noise_variance` must be greater than 0. Got {checks.short(value)}. For outputs without noise give a small one, "
            "such as 1e-6 of the mean square of y."
        )
    return noise
