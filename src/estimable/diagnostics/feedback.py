"""A test whether the inputs of a record were computed from its outputs."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .. import checks
from ..data.record import Record, several
from ..frozen import saved
from ..kernels.regression import lagged

REACHES, OWN_REACHES = (12, 6, 3), (20, 8, 3)  # most rows of the past that predict an output, and an input
LEAST = 3  # rows of the past, at least
RECENT = 8  # rows whose residuals the inputs may depend on
ROWS = 3  # rows for each regressor
LEVEL = 1e-3  # p-value below which there is feedback
WHITE = 1e-2  # p-value below which an input depends on its own past
TINY = float(np.finfo(float).tiny)
EXACT = 1e-10  # of its square: what remains of an input that its past predicts exactly
ROUNDING = 1e-9  # of the size of an output: residuals that are no noise


@saved
class Feedback(NamedTuple):
    """The result of `feedback`.

    - `earlier`: the p-value of the inputs' dependence on noise of earlier rows, which only feedback can cause. None: too few
      rows.
    - `same_row`: the p-value of their dependence on noise of the same row. The cause is feedback within the row, or an input
      that acts on the outputs at once. None: too few rows.
    - `direct`: whether the inputs act at once, where that is known.
    - `white`: whether the inputs do not depend on their own past. Those of a loop do.
    """

    earlier: float | None
    same_row: float | None
    direct: bool | None
    white: bool

    @property
    def p(self) -> float:
        """The smaller p-value of those that prove feedback; 1 where there are too few rows."""
        return min(
            (p for p in (self.earlier, self.same_row if self.direct is False else None) if p is not None), default=1.0
        )

    @property
    def closed(self) -> bool:
        """Whether there is feedback."""
        return self.p < LEVEL

    @property
    def unclear(self) -> bool:
        """Whether there is feedback within the row or a direct effect of an input, which the record does not distinguish."""
        return (
            self.direct is None
            and not self.closed
            and not self.white
            and self.same_row is not None
            and self.same_row < LEVEL
        )

    @property
    def sentence(self) -> str:
        """The verdict as a sentence."""
        if self.earlier is None:
            return "The record is too short, or has too many gaps, to test for feedback."
        if self.closed:
            return f"The record was made in a closed loop: the input depends on the noise of the output (p = {self.p:.1g})."
        if self.unclear:
            return (
                "The input and the noise of the output are correlated in the same row. Either the input acts at once, or it was "
                'computed from that output; if so, say feedback="closed".'
            )
        return "No feedback from the output to the input is seen, which does not exclude a weak one."


def feedback(record: Record | Sequence[Record], *, direct: bool | None = None) -> Feedback:
    """Test whether the inputs depend on the noise of the outputs, as in a closed loop.

    The outputs are regressed on their past and on the inputs' past, with an order chosen by BIC. The inputs are then regressed
    on their own past, and on the residuals e of that regression in the same row and the seven rows before. An input that was
    not computed from the outputs does not depend on e, whether it is a sweep, a step or noise. (Regressing it on the outputs
    themselves, as in Granger's test, finds feedback in every open-loop sweep.)

    `direct`: whether an input acts on the outputs in its own row. True: only earlier rows count. False: the same row counts.
    None: not known; then a dependence within the row has two possible causes.

    Returns a `Feedback`. False alarms are about 1 in 1,000. No alarm is no proof: a loop with a gain of .4, a sensor noise of
    .5 and 200 rows is found in 98 % of the records, one with a gain of .1 in 4 %, and in 45 % with 1,000 rows. Rows with a
    missing value are left out.

    Cost: two QR factorisations for the outputs and six for each input, of up to 40 columns.
    Reference: C. Granger (1969); P. Caines, C. Chan (1975).

    >>> u = np.random.default_rng(0).normal(size=500)
    >>> record = simulate(OutputError([-0.5], [1.0], delay=1, noise_variance=0.1, dt=1), u, seed=0).record
    >>> diagnostics.feedback(record).closed
    False
    """
    faults = checks.Faults()
    records = several("record", record, faults)
    if direct is not None:
        faults.flag("direct", direct)
    if records and not records[0].inputs:
        faults.add("`record` has no input, so there is no feedback to test: give `u`.")
    faults.finish()
    direct = True if records[0].hold == "first_order" else direct
    gap = ((0, OWN_REACHES[0]), (0, 0))  # missing rows between records
    u, y = (
        np.concatenate([np.pad(x, gap, constant_values=np.nan) for x in each])
        for each in ([one.applied() for one in records], [one.y for one in records])
    )
    ones = np.ones((len(u), 1))
    own = [_predicted(ones, u, target[:, None], OWN_REACHES) for target in u.T]
    earlier, same_row = (_p_value(u, y, own, same_row=same_row) for same_row in (False, True))
    return Feedback(earlier, same_row, direct, all(map(is_white, u.T)))


def is_white(u: np.ndarray) -> bool:
    """Whether an input (T,) does not depend on its own past, as noise or a random sequence; False with too few rows."""
    past = np.column_stack([np.ones(len(u)), lagged(u, range(1, LEAST + 1))])
    p = _added(past[:, :1], past[:, 1:], u)
    return p is not None and p >= WHITE


def _p_value(u: np.ndarray, y: np.ndarray, own: Sequence["_Predicted | None"], *, same_row: bool) -> float | None:
    """The smallest p-value of any input (T, m), on one row and on `RECENT` rows of residuals, times the number of these tests.

    `own`: the regression of each input on the past of all. None where there are too few rows.
    """
    now = np.column_stack([np.ones(len(u)), *([] if same_row else [u])])
    output = _predicted(now, np.concatenate([u, y], axis=1), y, REACHES)
    if output is None:
        return None
    if np.nansum(output.e**2) <= ROUNDING**2 * np.nansum(y**2):
        return 1.0
    tests = []
    for input, target in zip(own, u.T, strict=True):
        if input is None:
            continue
        for rows in (1, RECENT):
            late = range(rows) if same_row else range(1, rows + 1)
            tests.append(_added(input.past, np.concatenate([lagged(one, late) for one in output.e.T], axis=1), target))
    known = [p for p in tests if p is not None]
    return min(1.0, len(known) * min(known)) if known else None


class _Predicted(NamedTuple):
    """The `past` (T, d) that predicts a series, and what it leaves e (T, p), NaN where a value is missing."""

    past: np.ndarray
    e: np.ndarray


def _predicted(now: np.ndarray, x: np.ndarray, y: np.ndarray, reaches: Sequence[int]) -> _Predicted | None:
    """The regression of y (T, p) on `now` and on as many rows of x (T, k) before it as BIC chooses; None with too few rows.

    `reaches`: the most rows to try, the first for which the record is long enough.
    """
    T, k = x.shape
    for most in reaches:
        late = np.stack([lagged(one, range(1, most + 1)) for one in x.T], axis=2).reshape(T, most * k)
        past = np.concatenate([now, late], axis=1)
        rows, d = ~(np.isnan(past).any(axis=1) | np.isnan(y).any(axis=1)), past.shape[1]
        N = int(rows.sum())
        if ROWS * d > N:
            continue
        R = np.asarray(np.linalg.qr(np.concatenate([past[rows], y[rows]], axis=1), mode="r"))
        left = np.cumsum(R[::-1, d:] ** 2, axis=0)[::-1]  # row n: the squares that n columns leave, on the same rows
        sizes = range(now.shape[1] + min(LEAST, most) * k, d + 1, k)
        bic = [N * np.sum(np.log(np.maximum(left[n] / N, TINY))) + n * y.shape[1] * np.log(N) for n in sizes]
        n = sizes[int(np.argmin(bic))]
        θ = np.linalg.lstsq(R[:n, :n], R[:n, d:], rcond=1e-12)[0]
        return _Predicted(past[:, :n], y - past[:, :n] @ θ)
    return None


def _added(past: np.ndarray, more: np.ndarray, y: np.ndarray) -> float | None:
    """The p-value of the F test of `more` columns in the regression of y (T,) on `past`; None with too few rows.

    1 where the past predicts y exactly, or where `more` is rounding.
    """
    from scipy.special import fdtrc

    whole = np.column_stack([past, more, y])
    whole = whole[~np.isnan(whole).any(axis=1)]
    N, k, d = len(whole), past.shape[1], past.shape[1] + more.shape[1]
    if ROWS * d > N:
        return None
    squares = np.asarray(np.linalg.qr(whole, mode="r"))[:, -1] ** 2
    without, left = squares[k:].sum(), squares[d:].sum()
    if without <= EXACT * np.sum((whole[:, -1] - whole[:, -1].mean()) ** 2):
        return 1.0
    return float(fdtrc(d - k, N - d, (without - left) / (d - k) / max(left / (N - d), TINY)))
