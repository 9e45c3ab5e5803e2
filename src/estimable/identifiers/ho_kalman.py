"""A state-space model from an impulse response (Ho-Kalman, ERA)."""

from collections.abc import Sequence
from dataclasses import KW_ONLY
from typing import Any

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..data.record import Record
from ..frozen import frozen, static
from ..kernels.realisation import ho_kalman
from ..kernels.tangents import Dynamics, aligned, root
from ..models.state_space import StateSpace
from ..protocols import Identifier
from ..results import Fit
from .markov_parameters import WEIGHTINGS, MarkovParameters
from .realised import check_moving, check_records, impulse, impulse_covariance, impulse_names, persistence_check, whole
from .standing import validation_of

LENGTH = 20  # default number of Markov parameters; or two for each state and two more
STEP = 1e-3  # of a standard deviation: step of the numerical derivative


@frozen
class HoKalman(Identifier):
    """A state-space model of a given order from Markov parameters (the impulse response), which are estimated from a record
    or given.

    Model: x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k] + v[k], in balanced coordinates. `fit.model` has no process noise.

    Assumes what `MarkovParameters` assumes: a stable plant whose response dies out within `length` steps, and a long record.
    For given Markov parameters, `realise` needs only M_0 to M_q with q at most 2 n. If these are exact, so is the model.
    `Subspace` is better on short records.

    Settings: `order` n; `length`: the number of Markov parameters fitted to the record (None: 20 or 2 n + 2, the larger);
    `weighting` of their fit, as in `MarkovParameters`: "ordinary", "best" or "observer" (OKID).

    `fit.parameters` are the Markov parameters M_0 to M_2n of the model. They determine the model up to a choice of states.
    Their covariance follows from that of the fitted parameters, to first order. A gap in `fit.extra["singular_values"]` of
    the Hankel matrix shows the order.

    Cost: that of `MarkovParameters`, and two singular value decompositions of a Hankel matrix with length / 2 block rows for
    each parameter.

    Reference: B. L. Ho, R. E. Kálmán (1966); J.-N. Juang, R. S. Pappa (1985).

    >>> HoKalman(1).realise([1.0, 2.0, 1.0, 0.5], dt=1).A.round(12).tolist()
    [[0.5]]
    """

    order: int = static()
    _: KW_ONLY
    length: int | None = static(default=None)
    weighting: str = static(default="ordinary")

    in_a_loop = "biased"

    def __post_init__(self):
        faults = checks.Faults()
        faults.whole("order", self.order, 1, checks.LARGEST_ORDER)
        whole("length", self.length, 2, faults)
        faults.choice("weighting", self.weighting, WEIGHTINGS)
        faults.finish()

    @property
    def cannot_weigh(self) -> str:  # type: ignore[override]
        """That of `MarkovParameters` with the same weighting."""
        return MarkovParameters(1, weighting=self.weighting).cannot_weigh

    @property
    def label(self) -> str:
        """The class, and its weighting if it is not the ordinary one."""
        return "HoKalman" if self.weighting == "ordinary" else f"HoKalman {self.weighting}"

    def realise(
        self,
        markov_parameters: Numbers,
        *,
        dt: float,
        inputs: Sequence[str] | None = None,
        outputs: Sequence[str] | None = None,
    ) -> StateSpace:
        """The model of M_0, M_1, .. (length+1, p, m), or (length+1,) for one input and output; `dt` in seconds.

        Raises `InputError` where there are too few for the order.
        """
        faults = checks.Faults()
        given = np.asarray(markov_parameters)
        M = faults.array("markov_parameters", given[:, None, None] if given.ndim == 1 else given, "lags p m")
        faults.finish()
        assert M is not None
        self._check(len(M) - 1, *M.shape[1:])
        found = ho_kalman(M, self.order)
        p, n = found.C.shape
        return StateSpace(*found[:4], Q=np.zeros((n, n)), R=np.zeros((p, p)), dt=dt, inputs=inputs, outputs=outputs)

    def _check(self, length: int, p: int, m: int) -> None:
        needed = -(-self.order // p) + -(-self.order // m)
        if length < needed:
            checks.refuse(
                f"order {self.order} needs the Markov parameters up to M{needed} with {checks.counted(p, 'output')} and "
                f"{checks.counted(m, 'input')}. Got up to M{length}."
            )

    def fit(self, records: Sequence[Record]) -> Fit:
        """The fit to records of equal channels and step."""
        faults, first = checks.Faults(), records[0]
        check_records(records, faults)
        faults.finish()
        check_moving(records, faults)
        faults.finish()
        length = max(LENGTH, 2 * self.order + 2) if self.length is None else self.length
        self._check(length, len(first.outputs), len(first.inputs))
        fitted = MarkovParameters(length, weighting=self.weighting).fit(records)
        if fitted.covariance is None:
            checks.refuse(
                "these records do not determine an observer with that many terms: lower `length`, or record more samples."
            )
        M = fitted.model.b.transpose(2, 0, 1)
        found = ho_kalman(M, self.order)
        n = len(found.A)
        model = StateSpace(
            *found[:4], Q=np.zeros((n, n)), R=np.diag(fitted.model.noise_variance), dt=float(first.dt or 0.0),
            inputs=first.inputs, outputs=first.outputs,
        )  # fmt: skip
        moves, length = self._tangents(M, root(fitted.covariance), Dynamics(*found[:4])), 2 * self.order
        Σ = impulse_covariance(model, moves, length)
        extra: dict[str, Any] = {"singular_values": found.singular_values}
        excited = persistence_check(records, len(M) // 2, self.order)
        if excited.passed:
            extra["tangents"] = moves
        return Fit(
            model, impulse(model, length), Σ, impulse_names(length, first.inputs, first.outputs),
            validation_of(model, records, [excited]), method=type(self).__name__, extra=extra,
            undetermined=None if excited.passed else np.eye(len(Σ)),
        )  # fmt: skip

    def _tangents(self, M: np.ndarray, L: np.ndarray, base: Dynamics) -> Dynamics:
        """Changes of the model, in its own states, when M (L+1, p, m) moves by the columns of L (d, r) (central differences)."""
        moves, shape = [], (*M.shape[1:], len(M))
        for column in STEP * L.T:
            move = column.reshape(shape).transpose(2, 0, 1)
            up, down = (aligned(Dynamics(*ho_kalman(one, self.order)[:4]), base) for one in (M + move, M - move))
            moves.append([(above - below) / (2 * STEP) for above, below in zip(up, down, strict=True)])
        return Dynamics(*(np.stack(one) for one in zip(*moves, strict=True)))
