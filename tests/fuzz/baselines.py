"""Right calls of everything public, taken from the examples of the docstrings: a new name is covered by its own example."""

import ast
import doctest
import importlib
import inspect
import pkgutil
import types
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import jax
import numpy as np

import estimable as es
from estimable import checks, protocols

PUBLIC = {name: getattr(package, name) for package in (es, es.results) for name in package.__all__}
INNER = (protocols.Algorithm, protocols.Link, protocols.Controller, protocols.Identifier, protocols.Plant)
MODULES = sorted(m.name for m in pkgutil.walk_packages(es.__path__, "estimable.") if m.name != "estimable.__main__")


class Baseline(NamedTuple):
    """A call that is right: what is called, and its arguments by name."""

    name: str
    function: Callable[..., Any]
    arguments: dict[str, Any]
    optional: tuple[str, ...]


def baselines() -> list[Baseline]:
    """Every public call in the examples, in the order of the modules."""
    found: list[Baseline] = []
    for module in MODULES:
        found += _of_module(importlib.import_module(module))
    return found


def _of_module(module: types.ModuleType) -> Iterator[Baseline]:
    names = PUBLIC | {"np": np, "float64": np.float64} | vars(module)
    for test in doctest.DocTestFinder(exclude_empty=True).find(module, globs=dict(names)):
        calls: list[Baseline] = []
        test.globs["_call"] = lambda function, *args, _calls=calls, **kwargs: _call(_calls, function, args, kwargs)
        for example in test.examples:
            tree = ast.fix_missing_locations(_Calls().visit(ast.parse(example.source)))
            try:
                exec(compile(tree, test.name, "exec"), test.globs)
            except Exception:  # an example of an error
                break
        yield from calls


class _Calls(ast.NodeTransformer):
    """f(a, b=c) becomes _call(f, a, b=c)."""

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        return ast.Call(ast.Name("_call", ast.Load()), [node.func, *node.args], node.keywords)


def _call(calls: list[Baseline], function: Any, args: tuple, kwargs: dict[str, Any]) -> Any:
    if _is_public(function):
        try:
            signature = inspect.signature(function)
            bound = signature.bind(*args, **kwargs)
        except (TypeError, ValueError):
            return function(*args, **kwargs)
        several = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD, inspect.Parameter.POSITIONAL_ONLY)
        kinds = {name: parameter.kind for name, parameter in signature.parameters.items()}
        traced = any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree_util.tree_leaves(dict(bound.arguments)))
        if not traced and not any(kinds[name] in several for name in bound.arguments):
            optional = tuple(
                name for name, kind in kinds.items() if name not in bound.arguments and kind not in several
            )
            calls.append(Baseline(function.__qualname__, function, dict(bound.arguments), optional))
    return function(*args, **kwargs)


def _is_public(function: Any) -> bool:
    name, module = getattr(function, "__qualname__", "_"), getattr(function, "__module__", None) or ""
    if not module.startswith("estimable.") or any(part.startswith("_") for part in name.split(".")) or "<" in name:
        return False
    owner = getattr(function, "__self__", None)
    if isinstance(owner, checks.Faults):
        return False  # its arguments are words of this package's own code, except the value that is checked
    if owner is not None and not isinstance(owner, type):
        return not isinstance(owner, INNER)  # their steps are called by the drivers, with checked arguments
    return name.split(".")[0] in PUBLIC or "diagnostics" in module or "plants" in module
