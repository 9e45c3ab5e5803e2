"""Weights that depend on one number η: the designs of rho synthesis."""

from dataclasses import KW_ONLY
from typing import Any

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..frozen import frozen, replace, set_field, static
from ..models.state_space import StateSpace

FASTEST = 1e100  # largest η: its square is finite


@frozen
class DesignFamily:
    """A family of quadratic costs x'Q x + 2 x'S u + u'R u with one parameter η, for `rho_synthesis`.

    Model: Q(η) = Q0 + p Q01 + p² Q1 and S(η) = S0 + p S1; R is fixed. Here p = η. Where `dt` is given, p = -exp(-η dt), so
    that η is a rate per second for a discrete model too.

    For a filter, Q, S and R are the covariances of process noise, cross noise and measurement noise. For a discrete filter S
    must be zero, or `next_output` must be True: then S and R belong to the next output, C A x + noise.

    Settings: `R` (m, m); `Q0`, `Q01`, `Q1` (n, n); `S0`, `S1` (n, m). Matrices that are not given are zero, but Q0 or Q1 is
    needed. [[Q, S], [S', R]] must be positive semidefinite at every η that is used. If Q01 = S0 = 0, this holds for every η
    if Q0 and Q1 - S1 R^-1 S1' are positive semidefinite. It always holds for families made by `factored`. For LQG/LTR give
    Q0 = G Q G' and Q1 = B V B'.

    Reference: R. W. Bass (2005): R fixed, S linear and Q quadratic in η.

    >>> family = DesignFamily([[1.0]], Q0=[[0.0]], Q1=[[1.0]])
    >>> family.at(2.0)[0].tolist()
    [[4.0]]
    """

    R: Any
    _: KW_ONLY
    Q0: Any = None
    Q01: Any = None
    Q1: Any = None
    S0: Any = None
    S1: Any = None
    dt: Any = None
    next_output: bool = static(default=False)

    def __post_init__(self):
        faults = checks.Faults()
        faults.flag("next_output", self.next_output)
        read: dict[str, Any] = {"R": faults.covariance("R", self.R, "m m")}
        for name in ("Q0", "Q1", "Q01"):
            given = getattr(self, name)
            check = faults.array if name == "Q01" else faults.covariance
            read[name] = None if given is None else check(name, given, "n n")
        for name in ("S0", "S1"):
            given = getattr(self, name)
            read[name] = None if given is None else faults.array(name, given, "n m")
        if self.Q0 is None and self.Q1 is None:
            faults.add("`Q0` or `Q1` must be given: without them the state has no weight.")
        read["dt"] = None if self.dt is None else faults.number("dt", self.dt, above=0.0, unit="seconds")
        faults.finish()
        n, m = faults.sizes["n"], faults.sizes["m"]
        blank = {"Q0": (n, n), "Q01": (n, n), "Q1": (n, n), "S0": (n, m), "S1": (n, m)}
        set_field(
            self, **{name: np.zeros(blank[name]) if v is None and name in blank else v for name, v in read.items()}
        )

    @property
    def n(self) -> int:
        """Number of states."""
        return self.Q0.shape[0]

    @property
    def m(self) -> int:
        """Number of inputs (for a filter: outputs)."""
        return self.R.shape[0]

    def at(self, eta: float) -> tuple[Any, Any, Any]:
        """Q (n, n), S (n, m) and R (m, m) at one η."""
        faults = checks.Faults()
        eta = faults.number("eta", eta, lower=-FASTEST, upper=FASTEST)
        faults.finish()
        p = eta if self.dt is None else -np.exp(-eta * self.dt)
        return self.Q0 + p * self.Q01 + p**2 * self.Q1, self.S0 + p * self.S1, self.R

    @staticmethod
    def factored(
        M0: np.ndarray, M1: np.ndarray, D: np.ndarray, *, weight: Numbers | None = None, dt: float | None = None
    ) -> "DesignFamily":
        """The family of the cost ||(M0 + p M1) x + D u||²_W, which is positive semidefinite at every η.

        M0 and M1 are (k, n), D is (k, m). `weight` W is (k, k); None: the identity.

        >>> DesignFamily.factored([[0.0]], [[1.0]], [[1.0]]).at(3.0)[1].tolist()
        [[3.0]]
        """
        faults = checks.Faults()
        M0, M1, D = faults.array("M0", M0, "k n"), faults.array("M1", M1, "k n"), faults.array("D", D, "k m")
        W = None if weight is None else faults.covariance("weight", weight, "k k")
        faults.finish()
        assert M0 is not None
        W = np.eye(len(M0)) if W is None else W
        cross = M0.T @ W @ M1
        return DesignFamily(
            _even(D.T @ W @ D), Q0=_even(M0.T @ W @ M0), Q01=cross + cross.T, Q1=_even(M1.T @ W @ M1), S0=M0.T @ W @ D,
            S1=M1.T @ W @ D, dt=dt,
        )  # fmt: skip

    @staticmethod
    def approach(model: StateSpace, *, weight: Numbers | None = None) -> "DesignFamily":
        """The family of feedbacks with which x follows dx/dt = -η x as closely as possible. The cost is ||dx/dt + η x||²_W.

        For a discrete model the cost is ||x[k+1] - exp(-η dt) x[k]||²_W. `weight` W (n, n) is symmetric and positive
        semidefinite. None: the identity, whose meaning depends on the units of the states. B'W B must not be singular.
        """
        checks.require(model=(model, StateSpace))
        return _approaching(model, model.A, model.B, weight)

    @staticmethod
    def approach_of_error(model: StateSpace, *, weight: Numbers | None = None) -> "DesignFamily":
        """The family of filters with which the error of the estimate follows exp(-η t) as closely as possible: `approach` by
        duality.

        `weight` is (n, n). C weight C' must not be singular (for a discrete model C A weight A' C'): no two outputs may be
        dependent.
        """
        checks.require(model=(model, StateSpace))
        if model.is_continuous:
            return _approaching(model, model.A.T, model.C.T, weight)
        return replace(_approaching(model, model.A.T, (model.C @ model.A).T, weight), next_output=True)


def _approaching(model: StateSpace, A: np.ndarray, B: np.ndarray, weight: Numbers | None) -> DesignFamily:
    dt = None if model.is_continuous else model.dt
    return DesignFamily.factored(A, np.eye(len(A)), B, weight=weight, dt=dt)


def _even(M: np.ndarray) -> Any:
    return (M + M.T) / 2


def joint(Q: np.ndarray, S: np.ndarray, R: np.ndarray) -> float:
    """The smallest eigenvalue of [[Q, S], [S', R]], relative to its largest entry; -0 is 0."""
    M = np.block([[Q, S], [S.T, R]])
    return float(np.linalg.eigvalsh(M)[0] / (np.abs(M).max() or 1.0))
