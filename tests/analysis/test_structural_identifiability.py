"""Hidden by the structure, or only weakly seen: decided and named."""

import jax.numpy as jnp
import numpy as np
import pytest

from estimable import InputError, NonlinearModel, structural_identifiability


def model(f, h, states, parameters, *, inputs=("u",), dt=1, **options):
    n, p = len(states), len(h(jnp.ones(len(states)), jnp.ones(len(inputs)), jnp.ones(len(parameters))))
    return NonlinearModel(
        f, h, Q=np.zeros((n, n)), R=np.eye(p), dt=dt, states=states, inputs=inputs,
        parameters={name: 0.3 + 0.2 * i for i, name in enumerate(parameters)}, **options,
    )  # fmt: skip


def tanks(weak):
    def f(x, u, θ):
        out = θ[:2] * jnp.sqrt(x)
        return x + jnp.array([θ[2] * θ[3] * u[0] + weak * (θ[3] * u[0]) ** 2 - out[0], out[0] - out[1]])

    return model(f, lambda x, u, θ: x, ["x1", "x2"], ["out1", "out2", "valve", "gain"])


HIDDEN = {
    "tanks": (tanks(0.0), ("x1", "x2", "out1", "out2", "valve * gain")),
    "a sensor of unknown scale": (
        model(lambda x, u, θ: x * (1 - θ[0]) + θ[1] * u, lambda x, u, θ: θ[2] * x, ["x"], ["k", "b", "c"]),
        ("x * c", "k", "b * c"),
    ),
    "two offsets of a sensor": (
        model(lambda x, u, θ: 0.9 * x + u, lambda x, u, θ: x + θ[0] + θ[1], ["x"], ["a", "b"]), ("x", "a + b"),
    ),
    "a pendulum": (
        model(lambda x, u, θ: jnp.array([x[1], -θ[0] / θ[1] * jnp.sin(x[0])]), lambda x, u, θ: x[:1], ["angle", "rate"],
              ["g", "l"], inputs=(), dt=0, substeps=2),
        ("angle", "rate", "g / l"),
    ),
    "a decay of two causes": (
        model(lambda x, u, θ: x * jnp.exp(-θ[0] - θ[1]), lambda x, u, θ: x, ["x"], ["a", "b"], inputs=()), ("x", "a + b"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", HIDDEN)
def test_what_the_structure_hides_is_named(name):
    one, combinations = HIDDEN[name]
    found = structural_identifiability(one, points=2)
    assert not found.identifiable
    assert found.identifiable_combinations == combinations
    assert found.singular_values.min() < 1e-50
    assert "do not determine" in found.sentences[0]


@pytest.mark.parametrize(
    "one",
    [
        tanks(1e-12),
        model(
            lambda x, u, θ: x * (1 - θ[0]) + θ[1] * u, lambda x, u, θ: θ[2] * x + 1e-9 * x**2, ["x"], ["k", "b", "c"]
        ),
        model(lambda x, u, θ: 0.9 * x + u, lambda x, u, θ: x * (1 + 1e-13 * θ[1]) + θ[0] + θ[1], ["x"], ["a", "b"]),
    ],
)
def test_what_is_weakly_seen_is_not_hidden(one):
    found = structural_identifiability(one, points=2)
    assert found.identifiable
    assert 0 < found.singular_values.min() < 1e-7


def test_what_cannot_be_decided_is_said():
    branched = model(lambda x, u, θ: jnp.where(x > 1, θ[0] * x, x + θ[0] * u), lambda x, u, θ: x, ["x"], ["a"])
    assert "different branches" in structural_identifiability(branched).sentences[-1]
    special = model(lambda x, u, θ: x + jnp.linalg.inv(θ[0] * jnp.eye(1))[0], lambda x, u, θ: x, ["x"], ["a"])
    with pytest.raises(InputError, match="which cannot be evaluated with many digits"):
        structural_identifiability(special)
