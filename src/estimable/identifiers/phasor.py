"""A transfer function from the response to sinusoids."""

from collections.abc import Sequence
from dataclasses import KW_ONLY
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..analysis.excitation import excitation_check
from ..data.record import Record
from ..frozen import frozen, saved, set_field, static
from ..kernels import phasors as kernel
from ..models.output_error import OutputError
from ..models.polynomials import joined
from ..models.state_space import StateSpace
from ..protocols import Identifier
from ..results import Check, Fit
from .realised import check_records, variances_of
from .standing import validation_of

DOMAINS = ("discrete", "continuous")
FAINT = 1e-6  # of the largest input phasor: below it the input has no such frequency
LARGEST = 1e100  # phasor of `second_order`: its square is finite
COHERENT = 0.8  # part of the variation of an output that the sinusoids should explain


@saved
class SecondOrder(NamedTuple):
    """ω_n² / (s² + 2 ζ ω_n s + ω_n²): `natural_frequency` in hertz, `damping` ζ."""

    natural_frequency: float
    damping: float


class _Seen(NamedTuple):
    """H at frequencies ω (K,), estimated from the records: values and their covariance (2K, 2K); residual variance; coherence."""

    ω: np.ndarray
    H: np.ndarray
    covariance: np.ndarray
    variance: float
    coherence: float


