"""The same model with independent process and measurement noise."""

import numpy as np

from .. import checks
from .state_space import StateSpace


def uncorrelated(model: StateSpace) -> StateSpace:
    """A model with the same outputs as `model` but without cross noise S and without operating point, as `ControlledPlant`
    needs it.

    The process noise is split: w = S R^+ v + a part that is uncorrelated with v, with R^+ the pseudo-inverse. The measurement
    noise v becomes part of the state. The new model has n + p states, the last p named after the noises of the outputs, and
    R = 0. Its signals are deviations from the operating point, and its outputs have the same distribution. For discrete,
    constant models.

    Raises `InputError` for a model that varies, or is continuous with cross noise.

    >>> model = ARX([-0.5], [1.0], noise_variance=0.1, dt=1).to_state_space()
    >>> found = uncorrelated(model)
    >>> found.A.tolist(), found.Q.round(9).tolist(), found.S
    ([[0.5, 0.5], [0.0, 0.0]], [[0.0, 0.0], [0.0, 0.1]], None)
    """
    checks.require(model=(model, StateSpace))
    if model.varying or model.B_end is not None:
        checks.refuse("`model` must be constant, without B_end.")
    if model.S is None:
        return _plain(model)
    A, B, C, D, G, S = (np.asarray(getattr(model, name)) for name in "ABCDGS")
    n, p = model.n, model.p
    R = np.asarray(model.R)
    K = np.asarray(G @ S @ np.linalg.pinv(R, hermitian=True))
    left = G @ np.asarray(model.Q) @ G.T - K @ R @ K.T
    Q = np.block([[_positive(left, np.abs(G @ model.Q @ G.T).max()), np.zeros((n, p))], [np.zeros((p, n)), R]])
    return StateSpace(
        np.block([[A, K], [np.zeros((p, n + p))]]), np.vstack([B, np.zeros((p, model.m))]), np.hstack([C, np.eye(p)]), D, Q=Q,
        R=np.zeros((p, p)), dt=model.dt, states=[*model.states, *(f"noise of {name}" for name in model.outputs)],
        inputs=model.inputs, outputs=model.outputs,
    )  # fmt: skip


def _plain(model: StateSpace) -> StateSpace:
    return StateSpace(
        model.A, model.B, model.C, model.D, Q=model.Q, R=model.R, G=model.G, dt=model.dt, states=model.states,
        inputs=model.inputs, outputs=model.outputs,
    )  # fmt: skip


def _positive(Q: np.ndarray, size: float) -> np.ndarray:
    """A covariance without the negative eigenvalues that rounding leaves."""
    values, vectors = np.linalg.eigh((Q + Q.T) / 2)
    return (vectors * np.where(values > 1e-13 * size, values, 0.0)) @ vectors.T
