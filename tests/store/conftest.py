import dataclasses

import jax
import numpy as np
import pytest


def items(thing):
    """What is in a thing, by name; None where nothing is."""
    if dataclasses.is_dataclass(thing):
        return [(field.name, getattr(thing, field.name)) for field in dataclasses.fields(thing)]
    if isinstance(thing, dict):
        return list(thing.items())
    return list(enumerate(thing)) if isinstance(thing, tuple | list) else None


def content(thing):
    """A number, an array or a text; numbers to the last bit."""
    if isinstance(thing, float | np.ndarray | np.generic):
        array = np.asarray(thing)
        return array.dtype, array.shape, array.tobytes()
    return thing


def parts(thing, where="thing"):
    """All that is in a thing: where, of which class, and what; an array of JAX is one of NumPy in a file."""
    thing = np.asarray(thing) if isinstance(thing, jax.Array) else thing
    inside = items(thing)
    yield where, type(thing), content(thing) if inside is None else len(inside)
    for name, item in inside or ():
        yield from parts(item, f"{where}.{name}")


@pytest.fixture
def same():
    """Asserts that two things agree in every class, in every number to the last bit, and in every text."""

    def check(back, thing):
        for found, expected in zip(parts(back), parts(thing), strict=True):
            assert found == expected

    return check
