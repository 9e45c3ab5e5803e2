"""Entries that one process stores for the next, each named by everything it depends on."""

import dataclasses
import hashlib
import os
import platform
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import jax
import jaxlib.version
import numpy as np

from .. import cache_folder, forks
from . import plain_format

PLAIN = (type(None), bool, int, float, str, bytes, np.generic)
Made = TypeVar("Made")


class UnnamedError(Exception):
    """An entry depends on something without a name outside this process, such as a user's function."""


def read(words: str, ending: str) -> bytes | None:
    """The entry for these words, if it exists, undamaged and under its own name."""
    found = cache_folder.read(_file(words, ending))
    whole = found is not None and found[:32] == _digest(words, found[32:])
    return found[32:] if found is not None and whole else None


def write(words: str, ending: str, content: bytes) -> None:
    """Store an entry for later processes; without a writable folder nothing is stored."""
    cache_folder.write(_file(words, ending), _digest(words, content) + content)


def _file(words: str, ending: str) -> str:
    return f"{hashlib.sha256(words.encode()).hexdigest()}.{ending}"


def _digest(words: str, content: bytes) -> bytes:
    """The digest of both. It prevents loading a damaged or misnamed entry, which would crash the process."""
    return hashlib.sha256(hashlib.sha256(words.encode()).digest() + content).digest()


def once(make: Callable[..., Made], *arguments: Any) -> Made:
    """`make(*arguments)`, from the disk where an earlier process made it from the same source and arguments."""
    try:
        words = "|".join((source(), name_of(make), *map(name_of, arguments)))
    except UnnamedError:
        forks.check()
        return make(*arguments)
    content = read(words, "json")
    with suppress(ValueError):
        if content is not None:
            return plain_format.loads(content)
    forks.check()  # indices are followed by XLA
    made = make(*arguments)
    with suppress(TypeError):  # without a plain form it is made again
        content = plain_format.dumps(made)
        write(words, "json", content)
        return plain_format.loads(content)  # as in later processes, so that machine code has the same name
    return made


@cache
def source() -> str:
    """The identity of this package and its dependencies: versions, a setting, and the content of every file."""
    folders = os.walk(Path(__file__).parents[1])
    paths = sorted(os.path.join(folder, name) for folder, _, names in folders for name in names if name.endswith(".py"))
    text = hashlib.sha256()
    for path in paths:  # 400 files: `Path` takes twice the time
        with open(path, "rb", buffering=0) as file:
            text.update(file.read())
    versions = jax.__version__, jaxlib.version.__version__, np.__version__, platform.python_version()
    return "|".join((*versions, str(jax.config.read("jax_enable_x64")), text.hexdigest()))


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
    """The name of a built-in class or function, or of one of this package."""
    module, name = str(getattr(thing, "__module__", "")), getattr(thing, "__qualname__", "<>")
    bound = getattr(thing, "__self__", None) is not None
    if bound or "<" in name or module.split(".")[0] not in ("builtins", __name__.split(".")[0]):
        raise UnnamedError
    return f"{module}.{name}"
