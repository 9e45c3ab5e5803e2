"""From continuous to discrete time, with the noise that accumulates over a step.

Letters: Φ = e^{A h}; Γ(h) = ∫_0^h e^{A s} ds; Qd(h) = ∫_0^h e^{A s} G Q G' e^{A' s} ds.
Reference: C. F. Van Loan, Computing integrals involving the matrix exponential, IEEE TAC 23 (1978) 395-404.
"""

import numpy as np

from .. import checks
from .state_space import StateSpace

HOLDS = ("zero_order", "first_order")


def discretise(model: StateSpace, dt, *, hold: str = "zero_order") -> StateSpace:
    """The discrete model over steps of `dt` seconds: one number, or an array (T,) for a step length that varies.

    Raises `InputError` where the model is discrete already, `dt` not positive or `hold` unknown.
    """
    faults = checks.Faults()
    faults.choice("hold", hold, HOLDS)
    if not model.is_continuous:
        faults.add(f"only a continuous model (dt = 0) can be discretised. This one has dt = {model.dt:g} s.")
    steps = np.asarray(dt, float)
    if steps.size == 0 or not np.all(np.isfinite(steps)) or np.any(steps <= 0):
        faults.add(f"`dt` must be a positive number of seconds. Got {checks.short(dt)}.")
    faults.finish()
    Φ, B, B_end, Qd = over(model.A, model.B, model.G @ model.Q @ np.swapaxes(model.G, -1, -2), steps, hold=hold)
    return StateSpace(
        Φ, B, model.C, model.D, Q=Qd, R=model.R, B_end=B_end, dt=float(np.mean(steps)),
        states=model.states, inputs=model.inputs, outputs=model.outputs, operating_point=model.operating_point,
    )  # fmt: skip


def over(A, B, GQG, h, *, hold):
    """Φ, B, B_end (None for a zero-order hold) and Qd over steps h; leading axes of A, B, GQG and h are broadcast."""
    h = np.asarray(h, float)
    with np.errstate(over="ignore", invalid="ignore"):
        Φ, Γ, Γ2 = _input_integrals(A, h)
        Qd = _noise_integral(A, GQG, h)
    if not (np.all(np.isfinite(Φ)) and np.all(np.isfinite(Qd))):
        checks.refuse(
            f"the model grows beyond any number within a step of {np.max(h):g} s: its fastest entry is "
            f"{np.abs(A).max():.3g} per second. Are A and dt in seconds?"
        )
    if hold == "zero_order":
        return Φ, Γ @ B, None, Qd
    ramp = Γ2 / h[..., None, None]                       # of u[k+1]: ∫ e^{A (h-s)} (s / h) ds
    return Φ, (Γ - ramp) @ B, ramp @ B, Qd


def _input_integrals(A, h):
    """Φ, Γ and ∫_0^h Γ(s) ds, from one exponential of [[A, I, 0], [0, 0, I], [0, 0, 0]] h."""
    from scipy.linalg import expm

    n = A.shape[-1]
    M = np.zeros((*np.broadcast_shapes(A.shape[:-2], h.shape), 3 * n, 3 * n))
    M[..., :n, :n] = A
    M[..., :n, n : 2 * n] = M[..., n : 2 * n, 2 * n :] = np.eye(n)
    E = expm(M * h[..., None, None])
    return E[..., :n, :n], E[..., :n, n : 2 * n], E[..., :n, 2 * n :]


def _noise_integral(A, GQG, h):
    """Qd by Van Loan's exponential over h / 2^s, then s doublings Qd(2h) = Qd(h) + Φ Qd(h) Φ'.

    One exponential over the whole of a long step holds e^{-A h} and overflows where A is stable and fast.
    """
    from scipy.linalg import expm

    n = A.shape[-1]
    size = np.max(np.abs(A).sum(-1) * h[..., None], initial=0.0)
    doublings = max(0, int(np.ceil(np.log2(max(size, 1e-300)))) + 1)
    step = (h / 2.0**doublings)[..., None, None]
    M = np.zeros((*np.broadcast_shapes(A.shape[:-2], GQG.shape[:-2], h.shape), 2 * n, 2 * n))
    M[..., :n, :n], M[..., :n, n:], M[..., n:, n:] = -A, GQG, np.swapaxes(A, -1, -2)
    E = expm(M * step)
    Φ = np.swapaxes(E[..., n:, n:], -1, -2)
    Qd = Φ @ E[..., :n, n:]                              # Van Loan (1.4)
    for _ in range(doublings):
        Qd = Qd + Φ @ Qd @ np.swapaxes(Φ, -1, -2)
        Φ = Φ @ Φ
    return (Qd + np.swapaxes(Qd, -1, -2)) / 2
