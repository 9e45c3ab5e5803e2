"""What `estimable simulate f16` flies and prints."""

import statistics
from typing import Any

from .. import checks
from . import show
from .simulate_report import check_links, link

SIMULATED = {
    "jsbsim": "trim",
    "jsbsim-untrimmed": "zero",
}  # plants of JSBSim: the deflection about which the effect is lost
REST = {"rows": 1000, "lost": None, "settings": None, "out": None}  # options that do not apply to a flight


def flown(
    loss: float, plant: str, *, runs: int | None, seed: int, arrivals: tuple[float, float], burst: float, where: dict[str, Any],
    rest: dict[str, Any],
) -> dict:  # fmt: skip
    """The numbers of the flights. Raises `InputError` with all faults of the call."""
    faults = checks.Faults()
    faults.number("--loss", loss, lower=0.0, upper=1.0)
    faults.choice("--plant", plant, ("short-period", *SIMULATED))
    runs = (1 if plant in SIMULATED else 200) if runs is None else runs
    faults.whole("--runs", runs, 1)
    faults.whole("--seed", seed, 0)
    check_links(arrivals, burst, faults)
    for name, value in rest.items():
        if value != REST[name]:
            option = "--set" if name == "settings" else f"--{name}"
            faults.add(f"{option} does not apply to f16, whose flights always last the same 16.5 s: leave it out.")
    faults.finish()
    links = dict(zip(("input_link", "output_link"), (link(rate, burst) for rate in arrivals), strict=True))
    fly = _in_simulator if plant in SIMULATED else _short_period
    return {"loss": loss, "plant": plant, "runs": runs, "seed": seed, **fly(1 - loss, plant, runs, seed, links, where)}


def _short_period(gain: float, plant: str, runs: int, seed: int, links: dict, where: dict) -> dict[str, float]:
    from ..plants import f16_failure

    return f16_failure.study(gain, runs=runs, seed=seed, **links, **where)


def _in_simulator(gain: float, plant: str, runs: int, seed: int, links: dict, where: dict) -> dict[str, float]:
    from ..plants import f16_in_jsbsim

    faults = checks.Faults()
    for name, value in where.items():
        if value is not None:
            faults.add(
                f"--{name} applies only to --plant short-period: leave it out. "
                "JSBSim flies on this machine, one flight after the other."
            )
    faults.finish()
    with show.working("Flying"):
        flights = [f16_in_jsbsim.fly(gain, seed=seed + i, about=SIMULATED[plant], **links).numbers for i in range(runs)]
    return {name: statistics.median(one[name] for one in flights) for name in flights[0]}


def as_data(numbers: dict[str, Any]) -> dict[str, Any]:
    """The flights, as JSON."""
    return {"outcome": {"code": 0, "sentence": ""}, **numbers}


def as_text(numbers: dict[str, Any]) -> list[str]:
    """The flights, as text."""
    loss, delay = 100 * numbers["loss"], numbers["detection_delay_s"]
    found = f"was detected {delay:.2f} s later" if delay < float("inf") else "was not detected in most flights"
    return [
        f"At 4.5 s the elevator loses {loss:g} % of its effect. The loss {found} (median of {numbers['runs']:,}).",
        "RMS difference of the pitch rate from the flight without a failure, in deg/s:",
        "                    4.5 to 6 s   after 6 s",
        f"fixed law           {numbers['fixed_rms_transient']:10.3g} {numbers['fixed_rms_after']:11.3g}",
        f"reconfigured        {numbers['adaptive_rms_transient']:10.3g} {numbers['adaptive_rms_after']:11.3g}",
    ]


def refuse_options(given: dict[str, Any]) -> None:
    """Refuse options of a flight that were given for a record."""
    faults = checks.Faults()
    for name, value in given.items():
        if value is not None:
            shown = f"{value:g}" if isinstance(value, int | float) else value
            faults.add(f"--{name} applies only to f16: estimable simulate f16 --{name} {shown}.")
    faults.finish()
