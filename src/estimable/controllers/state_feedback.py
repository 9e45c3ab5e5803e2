"""An input that is linear in the estimated state."""

from collections.abc import Mapping
from dataclasses import KW_ONLY
from typing import Any

import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array
from ..frozen import frozen, set_field
from ..kernels.small import apply
from ..protocols import Controller, SharedController
from ..results import Info, Names

POINT = {"states": "n", "inputs": "m", "references": "r"}  # of a law, with their sizes


def check_states(feedback: Array, names: Names, faults: checks.Faults) -> None:
    """Check that the estimator has as many states as `feedback` (m, n) takes."""
    n = feedback.shape[-1]
    if n != len(names.states):
        states = checks.counted(len(names.states), "state")
        faults.add(
            f"`controller` feeds back {n} states, but the estimator has {states}: {checks.listed(names.states)}."
        )


@frozen
class StateFeedback(SharedController[tuple[()]]):
    """A linear control law on the estimated state: u = N r - F x^ - L i.

    Here r is the reference, x^ the estimated state, and i the measured positions of the actuators.

    Settings: `feedback` F (m, n), such as `lqr_gain(...).feedback`; `reference_gain` N (m, r) (default None: no reference);
    `input_feedback` L (m, m) (default None: positions are not fed back); `operating_point`: {"states", "inputs",
    "references"}, the point about which the law is linear (default None: zero). x^, i, r and u are then absolute:
    u - u0 = N (r - r0) - F (x^ - x0) - L (i - u0).

    The law uses the filtered estimate and ignores its covariance. For an actuator that may lose its effect, use
    `GainReconfiguration`; for an offset that must vanish, `ProportionalIntegral`.

    Cost: m (n + r + m) multiplications. Reference: A. G. Sillence (1999), ch. 3, the law without its integral.

    >>> law = StateFeedback([[2.0]], reference_gain=[[3.0]])
    >>> law.act(law.init(), Info(mean=np.array([0.5])), np.array([1.0]))[1].tolist()
    [2.0]
    """

    feedback: Any
    _: KW_ONLY
    reference_gain: Any = None
    input_feedback: Any = None
    operating_point: Any = None

    def __post_init__(self):
        faults = checks.Faults()
        set_field(self, **read_law(self, faults))
        faults.finish()

    @property
    def size(self) -> int:
        """The number of inputs."""
        return self.feedback.shape[-2]

    @property
    def references(self) -> int:
        """The number of references."""
        return self.reference_gain.shape[-1]

    def check(self, names: Names, faults: checks.Faults) -> None:
        """Check that the estimator has the states that are fed back."""
        check_states(self.feedback, names, faults)

    def init(self) -> tuple[()]:
        """An empty state."""
        return ()

    def act(
        self, state: tuple[()], estimate: Info, reference: Array, effect: Array | float = 1.0
    ) -> tuple[tuple[()], Array, Mapping[str, Array]]:
        """The input (m,). Its demand on the plant, N r - F x^, is divided by `effect`."""
        return state, shared(demand(self, estimate, reference), effect) - of_input(self, estimate), {}


def read_law(law: Any, faults: checks.Faults) -> dict[str, Any]:
    """The matrices of a linear law, checked together; omitted ones are zero."""
    read = {"feedback": faults.array("feedback", law.feedback, "m n")}
    for name, axes, size in (("reference_gain", "m r", 0), ("input_feedback", "m m", None)):
        given = getattr(law, name)
        m = faults.sizes.get("m", 1)
        default = np.zeros((m, m if size is None else size))
        read[name] = default if given is None else faults.array(name, given, axes)
    if read["reference_gain"] is not None:
        faults.learn("r", read["reference_gain"].shape[-1], "`reference_gain` is (m, r)")
    read["operating_point"] = _read_point(law.operating_point, faults)
    return read


def _read_point(given: Any, faults: checks.Faults) -> Any:
    """The operating point of a law: {part: numbers}; zero where a part is omitted. None: zero."""
    if given is None:
        return None
    if not isinstance(given, Mapping):
        faults.add(
            "`operating_point` must be a mapping {'states': ..., 'inputs': ..., 'references': ...}. Got "
            f"{checks.short(given)}."
        )
        return None
    for part in given:
        if part not in POINT:
            near = checks.suggestion(part, POINT)
            faults.add(f"`operating_point` may have the keys {checks.listed(POINT)}. Got {part!r}.{near}")
    return {
        part: faults.array(f"operating_point {part}", given.get(part, np.zeros(faults.sizes.get(axis, 1))), axis)
        for part, axis in POINT.items()
    }


def check_controller(controller: Controller[Any], faults: checks.Faults) -> None:
    """Check that it is a controller, not a class."""
    if not isinstance(controller, Controller):
        faults.add(
            "`controller` must be a controller, such as StateFeedback(feedback), or your own class derived from "
            f"estimable.Controller. Got {checks.short(controller)}."
        )


def check_inner(controller: Controller[Any], around: str, faults: checks.Faults) -> None:
    """Check that it is a controller whose demand on the plant can be divided."""
    check_controller(controller, faults)
    if isinstance(controller, Controller) and not isinstance(controller, SharedController):
        faults.add(
            f"`controller` must be a law whose demand {around} can divide, such as StateFeedback or ProportionalIntegral. "
            f"Got {type(controller).__name__}."
        )


def demand(law: Any, estimate: Info, reference: Array) -> Any:
    """u0 + N (r - r0) - F (x^ - x0): the demand on the plant."""
    point, r, x = law.operating_point, jnp.asarray(reference), jnp.asarray(estimate.mean)
    if point is not None:
        r, x = r - jnp.asarray(point["references"]), x - jnp.asarray(point["states"])
    wanted = apply(jnp.asarray(law.reference_gain), r) if law.references else 0.0
    wanted = wanted - apply(jnp.asarray(law.feedback), x)
    return wanted if point is None else wanted + jnp.asarray(point["inputs"])


def shared(wanted: Array, effect: Array | float) -> Any:
    """The demand on the plant, divided by `effect`, one number or (m,); or multiplied by it, where it is a matrix (m, m)."""
    return apply(jnp.asarray(effect), wanted) if jnp.ndim(effect) == 2 else wanted / effect


def of_input(law: Any, estimate: Info) -> Any:
    """L (i - u0), with i the actuator positions."""
    extra = estimate.extra or {}
    if "input" not in extra:
        return 0.0
    i = jnp.asarray(extra["input"])
    about = i if law.operating_point is None else i - jnp.asarray(law.operating_point["inputs"])
    return apply(jnp.asarray(law.input_feedback), about)
