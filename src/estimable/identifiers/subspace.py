"""A state-space model by subspace identification: N4SID, MOESP, CVA."""

from collections.abc import Sequence
from dataclasses import KW_ONLY
from typing import Any

import numpy as np

from .. import checks
from ..data.record import Record
from ..frozen import frozen, static
from ..kernels import subspace_algorithms as kernel
from ..kernels.innovations_form import System, response
from ..kernels.subspace_spread import Drawn, spread
from ..kernels.tangents import Dynamics
from ..models.state_space import StateSpace
from ..protocols import Identifier
from ..results import Fit
from .least_squares import LeastSquares
from .realised import (
    check_moving,
    check_records,
    impulse,
    impulse_covariance,
    impulse_names,
    innovations_model,
    persistence_check,
    stationary_gain,
    whole,
)
from .standing import initial_state, system_of, validation_of

HORIZON = 15  # block rows where none are given
ROUNDS = 3  # of filling in missing outputs
FILL = 20  # length of the impulse response that fills them in first

Data = list[tuple[np.ndarray, np.ndarray]]


@frozen
class Subspace(Identifier):
    """A state-space model of a given order by subspace identification, from one record or several.

    Model: x[k+1] = A x[k] + B u[k] + K e[k], y[k] = C x[k] + D u[k] + e[k], e white. `fit.model` has this innovations form.

    Assumes an input that moves and does not depend on the outputs (no feedback: in closed loop the estimate is biased), and a
    record much longer than 2 (m + p) `horizon` rows. It needs no start and no search; `OutputErrorML` is usually a little
    better.

    Settings: `order` n; `weighting`: "moesp", "n4sid" or "cva" (similar for white inputs; CVA weights by the noise);
    `horizon` s in block rows (None: 15, or order + 2, or less for a short record); `feedthrough`: whether D is fitted;
    `draws`: the number of records drawn to compute the covariance (0: no covariance).

    A and C come from the shift of the observability matrix. B and D come from a regression of the outputs on the simulation,
    or on the predictions where A is not stable. K is that of the stationary Kalman filter for the residuals. Missing outputs
    are filled in for A, C and K: by an impulse response and then by the model's own simulation, three times. For B and D they
    are left out. Inputs must be known.

    `fit.parameters` are the Markov parameters M_0 to M_2n, which determine the model up to a choice of states. To find their
    covariance, the fitted model draws `draws` records under the same inputs, and the same estimate is made on each: the
    spread of these estimates is the covariance (a parametric bootstrap, B and D to first order; the same numbers in every
    call). Standard deviations are accurate to 1 / sqrt(2 draws), 11 %. The covariance is None for an unstable model. A gap in
    `fit.extra["singular_values"]` shows the order.

    Cost: 2 T (2 s (m + p))² operations, with T samples, and about as many for each draw.

    Reference: P. Van Overschee, B. De Moor (1996), Table 4.1, Figs 4.6-4.8; M. Verhaegen, P. Dewilde (1992).

    >>> u = np.random.default_rng(0).normal(size=300)
    >>> plant = ARX([-0.5], [1.0], delay=1, noise_variance=1e-12, dt=1)
    >>> fit = identify(Subspace(1), simulate(plant.to_state_space(), u, seed=0).record)
    >>> fit.model.A.round(4).tolist(), fit.parameters.round(4).tolist()
    ([[0.5]], [0.0, 1.0, 0.5])
    """

    order: int = static()
    _: KW_ONLY
    weighting: str = static(default="moesp")
    horizon: int | None = static(default=None)
    feedthrough: bool = static(default=True)
    draws: int = static(default=40)

    cannot_weigh = "its noise is stationary"
    in_a_loop = "biased"

    def __post_init__(self):
        faults = checks.Faults()
        faults.whole("order", self.order, 1, checks.LARGEST_ORDER)
        faults.choice("weighting", self.weighting, kernel.WEIGHTINGS)
        whole("horizon", self.horizon, 2, faults)
        faults.flag("feedthrough", self.feedthrough)
        faults.whole("draws", self.draws, 0, checks.MOST_ROWS)
        if isinstance(self.draws, int) and self.draws == 1:
            faults.add("`draws` must be 0, or at least 2: one draw has no spread.")
        faults.finish()

    @property
    def label(self) -> str:
        """The class and its weighting."""
        return f"Subspace {self.weighting}"

    def fit(self, records: Sequence[Record]) -> Fit:
        """The fit to records of equal channels and step. Raises `InputError` where they are too short for the order."""
        model, values = self.model(records)
        first, length = records[0], 2 * self.order
        extra: dict[str, Any] = {"singular_values": values}
        excited = persistence_check(records, self._check(records), self.order)
        Σ, moves = None, self._spread(model, records) if excited.passed else None
        names = impulse_names(length, first.inputs, first.outputs)
        if moves is not None:
            extra["tangents"], Σ = moves, impulse_covariance(model, moves, length)
        return Fit(
            model, impulse(model, length), Σ if excited.passed else np.zeros((len(names),) * 2), names,
            validation_of(model, records, [excited]), method=type(self).__name__, extra=extra,
            undetermined=None if excited.passed else np.eye(len(names)),
        )  # fmt: skip

    def _spread(self, model: StateSpace, records: Sequence[Record]) -> Dynamics | None:
        """Tangents of the estimate; None for an unstable model, or outputs without noise."""
        if not self.draws or np.abs(np.linalg.eigvals(model.A)).max() >= 1:
            return None
        base = Dynamics(model.A, model.B, model.C, model.D)
        how = Drawn(self._check(records), self.order, self.weighting, self.feedthrough)
        data = [(record.applied(), record.y) for record in records]
        try:
            return spread(base, np.asarray(model.G), np.asarray(model.R), data, how, self.draws)
        except np.linalg.LinAlgError:
            return None

    def model(self, records: Sequence[Record]) -> tuple[StateSpace, np.ndarray]:
        """The model of the fit alone, and the singular values."""
        s = self._check(records)
        data: Data = [(record.applied(), record.y) for record in records]
        gaps = any(np.isnan(y).any() for _, y in data)
        full = self._filled_first(records) if gaps else data
        model, values = self._model(full, data, s, records[0])
        for _ in range(ROUNDS if gaps else 0):
            model, values = self._model(self._filled(model, data), data, s, records[0])
        return model, values

    def _check(self, records: Sequence[Record]) -> int:
        """The horizon, after a check of the records that reports every fault at once."""
        faults, first = checks.Faults(), records[0]
        check_records(records, faults)
        faults.finish()
        check_moving(records, faults)
        m, p = len(first.inputs), len(first.outputs)
        least = -(-self.order // p) + 1  # block rows that show n states
        most = max((sum(len(r) for r in records) + 1) // (2 * (m + p + len(records))), 0)
        s = self.horizon if self.horizon is not None else max(min(max(HORIZON, self.order + 2), most), least)
        if s < least:
            faults.add(
                f"`horizon` must be at least {least} for order {self.order} with {checks.counted(p, 'output')}. Got {s}."
            )
        columns, needed = sum(max(len(r) - 2 * s + 1, 0) for r in records), 2 * s * (m + p)
        if columns < needed:
            faults.add(
                f"the record is too short for order {self.order} with horizon {s}: its data matrix has {columns} columns, but "
                f"{needed} are needed. Lower the order or the horizon, or use LeastSquares."
            )
        faults.finish()
        return s

    def _model(self, full: Data, data: Data, s: int, first: Record) -> tuple[StateSpace, np.ndarray]:
        """The model, with A, C and K from the `full` outputs, B and D from the seen ones; and the singular values."""
        found = kernel.dynamics(kernel.factor(full, s), self.order, self.weighting)
        A, C = found.A, found.C
        if np.abs(np.linalg.eigvals(A)).max() < 1:
            B, D = kernel.inputs_of(A, C, data, self.feedthrough)
        else:
            B, D = self._by_predictor(A, C, stationary_gain(A, C, found.noise)[0], full)
        return innovations_model((A, B, C, D), found.noise, first), found.singular_values

    def _by_predictor(self, A: np.ndarray, C: np.ndarray, K: np.ndarray, full: Data) -> tuple[np.ndarray, np.ndarray]:
        """B and D with which predictions are nearest: x+ = (A - K C) x + (B - K D) u + K y, a stable system."""
        F, none = A - K @ C, np.zeros((len(C), len(C)))
        driven = System(F, K, C, none, A, A, A)
        left = [(u, y - response(driven, y, np.zeros(len(A)))[0]) for u, y in full]
        B, D = kernel.inputs_of(F, C, left, self.feedthrough)
        return B + K @ D, D

    def _filled_first(self, records: Sequence[Record]) -> Data:
        """Missing outputs filled in by an impulse response, or by the mean where none can be fitted."""
        total = sum(len(record) for record in records)
        length = min(FILL, total // (4 * len(records[0].inputs)))
        model = LeastSquares(0, length).model(records)
        return [(r.applied(), np.where(r.seen, r.y, model.plant.response(r.applied()))) for r in records]

    def _filled(self, model: StateSpace, data: Data) -> Data:
        """Missing outputs filled in by the model's simulation."""
        system, full = system_of(model), []
        for u, y in data:
            simulated, _ = response(system, u, initial_state(system, u, y))
            full.append((u, np.where(np.isnan(y), simulated, y)))
        return full
