"""`--set name=value`: settings of an algorithm, as text; other options are read alike."""

import json
import re
import tomllib
from collections.abc import Iterable
from typing import Any

import numpy as np

from .. import catalogue, checks
from ..annotations import Tree
from ..protocols import Algorithm, Wrapper

WORD = re.compile(r"[A-Za-z_][\w.-]*")


def read_settings(given: Iterable[str], *, option: str = "--set", example: str = "walk=0.02") -> dict[str, Any]:
    """Settings from texts `name=value`; a value is TOML or JSON (numbers, lists, strings), or one bare word.

    `option`, `example`: what the messages name.

    Raises `InputError` with all faults at once.

    >>> read_settings(["walk=0.02", "directions=per_input", "fixed=[[0.0], [1]]"])
    {'walk': 0.02, 'directions': 'per_input', 'fixed': [[0.0], [1]]}
    """
    faults, settings = checks.Faults(), {}
    for text in given:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not name.isidentifier():
            faults.add(f"{option} needs name=value, as in {option} {example}. Got {text!r}.")
        elif name in settings:
            faults.add(f"{option} gives {name!r} twice.")
        else:
            settings[name] = _value(f"{option} {name}", value, faults)
    faults.finish()
    return settings


def settings_in_force(algorithm: Algorithm[Any]) -> dict[str, Any]:
    """The current settings of an algorithm and of those it wraps, as --set names them; of two with one name, the outer one.

    >>> model = StateSpace([[0.5]], [[1.0]], Q=[[0.0]], R=[[0.01]], dt=1)
    >>> settings_in_force(MovingWindow(UnknownGain(model, Prior([1.0], [[0.3]]), walk=0.1), 5))
    {'algorithm': 'unknown-gain', 'length': 5, 'directions': 'one', 'walk': 0.1, 'forgetting': 1.0}
    """
    wrapped = algorithm.algorithm if isinstance(algorithm, Wrapper) else None
    outer = {} if wrapped is None else {"algorithm": catalogue.name_of(wrapped)}
    outer |= {name: _plain(getattr(algorithm, name)) for name in catalogue.settings_of(type(algorithm))}
    inner = {} if wrapped is None else settings_in_force(wrapped)
    both = outer | {name: value for name, value in inner.items() if name not in outer}
    return {name: value for name, value in both.items() if value is not None}


def _plain(value: Tree) -> Any:
    """A number, a string or a list; one number for a multiple of the identity or for equal numbers; None for anything else."""
    if isinstance(value, np.ndarray) and value.size:
        alike = value.flat[0] * (np.eye(len(value)) if value.ndim == 2 else np.ones(value.shape))
        return value.flat[0].item() if np.array_equal(value, alike) else value.tolist()
    return value if isinstance(value, int | float | str) else None


def _value(what: str, text: str, faults: checks.Faults) -> Any:
    for read in (_toml, json.loads, float):
        try:
            return read(text)
        except ValueError:
            continue
    if WORD.fullmatch(text):
        return text
    faults.add(f"{what}: {text!r} is not a number, list or word. Write numbers as 0.02 and lists as [0.1, 0.2].")
    return None


def _toml(text: str) -> Any:
    document = tomllib.loads(f"value = {text}")
    if set(document) != {"value"}:
        raise ValueError("more than one value")
    return document["value"]
