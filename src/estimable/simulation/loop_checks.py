# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false, reportUnknownVariableType=false
"""The checks of a call of `close_loop`: that its blocks fit together."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..controllers.state_feedback import check_controller
from ..engines import choice
from ..estimation.binding import check_hold, check_prior, check_prior_kind, model_of
from ..filters.actuated import Actuated
from ..filters.wrapped import check_algorithm
from ..models.controlled import ControlledPlant
from ..models.prior import Prior
from ..models.state_space import StateSpace
from ..networks.links import DelayLink
from ..networks.trace import Trace
from ..protocols import Algorithm, Anticipating, Controller
from ..protocols import Plant as Simulator
from .late_outputs import longest_delay
from .transmit import Links, check_links, is_link


def known_hold(plant: ControlledPlant, estimator: Algorithm[Any]) -> str:
    """How the inputs that the estimator knows vary between samples: commands are held, measured positions move."""
    return "zero_order" if isinstance(estimator, Actuated) else plant.hold


def check_run(seed: int, runs: int | None, first: int, on_failure: str, engine: str, plants: int | None) -> None:
    """Check the arguments that say what runs, and how."""
    faults = checks.Faults()
    faults.whole("seed", seed, 0)
    faults.whole("runs", runs, 1, checks.MOST_ROWS)  # pyright: ignore[reportArgumentType]
    if plants is not None and runs != plants:
        faults.add(f"`plant` is a list of {plants}, one for each run: leave `runs` out. Got {checks.short(runs)}.")
    faults.whole("first", first, 0)
    faults.choice("on_failure", on_failure, ("raise", "keep"))
    choice.check(engine, faults)
    faults.finish()


def check_simulators(simulators: Sequence[Simulator], several: bool, links: Links, measured: Mapping[str, int]) -> None:
    """Check what a loop in Python cannot do."""
    faults = checks.Faults()
    if several and simulators:
        faults.add("`plant` must not be a list of simulators, which fly one by one: call close_loop for each of them.")
    if measured and longest_delay(links.output):
        faults.add(
            f"the matrices of the estimator follow {checks.listed(list(measured))} as measured, so that it cannot go back to the "
            'sample of a late packet: give late="drop", or the course.'
        )
    faults.finish()


def check_call(
    plant: ControlledPlant,
    controller: Controller[Any],
    estimator: Algorithm[Any],
    links: Links,
    reference: Numbers,
    prior: Prior | None,
    dt: float | None,
    start: Numbers | None,
    lost: str,
) -> tuple[np.ndarray, Any]:
    """The reference (T, r) and the step in seconds; an `InputError` with every fault."""
    faults = checks.Faults()
    faults.instance("plant", plant, ControlledPlant, " A StateSpace or an OutputError is also possible.")
    check_controller(controller, faults)
    check_algorithm(estimator, faults)
    faults.finish()
    check_prior_kind(estimator, prior, faults)
    faults.finish()
    model, inner = plant.model, model_of(estimator)
    if estimator.has_state_prior:
        check_prior(prior, inner, faults)
    step = _read_step(model, inner, dt, faults)
    _check_blocks(plant, controller, estimator, links, lost, faults)
    given = np.asarray(reference)[:, None] if checks.depth(reference) == 1 else reference
    r = controller.references
    faults.learn("r", r, f"the controller follows {checks.counted(r, 'reference')}")
    followed = faults.array("reference", given, "T r")
    if followed is not None and len(followed) == 0:
        faults.add("`reference` must have at least one row in time.")
    for who, phase in [("plant", phase) for phase in plant.phases()] + [("estimator", inner)]:
        if followed is not None and phase.steps not in (None, len(followed)):
            faults.add(
                f"the model of the {who} varies over {phase.steps} rows of time, but `reference` has {len(followed)} rows."
            )
    if start is not None:
        faults.learn("n", model.n, f"the plant has {checks.counted(model.n, 'state')}")
        faults.array("start", start, "n")
    faults.finish()
    assert followed is not None
    return followed, step


def _read_step(model: StateSpace, inner: Any, dt: float | None, faults: checks.Faults) -> Any:
    """The step in seconds: that of a discrete model, or `dt`."""
    own = [m.dt for m in (model, inner) if m.dt]
    if dt is None and not own:
        faults.add("`dt` must be given, in seconds: the plant is continuous.")
        return None
    step = own[0] if dt is None else faults.number("dt", dt, above=0.0, unit="seconds")
    if step is not None and any(abs(step - other) > 1e-9 * step for other in own):
        faults.add(f"the plant, the estimator and `dt` must have the same step. Got {checks.listed([*own, step])} s.")
    return step


def _check_blocks(
    plant: ControlledPlant,
    controller: Controller[Any],
    estimator: Algorithm[Any],
    links: Links,
    lost: str,
    faults: checks.Faults,
) -> None:
    """Check that the blocks fit together."""
    model, inner = plant.model, model_of(estimator)
    check_hold(inner, known_hold(plant, estimator), faults)
    check_links(links, lost, model.m, model.p, "zero_order", faults)
    controller.check(estimator.names, faults)
    if controller.size != model.m:
        faults.add(f"`controller` has {checks.counted(controller.size, 'input')}, but the plant has {model.m}.")
    for name in estimator.names.outputs:
        if name not in model.outputs:
            faults.add(f"the estimator needs the output {name!r}, but the plant has {checks.listed(model.outputs)}.")
    if tuple(estimator.names.inputs) != tuple(model.inputs):
        faults.add(
            f"the estimator must have the plant's inputs, {checks.listed(model.inputs)}. It has "
            f"{checks.listed(estimator.names.inputs)}."
        )
    if links.output is not None and links.output.late == "use" and not isinstance(links.output, DelayLink | Trace):
        faults.add('`output_link`: late="use" is possible with a DelayLink or a Trace, whose longest delay is known.')
    if longest_delay(links.output) and isinstance(inner, StateSpace) and inner.varying:
        faults.add('`estimator` varies in time, and cannot go back to the sample of a late packet: give late="drop".')
    _check_inputs(plant, controller, estimator, links, faults)


def _check_inputs(
    plant: ControlledPlant, controller: Controller[Any], estimator: Algorithm[Any], links: Links, faults: checks.Faults
) -> None:
    """Check which inputs the estimator knows when the controller acts."""
    inner = model_of(estimator)
    through = any(np.any(phase.D) for phase in plant.phases()) or inner.feeds_through(list(range(inner.m)))
    if controller.acts_on == "filtered" and through and plant.actuator is None:
        faults.add(
            "the input enters y directly (`D` is not zero), and the controller acts on y: an algebraic loop. Give the plant an "
            "actuator, or delay the input by a sample."
        )
    counts = plant.position_sigma is not None and estimator.innermost.takes_uncertain_inputs
    if counts and not isinstance(estimator, Actuated) and inner.feeds_through(list(range(inner.m))):
        faults.add(
            "`position_sigma`: the input enters the outputs of the estimator directly, so that an error of its measured position "
            "is in y and in the state at once, which no filter here counts: use an estimator without these outputs."
        )
    if controller.acts_on == "predicted":
        _check_first(plant, controller, estimator, links, faults)
    if (plant.actuator is None or isinstance(estimator, Actuated)) and not (
        not is_link(links.input) or links.input.acknowledged or estimator.takes_unknown_arrivals
    ):
        faults.add(
            "`input_link` never acknowledges, so that the estimator would not know the applied inputs: measure them "
            "(ControlledPlant with an actuator), give acknowledged=True, or use JointOutputError(..., arrival=)."
        )


def _check_first(
    plant: ControlledPlant, controller: Controller[Any], estimator: Algorithm[Any], links: Links, faults: checks.Faults
) -> None:
    """Check the requirements of a controller that acts before the sample is measured."""
    if not isinstance(estimator, Anticipating):
        faults.add(
            "`controller` acts on a prediction, but the estimator does not report one: use JointOutputError or "
            f"RecursiveOutputError. Got {type(estimator).__name__}."
        )
    if longest_delay(links.output):
        faults.add(
            '`controller` acts on a prediction, and cannot use outputs that arrive late: give `output_link` late="drop".'
        )
    if plant.actuator is not None:
        faults.add(
            "`controller` acts on a prediction, and needs a plant whose inputs act directly: leave out `actuator`."
        )
    for phase in plant.phases():
        for k in range(phase.steps or 1):
            if not faults.sentences:
                controller.check_plant(phase.at(k), faults)
