"""The filters and identifiers by name, with their assumptions and references: `entry(name)`, `build(name, file)`."""

from collections.abc import Mapping
from dataclasses import MISSING
from typing import Any, NamedTuple

from . import checks
from .filters.alpha_beta import AlphaBeta
from .filters.bounded import Bounded
from .filters.change_detection import ChangeDetection
from .filters.extended_kalman import ExtendedKalman
from .filters.fixed_gain import FixedGain
from .filters.gated import Gated
from .filters.kalman_filter import Kalman
from .filters.mixture import SHARES, WALKS, Mixture
from .filters.moving_window import MovingWindow
from .filters.second_order_kalman import SecondOrderKalman
from .filters.smoothed import Smoothed
from .filters.unknown_gain import UnknownGain
from .filters.unknown_input import UnknownInput
from .filters.unscented_kalman import UnscentedKalman
from .identifiers.adaptive_identification import AdaptiveIdentification
from .identifiers.coupled_least_squares import CoupledLeastSquares
from .identifiers.ho_kalman import HoKalman
from .identifiers.instrumental_variables import InstrumentalVariables
from .identifiers.joint_output_error import JointOutputError
from .identifiers.least_squares import LeastSquares
from .identifiers.markov_parameters import MarkovParameters
from .identifiers.minimum_variance import MinimumVariance
from .identifiers.output_error_ml import OutputErrorML
from .identifiers.phasor import Phasor
from .identifiers.prediction_errors import PredictionError
from .identifiers.predictor_subspace import PredictorSubspace
from .identifiers.recursive_output_error import RecursiveOutputError
from .identifiers.subspace import Subspace
from .models.files import ModelFile
from .models.nonlinear_model import NonlinearModel
from .protocols import Algorithm


class Entry(NamedTuple):
    """One algorithm of the catalogue: its `name` on the command line, its class `cls`, its `reference`, and what it `assumes`.

    `settings` are default settings. For a wrapper, `wraps` lists the names of the algorithms that it can wrap; the default is
    the first that suits the model file.
    """

    name: str
    cls: type
    kind: str
    reference: str
    assumes: str
    wraps: tuple[str, ...] = ()
    settings: Mapping[str, Any] = {}


NONLINEAR = ("extended-kalman", "second-order-kalman", "unscented-kalman")
GAINS = ("unknown-gain", "change-detection", "moving-window", "bounded", "gated", "smoothed", "mixture", *NONLINEAR)

ENTRIES = (
    Entry(
        "kalman", Kalman, "filter", "Kailath, Sayed & Hassibi (2000) ch. 12; Durbin & Koopman (2012) ch. 5",
        "the model, Q and R are right; every input is known",
    ),
    Entry(
        "unknown-gain", UnknownGain, "filter", "Pachter (1999) (31)-(37); Sillence (1999) (31)-(37)",
        "the model is right except for its input gain; the input is measured without error",
    ),
    Entry(
        "unknown-input", UnknownInput, "filter", "Gillijns & De Moor (2007a, b); Fang (2009) Algorithm 1",
        "the model, Q and R are right; the outputs distinguish the unknown inputs, whose values are arbitrary",
    ),
    Entry(
        "change-detection", ChangeDetection, "filter", "Willsky & Jones (1976); Pollak (1985)",
        "the model is right except for its gains; between jumps the gains are constant", ("unknown-gain", *NONLINEAR[:2]),
    ),
    Entry(
        "mixture", Mixture, "filter", "Magill (1965)",
        "one of several algorithms is right: here of several walks of the gain", ("change-detection", "unknown-gain"),
    ),
    Entry(
        "moving-window", MovingWindow, "filter", "Sillence (1999) §5.4",
        "the gain is constant over a window", ("unknown-gain", "kalman", "gated", *NONLINEAR), {"length": 30},
    ),
    Entry(
        "bounded", Bounded, "filter", "Sillence (1999) §5.5",
        "the gain lies between the bounds", GAINS, {"lower": 0.0, "upper": 1.0},
    ),
    Entry(
        "smoothed", Smoothed, "filter", "Sillence (1999) (85)",
        "the gain changes slowly compared with 1 / (1 - weight) samples", GAINS, {"weight": 0.9},
    ),
    Entry(
        "gated", Gated, "filter", "Bar-Shalom, Li & Kirubarajan (2001) §5.4",
        "the innovation covariance is right",
        ("unknown-gain", "kalman", "moving-window", "alpha-beta", "fixed-gain", *NONLINEAR), {"probability": 0.999},
    ),
    Entry(
        "alpha-beta", AlphaBeta, "filter", "Bass (2005); Kalata (1984)",
        "a position, measured, and its derivatives; constant gains suit steps that do not change by large factors",
    ),
    Entry(
        "fixed-gain", FixedGain, "filter", "Bass (2005); Bucy & Joseph (1968) ch. XVI",
        "the model and every input are known; Q and R are right (for the covariance only); the gain is arbitrary",
    ),
    Entry(
        "extended-kalman", ExtendedKalman, "filter", "Jazwinski (1970) §8.3",
        "f and h are nearly linear over a standard deviation",
    ),
    Entry(
        "second-order-kalman", SecondOrderKalman, "filter",
        "Jazwinski (1970) §9.3; Athans, Wishner & Bertolini (1968); Bass, Norum & Schwartz (1966)",
        "third derivatives of f and h are small over a standard deviation; the belief is nearly Gaussian",
    ),
    Entry(
        "unscented-kalman", UnscentedKalman, "filter", "Julier & Uhlmann (2004); Arasaratnam & Haykin (2009)",
        "the belief is nearly Gaussian",
    ),
)  # fmt: skip

