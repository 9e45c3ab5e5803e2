"""What the API reference reads of the source: signatures of records, and docstrings as Markdown.

A record made by `frozen` (or a NamedTuple) has its constructor from its fields, which is not in the source.
"""

import importlib
import inspect
import re
from typing import Any

from griffe import Class, Docstring, Extension, Function, Object, Parameter, ParameterKind, Parameters

LEADS = "Model|Assumes|Settings|Arguments|Returns|Raises|Cost|Reference|References"
KINDS = {
    inspect.Parameter.POSITIONAL_ONLY: ParameterKind.positional_only,
    inspect.Parameter.POSITIONAL_OR_KEYWORD: ParameterKind.positional_or_keyword,
    inspect.Parameter.VAR_POSITIONAL: ParameterKind.var_positional,
    inspect.Parameter.KEYWORD_ONLY: ParameterKind.keyword_only,
    inspect.Parameter.VAR_KEYWORD: ParameterKind.var_keyword,
}


class AsMarkdown(Extension):
    """Docstrings as Markdown, and the signatures of records."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Rewrite one docstring."""
        if obj.docstring is not None:
            obj.docstring = Docstring(markdown(obj.docstring.value), parent=obj)

    def on_class_members(self, *, cls: Class, **_: Any) -> None:
        """Give a record the constructor that its fields make."""
        if "__init__" not in cls.members and (_is_frozen(cls) or _is_tuple(cls)):
            constructor = Function("__init__", parameters=Parameters(*_parameters(cls)))
            cls.set_member("__init__", constructor)


def markdown(text: str) -> str:
    """A docstring as Markdown: examples fenced, the first words of a part in bold, signs of Markdown escaped.

    >>> markdown("Cost: n * p.\\n\\n>>> 1 + 1\\n2")
    '**Cost.** n \\\\* p.\\n\\n```pycon\\n>>> 1 + 1\\n2\\n```'
    """
    parts = re.split(r"\n\s*\n", inspect.cleandoc(text))
    return "\n\n".join(f"```pycon\n{part}\n```" if part.startswith(">>>") else _prose(part) for part in parts)


def _prose(part: str) -> str:
    body, mark, example = part.partition("\n>>>")
    plain = re.split(r"(`[^`]*`)", body)
    plain[::2] = [piece.replace("*", r"\*").replace("<", "&lt;").replace("$", "&#36;") for piece in plain[::2]]
    led = re.sub(rf"^({LEADS}): ", r"**\1.** ", "".join(plain), flags=re.MULTILINE)
    return f"{led}\n\n```pycon\n>>>{example}\n```" if mark else led


def _is_frozen(cls: Class) -> bool:
    return any(str(decorator.value).split(".")[-1] == "frozen" for decorator in cls.decorators)


def _is_tuple(cls: Class) -> bool:
    return any(str(base) == "NamedTuple" for base in cls.bases)


def _parameters(cls: Class) -> list[Parameter]:
    real = getattr(importlib.import_module(cls.module.path), cls.name)
    return [
        Parameter(
            name,
            kind=KINDS[found.kind],
            default=None if found.default is inspect.Parameter.empty else repr(found.default),
        )
        for name, found in inspect.signature(real).parameters.items()
    ]
