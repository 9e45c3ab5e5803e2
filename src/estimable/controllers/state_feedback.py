"""An input that is linear in the estimated state."""

from dataclasses import KW_ONLY
from typing import Any

import jax.numpy as jnp
import numpy as np

from .. import checks
from ..frozen import frozen, set_field
from ..kernels.small import apply
from ..results import Info, Names


class Law:
    """A linear law: `feedback` (m, n) and `reference_gain` (m, r)."""

    feedback: Any
    reference_gain: Any

    @property
    def references(self) -> int:
        """How many references are followed."""
        return self.reference_gain.shape[-1]

    @property
    def size(self) -> int:
        """How many inputs are made."""
        return self.feedback.shape[-2]

    def check(self, names: Names, faults: checks.Faults) -> None:
        """What this asks of the estimator whose columns have these names."""
        n = self.feedback.shape[-1]
        if n != len(names.states):
            states = checks.counted(len(names.states), "state")
            faults.add(
                f"`controller` feeds back {n} states, and the estimator gives {states}: {checks.listed(names.states)}."
            )


class Around:
    """What acts through a `controller` of another kind."""

    controller: Any

    @property
    def references(self) -> int:
        """How many references are followed."""
        return self.controller.references

    @property
    def size(self) -> int:
        """How many inputs are made."""
        return self.controller.size


@frozen
class StateFeedback(Law):
    """u = N r - F x^ - L i: the reference r, the estimated state x^, and what the actuators do, i, where that is measured.

    Settings: `feedback` F (m, n), as `lqr_gain(...).feedback`; `reference_gain` N (m, r) (default None: no reference);
    `input_feedback` L (m, m), of the measured inputs (default None: none).

    The state is the filtered estimate, of which this takes no account of the covariance. For an actuator that may lose its
    effect, see `GainReconfiguration`; for an offset that must vanish, `ProportionalIntegral`.

    Cost: m (n + r + m) multiplications. Reference: A. G. Sillence (1999), ch. 3, the law without its integral.

    >>> law = StateFeedback([[2.0]], reference_gain=[[3.0]])
    >>> law.act(law.init(), Info(mean=np.array([0.5])), np.array([1.0]))[1].tolist()
    [2.0]
    """

    feedback: Any
    _: KW_ONLY
    reference_gain: Any = None
    input_feedback: Any = None

    acts_on = "filtered"

    def __post_init__(self):
        faults = checks.Faults()
        set_field(self, **read_law(self, faults))
        faults.finish()

    def init(self):
        """Nothing to remember."""
        return ()

    def act(self, state, estimate: Info, reference, effect=1.0):
        """The input (m,), with the part that passes through the plant shared out by `effect` (see `shared`)."""
        return state, shared(demand(self, estimate, reference), effect) - of_input(self, estimate), {}


def read_law(law: Any, faults: checks.Faults) -> dict[str, Any]:
    """The matrices of a linear law, checked together; those left out are zero."""
    read = {"feedback": faults.array("feedback", law.feedback, "m n")}
    for name, axes, size in (("reference_gain", "m r", 0), ("input_feedback", "m m", None)):
        given = getattr(law, name)
        m = faults.sizes.get("m", 1)
        default = np.zeros((m, m if size is None else size))
        read[name] = default if given is None else faults.array(name, given, axes)
    return read


def check_inner(controller: Any, faults: checks.Faults) -> None:
    """What a controller is put in is a controller."""
    if isinstance(controller, type) or not all(hasattr(controller, part) for part in ("act", "references")):
        faults.add(f"`controller` must be a controller, as StateFeedback(feedback). Got {checks.short(controller)}.")


def demand(law: Any, estimate: Info, reference) -> Any:
    """N r - F x^: what is asked of the plant."""
    wanted = apply(jnp.asarray(law.reference_gain), jnp.asarray(reference)) if law.references else 0.0
    return wanted - apply(jnp.asarray(law.feedback), jnp.asarray(estimate.mean))


def shared(wanted, effect) -> Any:
    """What is asked of the plant, divided by `effect`, one number or (m,); or times it, where it is a matrix (m, m)."""
    return apply(effect, wanted) if jnp.ndim(effect) == 2 else wanted / effect


def of_input(law: Any, estimate: Info) -> Any:
    """L i, with i what the actuators do."""
    extra = estimate.extra or {}
    return apply(jnp.asarray(law.input_feedback), jnp.asarray(extra["input"])) if "input" in extra else 0.0
