"""The mean and covariance of a nonlinear system carried through time, between two samples.

dx = f(x, t) dt + G(x, t) dw, with w of density Q. Along the mean m the covariance is P = Y Y' + N: Y is the transported initial
factor, N the accumulated process noise. P is positive semidefinite by construction.

References: A. H. Jazwinski, Stochastic Processes and Filtering Theory (1970), §9.3 (9.41)-(9.42); R. W. Bass, V. D. Norum,
L. Schwartz, J. Math. Anal. Appl. 16 (1966) 152-164 (the same equations, second order).
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias, TypeVar

import jax
import jax.numpy as jnp

from .expansion import hessian, jacobian
from .shapes import Float
from .small import Real, Scalar, gram, product

Y = TypeVar("Y")  # an array, or a tree of arrays
Derivative: TypeAlias = Callable[[Any, Y], Y]  # of t and y
RELATIVE, ABSOLUTE, MOST = 1e-9, 1e-12, 4096  # tolerances and steps of the adaptive integrator


class Moments(NamedTuple):
    """Mean m (n,), transported factor Y (n, k), and accumulated noise N (n, n)."""

    m: Real
    Y: Real
    N: Real


def moment_derivative(f: Callable, W: Callable, order: int, *, factor_columns: int = 0) -> Callable:
    """d/dt of `Moments`; W(x, t) (n, q) is G times a factor of Q. The first `factor_columns` columns of Y belong to a covariance.

    First order: ṁ = f, Ẏ = F Y, Ṅ = F N + N F' + G Q G'. Second order adds ½ f'':P to ṁ, and to Ṅ the mean
    effect of a state-dependent noise input, Σ_ij P_ij ∂_i W ∂_j W'.
    """

    def derivative(t: Scalar, b: Moments) -> Moments:
        """The moment equations at time t."""
        if order == 1:
            drift, F = jacobian(lambda x: f(x, t), b.m)
            noise = gram(W(b.m, t))
        else:
            drift, F, H = hessian(lambda x: f(x, t), b.m)
            P = gram(b.Y[:, :factor_columns]) + b.N
            drift = drift + jnp.sum(H * P[None, :, :], axis=(1, 2)) / 2                    # ½ f'':P
            noise = _mean_noise(lambda x: W(x, t), b.m, P)
        FN = product(F, b.N)
        return Moments(drift, product(F, b.Y), FN + FN.T + noise)

    return derivative


def _mean_noise(W: Callable, m: Float[Real, " n"], P: Float[Real, "n n"]) -> Real:
    """E[W(x) W(x)'] to the second order in x - m, without the second derivatives of W: W W' + Σ_ij P_ij ∂_i W ∂_j W'."""
    value, slopes = jacobian(W, m)                                                         # (n, q), (n, q, n)
    PW = jnp.sum(slopes[:, :, None, :] * P[None, None, :, :], axis=-1)
    return gram(value) + jnp.sum(PW[:, None] * slopes[None, :], axis=(2, 3))


def integrate(derivative: Derivative[Y], start: Y, dt: Scalar, substeps: int | None) -> tuple[Y, Any]:
    """The solution at dt of d/dt y = derivative(t, y), and whether it was reached.

    `substeps`: that many steps of the classical Runge-Kutta method; None: the adaptive method of Tsitouras (diffrax), to 1e-9.
    """
    return _adaptive(derivative, start, dt) if substeps is None else (runge_kutta(derivative, start, dt, substeps), True)


def runge_kutta(derivative: Derivative[Y], start: Y, dt: Scalar, substeps: int) -> Y:
    """`substeps` classical fourth-order steps."""
    h, y = dt / substeps, start

    def moved(y: Y, slope: Y, step: Scalar) -> Y:
        """y after `step` along `slope`, leaf by leaf."""
        return jax.tree_util.tree_map(lambda a, b: a + step * b, y, slope)

    for i in range(substeps):
        t = i * h
        k1 = derivative(t, y)
        k2 = derivative(t + h / 2, moved(y, k1, h / 2))
        k3 = derivative(t + h / 2, moved(y, k2, h / 2))
        k4 = derivative(t + h, moved(y, k3, h))
        y = jax.tree_util.tree_map(lambda y, a, b, c, d: y + h / 6 * (a + 2 * b + 2 * c + d), y, k1, k2, k3, k4)
    return y


def _adaptive(derivative: Derivative[Y], start: Y, dt: Scalar) -> tuple[Y, Any]:
    import diffrax

    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(lambda t, y, _: derivative(t, y)), diffrax.Tsit5(), 0.0, dt, None, start,
        stepsize_controller=diffrax.PIDController(rtol=RELATIVE, atol=ABSOLUTE), max_steps=MOST, throw=False,
        saveat=diffrax.SaveAt(t1=True),
    )  # fmt: skip
    reached = solution.result == diffrax.RESULTS.successful
    return jax.tree_util.tree_map(lambda leaf: leaf[0], solution.ys), reached