@frozen
class Phasor(Identifier):
    """A transfer function of a given order from the response to sinusoids, one or several at a time, from records with gaps.

    Model: y = H u + c + v. The response of y to a sinusoid in u of frequency ω_k and amplitude 1 has an in-phase part A_k and a
    quadrature part B_k. Together they are the value H(jω_k) = A_k + j B_k. Each frequency gives two real equations that are
    linear in the coefficients a_i, b_i of H.

    Assumes a linear plant in steady state (see `settle`), one input, white v, and the right order. With too low an order the
    model fits the given frequencies only; with too high an order the surplus poles and zeros are noise.

    Settings:

    - `order` n.
    - `frequencies` in hertz: at least n, between 0 and half the sampling rate. More than n are weighted by their covariances.
    - `settle`: the seconds that are cut off the start of each record.
    - `domain`: "discrete": H = Σ b_i z^-i / (1 + Σ a_i z^-i) at z = exp(jω dt), exact for inputs that are held over each
      sample. "continuous": H = Σ b_i s^(n-i) / (s^n + Σ a_i s^(n-i)), for inputs that are sinusoids between the samples too.
      (Sillence's a_i have the opposite sign.)

    Rows with a missing output are left out. `fit.extra` holds "frequencies", "in_phase" and "quadrature" (K, p) and
    "coherence" (p,). The coherence is the part of the output's variation at these frequencies. The rest is noise, a
    transient, or a nonlinearity of the plant.

    Cost: O(T K²) operations, with T samples and K frequencies.

    Reference: J. Sillence (1999) §2.2, (7)-(14), §2.2.1.

    >>> t = 0.1 * np.arange(400)
    >>> u = np.sin(2 * np.pi * 0.3 * t) + np.sin(2 * np.pi * 0.9 * t)
    >>> record = Record(OutputError([-1.2, 0.5], [1.0, 0.4], delay=1, noise_variance=0.0, dt=0.1).response(u), u, dt=0.1)
    >>> identify(Phasor(2, [0.3, 0.9], settle=10), record).parameters.round(5).tolist()
    [-1.2, 0.5, 1.0, 0.4]
    """

    order: int = static()
    frequencies: Any
    _: KW_ONLY
    settle: float = 0.0
    domain: str = static(default="discrete")

    def __post_init__(self):
        faults = checks.Faults()
        faults.whole("order", self.order, 1, checks.LARGEST_ORDER)
        f = faults.numbers("frequencies", self.frequencies)
        f = None if f is None else faults.array("frequencies", np.atleast_1d(f), "K")
        settle = faults.number("settle", self.settle, lower=0.0, unit="seconds")
        faults.choice("domain", self.domain, DOMAINS)
        if f is not None and np.any(f <= 0):
            faults.add(f"`frequencies` must be greater than 0 hertz. Got {checks.short(self.frequencies)}.")
        if f is not None and len(np.unique(f)) != len(f):
            faults.add(f"`frequencies` must differ from each other. Got {checks.short(self.frequencies)}.")
        faults.finish()
        set_field(self, frequencies=f, settle=settle)

    @staticmethod
    def second_order(in_phase: float, quadrature: float, frequency: float) -> SecondOrder:
        """The second-order lag with unit gain whose response at one frequency in hertz is `in_phase` + j `quadrature`.

        Raises `InputError` where there is none: the response must lie below the real axis, outside the circle
        |H - 1/2| = 1/2.

        >>> Phasor.second_order(0.0, -1.0, 0.5)
        SecondOrder(natural_frequency=0.5, damping=0.5)
        """
        faults = checks.Faults()
        in_phase = faults.number("in_phase", in_phase, lower=-LARGEST, upper=LARGEST)
        quadrature = faults.number("quadrature", quadrature, lower=-LARGEST, upper=LARGEST)
        frequency = faults.number("frequency", frequency, above=0.0, unit="hertz")
        faults.finish()
        if in_phase**2 + quadrature**2 <= in_phase or quadrature >= 0:
            checks.refuse(
                f"no stable second-order lag with unit gain has the response {in_phase:g} {quadrature:+g}j: it must lie "
                "below the real axis, outside the circle with centre 1/2 and radius 1/2."
            )
        ω_n, ζ = kernel.second_order(in_phase, quadrature, 2 * np.pi * frequency)
        return SecondOrder(ω_n / (2 * np.pi), ζ)

    def fit(self, records: Sequence[Record]) -> Fit:
        """The fit to records of equal channels and step; each record may have any of the frequencies."""
        self._check(records)
        first = records[0]
        dt = float(first.dt or 0.0)
        seen = [self._seen(records, i, dt) for i in range(len(first.outputs))]
        q = [self._variable(one.ω, dt) for one in seen]
        found = [kernel.coefficients(one.H, one.covariance, q_i, self.order) for one, q_i in zip(seen, q, strict=True)]
        return self._assembled(records, seen, found)

    def _check(self, records: Sequence[Record]) -> None:
        faults, first = checks.Faults(), records[0]
        check_records(records, faults)
        if len(first.inputs) != 1:
            faults.add(
                f"Phasor takes one input, but the records have {len(first.inputs)}: identify them one at a time."
            )
        highest = 0.5 / float(first.dt or 1.0)
        if np.any(self.frequencies >= highest):
            faults.add(f"`frequencies` must be below half the sampling rate, {highest:g} Hz.")
        needed = 2 * len(self.frequencies) + 2
        for i, record in enumerate(records):
            left = len(record) - round(self.settle / float(record.dt or 1.0))
            if left < needed:
                faults.add(
                    f"record {i} has {max(left, 0)} rows after {self.settle:g} s, but {needed} are needed. Lower `settle`."
                )
        faults.finish()

    def _seen(self, records: Sequence[Record], i: int, dt: float) -> _Seen:
        """The phasors of H in all records, for output i."""
        from scipy.linalg import block_diag

        ω = 2 * np.pi * self.frequencies
        variances = variances_of(records, i)
        frequencies, values, spread, squares, variation, spare = [], [], [], 0.0, 0.0, 0
        for k, record in enumerate(records):
            rows = slice(round(self.settle / dt), None)
            t, y, u = dt * np.arange(len(record))[rows], record.y[rows, i], record.applied()[rows, 0]
            equal = np.ones(len(t))
            σ = equal if variances is None else np.sqrt(variances[k][rows])
            U, Y = kernel.phasors(u, t, ω, equal), kernel.phasors(y, t, ω, σ)
            there = np.abs(U.values) > FAINT * max(np.abs(U.values).max(), 1e-300)
            picked = np.concatenate([there, there])
            frequencies.append(ω[there])
            values.append(Y.values[there] / U.values[there])
            spread.append(kernel.rotated(Y.covariance[np.ix_(picked, picked)], 1 / U.values[there]))
            squares, variation = squares + float(Y.e @ Y.e), variation + float(np.nansum((y - np.nanmean(y)) ** 2))
            spare += len(Y.e) - 2 * int(there.sum()) - 1
        ω, H = np.concatenate(frequencies), np.concatenate(values)
        self._check_excited(ω)
        r = max(squares / max(spare, 1), np.finfo(float).tiny)
        order = np.argsort(np.concatenate([np.arange(2).repeat(len(one)) for one in frequencies]), kind="stable")
        Σ = np.asarray(block_diag(*spread))[np.ix_(order, order)]
        coherence = 1 - squares / variation if variation > 0 else 0.0
        return _Seen(ω, H, Σ if variances is not None else r * Σ, r, coherence)

    cannot_weigh = ""

    def _check_excited(self, ω: np.ndarray) -> None:
        moving = len(np.unique(ω))
        if moving < self.order:
            checks.refuse(
                f"order {self.order} needs {self.order} frequencies in the input. Got {moving}: lower the order, or add "
                "sinusoids."
            )

    def _variable(self, ω: np.ndarray, dt: float) -> np.ndarray:
        return np.exp(-1j * ω * dt) if self.domain == "discrete" else 1 / (1j * ω)

    def _assembled(self, records: Sequence[Record], seen: list[_Seen], found: list[Any]) -> Fit:
        from scipy.linalg import block_diag

        first, n = records[0], self.order
        a, b = (np.stack([one.θ[part] for one in found]) for part in (slice(n), slice(n, None)))
        model, discrete = self._models(first, a, b, np.array([one.variance for one in seen]))
        names = self._names(first)
        Σ = np.asarray(block_diag(*(one.covariance for one in found)))
        checks_made = [
            excitation_check(np.linalg.pinv(Σ, hermitian=True), names, np.zeros((len(Σ), 0))),
            *(_coherence(name, one.coherence) for name, one in zip(first.outputs, seen, strict=True)),
        ]
        extra = {
            "frequencies": seen[0].ω / (2 * np.pi), "in_phase": np.stack([np.real(one.H) for one in seen], axis=1),
            "quadrature": np.stack([np.imag(one.H) for one in seen], axis=1),
            "coherence": np.array([one.coherence for one in seen]),
        }  # fmt: skip
        return Fit(
            model,
            joined(a, b),
            Σ,
            names,
            validation_of(discrete, records, checks_made),
            method=type(self).__name__,
            extra=extra,
        )

    def _names(self, first: Record) -> tuple[str, ...]:
        base = 0 if self.domain == "discrete" else 1
        alone = len(first.outputs) == 1
        rows = [[f"a{i + 1}" for i in range(self.order)] + [f"b{i + base}" for i in range(self.order)]]
        return tuple(name + ("" if alone else f"_{y}") for y in first.outputs for name in rows[0])

    def _models(self, first: Record, a: np.ndarray, b: np.ndarray, noise: np.ndarray) -> tuple[Any, StateSpace]:
        """The model, and the same in discrete time."""
        dt, channels = float(first.dt or 0.0), {"inputs": first.inputs, "outputs": first.outputs}
        if self.domain == "discrete":
            model = OutputError(a, b[:, None, :], delay=1, noise_variance=noise, dt=dt, **channels)
            return model, model.to_state_space()
        from scipy.linalg import block_diag

        n = self.order
        A = [np.column_stack([-row, np.eye(n)[:, : n - 1]]) for row in a]
        C = np.asarray(block_diag(*(np.eye(n)[:1] for _ in a)))
        still = np.zeros((n * len(a), n * len(a)))
        model = StateSpace(
            np.asarray(block_diag(*A)), b.ravel()[:, None], C, Q=still, R=np.diag(noise), dt=0, **channels
        )
        return model, _with_input_now(model.discretise(dt, hold=first.hold))


def _with_input_now(model: StateSpace) -> StateSpace:
    """x+ = A x + B u + E u+ without E: in the states z = x - E u."""
    if model.B_end is None:
        return model
    A, B, C, D, E = (np.asarray(getattr(model, name)) for name in ("A", "B", "C", "D", "B_end"))
    return StateSpace(
        A, B + A @ E, C, D + C @ E, Q=model.Q, R=model.R, dt=model.dt, inputs=model.inputs, outputs=model.outputs
    )


def _coherence(name: str, value: float) -> Check:
    """Check that the output moves at the frequencies of the input only."""
    found = f"Coherence: {value:.1%} of the variation of {name} is at the given frequencies"
    if value >= COHERENT:
        return Check("coherence", True, value, COHERENT, f"{found}.")
    advice = "the rest is noise, a transient (raise `settle`) or a nonlinearity of the plant"
    return Check("coherence", False, value, COHERENT, f"{found}: {advice}.")
