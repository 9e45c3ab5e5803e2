"""An algorithm whose report has each state that is an angle in its range."""

from typing import Any

from ..annotations import Tree
from ..frozen import frozen, replace, static
from ..models import angles
from ..protocols import Wrapper
from ..results import Info, Sample


@frozen
class Reported(Wrapper[Any]):
    """A wrapper around a sampled algorithm. Its state goes on through any number of turns; its report is in the range.

    Settings: `algorithm`; `angles`, as in a model; `states`, the names of the states.
    """

    algorithm: Any
    angles: Any = static()
    states: tuple[str, ...] = static()

    def correct(self, state: Tree, sample: Sample) -> tuple[Any, Info]:
        """Update with one sample."""
        state, info = self.algorithm.correct(state, sample)
        return state, replace(info, mean=angles.ranged(info.mean, self.angles, self.states))
