"""What the wrappers ask of what they wrap."""

from typing import Any

from .. import checks
from ..models.prior import Prior

STEPS = ("init", "correct", "predict")


def innermost(algorithm: Any) -> Any:
    """The algorithm inside all wrappers: the one that has a model."""
    while not hasattr(algorithm, "model"):
        algorithm = algorithm.algorithm
    return algorithm


def gain_prior(algorithm: Any) -> Prior:
    """The prior of the gains that an algorithm estimates."""
    return innermost(algorithm).gain


def check_algorithm(algorithm: Any, faults: checks.Faults) -> None:
    """What is wrapped has the three steps."""
    if isinstance(algorithm, type) or not all(hasattr(algorithm, step) for step in STEPS):
        faults.add(f"`algorithm` must be an algorithm, as UnknownGain(model, gain) is. Got {checks.short(algorithm)}.")


def check_gain(algorithm: Any, wrapper: str, faults: checks.Faults) -> None:
    """What is wrapped estimates a gain."""
    check_algorithm(algorithm, faults)
    faults.finish()
    if not algorithm.names.gains:
        faults.add(
            f"`algorithm` must estimate a gain, on which {wrapper} acts: {type(innermost(algorithm)).__name__} has none. "
            "Wrap an UnknownGain."
        )


def per_gain(name: str, value: Any, algorithm: Any, faults: checks.Faults) -> Any:
    """`value` for each gain, (p,), from one number or as many as there are gains."""
    p = len(algorithm.names.gains)
    faults.learn("gains", p, f"the algorithm has {checks.counted(p, 'gain')}")
    return faults.array(name, [value] * p if isinstance(value, int | float) else value, "gains")
