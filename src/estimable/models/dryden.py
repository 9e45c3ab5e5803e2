"""Dryden's model of atmospheric turbulence, as a linear model driven by white noise. SI units throughout."""

from typing import Any, Self

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..frozen import frozen, set_field, static
from .state_space import StateSpace

CONVENTIONS = ("MIL-F-8785C", "MIL-HDBK-1797")
SEVERITIES = ("light", "moderate", "severe")
FOOT, KNOT = 0.3048, 0.514444
WIND_AT_20_FT = {"light": 15.0, "moderate": 30.0, "severe": 45.0}  # [knots], MIL-F-8785C figure 9
LOW, HIGH, LOWEST = 1000.0, 2000.0, 10.0  # [ft]: below, between and above which the formulas of `at` hold
FREE_SCALE = 1750.0  # [ft], MIL-F-8785C §3.7.2
HEIGHTS = (500, 1750, 3750, 7500, 15_000, 25_000, 35_000, 45_000, 55_000, 65_000, 75_000, 80_000)  # [ft]
EXCEEDED = {  # σ [ft/s] at these heights, MIL-F-8785C figure 7: exceeded with probability 1e-2, 1e-3, 1e-5
    "light": (6.6, 6.9, 7.4, 6.7, 4.6, 2.7, 0.4, 0.0, 0.0, 0.0, 0.0, 0.0),
    "moderate": (8.6, 9.6, 10.6, 10.1, 8.0, 6.6, 5.0, 4.2, 2.7, 0.0, 0.0, 0.0),
    "severe": (15.6, 17.6, 23.0, 23.6, 22.1, 20.0, 16.0, 15.1, 12.1, 7.9, 6.2, 5.1),
}
COMPONENTS = {  # the states of each block: the wanted components, and a lag
    "longitudinal": ("gust_u", "gust_w", "gust_w_lag", "gust_q"),
    "lateral": ("gust_v", "gust_v_lag", "gust_r", "gust_p"),
}
STATES = (*COMPONENTS["longitudinal"], *COMPONENTS["lateral"])


