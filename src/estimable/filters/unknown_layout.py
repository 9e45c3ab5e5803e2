"""The unknown-input filter that the ranks of a model allow, and the layout of its state."""

from typing import Any, NamedTuple

import jax
import numpy as np

from .. import checks
from ..analysis.unknown_input_existence import METHODS as CASES
from ..analysis.unknown_input_existence import existence
from ..annotations import Array
from ..frozen import replace, saved
from ..models.sampled import Clock
from ..models.state_space import StateSpace
from ..results import UnknownInputExistence

METHODS = ("auto", *CASES, "exact", "fang")


@saved
class Layout(NamedTuple):
    """The state (x, d[-slots + 1], .., d[0]): n states and `slots` times d unknown inputs, the oldest first.

    `now`: the newest input is that of this instant (it enters y or x at once), not of the one before. `freedom`: the prior
    of the input: "none", "variance" or "walk". `known`, `unknown`: columns of the model's inputs. `leftover`: whether a
    direction may remain undetermined from one sample to the next.
    """

    n: int
    d: int
    slots: int
    now: bool
    freedom: str
    method: str
    known: tuple[int, ...]
    unknown: tuple[int, ...]
    delay: int
    note: str
    leftover: bool = True

    @property
    def complete(self) -> "Layout":
        """The layout where every output is seen and the prior is proper: each input is determined as soon as possible."""
        at_once = self.slots == 1 and self.method == ("feedthrough" if self.now else "no_feedthrough")
        return self._replace(leftover=not (at_once and self.freedom == "none"))

    @property
    def size(self) -> int:
        """Entries of the state."""
        return self.n + self.d * self.slots


def pick(M: Array | None, columns: tuple[int, ...]) -> Any:
    """Those columns of a matrix, or entries of a vector; None of None."""
    return None if M is None else M[..., np.array(columns, int)]


def lay_out(algorithm: Any, model: StateSpace, clock: Clock | None = None) -> Layout:
    """The layout for a model sampled at the steps of `clock` (None: a discrete one).

    Raises `InputError` with the ranks where the unknown inputs cannot be estimated, or not by the requested method.
    """
    unknown = tuple(model.inputs.index(name) for name in algorithm.unknown)
    known = tuple(i for i in range(model.m) if i not in unknown)
    freedom = "none" if algorithm.variance is algorithm.walk is None else "variance"
    freedom = freedom if algorithm.walk is None else "walk"
    first_order = model.B_end is not None or (clock is not None and model.is_continuous and clock.hold == "first_order")
    method, delay, note = _choose(algorithm, model, clock, unknown, freedom, first_order)
    D = pick(model.D, unknown)
    enters = checks.is_traced(D) or bool(np.any(D))
    now = freedom == "walk" or first_order or enters or delay == 0
    slots = delay + 1 if now else delay
    return Layout(model.n, len(unknown), slots, now, freedom, method, known, unknown, delay, note)


def _choose(
    algorithm, model: StateSpace, clock: Clock | None, unknown: tuple[int, ...], freedom: str, first_order: bool
) -> tuple[str, int, str]:
    """Method, delay, and a note that says which and why."""
    asked = algorithm.method
    if freedom != "none":
        kind = {"variance": "a prior variance", "walk": "a random walk"}[freedom]
        return "exact", algorithm.delay or 0, f"Exact conditioning: the unknown inputs have {kind}."
    verdict = _verdict(model, clock, unknown)
    if verdict is None:
        delay = 0 if first_order or checks.is_traced(model.D) or np.any(pick(model.D, unknown)) else 1
        return asked if asked == "fang" else "exact", _chosen(algorithm.delay, delay), "Exact conditioning."
    if asked == "fang":
        _check_fang(verdict, model, first_order)
        return (
            "fang",
            0,
            (
                f"Fang's Algorithm 1: D has full column rank {verdict.rank_D}. Row k of the state is predicted from the samples "
                "0..k-1; its covariance is the true one."
            ),
        )
    if asked != "exact":
        _check_exists(verdict, asked)
    delay = _chosen(algorithm.delay, 1 if verdict.delay is None else verdict.delay)
    name = CASES.get(verdict.method or "", "exact conditioning")
    which = "the input of row k" if delay == 0 else f"the input of row k - {delay}"
    note = (
        f"{name[0].upper()}{name[1:]}: rank D = {verdict.rank_D} of {len(unknown)}, rank [C B N, D] = {verdict.rank_next}. "
        f"Row k uses the samples 0..k, for the state of row k and {which}."
    )
    return verdict.method or "exact", delay, note


def _chosen(given: int | None, shortest: int) -> int:
    return shortest if given is None else given


def _verdict(model: StateSpace, clock: Clock | None, unknown: tuple[int, ...]) -> UnknownInputExistence | None:
    """Whether the model determines the inputs at the steps of the clock; None where the steps are unknown yet, or traced."""
    if checks.is_traced(model.A, model.B, model.C, model.D):
        return None
    while model.A.ndim - ("A" in model.varying) > 2:
        model = jax.tree_util.tree_map(lambda leaf: leaf[0], model)  # of a stack, the first
    if not model.is_continuous:
        return existence(model, unknown)
    if clock is None or model.varying:
        return None
    generic = existence(model.discretise(_short_step(model), hold=clock.hold), unknown)  # ranks are those of any step
    dt = float(np.ravel(clock.lengths)[0])
    if dt <= 0:
        return replace(generic, exists=True)
    actual = existence(model.discretise(dt, hold=clock.hold), unknown)
    return replace(actual, delay=generic.delay, method=generic.method)


def _short_step(model: StateSpace) -> float:
    """A step over which a continuous model changes by a hundredth."""
    return 0.01 / max(float(np.abs(model.A).max()), 1e-100) if model.A.any() else 0.01


def _check_exists(verdict: UnknownInputExistence, asked: str) -> None:
    if not verdict.exists:
        checks.refuse(
            f"the unknown inputs cannot be estimated: {verdict.sentence}. Give a prior for them (`variance` or `walk`), "
            'add an output, or run a short record anyway with method="exact".'
        )
    if asked not in ("auto", verdict.method):
        checks.refuse(
            f"`method` = {asked!r} does not fit this model. Its unknown inputs are known after "
            f"{checks.counted(verdict.delay or 0, 'sample')}, which is the case {verdict.method!r} (rank D = {verdict.rank_D})."
        )


def _check_fang(verdict: UnknownInputExistence, model: StateSpace, first_order: bool) -> None:
    faults = checks.Faults()
    if first_order:
        faults.add('`method` = "fang" needs an input that is constant over a sample (hold = "zero_order").')
    elif verdict.delay != 0:
        faults.add(
            f"Fang's Algorithm 1 needs D of full column rank: the columns of the unknown inputs have rank {verdict.rank_D}. "
            'method="auto" does not need it.'
        )
    elif len(verdict.unstable_zeros):
        faults.add(f"the unknown inputs cannot be estimated: {verdict.sentence}.")
    faults.finish()
