"""The calls in a jaxpr, and the names of its primitives here."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias, TypeGuard

from jax.core import ShapedArray

from .primitives import UnsupportedError

if TYPE_CHECKING:  # importing it takes a tenth of a second, for Pallas
    from jax.extend.core import JaxprEqn, Literal, Var

Atom: TypeAlias = "Var | Literal"
SAME = {"copy", "copy_p", "stop_gradient", "optimization_barrier"}
CALLS = {"jit", "pjit", "closed_call", "core_call", "custom_jvp_call", "custom_vjp_call", "checkpoint", "remat", "remat2",
         "custom_vmap_call"}  # fmt: skip


def is_literal(atom: Atom) -> TypeGuard[Literal]:
    """Whether an atom is a number, and not a variable."""
    return hasattr(atom, "val")


def name_of(equation: JaxprEqn) -> str:
    """The primitive of an equation. Raises `UnsupportedError` where it has side effects."""
    name: str = equation.primitive.name
    if name not in CALLS and (equation.effects or not equation.outvars):
        raise UnsupportedError(f"the primitive {name} has side effects")
    return "add" if name == "add_any" else name


def called(parameters: dict) -> tuple[Any, Any]:
    """The called jaxpr and its constants."""
    inner = next(parameters[name] for name in ("jaxpr", "call_jaxpr", "fun_jaxpr", "call") if name in parameters)
    return (inner.jaxpr, inner.consts) if hasattr(inner, "consts") else (inner, ())


def array_of(atom: Atom) -> ShapedArray:
    """The shape and type of an array in a jaxpr. Raises `UnsupportedError` for anything else."""
    if not isinstance(atom.aval, ShapedArray):
        raise UnsupportedError(f"a value of the kind {type(atom.aval).__name__} is not supported")
    return atom.aval
