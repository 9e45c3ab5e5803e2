"""Waveforms of disturbances: their form is known, but neither size nor phase."""

from typing import Any

import numpy as np

from .. import checks
from ..frozen import frozen, set_field
from ..models.discretisation import exponential


@frozen
class Waveform:
    """The form of a disturbance d whose size is unknown: d = H z, dz/dt = D z, for any z and any jumps of z.

    Settings: D (q, q) in units per second, and H (d, q). The methods `constant`, `ramp`, `polynomial` and `sinusoid` give the
    usual forms. The sum a + b of two waveforms acts on the same channels; `each(a, b)` gives each its own channels.

    Raises `InputError` for wrong shapes, and where a part of z never appears in d.

    Reference: C. D. Johnson, IEEE TAC 16 (1971) 635.

    >>> Waveform.ramp().values([0.0, 2.0], [1.0, 0.5]).tolist()
    [[1.0], [2.0]]
    """

    D: Any
    H: Any

    def __post_init__(self):
        faults = checks.Faults()
        D, H = faults.array("D", self.D, "q q"), faults.array("H", self.H, "d q")
        faults.finish()
        assert D is not None
        assert H is not None
        if 0 in H.shape:
            checks.refuse("a waveform needs a state and a channel: `H` must be (d, q), both at least 1.")
        shown = np.vstack([H @ np.linalg.matrix_power(D / (np.abs(D).max() or 1.0), k) for k in range(len(D))])
        if np.linalg.matrix_rank(shown) < len(D):
            checks.refuse("`H` must show all of z: a part of this waveform's state is never in d. Leave it out.")
        set_field(self, D=D, H=H)

    @property
    def order(self) -> int:
        """The number q of states z."""
        return len(self.D)

    @property
    def channels(self) -> int:
        """The number of disturbances."""
        return len(self.H)

    @staticmethod
    def constant() -> "Waveform":
        """An offset."""
        return Waveform.polynomial(0)

    @staticmethod
    def ramp() -> "Waveform":
        """An offset that grows steadily; z holds d and its slope."""
        return Waveform.polynomial(1)

    @staticmethod
    def polynomial(degree: int) -> "Waveform":
        """A polynomial in time; z holds d and its derivatives."""
        faults = checks.Faults()
        faults.whole("degree", degree, 0, checks.LARGEST_ORDER)
        faults.finish()
        return Waveform(np.eye(degree + 1, k=1), np.eye(1, degree + 1))

    @staticmethod
    def sinusoid(frequency: float) -> "Waveform":
        """An oscillation of `frequency` rad/s; z holds d, and the negative of d a quarter of a period later."""
        faults = checks.Faults()
        ω = faults.number("frequency", frequency, above=0.0, unit="rad/s")
        faults.finish()
        return Waveform([[0.0, ω], [-ω, 0.0]], [[1.0, 0.0]])

    @staticmethod
    def each(*waveforms: "Waveform") -> "Waveform":
        """Several waveforms, each on its own channels.

        >>> Waveform.each(Waveform.constant(), Waveform.ramp()).H.shape
        (2, 3)
        """
        from scipy.linalg import block_diag

        checks.require(**{f"waveforms[{i}]": (one, Waveform) for i, one in enumerate(waveforms)})
        if not waveforms:
            checks.refuse("`each` needs at least one waveform.")
        return Waveform(block_diag(*(w.D for w in waveforms)), block_diag(*(w.H for w in waveforms)))

    def __add__(self, other: "Waveform") -> "Waveform":
        from scipy.linalg import block_diag

        checks.require(other=(other, Waveform))
        if self.channels != other.channels:
            checks.refuse(
                f"only waveforms on equal channels can be added. Got {self.channels} and {other.channels}: did you mean `each`?"
            )
        return Waveform(block_diag(self.D, other.D), np.hstack([self.H, other.H]))

    def values(self, t: np.ndarray, z: np.ndarray) -> Any:
        """The disturbance d (T, channels) at the times t (T,) in seconds, from z (q,) at t = 0."""
        faults = checks.Faults()
        faults.learn("q", self.order, f"the waveform has {checks.counted(self.order, 'state')}")
        t, z = faults.array("t", t, "T"), faults.array("z", z, "q")
        faults.finish()
        assert t is not None
        return np.array([self.H @ exponential(self.D * time) @ z for time in t])
