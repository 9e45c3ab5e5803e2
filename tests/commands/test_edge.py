"""Help, version, and how wrong calls end."""

import json
import re
import subprocess
import sys

import pytest

import estimable
from estimable import packaged

COMMANDS = ("demo", "gain", "estimate")


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("width", [60, 80])
def test_help_describes_every_option_and_shows_an_example(run, command, width):
    answer = run(command, "--help", width=width)
    assert answer.code == 0
    assert re.search(rf"Example:\n +estimable {command}", answer.stdout)
    options = re.search(r"\nOptions:\n(.*)", answer.stdout, re.DOTALL).group(1)
    assert all(re.match(r"  -.*\S  +\S", line) or line.startswith("     ") for line in options.splitlines())


def test_help_of_estimable_lists_every_command_with_its_sentence(run):
    answer = run("--help")
    for command in COMMANDS:
        assert re.search(rf"^  {command}  +\w.*\.$", answer.stdout, re.MULTILINE)
    assert "..." not in answer.stdout.split("Commands:")[1]
    assert run().stdout == answer.stdout


def test_version(run):
    assert run("--version").stdout == f"estimable {estimable.__version__}\n"
    assert run("--version", "--json").json == {
        "command": "version", "version": estimable.__version__, "outcome": {"code": 0, "sentence": ""},
    }  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["gain"], "Missing argument 'RECORD'. Try: estimable gain --help."),
        (["gain", "flight.csv"], "Missing option '--model'. Try: estimable gain --help."),
        (["estimate", "a.csv", "--model", "b.toml"], "Missing option '--filter'. Try: estimable estimate --help."),
        (["demmo"], "No such command 'demmo'. Did you mean 'demo'? Try: estimable --help."),
        (["demo", "--jsno"], "No such option: --jsno"),
        (["demo", "flight.csv"], "Got unexpected extra argument"),
        (["gain", "flight.csv", "--model", "model.toml", "--dt", "fast"], "Invalid value for '--dt'"),
    ],
)
def test_a_usage_error_is_a_sentence_or_json(run, arguments, sentence):
    plain = run(*arguments)
    assert (plain.code, plain.stdout) == (2, "")
    assert plain.stderr.startswith(f"Error: {sentence}")
    assert plain.stderr.count("\n") == 1
    machine = run(*arguments, "--json")
    assert (machine.code, machine.stderr) == (2, "")
    assert set(machine.json) == {"error", "message"}
    assert machine.json["error"] == "InputError"
    assert machine.json["message"].startswith(sentence)


def test_json_without_a_command_is_refused(run):
    answer = run("--json")
    assert answer.code == 2
    assert answer.json["error"] == "InputError"


def test_json_may_stand_before_the_command(run):
    assert run("--json", "gain", "flight.csv", "--model", "model.toml", "--as-given").json["command"] == "gain"
    assert "none.csv does not exist" in run("--json", "gain", "none.csv", "--model", "model.toml").json["message"]


def test_the_program_itself_and_its_exit_code():
    program = [sys.executable, "-c", "from estimable.commands import main; main()"]
    flight, model = packaged.path("f16-flight.csv"), packaged.path("f16-model.toml")
    call = ["gain", str(flight), "--model", str(model), "--filter", "unknown-gain", "--json"]
    done = subprocess.run([*program, *call], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout)["command"] == "gain"
    assert done.stderr == ""
    failed = subprocess.run([*program, "gain", "none.csv", "--model", "none.toml"], capture_output=True, text=True)
    assert (failed.returncode, failed.stdout) == (2, "")
    assert failed.stderr.startswith("Error: ")
    assert "none.toml does not exist" in failed.stderr


def test_help_loads_neither_pandas_nor_plotly_nor_scipy():
    code = (
        "import sys\nfrom typer.testing import CliRunner\nfrom estimable.commands import app\n"
        "assert CliRunner().invoke(app, ['gain', '--help']).exit_code == 0\n"
        "print(sorted({'pandas', 'plotly', 'scipy'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_a_long_argument_is_shortened_in_the_message(run):
    answer = run("gain", "flight.csv", "--model", "model.toml", "x" * 5000)
    assert answer.code == 2
    assert "x" * 90 in answer.stderr
    assert len(answer.stderr) < 600
