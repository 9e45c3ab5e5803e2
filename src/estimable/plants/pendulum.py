"""A pendulum on a cart: unstable upright, stable hanging."""

import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array
from ..models.nonlinear_model import NonlinearModel

GRAVITY = 9.81  # [m/s²]


def pendulum(
    *,
    cart: float = 0.5,
    mass: float = 0.2,
    length: float = 0.3,
    inertia: float = 0.006,
    friction: float = 0.1,
    sigma: float = 1e-3,
    force_density: float = 1e-4,
    substeps: int = 2,
) -> NonlinearModel:
    """A pendulum on a cart as a continuous nonlinear model: input the force on the cart [N]; outputs its position [m] and the
    angle from the upright [rad].

    Model, with the angle φ from the upright and l the distance of the centre of mass: (M + m) x'' + b x' - m l φ'' cos φ +
    m l φ'² sin φ = u + w, (I + m l²) φ'' - m g l sin φ = m l x'' cos φ. States: position, velocity, angle, rate.

    `cart` M and `mass` m [kg], `length` l [m], `inertia` I [kg m²], `friction` b [N s/m], `sigma`: of both sensors,
    `force_density`: of w [N² s]. `linearised([0, 0, 0, 0], [0])` is the model upright, with the angle pi that hanging.

    Reference: W. Messner, D. Tilbury, Control Tutorials for MATLAB and Simulink, Inverted pendulum (the default numbers).

    >>> A = pendulum().linearised(np.zeros(4), [0.0]).A
    >>> sorted(np.linalg.eigvals(A).real.round(2).tolist())  # the tutorial, with g = 9.8: 5.565, -5.604
    [-5.61, -0.14, 0.0, 5.57]
    """
    faults = checks.Faults()
    given = {"cart": cart, "mass": mass, "length": length}
    M, m, reach = (faults.number(name, value, above=0.0) for name, value in given.items())
    rest = {"inertia": inertia, "friction": friction, "sigma": sigma, "force_density": force_density}
    own, b, noise, force = (faults.number(name, value, lower=0.0) for name, value in rest.items())
    faults.finish()
    ml, J = m * reach, own + m * reach**2

    def accelerations(x: Array, push: Array):
        """x'' and φ'', from the two equations."""
        sin, cos = jnp.sin(x[2]), jnp.cos(x[2])
        right = push - b * x[1] - ml * x[3] ** 2 * sin
        determinant = (M + m) * J - (ml * cos) ** 2
        return (
            (J * right + ml * cos * m * GRAVITY * reach * sin) / determinant,
            (ml * cos * right + (M + m) * m * GRAVITY * reach * sin) / determinant,
        )

    def f(x: Array, u: Array, θ: Array):
        cart, turn = accelerations(x, u[0])
        return jnp.stack([x[1], cart, x[3], turn])

    def G(x: Array, u: Array, θ: Array):
        cos = jnp.cos(x[2])
        determinant, nothing = (M + m) * J - (ml * cos) ** 2, jnp.zeros(())
        return jnp.stack([nothing, J / determinant, nothing, ml * cos / determinant])[:, None]

    return NonlinearModel(
        f, lambda x, u, θ: jnp.stack([x[0], x[2]]), G=G, Q=[[force]], R=np.diag([noise**2] * 2), dt=0, substeps=substeps,
        states=["position", "velocity", "angle", "rate"], inputs=["force_n"], outputs=["position_m", "angle_rad"],
    )  # fmt: skip
