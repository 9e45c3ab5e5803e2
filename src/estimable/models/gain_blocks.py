"""The blocks of B(θ) = fixed + Σ θ_i directions_i and of D(θ) that unknown gains multiply."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array, Numbers
from ..frozen import replace
from .sampled import point_of
from .state_space import StateSpace

WORDS = ("one", "per_input", "every_entry")


def read_directions(given: Numbers | str | None, model: StateSpace, faults: checks.Faults) -> Any:
    """A word, or (p, n, m); `faults` learns n, m, the number of outputs, and the number p of gains."""
    faults.learn("n", model.n, f"the model has {checks.counted(model.n, 'state')}")
    faults.learn("m", model.m, f"the model has {checks.counted(model.m, 'input')}")
    faults.learn("outputs", model.p, f"the model has {checks.counted(model.p, 'output')}")
    if model.m == 0:
        faults.add("the model has no input, and a gain multiplies B u: give `B`.")
    given = "one" if given is None else given
    if not isinstance(given, str):
        return faults.array("directions", given, "p n m")
    faults.choice("directions", given, WORDS)
    p = {"one": 1, "per_input": model.m, "every_entry": model.n * model.m}.get(given)
    if p is not None:
        states, inputs = checks.counted(model.n, "state"), checks.counted(model.m, "input")
        gains = checks.counted(p, "gain")
        faults.learn("p", p, f"directions {given!r} of a model with {states} and {inputs} means {gains}")
    return given


def read_feedthrough(given: Numbers | str | None, directions: Numbers | str | None, faults: checks.Faults) -> Any:
    """None, "scaled" or (p, outputs, m)."""
    if given is None or not isinstance(given, str):
        return None if given is None else faults.array("feedthrough", given, "p outputs m")
    faults.choice("feedthrough", given, ("scaled",))
    if directions is not None and not is_word(directions):
        faults.add('`feedthrough` = "scaled" needs directions "one" or "per_input"; otherwise give (p, outputs, m).')
    return given


def gain_names(directions: Array | str, p: int, model: StateSpace) -> tuple[str, ...]:
    """A name for each of the p gains."""
    if not isinstance(directions, str):
        return tuple(f"gain{i + 1}" for i in range(p))
    return {
        "one": ("gain",),
        "per_input": tuple(f"gain_{name}" for name in model.inputs),
        "every_entry": tuple(f"B_{x}_{u}" for x in model.states for u in model.inputs),
    }[directions]


def is_word(directions: Numbers | str | None) -> bool:
    """Whether the directions are those of the model's own B."""
    return isinstance(directions, str) and directions in ("one", "per_input")


def in_blocks(
    model: StateSpace,
    p: int,
    *,
    directions: Array | str,
    fixed: Array | None = None,
    feedthrough: Array | str | None = None,
) -> StateSpace:
    """The model with [fixed, directions_1, ..] side by side in B, and [D, feedthrough_1, ..] in D."""
    known = 0 * model.B if fixed is None else _over_time(fixed, model.B) + 0 * model.B
    B, B_end = _side_by_side([known, *_blocks(directions, model.B, p)]), model.B_end
    if B_end is not None:
        B_end = _side_by_side([0 * B_end, *_blocks(directions, B_end, p)])
    D = [model.D, *[0 * model.D] * p]
    if isinstance(feedthrough, str):
        D = [0 * model.D, *_blocks(directions, model.D, p)]
    elif feedthrough is not None:
        D = [model.D, *_blocks(feedthrough, model.D, p)]
    return replace(model, B=B, B_end=B_end, D=_side_by_side(D), operating_point=point_of(model))


def _blocks(directions: Array | str, M: Array, p: int) -> list:
    """The p matrices that θ multiplies, each with the leading axes of M."""
    n, m = M.shape[-2:]
    if isinstance(directions, str):
        if directions == "one":
            return [M]
        if directions == "per_input":
            return [M * (np.arange(m) == i) for i in range(m)]
        directions = np.eye(n * m).reshape(n * m, n, m)
    return [_over_time(directions[..., i, :, :], M) + 0 * M for i in range(p)]


def _over_time(N: Array, M: Array) -> Array:
    """N with a time axis if M has one and N, which may be stacked, does not."""
    return N[..., None, :, :] if np.ndim(N) == np.ndim(M) - 1 and np.ndim(M) > 3 else N


def _side_by_side(blocks: list):
    return jnp.concatenate(blocks, axis=-1) if checks.is_traced(blocks) else np.concatenate(blocks, axis=-1)
