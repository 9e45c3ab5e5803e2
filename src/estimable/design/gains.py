"""Stationary gains of the Kalman filter and the linear-quadratic regulator."""

from typing import Any

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..errors import AssumptionError
from ..kernels.joseph import stationary
from ..kernels.riccati import UNSETTLED, care, dare
from ..models.constant import check_constant, check_noise
from ..models.state_space import StateSpace
from ..results import FeedbackGain, KalmanGain

LIMIT = 3e-14  # of the fastest pole: nearer than this to the limit of stability, rounding decides


def kalman_gain(model: StateSpace) -> KalmanGain:
    """The gain of the Kalman filter of a constant model in steady state.

    P is the covariance of the error of the prediction, and S the covariance of process noise with measurement noise. A
    discrete model has P = A P A' + G Q G' - (A P C' + G S) (C P C' + R)^-1 (A P C' + G S)'. A continuous model has
    A P + P A' + G Q G' - P C' R^-1 C P = 0, where Q and R are both densities (per second).

    Assumes that the outputs show every unstable mode, and that noise excites every mode on the limit of stability. Otherwise,
    or with linearly dependent noise-free outputs, there is no stationary filter, and the function raises `AssumptionError`.
    It raises `InputError` for a model that varies in time or has no R, and for a singular R in continuous time.

    Returns a `KalmanGain`. Cost: about 200 n³ multiplications (7 ms at n = 100).

    Reference: B. D. O. Anderson, J. B. Moore, Optimal Filtering (1979), §4.4 (4.1) and §5.4 (S).

    >>> model = StateSpace([[1.0]], Q=[[1.0]], R=[[1.0]], dt=1)
    >>> round(float(kalman_gain(model).filter[0, 0]), 6)  # (sqrt(5) - 1) / 2
    0.618034
    """
    faults = checks.Faults()
    if faults.instance("model", model, StateSpace):
        check_constant(model, faults)
        check_noise(model, faults)
    faults.finish()
    A, C, Q, R = model.A, model.C, model.G @ model.Q @ model.G.T, model.R
    if model.is_continuous:
        P, K, F = care(A.T, C.T, Q, R)
        return KalmanGain(K.T, K.T, P, P, R, _poles(F, continuous=True))
    P, K, F = dare(A.T, C.T, Q, R, None if model.S is None else model.G @ model.S)
    S = C @ P @ C.T + R
    filter_gain = np.linalg.solve(S, C @ P).T
    J = np.eye(model.n) - filter_gain @ C
    P_filtered = J @ P @ J.T + filter_gain @ R @ filter_gain.T
    return KalmanGain(filter_gain, K.T, (P_filtered + P_filtered.T) / 2, P, S, _poles(F, continuous=False))


def _poles(F: np.ndarray, *, continuous: bool) -> Any:
    """The eigenvalues of a loop; an error where one is on the limit of stability."""
    z = np.linalg.eigvals(F)
    if np.max(z.real / (np.abs(z).max() or 1.0) if continuous else np.abs(z) - 1) > -LIMIT:
        raise AssumptionError(UNSETTLED)
    return z


def filter_covariance(model: StateSpace, filter: Numbers) -> Any:
    """The covariance (n, n) of the error of a filter with a given gain, in steady state, after each sample.

    `model`: discrete and constant, with Q and R. `filter` (n, p): the gain K, x[k|k] = x[k|k-1] + K e with e the innovation.
    For any gain P = Ψ P Ψ' + (I - K C) G Q G' (I - K C)' + K R K' with Ψ = (I - K C) A. The gain of `kalman_gain` has the
    smallest P, in every direction at once.

    Raises `InputError` for wrong shapes and for models that vary, are continuous or have no R; `AssumptionError` where the
    error grows.

    Reference: R. W. Bass (2005).

    >>> model = StateSpace([[1.0]], Q=[[1.0]], R=[[1.0]], dt=1)
    >>> filter_covariance(model, [[1.0]]), filter_covariance(model, kalman_gain(model).filter).round(3)
    (array([[1.]]), array([[0.618]]))
    """
    faults = checks.Faults()
    if faults.instance("model", model, StateSpace):
        check_constant(model, faults)
        check_noise(model, faults)
        if model.is_continuous:
            faults.add("`model` must be discrete, because the gain applies to a sample: give model.discretise(dt).")
        faults.learn("n", model.n, model.size_source)
        faults.learn("p", model.p, f"the model has {checks.counted(model.p, 'output')}")
    K = faults.array("filter", filter, "n p")
    faults.finish()
    GS = None if model.S is None else model.G @ model.S
    return stationary(model.A, model.C, K, model.G @ model.Q @ model.G.T, model.R, GS)


def lqr_gain(model: StateSpace, L: Numbers, M: Numbers, N: Numbers | None = None) -> FeedbackGain:
    """The feedback that minimises the cost Σ x'L x + u'M u + 2 x'N u of a constant model (in continuous time the integral).

    L (n, n) weights the state and M (m, m) the input; both are symmetric. N (n, m) couples them (default zero).

    Assumes that the inputs reach every unstable mode, and that every mode on the limit of stability has a cost. Otherwise it
    raises `AssumptionError`. It raises `InputError` for wrong shapes, for weights that are not jointly positive semidefinite,
    for a model that varies in time or has no input, and for a singular M in continuous time.

    Returns a `FeedbackGain`. Cost: about 200 n³ multiplications.

    Reference: H. Kwakernaak, R. Sivan, Linear Optimal Control Systems (1972), §3.4 and §6.4. With L = C'C the regulator of a
    model is the Kalman filter of the transposed model.

    >>> model = StateSpace([[1.0]], [[1.0]], dt=1)
    >>> round(float(lqr_gain(model, [[1.0]], [[1.0]]).feedback[0, 0]), 6)
    0.618034
    """
    faults = checks.Faults()
    weights = None
    if faults.instance("model", model, StateSpace):
        check_constant(model, faults)
        weights = _weights(model, L, M, N, faults)
    faults.finish()
    assert weights is not None
    X, K, F = (care if model.is_continuous else dare)(model.A, model.B, *weights)
    return FeedbackGain(K, X, _poles(F, continuous=model.is_continuous))


def _weights(model: StateSpace, L: Numbers, M: Numbers, N: Numbers | None, faults: checks.Faults) -> Any:
    """L, M and N, checked alone and together; None where invalid."""
    for axis in ("n", "m"):
        size = getattr(model, axis)
        faults.learn(axis, size, f"the model has {checks.counted(size, 'state' if axis == 'n' else 'input')}")
    if model.m == 0:
        faults.add("`model` has no input: give B, StateSpace(A, B, ...).")
        return None
    state, control = faults.covariance("L", L, "n n"), faults.covariance("M", M, "m m")
    cross = np.zeros((model.n, model.m)) if N is None else faults.array("N", N, "n m")
    if state is None or control is None or cross is None:
        return None
    if model.is_continuous:
        faults.positive_definite("M", control)
    joint = np.block([[state, cross], [cross.T, control]])
    smallest = np.linalg.eigvalsh(joint)[0]
    if smallest < -checks.ROUNDING * len(joint) * np.abs(joint).max():
        faults.add(f"[[L, N], [N.T, M]] must be positive semidefinite: its smallest eigenvalue is {smallest:.6g}.")
    return state, control, cross
