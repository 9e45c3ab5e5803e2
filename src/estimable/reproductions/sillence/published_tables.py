"""Tables 1, 2 and 3, which are computed without random draws."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...analysis.signal_to_noise import signal_to_noise as ratio
from ...plants import f16
from ..entries import Reproduced, ReproducedRow

ALPHA_MAX, Q_MAX = 6.0, 11.0  # [deg], [deg/s], as quoted
PRINTED_POLES = (-0.6737, 0.30691)  # as printed next to (82)
NOISES = ((0.55534, 0.03, 23.29), (0.1108, 0.03, 37.227), (0.0739, 0.0739, 40.0), (0.01108, 0.03, 53.286),
          (0.00739, 0.00739, 60.0))  # fmt: skip
PI_POLES = {1.0: (-14.4614 + 15.504j, -14.4614 - 15.504j, -1.4724, 0.0),
            0.08: (-26.6776, -3.7210, 0.0016 + 0.0071j, 0.0016 - 0.0071j)}  # fmt: skip
P_POLES = {1.0: (-1.4724, -14.4615 + 15.5040j, -14.4615 - 15.5040j), 0.08: (0.0032, -3.7210, -26.6776)}
OPEN_POLES = (-3.0691, 0.6737, -20.0)
ALPHA_ERROR = "The thesis prints 1.2915 for M_alpha; its open-loop poles need the 3.5 used here."
SIGN = "The feedback of the deflection is -0.4, as the poles need; the thesis prints 0.3 in one place."


def signal_to_noise(_: int) -> Reproduced:
    """Table 1: the ratio (82) of the sensors' noises."""
    right = tuple(np.linalg.eigvals(f16.A))
    rows = []
    for poles, which in ((PRINTED_POLES, "poles as printed"), (right, "poles of the plant")):
        for sigma_q, sigma_alpha, printed in NOISES:
            quantity = f"SNR, sigma_q = {sigma_q:g} deg/s, sigma_alpha = {sigma_alpha:g} deg, {which}"
            rows.append(ReproducedRow(quantity, "dB", printed, _ratio(sigma_q, sigma_alpha, poles)))
    largest = np.abs(f16.flight(1.0, seed=0).state).max(axis=0)
    rows.append(ReproducedRow("largest alpha of the unfailed flight", "deg", ALPHA_MAX, float(largest[0])))
    rows.append(ReproducedRow("largest pitch rate of the unfailed flight", "deg/s", Q_MAX, float(largest[1])))
    remarks = (
        "The table was made with p2 = 0.30691, a misprint of -3.0691: with it every row differs by the same 0.11 dB, which the "
        "rounding of the quoted maxima (6 deg, 11 deg/s) explains. With the poles of the plant the table is not reproduced.",
        "The 40 dB row prints sigma_alpha = 0.739; 0.0739 is meant, as in its figures.",
    )
    return Reproduced(tuple(rows), None, remarks)


def _ratio(sigma_q: float, sigma_alpha: float, poles: Sequence[complex]) -> float:
    w = 1 / np.sqrt(abs(poles[0] * poles[1]))
    return ratio([ALPHA_MAX, Q_MAX], [sigma_alpha, sigma_q], weight=[1.0, w])  # (82)


def poles_of_pi_loop(_: int) -> Reproduced:
    """Table 2."""
    integrator = "The fourth pole at K = 1 is the integrator's, -1.0e-4, printed as 0."
    return _poles(PI_POLES, integral=True, remarks=(ALPHA_ERROR, SIGN, integrator))


def poles_of_p_loop(_: int) -> Reproduced:
    """Table 3."""
    return _poles(P_POLES, integral=False, remarks=(ALPHA_ERROR, SIGN))


def _poles(printed: dict[float, tuple], *, integral: bool, remarks: tuple[str, ...]) -> Reproduced:
    ours = np.append(np.linalg.eigvals(f16.A), -f16.ACTUATOR)
    rows = _pole_rows("open loop", OPEN_POLES, ours)
    for gain, published in printed.items():
        ours = np.linalg.eigvals(f16.closed_loop(gain, integral=integral))
        rows += _pole_rows(f"K = {gain:g}", published, ours)
    return Reproduced(tuple(rows), lambda: _map_of(rows), remarks)


def _pole_rows(label: str, published: tuple, ours: np.ndarray) -> list[ReproducedRow]:
    """Each published pole next to the nearest of ours; a complex pair is represented by its upper pole."""
    rows = []
    for pole in published:
        if np.imag(pole) < 0:
            continue
        near = ours[np.argmin(np.abs(ours - pole))]
        name = f"{label}, pole near {np.real(pole):.4g}"
        rows.append(ReproducedRow(f"{name}, real part", "1/s", float(np.real(pole)), float(near.real)))
        if np.imag(pole) > 0:
            rows.append(ReproducedRow(f"{name}, imaginary part", "1/s", float(np.imag(pole)), float(near.imag)))
    return rows


def _map_of(rows: list[ReproducedRow]) -> Any:
    """Published and computed poles in the complex plane."""
    from ..plots import scatter

    by_source: dict[str, list[complex]] = {"published": [], "ours": []}
    for row in rows:
        for which, value in (("published", row.published or 0.0), ("ours", row.mean)):
            if row.quantity.endswith("imaginary part"):
                by_source[which][-1] = complex(by_source[which][-1], value)
                by_source[which].append(by_source[which][-1].conjugate())
            else:
                by_source[which].append(value)
    return scatter(by_source, x="real part [1/s]", y="imaginary part [rad/s]")
