"""The edge of the command line: an exception becomes a message and an exit code."""

import json
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

import typer
from typer.core import TyperGroup

from ..errors import EstimableError, InputError

UsageError: type[Exception] = typer.BadParameter.__bases__[0]  # its module differs between versions of typer
LONGEST = 100  # characters of an argument in a message
WRONG_CALL, OTHER, INTERRUPTED = 2, 1, 130


class Edge(TyperGroup):
    """A group of commands that reports errors as JSON with `--json`, else as a message on stderr."""

    def main(self, args: Sequence[str] | None = None, *rest: Any, **extra: Any) -> NoReturn:
        """Run a command and end with its exit code. An exception other than `EstimableError` is a bug: its traceback is shown."""
        given = sys.argv[1:] if args is None else list(args)
        extra["standalone_mode"] = False
        try:
            code = super().main(given, *rest, **extra)
        except UsageError as error:
            code = _refuse(given, InputError.__name__, _usage(error), WRONG_CALL)
        except EstimableError as error:
            wrong = isinstance(error, InputError)
            code = _refuse(given, type(error).__name__, str(error), WRONG_CALL if wrong else OTHER)
        except typer.Abort:
            code = INTERRUPTED
        except BrokenPipeError:
            sys.stderr.close()  # the reader has closed the pipe: write no further messages
            code = OTHER
        sys.exit(code if isinstance(code, int) else 0)


def _usage(error: Exception) -> str:
    """What is wrong with the options, and the help that describes them."""
    text = getattr(error, "format_message", error.__str__)
    message = " ".join(word if len(word) <= LONGEST else f"{word[:LONGEST]}..." for word in text().split())
    message += "" if message.endswith((".", "?")) else "."
    context = getattr(error, "ctx", None)
    return message if context is None else f"{message} Try: {context.command_path} --help."


def _refuse(given: list[str], name: str, message: str, code: int) -> int:
    if "--json" in given:
        print(json.dumps({"error": name, "message": message}))
    else:
        print(f"Error: {message}", file=sys.stderr)
    return code
