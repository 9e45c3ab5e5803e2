"""The parameters of an output-error model by maximum likelihood, from incomplete records."""

from collections.abc import Sequence
from dataclasses import KW_ONLY
from typing import Any

import numpy as np

from .. import checks
from ..annotations import Array
from ..data.record import Record
from ..diagnostics.cramer_rao import undetermined
from ..frozen import frozen, set_field, static
from ..kernels import impulse_start
from ..kernels.impulse_start import Datum
from ..kernels.innovation_information import Search
from ..models.output_error import OutputError
from ..protocols import StartedIdentifier
from ..results import Fit
from .one_output import OneOutput, Orders, covariance, fit_output
from .realised import check_lags
from .recursive_output_error import RecursiveOutputError
from .score_tests import score_checks, summary
from .uncertain_inputs import expected, fit_uncertain
from .validation import pole_checks, search_checks, sigma_check, validated

INITIAL = ("rest", "free")
LEVELS = {"none": 0, "estimated": 1, "trend": 2}
LEAST_NOISE = 1e-10  # of the mean square of an output: noise variance that the recursion assumes for noise-free data


@frozen
class OutputErrorML(StartedIdentifier):
    """The parameters of an output-error model by maximum likelihood, from one record or several with gaps.

    Model: `OutputError`; each output has its own polynomials. Outputs may be missing, and inputs are those that the actuator
    applied. Unknown inputs (not logged, or of unknown arrival as with UDP) enter with their means and variances.

    Assumes right orders, and a stable plant or an integrator. The estimate is the most accurate one for white Gaussian v. In
    other noise the method is nonlinear least squares: still consistent, with the covariance right to first order. Signals may
    be in absolute units, and the plant need not be at rest when a record begins. For on-line data, `RecursiveOutputError` is
    nearly as good.

    Settings: `na`, `nb`: degrees of A and B (Ljung's (na, nb, nk) is (na, nb - 1, delay = nk) here); `delay` in steps;
    `noise_variance` of v: one number, (p,), or None: estimated. `initial`: "free" (default):
    the past before row 0 is estimated too, max(na, nb + delay) numbers per output and record; "rest": the plant is at rest
    before row 0. `level`: "estimated" (default): a constant is added to each output, the same in all records; "trend": also a
    ramp from row 0 of each record; "none". `fit.extra["level"]` and `["slope"]` (per second) are (p, 2): values and standard
    deviations; `fit.model.level` is the level at the last row. `arrival`: the rate at which
    inputs of unknown arrival arrive (default None: every arrival is known). Inputs that were not logged (NaN) are assumed to
    be like the logged ones.

    Stamps that scatter are used as they are. The poles are then those of a continuous system, whose coefficients at the median
    step are reported; nb + delay is at most na, and the input is held from stamp to stamp.

    `sigma` of a record is the standard deviation of v of each sample. `noise_variance` is then that of the samples for which it
    is NaN; `fit.model` has that, or where there are none the mean square of `sigma`.

    The likelihood is that of the seen outputs. It is maximised by the Levenberg-Marquardt method with exact derivatives, from
    several starts: a long impulse response fitted linearly and, in `identify`, the estimate of `RecursiveOutputError`. Poles
    beyond .999 are mirrored and cut to it. A real pole there that does not differ from 1 significantly is fixed at 1 (an
    integrator: its level is its initial state); otherwise the check "stability" fails with the pole.

    The covariance is H^-1 M H^-1 with the spectrum of the residuals (an autoregression) in M, so that it holds in noise of any
    colour; `fit.covariance_white` is the inverse of the information. Directions of the parameters without information are in
    `fit.undetermined`, and the covariance is that of the other directions.

    Cost: about 20 passes over the T samples, each of O(T d) operations for d parameters: 10 ms at T = 1000.

    Reference: L. Ljung, System Identification (1999), §7.4, §9.2 and §10.2; H. Fang (2009), (3.1)-(3.4) for the losses.

    >>> plant = OutputError([-0.5], [1.0], noise_variance=0.01, dt=1)
    >>> u = np.random.default_rng(1).normal(size=300)
    >>> fit = identify(OutputErrorML(1, 0), simulate(plant, u, seed=1, output_link=BernoulliLink(0.5)).record)
    >>> bool(abs(fit.parameters[0] + 0.5) < 4 * fit.sigma[0]), bool(abs(fit.model.noise_variance[0] - 0.01) < 0.004)
    (True, True)
    """

    na: int = static()
    nb: int = static()
    _: KW_ONLY
    delay: int = static(default=0)
    noise_variance: Any = None
    initial: str = static(default="free")
    level: str = static(default="estimated")
    arrival: Any = None

    takes_unknown_inputs = True  # their variance enters the likelihood
    cannot_weigh = ""

    def __post_init__(self):
        faults = checks.Faults()
        for name in ("na", "nb", "delay"):
            faults.whole(name, getattr(self, name), 0, checks.LARGEST_ORDER)
        faults.choice("initial", self.initial, INITIAL)
        faults.choice("level", self.level, tuple(LEVELS))
        noise = self.noise_variance
        if noise is not None:
            noise = faults.array("noise_variance", np.atleast_1d(noise), "p")
            if noise is not None and np.any(noise <= 0):
                faults.add(
                    f"`noise_variance` must be greater than 0, or None. Got {checks.short(self.noise_variance)}."
                )
        arrival = self.arrival
        if arrival is not None:
            arrival = faults.number("arrival", arrival, above=0.0, upper=1.0)
        faults.finish()
        set_field(self, noise_variance=noise, arrival=arrival)

    in_a_loop = "white"

    def starter(self, records: Sequence[Record]) -> RecursiveOutputError | None:
        """The recursion whose estimate is a second start; None where inputs are unknown, or at stamps that are multiples
        of no step: it supports neither."""
        if _uncertain(records) or at_stamps(records):
            return None
        noise = self.noise_variance
        if noise is None:
            outputs = by_output(records)
            found = [impulse_start.residual_variance(self.na, self.nb, self.delay, data) for data in outputs]
            sizes = [np.mean(np.concatenate([one.y[one.seen] for one in data]) ** 2) for data in outputs]
            noise = np.maximum(found, np.maximum(LEAST_NOISE * np.array(sizes), np.finfo(float).tiny))
        return RecursiveOutputError(self.na, self.nb, delay=self.delay, noise_variance=noise)

    def fit(self, records: Sequence[Record], start: Array | None = None, search: Search | None = None) -> Fit:
        """The fit to records of equal channels, and of one step or with stamps; `start` (d,) is one more start.

        `search` maximises the likelihood where inputs are unknown: `identify` gives it.

        Raises `InputError` where an input has no known values or arrival rate, or an output was never seen.
        """
        self.check(records)
        inputs = expected(records, self.arrival) if _uncertain(records) else None
        if inputs is not None and search is None:
            checks.refuse(
                "some inputs are unknown: use identify(OutputErrorML(...), record), which searches the likelihood then."
            )
        first, noises = records[0], self.noise_variance
        past = max(self.na, self.nb + self.delay) if self.initial == "free" else 0
        orders = Orders(self.na, self.nb, self.delay, past, LEVELS[self.level])
        d = self.na + len(first.inputs) * (self.nb + 1)
        ends = []
        for i, data in enumerate(by_output(records)):
            if inputs is not None and search is not None:
                ends.append(fit_uncertain(orders, data, inputs, None if noises is None else float(noises[i]), search))
                continue
            starts = [] if start is None else [np.asarray(start)[i * d : (i + 1) * d]]
            ends.append(fit_output(orders, data, starts, None if noises is None else float(noises[i])))
        return self._assembled(records, ends)

    def check(self, records: Sequence[Record]) -> None:
        """Check that every output was seen at least once and has a noise variance."""
        faults, first = checks.Faults(), records[0]
        check_lags(self, records, faults)
        if self.noise_variance is not None and len(self.noise_variance) != len(first.outputs):
            outputs = checks.counted(len(first.outputs), "output")
            faults.add(f"`noise_variance` must hold one value for each of {outputs}. Got {len(self.noise_variance)}.")
        seen = np.concatenate([record.seen for record in records])
        never = [name for i, name in enumerate(first.outputs) if not seen[:, i].any()]
        if never:
            faults.add(f"output {checks.listed(never)} was never seen: there is nothing to fit. Leave it out.")
        if at_stamps(records):
            self._check_stamps(records, faults)
        faults.finish()

    def _check_stamps(self, records: Sequence[Record], faults: checks.Faults) -> None:
        """Check that a continuous system with known, held inputs has this form."""
        if self.nb + self.delay > self.na:
            faults.add(
                f"at stamps that are multiples of no step `nb` + `delay` must be at most na = {self.na}: no continuous system "
                f"responds otherwise. Got {self.nb + self.delay}."
            )
        if any(record.hold != "zero_order" for record in records):
            faults.add(
                'at stamps that are multiples of no step the input must be constant between them: hold = "zero_order".'
            )
        if _uncertain(records):
            faults.add("at stamps that are multiples of no step every input must be known: cut the records there.")

    def _assembled(self, records: Sequence[Record], ends: list[OneOutput]) -> Fit:
        first = records[0]
        θ, noise = np.concatenate([end.parameters for end in ends]), np.array([end.noise_variance for end in ends])
        levels = None if self.level == "none" else [self._level_at_the_end(end, records) for end in ends]
        model = OutputError.of_parameters(
            θ, na=self.na, nb=self.nb, delay=self.delay, noise_variance=noise, level=levels, dt=nominal_step(records),
            inputs=first.inputs, outputs=first.outputs,
        )  # fmt: skip
        M, L = (
            block_diagonal(list(blocks))
            for blocks in zip(*((end.information, end.slopes) for end in ends), strict=True)
        )
        free, white = np.linalg.qr(L @ undetermined(M))[0], L @ covariance(M) @ L.T
        coloured = [end.covariance for end in ends if end.covariance is not None]
        Σ = block_diagonal(coloured) if len(coloured) == len(ends) else white
        assumed = None if _uncertain(records) else self.noise_variance
        residuals = tuple(np.stack(columns, axis=1) for columns in zip(*(end.residuals for end in ends), strict=True))
        poles = pole_checks([end.pole for end in ends], first.outputs)
        validation = validated(model, records, assumed, residuals, M, directions=free, stability=poles)
        spread = [] if len(coloured) < len(ends) else [sigma_check(Σ, white, model.parameter_names)]
        scores = score_checks(ends, records, self.arrival if _uncertain(records) else None)
        extra = (*spread, *search_checks(ends), *summary(scores))
        validation = validation._replace(checks=(*validation.checks, *extra), scores=tuple(scores))
        return Fit(
            model, θ, Σ, model.parameter_names, validation, None,
            sum(end.log_likelihood for end in ends), free if free.shape[1] else None, method=type(self).__name__,
            extra=self._levels(ends, nominal_step(records)), covariance_white=white,
        )  # fmt: skip

    def _level_at_the_end(self, end: OneOutput, records: Sequence[Record]) -> float:
        """c_0 + c_1 k at the last row; an integrator has none."""
        return (
            float(np.polyval(end.level[0][::-1], _elapsed(records)))
            if end.level.shape[1] == LEVELS[self.level]
            else 0.0
        )

    def _levels(self, ends: list[OneOutput], dt: float) -> dict[str, np.ndarray] | None:
        """The levels, and the slopes of a trend in units of an output per second, (p, 2) each: values and standard deviations."""
        if self.level == "none":
            return None
        columns = [np.pad(end.level, ((0, 0), (0, LEVELS[self.level] - end.level.shape[1]))) for end in ends]
        level, *slope = np.stack(columns).transpose(2, 0, 1)
        return {"level": level, "slope": slope[0] / dt} if slope else {"level": level}