IDENTIFIERS = (
    Entry(
        "adaptive-identification", AdaptiveIdentification, "identifier", "Bass (2005), RANSID; Ho & Kálmán (1966)",
        "the nonlinear model, Q and R are right; the record stays near an equilibrium, or the prior is near the true values",
    ),
    Entry(
        "coupled-least-squares", CoupledLeastSquares, "identifier", "Ljung (1999) (4.52)-(4.57)",
        "the orders are right; the noise is white on the equations",
    ),
    Entry(
        "ho-kalman", HoKalman, "identifier", "Ho & Kálmán (1966); Juang & Pappa (1985)",
        "the impulse response has died out after `length` steps",
    ),
    Entry(
        "instrumental-variables", InstrumentalVariables, "identifier", "Ljung (1999) §7.6, §15.3",
        "the orders of A and B are right; inputs do not depend on the noise",
    ),
    Entry(
        "joint-output-error", JointOutputError, "identifier", "Athans, Wishner & Bertolini (1968); Fang (2009) (3.1)-(3.5)",
        "the orders and the noise variance are right; the plant starts at rest",
    ),
    Entry(
        "least-squares", LeastSquares, "identifier", "Ljung (1999) §4.2, §7.3; Sillence (1999) (22)-(23)",
        "the orders are right; the noise is white on the equation",
    ),
    Entry(
        "markov-parameters", MarkovParameters, "identifier", "Bass (2005); Aitken (1935)",
        "the impulse response has died out after `length` steps",
    ),
    Entry(
        "minimum-variance", MinimumVariance, "identifier", "Sillence (1999) ch. 2; Steiglitz & McBride (1965)",
        "the orders are right; white noise on the outputs only",
    ),
    Entry(
        "output-error-ml", OutputErrorML, "identifier", "Ljung (1999) §7.4, §10.2; Fang (2009) (3.1)-(3.4)",
        "the orders are right; white noise on the outputs only",
    ),
    Entry(
        "phasor", Phasor, "identifier", "Sillence (1999) §2.2",
        "the plant is linear and has settled; the inputs are sinusoids of known frequencies",
    ),
    Entry(
        "prediction-error", PredictionError, "identifier", "Ljung (1999) §7.2, §10.2; Hannan & Rissanen (1982)",
        "the orders are right; the noise is white, filtered by a moving average and the poles of the plant",
    ),
    Entry(
        "predictor-subspace", PredictorSubspace, "identifier", "Jansson (2003); Chiuso (2007)",
        "an input acts one row later or more; feedback leaves it something that does not come from the outputs",
    ),
    Entry(
        "recursive-output-error", RecursiveOutputError, "identifier", "Fang (2009) (3.12)-(3.17)",
        "the orders and the noise variance are right; the plant starts at rest",
    ),
    Entry(
        "subspace", Subspace, "identifier", "Van Overschee & De Moor (1996); Verhaegen & Dewilde (1992)",
        "the input is exciting, is known, and does not depend on the outputs",
    ),
)  # fmt: skip


def identifier(name: str) -> Entry:
    """The entry of an identifier by its name. An unknown name raises an `InputError` that lists the known ones.

    >>> identifier("output-error-ml").cls.__name__
    'OutputErrorML'
    """
    names = [known.name for known in IDENTIFIERS]
    if name not in names:
        near = checks.suggestion(name, names)
        checks.refuse(f"there is no identifier {name!r}. The identifiers are {checks.listed(names)}.{near}")
    return IDENTIFIERS[names.index(name)]


def entry(name: str) -> Entry:
    """The entry of a filter by its name, or by a unique beginning of it. An unknown name raises an `InputError` that lists the
    known ones.

    >>> entry("second-order").cls.__name__
    'SecondOrderKalman'
    """
    names = [known.name for known in ENTRIES]
    begun = [known for known in names if known.startswith(f"{name}-")]
    if name not in names and len(begun) == 1:
        name = begun[0]
    if name not in names:
        checks.refuse(
            f"there is no algorithm {name!r}. The algorithms are {checks.listed(names)}.{checks.suggestion(name, names)}"
        )
    return ENTRIES[names.index(name)]


def name_of(algorithm: Algorithm[Any]) -> str:
    """The name of an algorithm in the catalogue."""
    return next(known.name for known in ENTRIES if known.cls is type(algorithm))


