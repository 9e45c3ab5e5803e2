"""What `estimable simulate f16` flies and says."""

from typing import Any

from .. import checks
from .simulate_report import check_links, link

REST = {"rows": 1000, "lost": None, "settings": None, "out": None}  # options that are not of a flight


def flown(
    loss: float, *, runs: int, seed: int, arrivals: tuple[float, float], burst: float, where: dict[str, Any],
    rest: dict[str, Any],
) -> dict:  # fmt: skip
    """The numbers of the flights. Raises `InputError` with every fault of the call."""
    faults = checks.Faults()
    faults.number("--loss", loss, lower=0.0, upper=1.0)
    faults.whole("--runs", runs, 1)
    faults.whole("--seed", seed, 0)
    check_links(arrivals, burst, faults)
    for name, value in rest.items():
        if value != REST[name]:
            option = "--set" if name == "settings" else f"--{name}"
            faults.add(f"{option} is not of f16, whose flights are always the same 16.5 s: leave it out.")
    faults.finish()
    from ..plants import f16_failure

    input_link, output_link = (link(rate, burst) for rate in arrivals)
    numbers = f16_failure.study(1 - loss, runs=runs, seed=seed, input_link=input_link, output_link=output_link, **where)
    return {"loss": loss, "runs": runs, "seed": seed, **numbers}


def as_data(numbers: dict[str, Any]) -> dict[str, Any]:
    """What the flights say to a machine."""
    return {"outcome": {"code": 0, "sentence": ""}, **numbers}


def as_text(numbers: dict[str, Any]) -> list[str]:
    """What the flights say to people."""
    loss, delay = 100 * numbers["loss"], numbers["detection_delay_s"]
    found = f"was seen {delay:.2f} s later" if delay < float("inf") else "was not seen in most flights"
    return [
        f"At 4.5 s the elevator loses {loss:g} % of its effect; that {found} (median of {numbers['runs']:,}).",
        "Pitch rate about the flight that does not fail, RMS in deg/s:",
        "                    4.5 to 6 s   after 6 s",
        f"law as it is        {numbers['fixed_rms_transient']:10.3g} {numbers['fixed_rms_after']:11.3g}",
        f"reconfigured        {numbers['adaptive_rms_transient']:10.3g} {numbers['adaptive_rms_after']:11.3g}",
    ]


def refuse_options(given: dict[str, Any]) -> None:
    """Options of a flight that were given for a record."""
    faults = checks.Faults()
    for name, value in given.items():
        if value is not None:
            told = f"{value:g}" if isinstance(value, int | float) else value
            faults.add(f"--{name} is of f16: estimable simulate f16 --{name} {told}.")
    faults.finish()
