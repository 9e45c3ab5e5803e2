"""The natural logarithm of several lanes at once: a library call takes one at a time.

x = 2^k m with m between the roots of 1/2 and 2; log m by the odd series of s = f / (2 + f), f = m - 1, which ends after s^15;
an error below one unit in the last place. Coefficients: FreeBSD's msun, e_log.c (Sun Microsystems 1993), from a Remez fit.
"""

from typing import Any

from ..program.primitives import FLOAT

ODD = (0x3FE5555555555593, 0x3FD2492494229359, 0x3FC7466496CB03DE, 0x3FC2F112DF3E5244)  # of z, z^3, z^5, z^7, z = s^2
EVEN = (0x3FD999999997FA04, 0x3FCC71C51D8E78AF, 0x3FC39A09D078C69F)  # of z^2, z^4, z^6
LN2_HIGH, LN2_LOW = 0x3FE62E42FEE00000, 0x3DEA39EF35793C76
ROOT_HALF = 0x3FE6A09E667F3BCD
MAGIC = 0x4338000000000000  # bits of 1.5 * 2^52: an integer added to them is the integer added to it


class Logarithm:
    """Prints the lines of log x: -inf at 0, NaN below, as in JAX."""

    def __init__(self, scalars: Any, lines: list[str]):
        self.scalars, self.lines = scalars, lines
        self.float, self.integer = scalars.float, scalars.integer

    def of(self, x: str) -> str:
        """The name of log x."""
        f, k = self._reduced(x)
        s = self._do("div", f, self._do("add", f, self._real(2.0)))
        z = self._do("mul", s, s)
        w = self._do("mul", z, z)
        R = self._do("add", self._do("mul", z, self._series(ODD, w)), self._do("mul", w, self._series(EVEN, w)))
        half = self._do("mul", self._do("mul", f, self._real(0.5)), f)
        low = self._do("add", self._do("mul", s, self._do("add", half, R)), self._do("mul", k, self._known(LN2_LOW)))
        rest = self._do("sub", self._do("sub", half, low), f)
        value = self._do("sub", self._do("mul", k, self._known(LN2_HIGH)), rest)
        value = self._choose("olt", x, float("inf"), value, x)
        below = self._choose("oeq", x, 0.0, self._real(float("-inf")), self._real(float("nan")))
        return self._choose("ogt", x, 0.0, value, below)

    def _reduced(self, x: str) -> tuple[str, str]:
        """m - 1 and k."""
        scaled = self._choose("olt", x, 2.0**-1022, self._do("mul", x, self._real(2.0**54)), x)
        bits = self._assign(f"bitcast {self.float} {scaled} to {self.integer}")
        shifted = self._integer("add", bits, (1024 << 52) - ROOT_HALF)
        exponent = self._integer("lshr", shifted, 52)  # k + 1024
        k = self._assign(f"bitcast {self.integer} {self._integer('add', exponent, MAGIC)} to {self.float}")
        offset = 1.5 * 2.0**52 + 1024
        k = self._do("sub", k, self._choose("olt", x, 2.0**-1022, self._real(offset + 54), self._real(offset)))
        power = self._integer("shl", self._integer("sub", exponent, 1024), 52)
        m = self._assign(
            f"bitcast {self.integer} {self._assign(f'sub {self.integer} {bits}, {power}')} to {self.float}"
        )
        return self._do("sub", m, self._real(1.0)), k

    def _series(self, coefficients: tuple[int, ...], w: str) -> str:
        total = self._known(coefficients[-1])
        for value in reversed(coefficients[:-1]):
            total = self._do("add", self._do("mul", total, w), self._known(value))
        return total

    def _assign(self, text: str) -> str:
        return self.scalars.assign(text, self.lines)

    def _do(self, name: str, a: str, b: str) -> str:
        return self.scalars.operation(name, [a, b], (FLOAT, FLOAT), self.lines)

    def _real(self, value: float) -> str:
        return self.scalars.constant(value)

    def _known(self, value: int) -> str:
        """The number with these bits."""
        return self._assign(f"bitcast {self.integer} {self.scalars.constant(value)} to {self.float}")

    def _integer(self, name: str, a: str, value: int) -> str:
        """An operation on 64-bit integers."""
        return self._assign(f"{name} {self.integer} {a}, {self.scalars.constant(value)}")

    def _choose(self, how: str, x: str, limit: float, a: str, b: str) -> str:
        """`a` where x compares so with the limit, else `b`."""
        chosen = self._assign(f"fcmp {how} {self.float} {x}, {self._real(limit)}")
        return self._assign(f"select {self.scalars.bool} {chosen}, {self.float} {a}, {self.float} {b}")
