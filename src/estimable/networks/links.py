"""Links: perfect, with independent losses, with bursts of losses, with random delays."""

from dataclasses import KW_ONLY
from typing import Any

import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array, Numbers, Tree
from ..frozen import frozen, set_field, static
from .delivery import LATE, flight, fly, in_time


@frozen
class PerfectLink:
    """A link in which every packet arrives in time.

    >>> PerfectLink().send((), np.array([1.0]))[1].arrived.tolist()
    [True]
    """

    draws = 0
    acknowledged = True
    late = "drop"

    def init(self):
        """The empty state."""
        return ()

    def send(self, state: Tree, packet: Array, draw: Array | None = None):
        """The packet (c,), unchanged."""
        return state, in_time(packet, jnp.ones(jnp.shape(packet), bool))


@frozen
class BernoulliLink:
    """A link in which each packet arrives in time with probability `arrival`, independently of the others, and is lost
    otherwise.

    Settings: `arrival`, one number (one packet carries all channels) or (c,) (each channel has its own packets);
    `acknowledged`: True if the sender is notified one step later which packets arrived (as in TCP), False if it is never
    notified (as in UDP).

    Reference: H. Fang (2009), (3.3), (3.4).

    >>> BernoulliLink(0.8).send((), np.array([1.0]), np.array([0.7]))[1].value.tolist()
    [1.0]
    """

    arrival: Any
    _: KW_ONLY
    acknowledged: bool = static(default=True)

    late = "drop"

    def __post_init__(self):
        faults = checks.Faults()
        faults.flag("acknowledged", self.acknowledged)
        arrival = _read_probabilities("arrival", self.arrival, faults)
        faults.finish()
        set_field(self, arrival=arrival)

    @property
    def draws(self) -> int:
        """The number of uniform random numbers for one instant."""
        return np.shape(self.arrival)[-1]

    def init(self):
        """The empty state."""
        return ()

    def send(self, state: Tree, packet: Array, draw: Array):
        """Send the packet (c,). `draw` holds a uniform random number on [0, 1) for each packet, which decides whether it
        arrives.
        """
        return state, in_time(packet, jnp.broadcast_to(draw < self.arrival, jnp.shape(packet)))


@frozen
class GilbertElliottLink:
    """A link whose losses come in bursts: its channel is a Markov chain with a good and a bad state, each with its own
    arrival rate.

    Settings: `to_bad` and `to_good`: the probabilities of a change of state from one packet to the next; `good` and `bad`:
    the arrival rates in the two states; `acknowledged` as in `BernoulliLink`. `GilbertElliottLink.of_rate` makes a link from
    an arrival rate and the mean length of a burst. The chain starts in its stationary distribution. One packet carries all
    channels.

    Reference: E. N. Gilbert (1960); E. O. Elliott (1963).

    >>> round(GilbertElliottLink.of_rate(0.8, burst=4).arrival, 6)
    0.8
    """

    to_bad: Any
    to_good: Any
    _: KW_ONLY
    good: Any = 1.0
    bad: Any = 0.0
    acknowledged: bool = static(default=True)

    draws = 2
    late = "drop"

    def __post_init__(self):
        faults = checks.Faults()
        faults.flag("acknowledged", self.acknowledged)
        read = {
            name: faults.number(name, getattr(self, name), lower=0.0, upper=1.0)
            for name in ("to_bad", "to_good", "good", "bad")
        }
        if read["to_bad"] == 0 and read["to_good"] == 0:
            faults.add(
                "`to_bad` and `to_good` are both 0, so the initial state of the channel is undefined. Give one of them."
            )
        faults.finish()
        set_field(self, **read)

    @staticmethod
    def of_rate(arrival: float, *, burst: float, acknowledged: bool = True) -> "GilbertElliottLink":
        """A link with a given arrival rate and mean length of a burst. It loses all packets in its bad state and none in its
        good one.
        """
        faults = checks.Faults()
        rate = faults.number("arrival", arrival, above=0.0, upper=1.0)
        length = faults.number("burst", burst, lower=1.0, unit="packets")
        faults.finish()
        assert rate is not None
        assert length is not None
        to_bad = (1 - rate) / (rate * length)
        if to_bad > 1:
            least = (1 - rate) / rate
            checks.refuse(
                f"`burst` must be at least {least:g} packets for an arrival rate of {rate:g}. Got {length:g}."
            )
        return GilbertElliottLink(to_bad, 1 / length, acknowledged=acknowledged)

    @property
    def arrival(self) -> float:
        """The mean arrival rate."""
        in_bad = self.to_bad / (self.to_bad + self.to_good)
        return (1 - in_bad) * self.good + in_bad * self.bad

    def init(self):
        """The probability of being in the bad state."""
        return jnp.asarray(self.to_bad / (self.to_bad + self.to_good))

    def send(self, state: Array, packet: Array, draw: Array):
        """Send the packet (c,). `draw` (2,) holds uniform random numbers: for the state of the channel, and for the packet."""
        is_bad = draw[0] < state
        arrived = draw[1] < jnp.where(is_bad, self.bad, self.good)
        after = jnp.where(is_bad, 1 - self.to_good, self.to_bad)
        return after, in_time(packet, jnp.broadcast_to(arrived, jnp.shape(packet)))


