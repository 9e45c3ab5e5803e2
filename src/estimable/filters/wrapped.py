"""The checks that wrappers make of the algorithm inside."""

from typing import Any

from .. import checks
from ..annotations import Numbers
from ..models.state_space import StateSpace
from ..protocols import Algorithm


def check_algorithm(algorithm: Algorithm[Any], faults: checks.Faults) -> None:
    """Check that it is an algorithm made of a model, not a class."""
    if isinstance(algorithm, type) and issubclass(algorithm, Algorithm):
        faults.add(f"`algorithm` must be made of a model: write {algorithm.__name__}(model), not {algorithm.__name__}.")
    elif not isinstance(algorithm, Algorithm):
        faults.add(
            "`algorithm` must be an algorithm, such as Kalman(model), or your own class derived from estimable.Algorithm. "
            f"Got {type(algorithm).__name__}."
        )
    else:
        _check_steps(algorithm.innermost, faults)


def _check_steps(algorithm: Algorithm[Any], faults: checks.Faults) -> None:
    """A filter without `sampled` and `at` takes the matrices of its model as they are: right for some models only."""
    model, kind = algorithm.model, type(algorithm)
    if not isinstance(model, StateSpace):
        return
    wrong = []
    if kind.sampled is Algorithm.sampled:
        wrong += ["is continuous"] if model.is_continuous else []
        wrong += ["has an operating point"] if model.operating_point is not None else []
    if kind.at is Algorithm.at and model.varying:
        wrong += ["varies in time"]
    if wrong:
        faults.add(
            f"{kind.__name__} defines no `sampled` or no `at`, and so needs a model that is discrete and constant, without an "
            f"operating point. This one {' and '.join(wrong)}."
        )


def check_gain(algorithm: Algorithm[Any], wrapper: str, faults: checks.Faults) -> None:
    """Check that the algorithm inside estimates a gain."""
    check_algorithm(algorithm, faults)
    faults.finish()
    if not algorithm.names.gains:
        faults.add(
            f"`algorithm` must estimate a gain for {wrapper} to act on: {type(algorithm.innermost).__name__} has none. "
            "Wrap an UnknownGain."
        )


def per_gain(name: str, value: Numbers, algorithm: Algorithm[Any], faults: checks.Faults) -> Any:
    """`value` for each gain, (p,), from one number or one number per gain."""
    p = len(algorithm.names.gains)
    faults.learn("gains", p, f"the algorithm has {checks.counted(p, 'gain')}")
    return faults.array(name, [value] * p if isinstance(value, int | float) else value, "gains")


def disturbances(algorithm: Algorithm[Any]) -> tuple[str, ...]:
    """The states of its model that are disturbances, whose prior the model has."""
    model = algorithm.innermost.model
    found = model.disturbance if isinstance(model, StateSpace) else None
    return () if found is None else model.states[-len(found.at) :]