@frozen
class Dryden:
    """Dryden's atmospheric turbulence along the path of an aircraft: gust velocities u, v, w [m/s] and rates p, q, r [rad/s].

    Model, with τ = L/V, the span b, and unit white noises n_u, n_v, n_w, n_p (density 1 per second):

    - u = σ_u √(2 τ_u) / (1 + τ_u s) n_u
    - w = σ_w √τ_w (1 + √3 τ_w s) / (1 + τ_w s)² n_w, and v likewise. The variances of u, v and w are σ².
    - q = (s/V) / (1 + 4 b s/(π V)) w, and r = (s/V) / (1 + 3 b s/(π V)) v, both with this sign.
    - p = σ_w √(.8 π/V) (π/(4 b))^(1/6) / L_w^(1/3) / (1 + 4 b s/(π V)) n_p

    Axes are those of the body: x forward, y right, z down. The gusts add to the velocities and rates of the aircraft relative to
    the air, so that w raises the angle of attack by w/V.

    Settings, in SI units:

    - `sigma`: σ [m/s], one number or (u, v, w). `scale`: L [m], one number or (u, v, w). `airspeed`: V [m/s]. `span`: b [m].
    - `convention`: "MIL-F-8785C", the formulas above; "MIL-HDBK-1797": 2 L_v and 2 L_w instead of L_v and L_w.

    Assumes a frozen field of turbulence, much slower than the aircraft, and a constant airspeed.

    Reference: MIL-F-8785C (1980) §3.7.1.2 (spectra), §3.7.5 (rates), and for `at` §3.7.2 and §3.7.3.4; MIL-HDBK-1797 (1997).

    >>> air = Dryden(3.05, 533.4, 275.0, 9.144)
    >>> [round(float(x), 6) for x in np.diag(air.covariance("longitudinal"))[:2]]  # u, w: sigma squared
    [9.3025, 9.3025]
    """

    sigma: Any
    scale: Any
    airspeed: Any
    span: Any
    convention: str = static(default="MIL-F-8785C")

    def __post_init__(self):
        faults = checks.Faults()
        sigma, scale = (_three(name, getattr(self, name), faults) for name in ("sigma", "scale"))
        airspeed = faults.number("airspeed", self.airspeed, above=0.0, unit="m/s")
        span = faults.number("span", self.span, above=0.0, unit="m")
        faults.choice("convention", self.convention, CONVENTIONS)
        faults.finish()
        set_field(self, sigma=sigma, scale=scale, airspeed=airspeed, span=span)

    @classmethod
    def at(
        cls,
        altitude: float,
        airspeed: float,
        *,
        severity: str = "moderate",
        span: float = 9.144,
        convention: str = "MIL-F-8785C",
    ) -> Self:
        """The turbulence at an altitude above the ground [m], by severity: "light", "moderate" or "severe".

        Below 1,000 ft (MIL-F-8785C §3.7.3.4): L_w = h, L_u = L_v = h / (.177 + .000823 h)^1.2 with h in feet; σ_w = .1 W20 with
        the wind W20 at 20 ft of 15, 30 or 45 knots; σ_u = σ_v = σ_w / (.177 + .000823 h)^.4. Above 2,000 ft (§3.7.2): L =
        1,750 ft and σ from figure 7. Between, linear interpolation. In the convention "MIL-HDBK-1797" L_v and L_w are half of
        these, and their spectra equal those of MIL-F-8785C. `span` [m]: by default that of the F-16.

        >>> air = Dryden.at(6000.0, 275.0, severity="moderate")
        >>> air.scale.tolist(), round(float(air.sigma[2]), 2)
        ([533.4, 533.4, 533.4], 2.24)
        """
        faults = checks.Faults()
        faults.number("altitude", altitude, lower=0.0, upper=HEIGHTS[-1] * FOOT, unit="m")
        faults.choice("severity", severity, SEVERITIES)
        faults.finish()
        h = max(float(altitude) / FOOT, LOWEST)
        low, high = _near_ground(min(h, LOW), severity), _free(max(h, HIGH), severity)
        part = np.clip((h - LOW) / (HIGH - LOW), 0.0, 1.0)
        sigma, scale = ((1 - part) * below + part * above for below, above in zip(low, high, strict=True))
        if convention == "MIL-HDBK-1797":
            scale = scale * [1.0, 0.5, 0.5]
        return cls(sigma * FOOT, scale * FOOT, airspeed, span, convention)

    def model(self, which: str = "longitudinal") -> StateSpace:
        """The turbulence as a continuous model driven by unit white noise: "longitudinal" (u, w, q), "lateral" (v, r, p) or
        "both". Its outputs are its states, without noise.

        >>> Dryden(3.05, 533.4, 275.0, 9.144).model().states
        ('gust_u', 'gust_w', 'gust_w_lag', 'gust_q')
        """
        faults = checks.Faults()
        faults.choice("which", which, ("longitudinal", "lateral", "both"))
        faults.finish()
        blocks = {"longitudinal": self._longitudinal, "lateral": self._lateral}
        chosen = [blocks[name]() for name in (tuple(blocks) if which == "both" else (which,))]
        states = STATES if which == "both" else COMPONENTS[which]
        A, G = (diagonal(*parts) for parts in zip(*chosen, strict=True))
        n = len(A)
        return StateSpace(
            A, C=np.eye(n), G=G, Q=np.eye(G.shape[1]), R=np.zeros((n, n)), dt=0, states=states, outputs=states
        )

    def covariance(self, which: str = "longitudinal") -> np.ndarray:
        """The stationary covariance of the states of `model(which)`, from Lyapunov's equation."""
        from scipy import linalg

        model = self.model(which)
        return linalg.solve_continuous_lyapunov(model.A, -model.G @ model.G.T)

    @property
    def _lengths(self) -> np.ndarray:
        """L as in MIL-F-8785C."""
        return self.scale * ([1.0, 2.0, 2.0] if self.convention == "MIL-HDBK-1797" else [1.0, 1.0, 1.0])

    def _longitudinal(self) -> tuple[np.ndarray, np.ndarray]:
        """A and G of (u, w, w_lag, q)."""
        τ = self._lengths[0] / self.airspeed
        A_w, G_w = self._with_rate(2, 4.0)
        return diagonal(-1 / τ, A_w), diagonal(self.sigma[0] * np.sqrt(2 / τ), G_w)

    def _lateral(self) -> tuple[np.ndarray, np.ndarray]:
        """A and G of (v, v_lag, r, p)."""
        V, b, L = self.airspeed, self.span, self._lengths[2]
        A_v, G_v = self._with_rate(1, 3.0)
        T = 4 * b / (np.pi * V)
        size = self.sigma[2] * np.sqrt(0.8 * np.pi / V) * (np.pi / (4 * b)) ** (1 / 6) / L ** (1 / 3)
        return diagonal(A_v, -1 / T), diagonal(G_v, size / T)

    def _with_rate(self, i: int, spans: float) -> tuple[np.ndarray, np.ndarray]:
        """A and G of (w, its lag, its rate): w = σ√τ (√3 a + (1 - √3) c) with a, c the first and second lag of the noise."""
        τ, T = self._lengths[i] / self.airspeed, spans * self.span / (np.pi * self.airspeed)
        to = np.array([[np.sqrt(3), 1 - np.sqrt(3)], [0.0, 1.0]])  # (w, c) from (a, c), in units of σ√τ
        A = to @ np.array([[-1 / τ, 0.0], [1 / τ, -1 / τ]]) @ np.linalg.inv(to)
        G = self.sigma[i] * np.sqrt(τ) * to @ np.array([[1 / τ], [0.0]])
        rate = np.append(A[0] / (self.airspeed * T), -1 / T)  # q' = w'/(V T) - q/T
        return np.vstack([np.column_stack([A, np.zeros(2)]), rate]), np.vstack([G, G[:1] / (self.airspeed * T)])


