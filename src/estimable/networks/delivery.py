"""The output of a link."""

from typing import Annotated, Any, NamedTuple

import jax
import jax.numpy as jnp

from ..annotations import Array
from ..frozen import saved

LATE = ("drop", "use")  # what happens to packets that arrive late


@saved
class Delivery(NamedTuple):
    """The output of a link at one instant, for each of its c channels.

    - `value` (c,): the packet that arrives now. Among several it is the newest. NaN: none arrives, or only packets older than
      one that arrived before.
    - `age` (c,): how many steps ago that packet was sent. Infinite: none arrives.
    - `delay` (c,): the delay of the packet that is sent now, in steps. 0: it arrives in time. Infinite: it is lost.
    """

    value: Annotated[Any, "c"]
    age: Annotated[Any, "c"]
    delay: Annotated[Any, "c"]

    @property
    def arrived(self):
        """Whether the packets sent now arrive in time, (c,)."""
        return self.delay == 0


def transmit(link: Any, packets: Array, key: Array) -> Delivery:
    """Send packets (T, c) through a link, one at each instant; all fields of the delivery are (T, c)."""
    T = packets.shape[0]
    draws = jax.random.uniform(key, (T, max(link.draws, 1)), float)
    start, _ = link.send(link.init(), packets[0], draws[0])  # the state with the shapes that a packet gives it
    fresh = jax.tree_util.tree_map(lambda first, like: jnp.broadcast_to(first, jnp.shape(like)), link.init(), start)
    return jax.lax.scan(lambda state, row: link.send(state, *row), fresh, (packets, draws))[1]


def flight(longest: int):
    """Packets in flight, sent 1 .. `longest` steps ago, with their delays; and the age of the newest one that arrived."""
    return jnp.full((longest, 1), jnp.nan), jnp.full((longest, 1), jnp.inf), jnp.full((1,), jnp.inf)


def fly(state: tuple, packet: Array, delay: Array, late: str):
    """Send a packet (c,) with a delay of `delay` (c,) steps; returns the packets that arrive at this instant."""
    sent, delays, newest = state
    packet = jnp.asarray(packet)
    sent = jnp.concatenate([packet[None], jnp.broadcast_to(sent, (sent.shape[0], packet.shape[0]))])
    delays = jnp.concatenate([delay[None], jnp.broadcast_to(delays, (delays.shape[0], packet.shape[0]))])
    ages = jnp.arange(sent.shape[0], dtype=float)[:, None]
    newest = jnp.broadcast_to(newest, packet.shape) + 1
    comes = (delays == ages) & (ages < newest[None]) & ((ages == 0) | (late == "use"))
    age = jnp.min(jnp.where(comes, ages, jnp.inf), axis=0)
    value = jnp.sum(jnp.where(comes & (ages == age[None]), sent, 0.0), axis=0)
    delivery = Delivery(jnp.where(jnp.isfinite(age), value, jnp.nan), age, delay)
    return (sent[:-1], delays[:-1], jnp.minimum(newest, age)), delivery


def in_time(packet: Array, arrived: Array) -> Delivery:
    """The packet (c,) if it arrived; otherwise it is lost."""
    infinite = jnp.where(arrived, 0.0, jnp.inf)
    return Delivery(jnp.where(arrived, packet, jnp.nan), infinite, infinite)