def _uncertain(records: Sequence[Record]) -> bool:
    """Whether some input is unknown: not logged, or of unknown arrival."""
    return any(np.isnan(record.applied()).any() for record in records)


def block_diagonal(blocks: list[np.ndarray]) -> np.ndarray:
    """[[M1, 0], [0, M2]]."""
    from scipy.linalg import block_diag

    return np.asarray(block_diag(*blocks))


def by_output(records: Sequence[Record]) -> list[list[Datum]]:
    """The data of each output, record by record."""
    inputs, step, stamped = [np.asarray(one.applied()) for one in records], nominal_step(records), at_stamps(records)
    return [
        [
            Datum(
                u, record.y[:, i], record.seen[:, i], None if record.sigma is None else record.sigma[:, i],
                np.diff(record.t) / step if stamped else None,
            )
            for u, record in zip(inputs, records, strict=True)
        ]
        for i in range(len(records[0].outputs))
    ]  # fmt: skip


def at_stamps(records: Sequence[Record]) -> bool:
    """Whether the rows of some record have stamps that are multiples of no step."""
    return any(record.dt is None and record.t is not None for record in records)


def nominal_step(records: Sequence[Record]) -> float:
    """The step of the records; at stamps the median one."""
    if not at_stamps(records):
        return float(records[0].dt or 0.0)
    return float(f"{np.median(np.concatenate([np.diff(record.t) for record in records])):.9g}")


def _elapsed(records: Sequence[Record]) -> float:
    """The length of the last record, in nominal steps."""
    last = records[-1]
    return float(last.t[-1] - last.t[0]) / nominal_step(records) if at_stamps(records) else len(last) - 1
