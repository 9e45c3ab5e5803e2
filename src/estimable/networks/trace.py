"""A recorded run of a link, and the link that replays it."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array
from ..frozen import frozen, set_field, static
from .delivery import LATE, flight, fly


@frozen
class Trace:
    """The recorded delays of all packets of a run, and a link that repeats them.

    - `delay` (T, c): the delay of each packet in steps. 0: it arrived in time. Infinite: it was lost.
    - `late`: what the receiver does with packets that arrive late, "drop" or "use".
    - `acknowledged`: whether the sender is notified one step later.

    As a link, a trace uses no random numbers.

    >>> Trace([[0.0], [np.inf]]).arrival_rate
    0.5
    """

    delay: Any
    late: str = static(default="drop")
    acknowledged: bool = static(default=True)
    longest: int = static(default=0, init=False)

    draws = 0

    def __post_init__(self):
        faults = checks.Faults()
        faults.flag("acknowledged", self.acknowledged)
        faults.choice("late", self.late, LATE)
        try:
            delay = np.asarray(self.delay, float)
        except (TypeError, ValueError, OverflowError):
            delay = np.full((1, 1), np.nan)
        delay = delay[:, None] if delay.ndim == 1 else delay
        whole = np.isinf(delay) | (delay == np.floor(delay))
        if delay.ndim != 2 or np.any(np.isnan(delay)) or np.any(delay < 0) or not np.all(whole):
            faults.add("`delay` must be (T, c): 0 if in time, an integer number of steps if late, infinite if lost.")
        faults.finish()
        late = delay[np.isfinite(delay)].max(initial=0.0) if self.late == "use" else 0.0
        set_field(self, delay=delay, longest=int(late))

    @property
    def arrival_rate(self) -> float:
        """The fraction of packets that arrived in time."""
        return float(np.mean(np.asarray(self.delay) == 0))

    def init(self):
        """No packets sent yet."""
        return jnp.zeros((), int), flight(self.longest)

    def send(self, state: tuple[Array, tuple[Array, Array, Array]], packet: Array, draw: Array | None = None):
        """Send the packet with the delay of this row. After the last row, packets arrive in time."""
        row, flying = state
        rows = jnp.asarray(self.delay)
        delay = jnp.where(row < len(rows), rows[jnp.minimum(row, len(rows) - 1)], 0.0)
        flying, delivery = fly(flying, packet, jnp.broadcast_to(delay, jnp.shape(packet)), self.late)
        return (row + 1, flying), delivery
