"""A name for a computation, from its numbers, its settings, and the source of every function that it uses."""

import dataclasses
import functools
import hashlib
import pickle
import sys
import sysconfig
import types
from collections.abc import Callable, Iterator
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, ClassVar

import jax
import numpy as np

from .. import __version__
from ..frozen import field_names

PLAIN = (type(None), bool, int, float, complex, str, bytes, Path)
INSTALLED = tuple(Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib", "purelib", "platlib"))


class UnseenError(Exception):
    """The content of an object cannot be inspected."""


def fingerprint(*things: Any) -> str:
    """A name that is equal for equal things in every process, under one version of this package, of JAX and of NumPy.

    A function is represented by its instructions and everything it uses: defaults, closure, globals, the functions and modules
    it calls. Those of installed packages are represented by their versions. Raises `UnseenError`.
    """
    words = _Words()
    parts = [__version__, jax.__version__, np.__version__, *map(words.of, things)]
    return hashlib.sha256("|".join(parts).encode()).hexdigest()[:20]


class _Words:
    """The words of things; a thing met before is represented by its number."""

    BY_KIND: ClassVar[tuple[tuple[Any, Callable[..., Iterator[str]]], ...]]

    def __init__(self) -> None:
        self.met: dict[int, tuple[int, Any]] = {}

    def of(self, thing: Any) -> str:
        """Words that two things share only where they are equal."""
        if isinstance(thing, PLAIN):
            return f"{type(thing).__name__} {thing!r}"
        if isinstance(thing, np.ndarray | np.generic | jax.Array):
            return _of_array(np.asarray(thing))
        if id(thing) in self.met:
            return f"again {self.met[id(thing)][0]}"
        self.met[id(thing)] = len(self.met), thing
        return f"{type(thing).__qualname__}({','.join(self._parts(thing))})"

    def _parts(self, thing: Any) -> Iterator[str]:
        for kinds, parts in self.BY_KIND:
            if isinstance(thing, kinds):
                return parts(self, thing)
        if hasattr(thing, "__wrapped__"):
            return self._function(thing)
        if dataclasses.is_dataclass(thing):
            return map(self.of, (type(thing), *(getattr(thing, name) for name in field_names(type(thing)))))
        return self._other(thing)

    def _builtin(self, function: Any) -> Iterator[str]:
        yield getattr(function, "__qualname__", repr(function))
        yield self.of(getattr(function, "__self__", None))

    def _sequence(self, parts: tuple | list) -> Iterator[str]:
        yield from map(self.of, parts if type(parts) in (tuple, list) else (type(parts), *parts))

    def _function(self, function: Any) -> Iterator[str]:
        if (name := installed(function)) is not None:
            yield name
            return
        function = getattr(function, "__wrapped__", function)
        code = getattr(function, "__code__", None)
        if code is None:
            raise UnseenError(repr(function))
        yield _of_code(code)
        held = [cell.cell_contents for cell in function.__closure__ or () if _is_filled(cell)]
        yield from map(self.of, (*held, *(function.__defaults__ or ()), *(function.__kwdefaults__ or {}).items()))
        for name in sorted(_names(code) & function.__globals__.keys()):
            yield f"{name}={self.of(function.__globals__[name])}"

    def _class(self, kind: type) -> Iterator[str]:
        if (name := installed(kind)) is not None:
            yield name
            return
        yield kind.__qualname__
        yield from map(self.of, kind.__bases__)
        for name, value in sorted(vars(kind).items()):
            if name not in ("__dict__", "__weakref__", "__doc__", "__module__", "__annotations__", "__firstlineno__",
                            "__static_attributes__", "__abstractmethods__", "_abc_impl"):  # fmt: skip
                yield f"{name}={self.of(value.fget if isinstance(value, property) else getattr(value, '__func__', value))}"

    def _module(self, module: types.ModuleType) -> Iterator[str]:
        """The version of an installed module; the content of a user's file, and of the user's modules that it imports."""
        yield module.__name__
        if (name := installed(module)) is not None:
            yield name
        elif getattr(module, "__file__", None):
            yield hashlib.sha256(Path(module.__file__ or "").read_bytes()).hexdigest()
            for value in vars(module).values():
                other = (
                    value
                    if isinstance(value, types.ModuleType)
                    else sys.modules.get(getattr(value, "__module__", "") or "")
                )
                if other is not None and other is not module and installed(other) is None:
                    yield self.of(other)

    def _other(self, thing: Any) -> Iterator[str]:
        """A user's object: its class and its content, or else its pickled form."""
        yield self.of(type(thing))
        held = getattr(thing, "__dict__", None)
        if held is not None and installed(type(thing)) is None:
            yield self.of(held)
            return
        try:
            yield hashlib.sha256(pickle.dumps(thing)).hexdigest()
        except Exception as reason:  # any error of a class that cannot be pickled
            raise UnseenError(f"{type(thing).__name__} ({reason})") from None


_Words.BY_KIND = (
    (types.ModuleType, _Words._module),
    ((types.BuiltinFunctionType, types.MethodDescriptorType, np.ufunc), _Words._builtin),
    (types.FunctionType, _Words._function),
    (types.MethodType, lambda words, method: map(words.of, (method.__func__, method.__self__))),
    (functools.partial, lambda words, made: map(words.of, (made.func, made.args, made.keywords))),
    (type, _Words._class),
    (dict, lambda words, held: (words.of(part) for pair in held.items() for part in pair)),
    ((set, frozenset), lambda words, held: iter(sorted(_Words().of(part) for part in held))),
    ((tuple, list), _Words._sequence),
)


def installed(thing: Any) -> str | None:
    """The name and version of an object of Python or of an installed package; None for a user's object."""
    name = thing.__name__ if isinstance(thing, types.ModuleType) else getattr(thing, "__module__", None)
    if not isinstance(name, str):
        return None
    package = name.partition(".")[0]
    if not _is_installed(package):
        return None
    return f"{name}.{getattr(thing, '__qualname__', '')} {_version(package)}"


@cache
def _is_installed(package: str) -> bool:
    if (
        package == __name__.partition(".")[0]
        or package in sys.stdlib_module_names
        or package in sys.builtin_module_names
    ):
        return True
    file = getattr(sys.modules.get(package), "__file__", None)
    return file is not None and any(Path(file).resolve().is_relative_to(folder) for folder in INSTALLED)


@cache
def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return str(getattr(sys.modules.get(package), "__version__", sys.version.split()[0]))


def _of_array(array: np.ndarray) -> str:
    if array.dtype.hasobject:
        raise UnseenError("an array of objects")
    return f"{array.shape}{array.dtype}{hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()}"


def _of_code(code: types.CodeType) -> str:
    """The content of a function: its instructions, names and constants, but not its location."""
    constants = [_of_code(c) if isinstance(c, types.CodeType) else repr(c) for c in code.co_consts]
    return f"{code.co_code.hex()}{code.co_names}{code.co_varnames}{constants}"


def _names(code: types.CodeType) -> set[str]:
    """The names that a function and those inside it look up."""
    inner = (_names(c) for c in code.co_consts if isinstance(c, types.CodeType))
    return set(code.co_names).union(*inner)


def _is_filled(cell: Any) -> bool:
    try:
        cell.cell_contents  # noqa: B018
    except ValueError:
        return False
    return True
