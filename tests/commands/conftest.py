"""The command line, run in this process, in a folder of its own."""

import json
from typing import NamedTuple

import pytest
from typer.testing import CliRunner

from estimable.commands import app
from estimable.packaged import path

MODEL = path("f16-model.toml").read_text()
FLIGHT = path("f16-flight.csv").read_text().splitlines()
HEADER = FLIGHT[0]


class Answer(NamedTuple):
    """How a command ended."""

    code: int
    stdout: str
    stderr: str

    @property
    def json(self):
        def refuse(constant):
            raise AssertionError(f"{constant} is not JSON")

        return json.loads(self.stdout, parse_constant=refuse)


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Run `estimable` with these arguments; what is not an error of ours raises."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "model.toml").write_text(MODEL)
    (tmp_path / "flight.csv").write_text("\n".join(FLIGHT[:20]) + "\n")

    def call(*arguments, width=80):
        environment = {"COLUMNS": str(width), "NO_COLOR": "1", "TERM": "dumb"}
        given = [str(argument) for argument in arguments]
        result = CliRunner(env=environment).invoke(app, given, prog_name="estimable")
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        return Answer(result.exit_code, result.stdout, result.stderr)

    return call


@pytest.fixture
def change_model(tmp_path):
    """Write model.toml with one text in the place of another."""

    def change(old, new):
        assert old in MODEL
        (tmp_path / "model.toml").write_text(MODEL.replace(old, new))

    return change


@pytest.fixture
def write_record(tmp_path):
    """Write flight.csv: the header, and these rows."""

    def write(*rows, header=HEADER):
        (tmp_path / "flight.csv").write_text("\n".join([header, *rows]) + "\n")

    return write
