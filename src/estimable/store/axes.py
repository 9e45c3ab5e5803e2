"""The axes of the arrays of one record: the same letter has the same size in each array."""

import jax
import numpy as np

from .. import checks
from ..annotations import Numbers, Tree

Shape = tuple[int, ...]


class Axes:
    """The sizes of the axes of a record, learnt from its arrays in turn; `faults` lists those that do not fit.

    Arrays may have leading axes in front of the declared ones, the same in all arrays that have any: rows in time, or the
    runs of a batch.
    """

    def __init__(self, leading: Shape, sizes: dict[str, int]):
        self.leading, self.sizes = leading, sizes
        self.known = ""
        self.faults: list[str] = []

    def end(self, name: str, value: Numbers, axes: tuple[str, ...]) -> None:
        """Check numbers whose shape must end with `axes`."""
        shape = np.shape(value)
        cut = max(len(shape) - len(axes), 0)
        same = not (shape[:cut] and self.leading) or shape[:cut] == self.leading
        if np.asarray(value).dtype.kind not in "biufc":
            self.faults.append(f"{name} must hold numbers. Got {checks.short(value)}.")
        elif same and self._fits(name, axes, shape, shape[cut:]):
            self.leading = self.leading or shape[:cut]
        else:
            self._add(name, axes, shape)

    def begin(self, name: str, value: Tree, axes: tuple[str, ...]) -> Shape:
        """Check a thing whose arrays must all begin with `axes`, or a tuple of their length; returns the leading sizes."""
        if type(value) is tuple or type(value) is list:
            if not self._fits(name, axes, (len(value),), (len(value),)):
                self._add(name, axes, (len(value),))
            return ()
        for path, leaf in jax.tree_util.tree_leaves_with_path(value):
            shape, cut = np.shape(leaf), len(self.leading)
            at = f"`{name[1:-1]}{jax.tree_util.keystr(path)}`"
            if shape[:cut] != self.leading or not self._fits(at, axes, shape, shape[cut : cut + len(axes)]):
                self._add(at, (*axes, ".."), shape)
                break
        return *self.leading, *(self.sizes.get(axis, 0) for axis in axes)

    def _fits(self, name: str, axes: tuple[str, ...], shape: Shape, sizes: Shape) -> bool:
        learnt = self.sizes | {axis: int(axis) for axis in axes if axis.isdigit()}
        if len(axes) != len(sizes) or any(
            learnt.setdefault(a, size) != size for a, size in zip(axes, sizes, strict=True)
        ):
            return False
        self.sizes, self.known = learnt, self.known or f": {name} is {shape}"
        return True

    def _add(self, name: str, axes: tuple[str, ...], shape: Shape) -> None:
        sizes = {axis: size for axis, size in self.sizes.items() if not axis.isdigit()}
        wanted = [f"{axis} = {sizes[axis]}" if axis in sizes else axis for axis in axes]
        self.faults.append(
            f"{name} must be ({', '.join([*map(str, self.leading), *wanted])}){self.known}. Got {shape}."
        )


def asymmetry(name: str, value: Numbers) -> list[str]:
    """A fault if a matrix, or one of a stack, is not symmetric; matrices that are not finite pass, as after a failure."""
    P = np.asarray(value)
    if P.ndim < 2 or P.shape[-1] != P.shape[-2]:
        return []
    with np.errstate(invalid="ignore"):
        skew = np.abs(P - np.swapaxes(P, -1, -2)).max(axis=(-1, -2), initial=0.0)
        wrong = skew > checks.ROUNDING * np.abs(P).max(axis=(-1, -2), initial=0.0)  # False of NaN
    if not np.any(wrong):
        return []
    return [f"{name} must be symmetric: it differs from its transpose by {skew[wrong].max():.3g}."]
