"""A state-space model from data of an open or a closed loop, by subspaces of the predictor: SSARX, PBSID."""

from collections.abc import Sequence
from dataclasses import KW_ONLY
from typing import Any

import numpy as np

from .. import checks
from ..data.record import Record
from ..frozen import frozen, static
from ..kernels import closed_loop_subspace as kernel
from ..models.state_space import StateSpace
from ..protocols import Identifier
from ..results import Fit
from .realised import check_moving, check_records, impulse, impulse_covariance, impulse_names, whole
from .standing import validation_of

WEIGHTINGS = tuple(kernel.METHODS)
PAST = {"ssarx": 15, "pbsid": 20}
FUTURE = 8  # rows, at least two more than the order


@frozen
class PredictorSubspace(Identifier):
    """A state-space model of a given order from a record of an open or a closed loop, without a search.

    Model: x[k+1] = A x[k] + B u[k] + K e[k], y[k] = C x[k] + e[k], e white. `fit.model` has this innovations form.

    Assumes that an input acts one row later or more (D = 0), that feedback, if any, leaves something in the input that does
    not come from the outputs, and a record much longer than (m + p) `past` rows. Feedback does no harm, nor does an unstable
    plant. In open loop, `Subspace` fits a direct term and fills in missing outputs; `PredictionError`, which starts from this
    estimate, is more accurate for white noise and right orders.

    Settings: `order` n; `weighting`: "ssarx" (canonical correlations of past and future) or "pbsid" (predictions); `past`: the
    order of the ARX model behind both (None: 15 and 20, or less for a short record); `blocks`: the number of parts of the
    record that are left out, one at a time, to compute the covariance (0: no covariance).

    An ARX model of high order is consistent in a loop. Its coefficients give predictions, or remove the effect of later inputs
    and outputs from future outputs; the state is the part of these that the past determines. C, then A, B and K, are
    regressions. Rows with a missing value in their window of `past` + 8 rows are left out.

    `fit.parameters` are the Markov parameters M_0 = 0 to M_2n. Their covariance is that of the jackknife over blocks; standard
    deviations are accurate to 1 / sqrt(2 blocks), 11 %.

    Cost: 2 T ((m + p) (past + 8))² operations, with T samples.

    Reference: M. Jansson (2003), SSARX; A. Chiuso (2007), PBSID.

    >>> u = np.random.default_rng(0).normal(size=300)
    >>> plant = ARX([-0.5], [1.0], delay=1, noise_variance=0.01, dt=1)
    >>> fit = identify(PredictorSubspace(1), simulate(plant.to_state_space(), u, seed=0).record)
    >>> bool(abs(fit.model.A[0, 0] - 0.5) < 0.02)
    True
    """

    order: int = static()
    _: KW_ONLY
    weighting: str = static(default="ssarx")
    past: int | None = static(default=None)
    blocks: int = static(default=40)

    fits_series = True

    def __post_init__(self):
        faults = checks.Faults()
        faults.whole("order", self.order, 1, checks.LARGEST_ORDER)
        faults.choice("weighting", self.weighting, WEIGHTINGS)
        whole("past", self.past, 1, faults)
        faults.whole("blocks", self.blocks, 0, checks.MOST_ROWS)
        if isinstance(self.blocks, int) and self.blocks == 1:
            faults.add("`blocks` must be 0, or at least 2: one block has no spread.")
        faults.finish()

    @property
    def label(self) -> str:
        """The class and its weighting."""
        return f"PredictorSubspace {self.weighting}"

    def fit(self, records: Sequence[Record]) -> Fit:
        """The fit to records of equal channels and step. Raises `InputError` where they are too short for the order."""
        sizes, found = self._found(records)
        first, length = records[0], 2 * self.order
        model = StateSpace(
            found.A, found.B, found.C, np.zeros((sizes.p, sizes.m)), G=found.K, Q=found.Σ, R=found.Σ, S=found.Σ,
            dt=float(first.dt or 0.0), inputs=first.inputs, outputs=first.outputs,
        )  # fmt: skip
        Σ = None
        extra: dict[str, Any] = {"singular_values": found.singular_values}
        if self.blocks:
            moves = kernel.spread(found, sizes, self.weighting)
            extra["tangents"], Σ = moves, impulse_covariance(model, moves, length)
        return Fit(
            model, impulse(model, length), Σ, impulse_names(length, first.inputs, first.outputs),
            validation_of(model, records), method=type(self).__name__, extra=extra,
        )  # fmt: skip

    def innovations_form(self, records: Sequence[Record]) -> kernel.InnovationsForm:
        """A, B, C, K and the covariance of e alone. Raises `InputError` where the records are too short for the order."""
        return self._found(records)[1]

    def _found(self, records: Sequence[Record]) -> tuple[kernel.Windows, kernel.InnovationsForm]:
        faults, first = checks.Faults(), records[0]
        check_records(records, faults)
        faults.finish()
        check_moving(records, faults)
        faults.finish()
        q, ahead = len(first.inputs) + len(first.outputs), max(FUTURE, self.order + 2)
        ahead = ahead if self.weighting == "ssarx" else 1
        most = sum(len(one) for one in records) // (3 * q) - ahead
        past = self.past or max(min(PAST[self.weighting], most), self.order + 1)
        data = [(record.applied(), record.y) for record in records]
        sizes = kernel.windows(data, past, ahead, max(self.blocks, 1))
        if sizes is None or self.order > min(past * q, ahead * len(first.outputs) if ahead > 1 else past):
            checks.refuse(
                f"the record is too short, or has too many gaps, for order {self.order} with {past} rows of the past: it has no "
                f"{2 * (past + ahead) * q} windows of {past + ahead} complete rows. Lower the order or `past`, or use "
                "PredictionError."
            )
        found = kernel.METHODS[self.weighting](sizes.whole, sizes, self.order)
        if len(found.A) < self.order:
            checks.refuse(
                f"the record shows {checks.counted(len(found.A), 'state')}, and `order` is {self.order}: lower it."
            )
        return sizes, found
