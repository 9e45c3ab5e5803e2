"""One function of scalars, run row by row by every engine."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from estimable.engines import lowering, native, xla
from estimable.engines.batches import words
from estimable.engines.large import large_step
from estimable.engines.one_step import Place, Step, code_of, flat, form_of
from estimable.frozen import frozen, static
from estimable.results import Info, Interval, Sample

AXES = (None, 0, None)
FIXED = np.pi, np.int64(2**62 + 1), np.bool_(True)  # numbers of the algorithm: float64 cannot represent the integer
TINY = np.finfo(float).tiny


class Rows(NamedTuple):
    """Floats, integers and bools, (runs, rows, entries) each: arguments or results of a function."""

    floats: np.ndarray
    integers: np.ndarray
    bools: np.ndarray


@frozen
class Pack:
    """An algorithm that applies a function to each row, and returns its own numbers and those of the previous row.

    `function(floats, integers, bools)` returns three vectors of the same types.
    """

    fixed: Any
    function: Callable = static()

    def at(self, k) -> "Pack":
        return self

    def init(self, prior) -> tuple:
        return jnp.zeros(()), jnp.zeros((), int), jnp.zeros((), bool)

    def correct(self, state: tuple, sample: Sample) -> tuple[tuple, Info]:
        given = sample.y, sample.u, sample.seen
        given = [jnp.concatenate([array, jnp.stack(own)]) for array, *own in zip(given, state, self.fixed, strict=True)]
        floats, integers, bools = (
            jnp.concatenate([vector, array[-2:]]) for vector, array in zip(self.function(*given), given, strict=True)
        )
        info = Info(mean=floats, extra={"integers": integers, "bools": bools}, log_likelihood=jnp.zeros(()),
                    outcome=jnp.zeros((), int))  # fmt: skip
        return (sample.y[0], sample.u[0], sample.seen[0]), info

    def predict(self, state: tuple, interval: Interval) -> tuple:
        return state


def outputs(info: Info, keep: str) -> Rows:
    """The selected outputs of a row."""
    return Rows(info.mean, info.extra["integers"], info.extra["bools"])


def _step(pack: Pack, state: tuple, floats, integers, bools) -> tuple:
    after, info = pack.correct(state, Sample(floats, bools, integers))
    return after, info, jnp.zeros((), int)


def by_xla(pack: Pack, given: Rows, keep: str = "all") -> Rows:
    return xla.scan_bank(pack, None, *_samples(given), axes=AXES, keep=keep, select=outputs).info


def by_scalars_side_by_side(pack: Pack, given: Rows, keep: str = "all") -> Rows:
    return native.scan_bank(pack, None, *_samples(given), axes=AXES, keep=keep, select=outputs).info


def by_scalars(pack: Pack, given: Rows, keep: str = "all") -> Rows:
    runs = []
    for i in range(len(given.floats)):
        one = (jax.tree_util.tree_map(lambda leaf, i=i: leaf[i], part) for part in _samples(given))
        runs.append(native.scan(pack, None, *one, keep=keep, select=outputs).info)
    return Rows(*map(np.stack, zip(*runs, strict=True)))


def by_arrays(pack: Pack, given: Rows, keep: str = "all") -> Rows:
    parts = pack, None, *_samples(given), AXES
    size, fixed, rows = lowering.batch(*parts)
    return large_step(*lowering.example(*parts), keep, outputs, False).run(size, words(fixed), rows).info


def online(pack: Pack, given: Rows, keep: str = "all") -> Rows:
    """One row per call, from one place in memory to another and back."""
    state = jax.tree_util.tree_map(np.asarray, pack.init(None))
    entries = [np.zeros(array.shape[2:], array.dtype) for array in given]
    code = code_of(_step, pack, form_of(state), *entries)
    here, there = Place(form_of(state)), Place(form_of(state))
    steps = [Step(code, flat(pack), here, there), Step(code, flat(pack), there, here)]
    after = []
    for run in range(len(given.floats)):
        here.flat[:] = there.flat[:] = flat(state)
        for row in range(given.floats.shape[1]):
            step = steps[row % 2]
            for place, (array, _) in zip(step.inputs, words([(part[run, row], None) for part in given]), strict=True):
                place[:] = array
            step.run()
            memory = step.report.tobytes()
            after.append((step.fields["mean"](memory), *step.fields["extra"](memory).values()))
    floats, bools, integers = (np.stack(part).reshape(*given.floats.shape[:2], -1) for part in zip(*after, strict=True))
    rows = Rows(floats, integers, bools)
    return rows if keep == "all" else Rows(*(part[:, -1] for part in rows))


def _samples(given: Rows) -> tuple[Sample, Interval]:
    nothing = np.zeros((*given.floats.shape[:2], 0))
    return Sample(given.floats, given.bools, given.integers), Interval(nothing, nothing, None, nothing[..., :0])


ENGINES: dict[str, Callable[..., Rows]] = {
    "scalars": by_scalars, "scalars side by side": by_scalars_side_by_side, "arrays": by_arrays, "online": online,
}  # fmt: skip


def differing(ours: np.ndarray, theirs: np.ndarray, ulps: int = 0) -> np.ndarray:
    """Where numbers differ by more than `ulps`. XLA flushes subnormal numbers to zero; the sign of that zero is not compared."""
    if ours.dtype != float:
        return ours != theirs
    ours, theirs = (np.where(np.abs(x) < (4 if ulps else 1) * TINY, np.copysign(0.0, x), x) for x in (ours, theirs))
    with np.errstate(all="ignore"):
        close = np.abs(ours - theirs) <= ulps * np.spacing(np.minimum(np.abs(ours), np.abs(theirs)))
    same = (ours == theirs) & (np.signbit(ours) == np.signbit(theirs))
    return ~(same | (np.isnan(ours) & np.isnan(theirs)) | close)