def settings_of(cls: type) -> list[str]:
    """The names of the settings of an algorithm, without those of an algorithm inside it."""
    fields = cls.__dataclass_fields__
    return [
        name for name in fields if name not in ("model", "gain", "algorithm", "algorithms", "_") and fields[name].init
    ]


def build(name: str, file: ModelFile, /, **settings: Any) -> Any:
    """Make the algorithm `name` for the model in a model file.

    Its settings are those of the file, replaced by the `settings` given here. For a wrapper, the setting `algorithm` names
    the algorithm inside it; settings that the wrapper does not have go to that algorithm.
    """
    built, wraps = entry(name), None
    faults = checks.Faults()
    if built.wraps:
        wraps = settings.pop("algorithm", _default(built, file))
        faults.choice("algorithm", wraps, built.wraps)
        faults.finish()
    _check_settings(built, wraps, file, settings, faults)
    faults.finish()
    if wraps:
        return _wrapper(built, wraps, file, settings)
    if isinstance(file.model, NonlinearModel):
        return _nonlinear(built, file, settings)
    if built.cls is UnknownGain:
        assert file.gain is not None
        return UnknownGain(file.model, file.gain.prior, **{**file.gain.settings, **_uncertain(file), **settings})
    if built.name in NONLINEAR and file.gain is not None:
        checks.refuse(
            f"{built.name} does not estimate the gain of a linear model, but the model file has a section [gain]: use "
            "unknown-gain, which is exact, or leave out the section."
        )
    if built.cls is Kalman:
        return Kalman(file.model, **{**_uncertain(file), **settings})
    if built.cls is AlphaBeta:
        return AlphaBeta(**{"model": file.model, **settings})
    return built.cls(file.model, **settings)


def _wrapper(built: Entry, wraps: str, file: ModelFile, settings: dict[str, Any]) -> Any:
    """A wrapper around the algorithm `wraps`; a mixture of those with several walks, unless a walk is given."""
    if built.cls is Mixture:
        walks = [settings.pop("walk")] if "walk" in settings else WALKS
        own = {"probability": settings.pop("probability", SHARES if len(walks) > 1 else None)}
        return Mixture([build(wraps, file, **{**settings, "walk": walk}) for walk in walks], **own)
    own = {key: settings.pop(key) for key in settings_of(built.cls) if key in settings}
    return built.cls(build(wraps, file, **settings), **{**built.settings, **own})


def _uncertain(file: ModelFile) -> dict[str, Any]:
    """The uncertainty of the model, for the filters that take it."""
    return {} if file.uncertainty is None else {"uncertainty": file.uncertainty}


def _check_settings(
    built: Entry, wraps: str | None, file: ModelFile, settings: dict[str, Any], faults: checks.Faults
) -> None:
    """Check that all settings are known, and that they include what the file lacks."""
    allowed = list(dict.fromkeys(settings_of(built.cls) + (_every_setting(entry(wraps), file) if wraps else [])))
    for key in settings:
        if key not in allowed:
            faults.add(
                f"{built.name} has no setting {key!r}: it has {checks.listed(allowed)}.{checks.suggestion(key, allowed)}"
            )
    if built.cls is UnknownGain and file.gain is None:
        faults.add("the model file has no section [gain]: give the prior of the gain there (mean, covariance).")
    if built.cls is UnknownInput and not settings.setdefault("unknown", file.unknown):
        faults.add(
            "no unknown input is named: give `inputs` in section [unknown] of the model file, or --unknown NAME."
        )
    for key in _required(built):
        if key not in settings:
            faults.add(
                f"{built.name} needs a value of {key!r}, which has no default. On the command line: --set {key}=.."
            )


def _default(wrapper: Entry, file: ModelFile) -> str:
    """The default algorithm of a wrapper: a filter that suits the model, of the gain if the file has one."""
    if isinstance(file.model, NonlinearModel):
        return next((name for name in wrapper.wraps if name in NONLINEAR), wrapper.wraps[0])
    return "kalman" if file.gain is None and "kalman" in wrapper.wraps else wrapper.wraps[0]


def _required(built: Entry) -> list[str]:
    """Its settings without a default in the class or in the catalogue."""
    fields = built.cls.__dataclass_fields__
    return [name for name in settings_of(built.cls) if fields[name].default is MISSING and name not in built.settings]


def _every_setting(built: Entry, file: ModelFile) -> list[str]:
    """The settings of an entry and of the algorithm that it wraps by default."""
    inner = _every_setting(entry(_default(built, file)), file) if built.wraps else []
    return [*settings_of(built.cls), *(name for name in inner if name not in settings_of(built.cls))]


def _nonlinear(built: Entry, file: ModelFile, settings: dict[str, Any]) -> Any:
    """A filter of a nonlinear model; the prior in the `gain` of the file is that of the parameters."""
    if built.name not in NONLINEAR:
        checks.refuse(f"{built.name} needs a linear model. This model is nonlinear: use {checks.listed(NONLINEAR)}.")
    given = {} if file.gain is None else {"parameters": file.gain.prior, **file.gain.settings}
    return built.cls(file.model, **{**given, **settings})
