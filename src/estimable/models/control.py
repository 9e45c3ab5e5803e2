"""python-control in and out."""

from typing import Any

from .. import checks


def arguments_of(system: Any) -> dict[str, Any]:
    """The arguments of the `StateSpace` that a `control.StateSpace` is; it carries no noises."""
    if not all(hasattr(system, name) for name in ("A", "B", "C", "D", "dt", "state_labels")):
        kind = type(system).__name__
        checks.refuse(f"`system` must be a control.StateSpace: control.ss(system) makes one. Got {kind}.")
    dt = system.dt
    if dt is None or dt is True:
        checks.refuse(f"the system's dt is {dt}: give it a sampling time in seconds, or 0 for continuous time.")
    return {
        "A": system.A, "B": system.B, "C": system.C, "D": system.D, "dt": float(dt),
        "states": system.state_labels, "inputs": system.input_labels, "outputs": system.output_labels,
    }  # fmt: skip


def to_control(model: Any) -> Any:
    """`model` as a `control.StateSpace`, without its noises and operating point."""
    try:
        import control
    except ImportError:
        checks.refuse("python-control is not installed: pip install 'estimable[control]'.")
    faults = checks.Faults()
    if model.varying:
        faults.add(f"python-control has no time-varying models. Varying here: {checks.listed(model.varying)}.")
    if model.B_end is not None:
        faults.add("python-control has no first-order hold: `B_end` would be lost. Convert the continuous model.")
    if model.m == 0:
        faults.add("python-control needs an input: this model has none.")
    faults.finish()
    return control.StateSpace(
        model.A, model.B, model.C, model.D, model.dt, states=model.states, inputs=model.inputs, outputs=model.outputs
    )
