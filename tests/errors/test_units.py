"""Units in model files."""

import pytest

from estimable import InputError, packaged, read_model


def test_units_must_be_texts(tmp_path):
    text = packaged.path("f16-model.toml").read_text().replace('alpha_deg = "deg",', "alpha_deg = 3,")
    (tmp_path / "model.toml").write_text(text)
    with pytest.raises(InputError, match=r"`\[record\] units` must be a table of channels and units"):
        read_model(tmp_path / "model.toml")
