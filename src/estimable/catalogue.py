"""One table of the algorithms: what tests, the command line and files go through."""

from typing import Any, NamedTuple

from . import checks
from .filters.kalman import Kalman
from .filters.unknown_gain import UnknownGain
from .filters.unknown_input import UnknownInput
from .models.files import ModelFile


class Entry(NamedTuple):
    """An algorithm: its name on the command line, its class, where it comes from, and what it assumes."""

    name: str
    cls: type
    kind: str
    reference: str
    assumes: str


ENTRIES = (
    Entry(
        "kalman", Kalman, "filter", "Kailath, Sayed & Hassibi (2000) ch. 12; Durbin & Koopman (2012) ch. 5",
        "the model, Q and R are right; every input is known",
    ),
    Entry(
        "unknown-gain", UnknownGain, "filter", "Pachter (1999) (31)-(37); Sillence (1999) (31)-(37)",
        "the model but its input gain is right; the input is measured without error",
    ),
    Entry(
        "unknown-input", UnknownInput, "filter", "Gillijns & De Moor (2007a, b); Fang (2009) Algorithm 1",
        "the model, Q and R are right; nothing of the unknown inputs, which the outputs must tell apart",
    ),
)  # fmt: skip


def entry(name: str) -> Entry:
    """The entry of a name; an `InputError` with the names there are."""
    names = [known.name for known in ENTRIES]
    if name not in names:
        checks.refuse(
            f"there is no algorithm {name!r}. There are {checks.listed(names)}.{checks.suggestion(name, names)}"
        )
    return ENTRIES[names.index(name)]


def build(name: str, file: ModelFile, /, **settings: Any) -> Any:
    """The algorithm `name` on the model of a file, with the file's settings and then those given here."""
    cls = entry(name).cls
    faults = checks.Faults()
    allowed = [
        field
        for field in cls.__dataclass_fields__
        if field not in ("model", "gain", "_") and cls.__dataclass_fields__[field].init
    ]
    for key in settings:
        if key not in allowed:
            faults.add(
                f"{name} has no setting {key!r}: it has {checks.listed(allowed)}.{checks.suggestion(key, allowed)}"
            )
    if cls is UnknownGain and file.gain is None:
        faults.add("the model file has no section [gain]: give the prior of the gain there (mean, covariance).")
    if cls is UnknownInput and not settings.setdefault("unknown", file.unknown):
        faults.add("no unknown input is named: in section [unknown] of the model file (inputs), or by --unknown NAME.")
    faults.finish()
    if cls is UnknownGain:
        assert file.gain is not None
        return UnknownGain(file.model, file.gain.prior, **{**file.gain.settings, **settings})
    return cls(file.model, **settings)