@frozen
class DelayLink:
    """A link whose packets arrive late and may overtake each other. Each packet has a time stamp.

    Settings: `delays`: the probabilities of 0, 1, 2, .. steps of delay; if their sum is below 1, the rest is the probability
    of a loss. `late`: "drop" discards packets that arrive late; "use" delivers them unless a newer one arrived before.
    `acknowledged` as in `BernoulliLink`. One packet carries all channels.

    >>> link = DelayLink([0.5, 0.3], late="use")
    >>> state, first = link.send(link.init(), np.array([1.0]), np.array([0.6]))
    >>> state, second = link.send(state, np.array([2.0]), np.array([0.9]))
    >>> first.delay.tolist(), second.value.tolist(), second.age.tolist()
    ([1.0], [1.0], [1.0])
    """

    delays: Any
    _: KW_ONLY
    late: str = static(default="drop")
    acknowledged: bool = static(default=True)

    draws = 1

    def __post_init__(self):
        faults = checks.Faults()
        faults.flag("acknowledged", self.acknowledged)
        faults.choice("late", self.late, LATE)
        delays = _read_probabilities("delays", self.delays, faults)
        if delays is not None and not checks.is_traced(delays) and delays.sum() > 1 + 1e-12:
            faults.add(
                f"`delays` must sum to at most 1; the remainder is the rate of lost packets. Got {delays.sum():g}."
            )
        faults.finish()
        set_field(self, delays=delays)

    @property
    def arrival(self) -> float:
        """The rate of packets that arrive in time."""
        return float(self.delays[0])

    def init(self):
        """No packets in flight."""
        return flight(len(self.delays) - 1)

    def send(self, state: tuple[Array, Array, Array], packet: Array, draw: Array):
        """Send the packet (c,), and deliver the newest packet that arrives at this instant. `draw` (1,) is a uniform random
        number.
        """
        steps = jnp.sum(jnp.where(draw[0] >= jnp.cumsum(jnp.asarray(self.delays)), 1.0, 0.0))
        delay = jnp.where(steps < len(self.delays), steps, jnp.inf)
        return fly(state, packet, jnp.broadcast_to(delay, jnp.shape(packet)), self.late)


def _read_probabilities(name: str, value: Numbers, faults: checks.Faults) -> Any:
    if checks.is_traced(value):
        return jnp.atleast_1d(jnp.asarray(value))
    read = faults.array(name, [value] if checks.depth(value) == 0 else value, "channels")
    if read is not None and (len(read) == 0 or np.any((read < 0) | (read > 1))):
        faults.add(f"`{name}` must be probabilities, from 0 to 1. Got {checks.short(value)}.")
        return None
    return read
