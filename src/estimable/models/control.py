"""Conversion from and to python-control."""

from typing import Any

from .. import checks


def arguments_of(system: Any) -> dict[str, Any]:
    """The arguments of `StateSpace` for a `control.StateSpace`, which has no noise covariances."""
    if not all(hasattr(system, name) for name in ("A", "B", "C", "D", "dt", "state_labels")):
        kind = type(system).__name__
        checks.refuse(f"`system` must be a control.StateSpace. Convert it with control.ss(system). Got {kind}.")
    dt = system.dt
    if dt is None or dt is True:
        checks.refuse(f"the system's dt is {dt}: give it a sampling time in seconds, or 0 for continuous time.")
    return {
        "A": system.A, "B": system.B, "C": system.C, "D": system.D, "dt": float(dt),
        "states": system.state_labels, "inputs": system.input_labels, "outputs": system.output_labels,
    }  # fmt: skip


def to_control(model: Any) -> Any:
    """`model` as a `control.StateSpace`, without its noise covariances and operating point."""
    try:
        import control
    except ImportError:
        checks.refuse("python-control is not installed: pip install 'estimable[control]'.")
    faults = checks.Faults()
    if model.varying:
        faults.add(
            f"python-control has no time-varying models. These matrices vary in time: {checks.listed(model.varying)}."
        )
    if model.B_end is not None:
        faults.add(
            "python-control has no first-order hold, so `B_end` would be lost. Convert the continuous model instead."
        )
    if model.m == 0:
        faults.add("python-control needs a model with an input. This model has none.")
    faults.finish()
    return control.StateSpace(
        model.A, model.B, model.C, model.D, model.dt, states=model.states, inputs=model.inputs, outputs=model.outputs
    )