def diagonal(*blocks: np.ndarray | float) -> np.ndarray:
    """The matrix with these blocks on its diagonal."""
    parts = [np.atleast_2d(block) for block in blocks]
    rows = [
        [part if i == j else np.zeros((len(part), other.shape[1])) for j, other in enumerate(parts)]
        for i, part in enumerate(parts)
    ]
    return np.block(rows)


def _three(name: str, given: Numbers, faults: checks.Faults) -> np.ndarray | None:
    """One positive number for each of u, v, w; intensities may be zero."""
    unit = {"sigma": "m/s", "scale": "m"}[name]
    read = faults.array(name, [given] * 3 if checks.depth(given) == 0 else given, "3")
    if read is None or checks.is_traced(read):
        return read
    if np.any(read < 0) or (name == "scale" and np.any(read == 0)):
        faults.add(
            f"`{name}` must be {'positive' if name == 'scale' else 'at least 0'}, in {unit}. Got {checks.short(given)}."
        )
    return read


def _near_ground(h: float, severity: str) -> tuple[np.ndarray, np.ndarray]:
    """σ [ft/s] and L [ft] of (u, v, w) at h feet, MIL-F-8785C figures 10 and 11."""
    shape = 0.177 + 0.000823 * h
    w = 0.1 * WIND_AT_20_FT[severity] * KNOT / FOOT
    return np.array([w / shape**0.4] * 2 + [w]), np.array([h / shape**1.2] * 2 + [h])


def _free(h: float, severity: str) -> tuple[np.ndarray, np.ndarray]:
    """σ [ft/s] and L [ft] of (u, v, w) at h feet."""
    return np.full(3, np.interp(h, HEIGHTS, EXCEEDED[severity])), np.full(3, FREE_SCALE)
