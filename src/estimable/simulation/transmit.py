"""Links between the controller, the plant and the estimator, in a simulation."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array
from ..data.record import LOST
from ..networks.delivery import transmit
from ..protocols import Link

INPUT, OUTPUT = 1, 2  # streams of a run's random numbers: the plant's draws are the same as without links


class Links(NamedTuple):
    """The links from the controller to the actuator, and from the sensors to the estimator; None: no losses."""

    input: Any = None
    output: Any = None


class Sent(NamedTuple):
    """The inputs: applied by the actuator (T, m), sent according to the record, and the mask of arrivals."""

    applied: Any
    logged: Any
    arrived: Any
    delay: Any


def check_links(links: Links, lost: str, m: int, p: int, hold: str, faults: checks.Faults) -> None:
    """Check that links have the required steps, carry m inputs and p outputs, and that a record can represent them."""
    for name, link, channels in (("input", links.input, m), ("output", links.output, p)):
        if link is None:
            continue
        if not is_link(link):
            faults.add(f"`{name}_link` must be a link, such as BernoulliLink(0.8). Got {checks.short(link)}.")
        elif channels and not _carries(link, channels):
            faults.add(
                f"`{name}_link` must carry {checks.counted(channels, name)}: its settings need one number, or one for each."
            )
    faults.choice("lost", lost, LOST)
    if links.input is not None and is_link(links.input):
        _check_input_link(links.input, m, hold, faults)


def _check_input_link(link: Link, m: int, hold: str, faults: checks.Faults) -> None:
    if m == 0:
        faults.add("`input_link` carries inputs, but the model has none.")
    if hold == "first_order":
        faults.add('`input_link` needs hold = "zero_order": an input sent in packets is constant between them.')
    if link.late == "use" and not link.acknowledged:
        faults.add(
            '`input_link`: a record can show which late packets were used (late = "use") only where they are acknowledged: '
            'give late="drop" or acknowledged=True.'
        )


def _carries(link: Link, channels: int) -> bool:
    """Whether a link delivers as many channels as it is given."""
    draw = np.zeros(max(link.draws, 1))
    try:
        _, delivery = jax.eval_shape(link.send, link.init(), np.zeros(channels), draw)
    except (TypeError, ValueError):
        return False
    return delivery.value.shape == delivery.delay.shape == (channels,)


def is_link(thing: Any) -> bool:
    """Whether it is a link, and not a class."""
    return isinstance(thing, Link) and not isinstance(thing, type)


def send_inputs(link: Link | None, u: Array, key: Array, lost: str) -> Sent:
    """Send u (T, m) to the actuator."""
    u = jnp.asarray(u)
    if link is None:
        return Sent(u, u, None, None)
    delivery = transmit(link, u, jax.random.fold_in(key, INPUT))
    came = ~jnp.isnan(delivery.value)
    applied = _held(delivery.value, came) if lost == "hold" else jnp.where(came, delivery.value, 0.0)
    if link.late == "use":  # then the applied input is neither u[k] nor zero
        return Sent(applied, applied, None, delivery.delay)
    arrived = jnp.where(delivery.arrived, 1.0, 0.0) if link.acknowledged else jnp.full(u.shape, jnp.nan)
    return Sent(applied, u, arrived, delivery.delay)


def send_outputs(link: Link | None, y: Array, key: Array) -> tuple[Any, Any]:
    """Send y (T, p) to the estimator: NaN where it was lost, or late and dropped; and the delays."""
    if link is None:
        return y, None
    delay = transmit(link, y, jax.random.fold_in(key, OUTPUT)).delay
    arrived = jnp.isfinite(delay) if link.late == "use" else delay == 0
    return jnp.where(arrived, y, jnp.nan), delay


def _held(value: Array, came: Array) -> Any:
    """The last arrived value; zero before the first arrival."""

    def hold(held: Array, row: tuple[Array, Array]):
        held = jnp.where(row[1], row[0], held)
        return held, held

    return jax.lax.scan(hold, jnp.zeros(value.shape[1:]), (value, came))[1]
