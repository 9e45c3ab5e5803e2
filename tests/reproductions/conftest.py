"""Each table and figure is recomputed once, from few draws."""

import pytest

from estimable import reproductions

FEW = 4  # draws: enough for a mean and a sigma


@pytest.fixture(scope="session")
def results():
    """The result of a name."""
    found = {}

    def result(name):
        if name not in found:
            found[name] = reproductions.reproduce(name, draws=FEW)
        return found[name]

    return result
