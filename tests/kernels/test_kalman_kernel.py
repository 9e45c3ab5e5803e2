"""The inputs of the filter kernels are named tuples, and the shape of every array in them is checked in the tests."""

import jax
import numpy as np
import pytest
from jaxtyping import TypeCheckError

from estimable.kernels import independent, joseph, kalman, stretch
from estimable.kernels.kalman import Drift, Gaussian, Measurement, Transition

N, P = 3, 2
PRIOR = Gaussian(np.ones(N), np.eye(N), np.ones((N, 1)), np.ones(N), np.zeros(()))
NOTHING_DIFFUSE = PRIOR._replace(X=np.ones((N, 0)))
MEASUREMENT = Measurement(np.ones((P, N)), np.ones(P), np.eye(P), np.ones((N, P)), np.zeros(P))
TRANSITION = Transition(np.eye(N), np.ones(N), np.ones((N, 1)))
DRIFT = Drift(np.ones(N), np.eye(N))
DATUM = (np.ones(P), np.ones(P, bool))
KERNELS = {
    "kalman.correct": (kalman.correct, (PRIOR, MEASUREMENT, *DATUM)),
    "independent.correct": (independent.correct, (NOTHING_DIFFUSE, MEASUREMENT._replace(Ω=None), *DATUM)),
    "joseph.correct": (joseph.correct, (PRIOR, np.ones((N, P)), MEASUREMENT, *DATUM)),
    "kalman.predict": (kalman.predict, (PRIOR, TRANSITION, DRIFT)),
    "stretch.of_sample": (stretch.of_sample, (TRANSITION, MEASUREMENT._replace(Ω=None), *DATUM)),
}
UNREAD = {  # fields that a kernel hands on, or has no use for
    "independent.correct": ("X", "log_scale", "Ω"),
    "joseph.correct": ("size", "log_scale"),
    "stretch.of_sample": ("Ω", "period"),
}


def longer(array):
    """The array with one more row, or one axis where it has none."""
    return np.concatenate([array, array[:1]]) if array.ndim else array[None]


def arrays():
    """(kernel, place of the argument, field of a tuple or None) of each array that is read."""
    for name, (_, arguments) in KERNELS.items():
        for place, argument in enumerate(arguments):
            fields = getattr(argument, "_fields", (None,))
            yield from ((name, place, field) for field in fields if field not in UNREAD.get(name, ()))


@pytest.mark.parametrize("name", KERNELS)
def test_right_shapes_pass(name):
    kernel, arguments = KERNELS[name]
    jax.eval_shape(kernel, *arguments)


@pytest.mark.parametrize(("name", "place", "field"), list(arrays()))
def test_a_wrong_shape_is_refused_in_the_tests(name, place, field):
    kernel, arguments = KERNELS[name]
    argument = arguments[place]
    wrong = longer(argument) if field is None else argument._replace(**{field: longer(getattr(argument, field))})
    with pytest.raises(TypeCheckError):
        jax.eval_shape(kernel, *arguments[:place], wrong, *arguments[place + 1 :])
