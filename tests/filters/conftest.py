"""How the tests of filters ask for the sentences of a refused call."""

import pytest

from estimable import InputError


@pytest.fixture
def refused():
    """The sentences with which a call is refused."""

    def sentences(call):
        with pytest.raises(InputError) as caught:
            call()
        return list(caught.value.faults)

    return sentences
