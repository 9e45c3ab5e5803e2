"""The option --fault: KIND:CHANNEL@TIME[-UNTIL][=VALUE]."""

import re
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from .. import checks
from ..models.disturbances import Gust, SensorFault, Upset
from ..models.events import ActuatorChange, Event, Failure, Floating, HardOver, Offset, Stuck
from ..models.state_space import StateSpace

FORM = re.compile(
    r"(?P<kind>[a-z-]+):(?P<channel>[^@=]+)@(?P<time>[-+0-9.e]+?)(-(?P<until>[0-9.]+(e[-+]?[0-9]+)?))?(=(?P<value>.+))?"
)
EXAMPLE = "stuck:elevator@4.5, effectiveness:motor3@14.2=0.7 or bias:pitch_rate@3-6=1.5"


class Kind(NamedTuple):
    """A kind of fault: its channel ("input", "output" or "state"), the event that it makes of (channel, time, value, until),
    and whether it needs a value or may end."""

    channel: str
    make: Callable[..., Event]
    needs: bool = False
    ends: bool = False


def _sensor(kind: str, needs: bool) -> Kind:
    return Kind("output", lambda c, t, v, until: SensorFault(t, c, kind, v, until), needs, ends=True)


KINDS = {
    "effectiveness": Kind("input", lambda c, t, v, until: Failure(t, v, c), needs=True),
    "stuck": Kind("input", lambda c, t, v, until: Stuck(t, c, v)),
    "floating": Kind("input", lambda c, t, v, until: Floating(t, c, v)),
    "hard-over": Kind("input", lambda c, t, v, until: HardOver(t, c, v), needs=True),
    "offset": Kind("input", lambda c, t, v, until: Offset(t, c, v), needs=True),
    "rate": Kind("input", lambda c, t, v, until: ActuatorChange(t, c, rate=v), needs=True),
    "bandwidth": Kind("input", lambda c, t, v, until: ActuatorChange(t, c, bandwidth=v), needs=True),
    "delay": Kind("input", lambda c, t, v, until: ActuatorChange(t, c, delay=v), needs=True),
    "limits": Kind("input", lambda c, t, v, until: ActuatorChange(t, c, limits=(-v, v)), needs=True),
    "upset": Kind("state", lambda c, t, v, until: Upset(t, {c: v}, until), needs=True, ends=True),
    "gust": Kind("state", lambda c, t, v, until: Gust(t, v, 0.5 if until is None else until - t, state=c), True, True),
    "bias": _sensor("bias", needs=True),
    "scale": _sensor("scale", needs=True),
    "drift": _sensor("drift", needs=True),
    "noise": _sensor("noise", needs=True),
    "frozen": _sensor("frozen", needs=False),
    "dropout": _sensor("dropout", needs=False),
}


def read_faults(texts: Iterable[str], model: StateSpace) -> list[Event]:
    """The events of the options --fault, for a plant with this model. Raises `InputError` with all faults of all options."""
    faults, events = checks.Faults(), []
    for text in texts:
        try:
            event = _event(text, model, faults)
        except checks.InputError as error:
            faults.sentences += [f"--fault {text}: {sentence}" for sentence in error.faults]
            continue
        events += [] if event is None else [event]
    faults.finish()
    return events


def _event(text: str, model: StateSpace, faults: checks.Faults) -> Event | None:
    found = FORM.fullmatch(text)
    if found is None:
        faults.add(
            f"--fault {text} must be KIND:CHANNEL@TIME, KIND:CHANNEL@TIME=VALUE or .. @TIME-UNTIL, such as {EXAMPLE}."
        )
        return None
    before = len(faults.sentences)
    kind = KINDS.get(found["kind"])
    if kind is None:
        near = checks.suggestion(found["kind"], KINDS)
        faults.add(f"--fault {text}: there is no kind {found['kind']!r}. The kinds are {checks.listed(KINDS)}.{near}")
        return None
    time, value, until = (_number(part, found[part], text, faults) for part in ("time", "value", "until"))
    if kind.needs and found["value"] is None:
        faults.add(f"--fault {text} needs a value: {found['kind']}:{found['channel']}@{found['time']}=VALUE.")
    if until is not None and not kind.ends:
        faults.add(f"--fault {text}: {found['kind']} lasts until the end of the run. Leave out -{found['until']}.")
    channel = _channel(found["channel"], kind.channel, model, text, faults)
    return kind.make(channel, time, value, until) if len(faults.sentences) == before else None


def _number(part: str, given: str | None, text: str, faults: checks.Faults) -> float | None:
    if given is None:
        return None
    try:
        return float(given)
    except ValueError:
        faults.add(f"--fault {text}: the {part} must be a number. Got {given!r}.")
        return None


def _channel(given: str, kind: str, model: StateSpace, text: str, faults: checks.Faults) -> Any:
    """The channel with this name, or the only one that begins with it."""
    names = getattr(model, f"{kind}s")
    starting = [name for name in names if name.startswith(given)]
    if given in names or len(starting) == 1:
        return given if given in names else starting[0]
    near = checks.suggestion(given, names)
    faults.add(f"--fault {text}: the plant has no {kind} {given!r}. Its {kind}s are {checks.listed(names)}.{near}")
    return None
