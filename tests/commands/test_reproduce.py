"""`estimable reproduce`."""

import pytest

from estimable import reproductions


def test_all_are_listed(run):
    told = run("reproduce", "--json").json
    assert [entry["name"] for entry in told["entries"]] == [entry.name for entry in reproductions.ENTRIES]
    assert {"name", "source", "title", "status", "reproduced"} == set(told["entries"][0])
    people = run("reproduce", width=60)
    assert all(len(line.rstrip()) <= 60 for line in people.stdout.splitlines())
    assert "tables and figures are reproduced" in people.stdout


def test_one_is_recomputed(run):
    told = run("reproduce", "sillence-table-3", "--json").json
    assert (told["name"], told["outcome"]["code"], told["figure"]) == ("sillence-table-3", 0, None)
    assert set(told["rows"][0]) == {"quantity", "unit", "published", "mean", "sigma", "draws"}


@pytest.mark.parametrize("width", [60, 80])
def test_one_for_people(run, width):
    people = run("reproduce", "sillence-table-3", width=width)
    assert all(len(line.rstrip()) <= width for line in people.stdout.splitlines())
    assert "-3.0691" in people.stdout


def test_the_picture_is_written(run, tmp_path):
    said = run("reproduce", "sillence-table-3", "--figure", "poles.html")
    assert "Wrote poles.html" in said.stderr
    assert "plotly" in (tmp_path / "poles.html").read_text()[:10_000_000]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("sillence-table-2", "--figure", "poles.png"), "--figure must end in .html"),
        (("sillence-table-2", "--figure", "nowhere/poles.html"), "there is no folder"),
        (("sillence-table-1", "--figure", "snr.html"), "sillence-table-1 has no figure"),
        (("silence-table-1",), "Did you mean 'sillence-table-1'"),
        (("sillence-fig-13",), "a drawing, with nothing to compute"),
    ],
)
def test_wrong_calls(run, arguments, sentence):
    said = run("reproduce", *arguments)
    assert said.code == 2
    assert sentence in said.stderr
