"""Names of channels cannot break what shows them: a terminal, a page, a table, a file."""

import csv
import io
import tomllib

import numpy as np
import pandas as pd
import pytest

import estimable as es

ODD = ["<!--", "<script", "</script>", "a,b", 'a"b', "a'b", "a;b", "a|b", "[bold]", "{{x}}", "${x}", "a\tb", "  a", "δ [deg/s]",
       "名前", "=1+1", "%s", "x" * 200, "é", "a\\b", "'''", "#a", "true", "1", "nan"]  # fmt: skip
HIDDEN = ["a\nb", "a\rb", "\x1b[2J", "a\0b", "\u202eabc", "\u2066a", "a\u200f", "\ud800", "\x7f", "\x9b2J"]


def model(names):
    n = len(names)
    return es.StateSpace(0.9 * np.eye(n), C=np.eye(n), Q=np.eye(n), R=np.eye(n), dt=0.1, states=names, outputs=names)


@pytest.mark.parametrize("name", HIDDEN, ids=ascii)
def test_what_controls_a_terminal_or_the_direction_of_writing_is_refused(name):
    calls = [
        lambda: model([name]),
        lambda: es.Record([1.0], dt=1, outputs=[name]),
        lambda: es.Record([1.0], dt=1, outputs=["y"], units={"y": name}),
        lambda: es.Record.from_pandas(pd.DataFrame({name: [1.0]}), outputs=[name], dt=1),
    ]
    for make in calls[: 3 if name == "\ud800" else 4]:  # pandas itself takes no half of a surrogate pair
        with pytest.raises(es.InputError, match="must be plain text") as raised:
            make()
        assert all(sentence.isprintable() for sentence in raised.value.faults)


def test_a_name_of_ten_thousand_characters_is_refused():
    with pytest.raises(es.InputError, match=r"`outputs` must have at most 200 characters each\. 'xxx.* has 10,000\."):
        es.Record([1.0], dt=1, outputs=["x" * 10_000])


def test_every_other_name_comes_back_from_tables_and_files(tmp_path):
    record = es.Record(np.arange(2.0 * len(ODD)).reshape(2, -1), dt=0.1, outputs=ODD)
    algorithm, prior = es.Kalman(model(ODD)), es.Prior(np.zeros(len(ODD)), np.eye(len(ODD)))
    result = es.estimate(algorithm, record, prior=prior)
    table = result.to_pandas()
    rows = list(csv.reader(io.StringIO(table.to_csv())))
    assert {len(row) for row in rows} == {len(table.columns) + 1}
    es.write_model(tmp_path / "model.toml", model(ODD), prior)
    assert es.read_model(tmp_path / "model.toml").model.outputs == tuple(ODD)
    assert tomllib.loads((tmp_path / "model.toml").read_text())["model"]["states"] == ODD
    es.save(tmp_path / "result.npz", result)
    assert es.load(tmp_path / "result.npz").names == result.names
    page = es.report.page_of(es.report.report_of(result, record=record, algorithm=algorithm, prior=prior, title=ODD[0]))
    assert page.count("<script") == 3
