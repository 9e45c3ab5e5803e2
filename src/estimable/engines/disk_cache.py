"""Files that one process leaves for the next, each under a name made of all that it depends on.

They are kept in the folder ESTIMABLE_CACHE, or else in the user's cache.
"""

import dataclasses
import hashlib
import os
import pickle
import platform
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import jax
import jaxlib.version
import numpy as np

PLAIN = (type(None), bool, int, float, str, bytes, np.generic)
FAILURES = (pickle.PickleError, AttributeError, ImportError, LookupError, EOFError, TypeError, ValueError, RuntimeError)
Made = TypeVar("Made")


class UnnamedError(Exception):
    """It depends on something that has no name beyond this process, as a function of the user's."""


def place(words: str, ending: str) -> Path:
    """The file of what depends on these words."""
    given = os.environ.get("ESTIMABLE_CACHE")
    folder = Path(
        given or os.path.join(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "estimable")
    )
    return folder / f"{hashlib.sha256(words.encode()).hexdigest()}.{ending}"


def read(path: Path) -> bytes | None:
    """What was kept, if it is there and whole: damaged machine code would take the process with it."""
    try:
        found = path.read_bytes()
    except OSError:
        return None
    return found[32:] if hashlib.sha256(found[32:]).digest() == found[:32] else None


def write(path: Path, content: bytes) -> None:
    """Write a file whole or not at all; a folder that cannot be written is no error."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        draft = path.with_suffix(f".{os.getpid()}.{threading.get_ident()}")
        draft.write_bytes(hashlib.sha256(content).digest() + content)
        draft.replace(path)
    except OSError:
        return


def once(make: Callable[..., Made], *arguments: Any) -> Made:
    """`make(*arguments)`, from the disk where a process has made it before from the same source and arguments."""
    try:
        path = place("|".join((source(), name_of(make), *map(name_of, arguments))), "made")
    except UnnamedError:
        return make(*arguments)
    content = read(path)
    with suppress(*FAILURES):
        if content is not None:
            return pickle.loads(content)
    made = make(*arguments)
    with suppress(*FAILURES):  # what cannot be kept is made again
        write(path, pickle.dumps(made))
    return made


@cache
def source() -> str:
    """What this package and those below it are: versions, a setting, and what every file holds."""
    root = Path(__file__).parents[1]
    text = hashlib.sha256(b"".join(path.read_bytes() for path in sorted(root.rglob("*.py")))).hexdigest()
    versions = jax.__version__, jaxlib.version.__version__, np.__version__, platform.python_version()
    return "|".join((*versions, str(jax.config.read("jax_enable_x64")), text))


def name_of(part: Any) -> str:
    """A name that means the same in every process; `UnnamedError` where there is none."""
    if isinstance(part, PLAIN):
        return repr(part)
    if isinstance(part, jax.tree_util.PyTreeDef):
        node = part.node_data()
        return "*" if node is None else _named(*node, *part.children())
    if isinstance(part, list | tuple):
        return _named(type(part), *part)
    if isinstance(part, type) or callable(part):
        return _own(part)
    if dataclasses.is_dataclass(part):
        return _named(type(part), *(getattr(part, field.name) for field in dataclasses.fields(part)))
    raise UnnamedError


def _named(kind: type, *parts: Any) -> str:
    return f"{_own(kind)}({','.join(map(name_of, parts))})"


def _own(thing: Any) -> str:
    """The name of a class or function of this package, or of one built in."""
    module, name = str(getattr(thing, "__module__", "")), getattr(thing, "__qualname__", "<>")
    bound = getattr(thing, "__self__", None) is not None
    if bound or "<" in name or module.split(".")[0] not in ("builtins", __name__.split(".")[0]):
        raise UnnamedError
    return f"{module}.{name}"
