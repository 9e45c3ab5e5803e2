"""What can be estimated with a model, as JSON and as text."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..analysis.estimability import estimability
from ..analysis.gain_information import gain_information
from ..analysis.loss_tolerance import loss_tolerance
from ..analysis.observability import observability, reachability
from ..analysis.unknown_input_existence import unknown_input_existence
from ..errors import EstimableError
from ..estimation.following import model_along
from ..models.files import ModelFile, read_model
from ..models.state_space import StateSpace
from ..results import (
    Estimability,
    GainInformation,
    LossTolerance,
    Names,
    Observability,
    Reachability,
    UnknownInputExistence,
)  # fmt: skip
from .numbers import counted
from .run_filter import read_measured

WORDS = {
    "estimable": "estimable one step ahead",
    "estimable_with_present": "estimable with the present output",
    "observable": "observable",
    "detectable": "detectable",
    "reachable": "reachable by inputs",
    "stabilisable": "stabilisable by inputs",
    "disturbable": "reachable by process noise",
    "unknown_inputs": "unknown inputs determined",
}


class Checked(NamedTuple):
    """A model file, the model that was judged (sampled, where a step was given), and the verdicts.

    `losses`: how many samples may be lost; None if no arrival rate suffices or the question does not apply. `gains`: the
    information about the gains that the inputs of a record provide; None without a record.
    """

    path: Path
    file: ModelFile
    model: StateSpace
    estimability: Estimability
    observability: Observability
    reachability: Reachability | None
    disturbability: Reachability
    unknown: UnknownInputExistence | None
    losses: LossTolerance | None
    gains: GainInformation | None


def checked(
    path: Path, *, dt: float | None = None, horizon: float | None = None, record: Path | None = None
) -> Checked:
    """Read a model file and judge its model, in steady state if it has one.

    `dt`: the step at which a continuous model is sampled, instead of the model file's. `horizon`: in samples, or in
    seconds if the model stays continuous. `record`: a file; the information about the gains is computed for its inputs.
    """
    file = read_model(path)
    model = sampled(file, dt)
    steps = _horizon(model, horizon)
    steady = steps is None and not model.varying
    prior = None if steady or file.prior.diffuse is not None else file.prior
    return Checked(
        path,
        file,
        model,
        estimability(model, horizon=steps, prior=prior),
        observability(model),
        reachability(model) if model.m else None,
        reachability(model, by="noise"),
        unknown_input_existence(model, unknown=file.unknown) if file.unknown else None,
        _losses(model),
        None if record is None else _gains(file, record),
    )


def _losses(model: StateSpace) -> LossTolerance | None:
    try:
        return loss_tolerance(model)
    except EstimableError:  # the question does not apply, or no rate suffices: "detectable" shows it
        return None


def _gains(file: ModelFile, path: Path) -> GainInformation:
    """The information in the inputs of a record about the gains of the model file, or else about one gain on all inputs."""
    names = Names(file.model.states, file.model.inputs, file.model.outputs)
    record, _ = read_measured(file, path, names)
    settings = {} if file.gain is None else file.gain.settings
    given = {name: settings[name] for name in ("directions", "feedthrough") if name in settings}
    prior = None if file.gain is None else file.gain.prior
    return gain_information(model_along(file.model, record), record, state=file.prior, gain=prior, **given)


def sampled(file: ModelFile, dt: float | None) -> StateSpace:
    """The (nominal) model, sampled if `dt` or the section [record] of the file gives a step."""
    model = file.model.nominal if isinstance(file.model, StateSpace) else file.model
    if not file.model.is_continuous:
        if dt is not None:
            checks.refuse(f"--dt is for continuous models: this one has dt = {file.model.dt:g} s.")
        return model
    step = file.record.get("dt") if dt is None else dt
    return model if step is None else model.discretise(step)


def in_samples(horizon: float) -> float:
    """A horizon in samples as an integer; as given where it is none, which its reader refuses."""
    return int(horizon) if horizon == int(horizon) else horizon


def _horizon(model: StateSpace, horizon: float | None) -> float | None:
    """As given; for an unstable model 2 n samples, or 2 n of its fastest time constants."""
    if horizon is not None:
        return horizon if model.is_continuous else in_samples(horizon)
    λ = np.linalg.eigvals(model.A)
    if model.varying or np.all(λ.real < 0 if model.is_continuous else np.abs(λ) < 1):
        return None
    return 2 * model.n if not model.is_continuous else float(2 * model.n / (np.abs(λ).max() or 1.0))


def has_sampled_noise(found: Checked) -> bool:
    """Whether R is the covariance of a sample, which the remaining variance needs: not in a model that is still continuous."""
    return not found.model.is_continuous


def answers(found: Checked) -> dict[str, dict[str, Any]]:
    """Each question with its answer, the distance to the opposite answer, and the directions concerned."""
    e, o, r, d = found.estimability, found.observability, found.reachability, found.disturbability
    verdicts = {
        "estimable": (e.verdict, e.distance, e.directions),
        "estimable_with_present": (e.filter_verdict, e.filter_distance, e.filter_directions),
        "observable": (o.verdict, o.distance, o.directions),
        "detectable": (_yes(o.detectable), None, o.unstable_directions),
    }
    if r is not None:
        verdicts["reachable"] = (r.verdict, r.distance, r.directions)
        verdicts["stabilisable"] = (_yes(r.stabilisable), None, r.unstable_directions)
    verdicts["disturbable"] = (d.verdict, d.distance, d.directions)
    if found.unknown is not None:
        verdicts["unknown_inputs"] = (_yes(found.unknown.exists), None, ())
    return {
        name: {
            "answer": answer,
            "distance": distance,
            "directions": [_named(g, found.model.states) for g in directions],
        }
        for name, (answer, distance, directions) in verdicts.items()
    }


def as_data(found: Checked) -> dict[str, Any]:
    """What `check` prints as JSON."""
    e, states = found.estimability, found.model.states
    sampled_noise = has_sampled_noise(found)
    return {
        "outcome": {"code": 0, "sentence": ""},
        "model": str(found.path),
        "dt": found.model.dt,
        "horizon": e.horizon,
        "states": states,
        "inputs": found.model.inputs,
        "outputs": found.model.outputs,
        "estimable": e.estimable,
        "answers": answers(found),
        "known_directions": [_named(g, states) for g in e.known_directions],
        "singular_values": e.singular_values.tolist(),
        "squared_correlations": e.squared_correlations.tolist() if sampled_noise else None,
        "sigma": _by_state(np.sqrt(np.diagonal(e.prior_covariance)), states),
        "variance_reduction": _by_state(e.variance_reduction, states) if sampled_noise else None,
        "variance_reduction_with_present": _by_state(e.filter_variance_reduction, states) if sampled_noise else None,
        "arrival_rate_needed": None if found.losses is None else [found.losses.lower, found.losses.upper],
        "gain_sigma": None if found.gains is None else _by_state(found.gains.sigma, found.gains.gains),
        "sentences": sentences(found),
    }


def sentences(found: Checked) -> list[str]:
    """Sentences on what is hidden; if all is estimable, one sentence on the direction that is known least."""
    parts = [found.estimability, found.observability, found.reachability, found.disturbability]
    hidden = [sentence for part in parts if part is not None and part.verdict != "yes" for sentence in part.sentences]
    if found.estimability.estimable:
        hidden = [*found.estimability.sentences[: None if has_sampled_noise(found) else 1], *hidden]
    unknown = [] if found.unknown is None else [found.unknown.sentence]
    losses = [found.losses.sentence] if found.losses is not None and found.losses.upper > 0 else []
    gains = () if found.gains is None else found.gains.sentences
    return list(dict.fromkeys([*hidden, *unknown, *losses, *gains]))


def as_text(found: Checked) -> list[Any]:
    """What `check` prints as text."""
    return [_header(found), "", _verdicts(found), "", _states(found), "", *sentences(found)]


def next_steps(found: Checked) -> tuple[str, ...]:
    """The options that show more."""
    of_gain = ["--record FILE also shows how accurately the gain can be estimated with the inputs of that record."]
    of_gain = of_gain if found.file.gain is not None and found.gains is None else []
    if has_sampled_noise(found):
        return ("", *of_gain) if of_gain else ()
    return ("", *of_gain, "R is the covariance of a sample: --dt SECONDS also shows what remains of each sigma.")


def _header(found: Checked) -> str:
    model, e = found.model, found.estimability
    when = "in steady state" if e.horizon is None else f"after {e.horizon:.4g} s" if model.is_continuous else (
        f"after {counted(int(e.horizon), 'sample')}")  # fmt: skip
    step = "continuous" if model.is_continuous else f"step {model.dt:g} s"
    sizes = ", ".join(
        counted(size, word) for size, word in ((model.n, "state"), (model.m, "input"), (model.p, "output"))
    )
    return f"{found.path.name}: {sizes}; {step}; {when}"


def _verdicts(found: Checked) -> Any:
    table = _table("", "answer", "distance")
    for name, verdict in answers(found).items():
        distance = "" if verdict["distance"] is None else f"{verdict['distance']:.2g}"
        table.add_row(WORDS[name], verdict["answer"] or "not asked", distance)
    return table


def _states(found: Checked) -> Any:
    """Each state's standard deviation with the model alone, and with the outputs."""
    e, sampled_noise = found.estimability, has_sampled_noise(found)
    headings = ("with past outputs", "and the present", "variance less by") if sampled_noise else ()
    table = _table("state", "sigma", *headings)
    sigma = np.sqrt(np.diagonal(e.prior_covariance))
    for i, name in enumerate(found.model.states):
        left = [np.sqrt(1 - share[i]) for share in (e.variance_reduction, e.filter_variance_reduction)]
        after = [f"{sigma[i] * part:.3g}" for part in left] + [f"{100 * e.filter_variance_reduction[i]:.1f} %"]
        table.add_row(name, f"{sigma[i]:.3g}", *(after if sampled_noise else ()))
    return table


def _table(first: str, *others: str) -> Any:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 2, 0, 0), show_edge=False)
    table.add_column(first)
    for heading in others:
        table.add_column(heading, justify="right", style="bold" if heading == "answer" else None)
    return table


def _yes(answer: bool | None) -> str | None:
    return None if answer is None else "yes" if answer else "no"


def _named(g: np.ndarray, names: tuple[str, ...]) -> dict[str, float]:
    return {name: float(value) for name, value in zip(names, g, strict=True) if value != 0}


def _by_state(values: np.ndarray, names: tuple[str, ...]) -> dict[str, float]:
    return {name: float(value) for name, value in zip(names, values, strict=True)}
