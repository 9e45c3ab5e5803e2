"""What every identifier of the catalogue must have."""

import inspect
from pathlib import Path

import pytest

import estimable
from estimable import InputError, catalogue

DOCS = Path(__file__).parents[2] / "docs" / "methods"


@pytest.mark.parametrize("entry", catalogue.IDENTIFIERS, ids=lambda entry: entry.name)
def test_it_is_documented_with_everything_a_user_needs(entry):
    text = inspect.getdoc(entry.cls) or ""
    for part in ("Model:", "Assumes", "Settings:", "Cost:", "Reference:", ">>>"):
        assert part in text, f"{entry.cls.__name__} lacks {part}"
    assert entry.cls.__name__ in estimable.__all__
    assert (DOCS / f"{entry.name}.md").is_file()
    ways = (("fit",), ("init", "correct", "predict", "fitted"), ("begin", "tracker", "known"))
    assert any(all(hasattr(entry.cls, step) for step in way) for way in ways)
    assert catalogue.identifier(entry.name) is entry


def test_a_wrong_name_is_met_with_the_right_ones():
    with pytest.raises(InputError, match="Did you mean 'output-error-ml'"):
        catalogue.identifier("output-error-lm")
