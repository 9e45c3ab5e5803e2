"""`--set name=value`: settings of an algorithm, as text."""

import json
import re
import tomllib
from collections.abc import Iterable
from typing import Any

from .. import checks

WORD = re.compile(r"[A-Za-z_][\w.-]*")


def read_settings(given: Iterable[str]) -> dict[str, Any]:
    """Settings from texts `name=value`; a value is TOML or JSON (numbers, lists, texts), or one bare word.

    Raises `InputError` with every fault at once.

    >>> read_settings(["walk=0.02", "directions=per_input", "fixed=[[0.0], [1]]"])
    {'walk': 0.02, 'directions': 'per_input', 'fixed': [[0.0], [1]]}
    """
    faults, settings = checks.Faults(), {}
    for text in given:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not name.isidentifier():
            faults.add(f"--set needs name=value, as in --set walk=0.02. Got {text!r}.")
        elif name in settings:
            faults.add(f"--set gives {name!r} twice.")
        else:
            settings[name] = _value(name, value, faults)
    faults.finish()
    return settings


def _value(name: str, text: str, faults: checks.Faults) -> Any:
    for read in (_toml, json.loads, float):
        try:
            return read(text)
        except ValueError:
            continue
    if WORD.fullmatch(text):
        return text
    faults.add(f"--set {name}: {text!r} is no number, list or word. Write numbers as 0.02 and lists as [0.1, 0.2].")
    return None


def _toml(text: str) -> Any:
    document = tomllib.loads(f"value = {text}")
    if set(document) != {"value"}:
        raise ValueError("more than one value")
    return document["value"]
