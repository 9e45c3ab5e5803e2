"""The command-line page is what `--help` prints. To regenerate it: WRITE_COMMAND_LINE=1 pytest tests/documents."""

import os
from pathlib import Path

from typer.testing import CliRunner

from estimable.commands import app

PAGE = Path(__file__).parents[2] / "docs" / "command-line.md"
COMMANDS = ("", "demo", "gain", "estimate", "check", "identify", "tune", "simulate", "reproduce", "cache")
HEAD = """# The command line

Every command has the option `--json`. It then prints one JSON object on stdout: `{"command", "version", "outcome": {"code",
"sentence"}, ...}`. An unknown number is null, never NaN. After an error the object is `{"error", "message"}`. The exit code is 0
after success, 2 for a wrong call, file or option, and 1 for a run that failed. The object of `gain` and `demo` has these keys:

| key | meaning |
|---|---|
| `gain_after`, `gain_after_sigma` | the estimate at the last row, and its standard deviation (interval / 3.92) |
| `gain_before`, `gain_before_sigma` | the same before the first change, or at a third of the record |
| `failure_time_s`, `detected_at_s` | when the gain first changed, and when that was detected; null where no change was found |
| `changes` | each change: `gain`, `onset_s`, `detected_at_s`, `before`, `after`, `sigma`, `onset_sigma_s` |
| `verdict`, `verdict_p`, `reasons`, `untestable` | the word, its p-value, why, and which errors no record shows |
| `gain_interval` | the 95 % interval of the gain at the last row |
| `finding`, `rows` | all gains in one sentence, and a row each: before, after, their sigmas, `changed_at`, `verdict`, `phrase` |
| `detectable_loss` | the smallest loss with 90 % power: `loss`, `start_s`, `end_s`, `floor_sigma`; of each second: `intervals` |
| `prepared` | what was fitted and estimated together with the gain, as sentences |
| `gaps` | what was done where an input was not recorded |
| `report` | the page that was written, or null |
| `nis` | the normalised innovations (of the filter inside a detector), their band, and a sentence |
| `settings` | the settings of the filter |
| `samples`, `seconds`, `notes` | the length of the record, and how it was read (unit of time, grid) |

With several gains each number is replaced by an object, {name: number}.
"""


def reference():
    pages = [HEAD]
    for name in COMMANDS:
        shown = CliRunner().invoke(app, [*([name] if name else []), "--help"], env={"COLUMNS": "80", "TERMINAL_WIDTH": "80"},
                                   prog_name="estimable")  # fmt: skip
        assert shown.exit_code == 0
        text = "\n".join(line.rstrip() for line in shown.output.strip().splitlines())
        pages.append(f"## estimable {name}".rstrip() + f"\n\n```\n{text}\n```\n")
    return "\n".join(pages)


def test_the_page_is_what_help_prints():
    if os.environ.get("WRITE_COMMAND_LINE"):
        PAGE.write_text(reference())
    assert PAGE.read_text() == reference()
