"""What the drivers ask of an algorithm, an identifier, a controller, a link and a plant.

A class says which of these it is by deriving from it, as in `class Kalman(Algorithm)`. Abstract members must be there; every
other member is an optional hook, and its default is here. The drivers ask for nothing else, and nothing but these defaults is
inherited: what algorithms share is called as functions, and what they are made of is in their fields.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, Generic, Protocol, Self, TypeVar, runtime_checkable

from .annotations import Array, Numbers
from .checks import Faults
from .data.record import Record
from .frozen import replace
from .kernels.smoothing import Instant
from .models.output_error import OutputError
from .models.prior import Prior
from .models.sampled import Clock
from .models.state_space import StateSpace
from .networks.delivery import Delivery
from .results import Fit, Info, Interval, Names, Sample

State = TypeVar("State")  # what is carried from sample to sample: a tree of arrays whose shapes do not change


class Algorithm(ABC, Generic[State]):
    """A state estimator, sample by sample: `correct`, then `predict`. A frozen record; only the state changes.

    `model`, where it is not a wrapper: a `StateSpace`, a `NonlinearModel` or, before there is a model, `Channels`.
    """

    model: Any

    @property
    @abstractmethod
    def names(self) -> Names:
        """Names of the columns: states, known inputs, outputs, gains and unknown inputs."""

    @abstractmethod
    def init(self, prior: Any) -> State:
        """What is believed about x[0], before y[0]. `prior`: a `Prior`, or None where `has_state_prior` is False."""

    @abstractmethod
    def correct(self, state: State, sample: Sample) -> tuple[State, Info]:
        """Learn from one sample, and say what is believed then. `Info.outcome` must be set: 0 where nothing failed."""

    @abstractmethod
    def predict(self, state: State, interval: Interval) -> State:
        """Move to the next sample."""

    def sampled(self, clock: Clock) -> Self:
        """The algorithm made ready for the steps of a record: its model discretised, its noises factored."""
        return self

    def at(self, k: int | Array) -> Self:
        """The algorithm at row k of a model that varies in time."""
        return self

    @property
    def where_all_is_seen(self) -> Self:
        """An equal algorithm, once sampled, which may be faster where every output is seen and the prior is proper."""
        return self

    @property
    def result_names(self) -> Mapping[str, Any]:
        """Fields of `Names` that are known once the algorithm is sampled: `input_delay`, `note`."""
        return {}

    @property
    def innermost(self) -> "Algorithm[Any]":
        """The algorithm inside all wrappers: the one that has a model."""
        return self

    @property
    def has_state_prior(self) -> bool:
        """Whether the drivers' `prior` is needed; not where all priors are settings of the algorithm."""
        return True

    @property
    def takes_unknown_arrivals(self) -> bool:
        """Whether inputs may come of which nobody knows whether they arrived."""
        return False

    @property
    def has_innovation_covariance(self) -> bool:
        """Whether `Info.innovation_covariance` is given."""
        return True

    def check_record(self, rows: int, faults: Faults) -> None:
        """Note what a record of that many rows lacks."""
        return


class Wrapper(Algorithm[State]):
    """An algorithm around another, its field `algorithm`. What a wrapper does not define is passed on."""

    algorithm: Any

    @property
    def names(self) -> Names:
        """Names of the columns of the wrapped algorithm."""
        return self.algorithm.names

    def init(self, prior: Any) -> State:
        """What the wrapped algorithm believes before y[0]."""
        return self.algorithm.init(prior)

    def correct(self, state: State, sample: Sample) -> tuple[State, Info]:
        """Let the wrapped algorithm learn from one sample."""
        return self.algorithm.correct(state, sample)

    def predict(self, state: State, interval: Interval) -> State:
        """Move to the next sample."""
        return self.algorithm.predict(state, interval)

    def sampled(self, clock: Clock) -> Self:
        """The same wrapper around the algorithm sampled."""
        return replace(self, algorithm=self.algorithm.sampled(clock))

    def at(self, k: int | Array) -> Self:
        """The same wrapper around the algorithm at row k of a time-varying model."""
        return replace(self, algorithm=self.algorithm.at(k))

    @property
    def result_names(self) -> Mapping[str, Any]:
        """Those of the wrapped algorithm."""
        return self.algorithm.result_names

    @property
    def innermost(self) -> Algorithm[Any]:
        """The algorithm inside all wrappers."""
        return self.algorithm.innermost

    @property
    def has_state_prior(self) -> bool:
        """That of the wrapped algorithm."""
        return self.algorithm.has_state_prior

    @property
    def takes_unknown_arrivals(self) -> bool:
        """That of the wrapped algorithm."""
        return self.algorithm.takes_unknown_arrivals

    @property
    def has_innovation_covariance(self) -> bool:
        """That of the wrapped algorithm."""
        return self.algorithm.has_innovation_covariance

    def check_record(self, rows: int, faults: Faults) -> None:
        """Note what a record lacks for the wrapped algorithm."""
        self.algorithm.check_record(rows, faults)


class GainAlgorithm(Algorithm[State]):
    """An algorithm that estimates gains (or parameters) together with the state.

    `gain`: their prior; None where none is estimated.
    """

    gain: Any


class JumpingGains(GainAlgorithm[State]):
    """A gain algorithm whose gains can be watched for jumps, by `ChangeDetection`: what it needs of the algorithm."""

    @abstractmethod
    def read_walk(self, given: Numbers, faults: Faults) -> Array | None:
        """A walk of the gains as a covariance per second, (p, p)."""

    @abstractmethod
    def constant(self, walk: Array, persistence: Array) -> Self:
        """The same algorithm with gains that move by `walk` only, and `persistence` times its process noise."""

    @abstractmethod
    def condition(self, state: State, sample: Sample, about: State | None = None) -> tuple[State, Any]:
        """The belief after one sample by the tangent at `about` (None: at the belief), and the posterior of `kernels.kalman`."""

    @abstractmethod
    def tell(self, state: State) -> Info:
        """What a belief says, in the user's units."""


class Smoothable(Algorithm[State]):
    """An algorithm with a linear Gaussian model of each row, which `smooth` runs backwards.

    `forgetting`: below 1 there is no model of how the gain moves, and smoothing is refused.
    """

    forgetting: Any = 1.0

    @abstractmethod
    def instant(self, sample: Sample, interval: Interval) -> Instant:
        """This row of the model: how the state moves, and what is measured."""

    @abstractmethod
    def tell(self, state: State) -> Info:
        """What a belief says, in the user's units."""

    @property
    def for_smoothing(self) -> Self:
        """The algorithm as the smoother needs it. Raises `InputError` where it cannot be smoothed."""
        return self


class Method:
    """What `identify` and `compare` take: a batch, a recursive or a filter identifier."""

    @property
    def label(self) -> str:
        """What a comparison calls it."""
        return type(self).__name__


class Identifier(Method, ABC):
    """A method that takes whole records: several experiments on one plant, of equal channels and step."""

    @abstractmethod
    def fit(self, records: Sequence[Record]) -> Fit:
        """The fit. Raises `InputError` for records that the method cannot take."""


class StartedIdentifier(Identifier):
    """An identifier whose search has one more start, from a recursive identifier that `identify` runs first."""

    @abstractmethod
    def check(self, records: Sequence[Record]) -> None:
        """Raise `InputError` for records that the method cannot take, before the recursion runs."""

    @abstractmethod
    def starter(self, records: Sequence[Record]) -> "RecursiveIdentifier[Any] | None":
        """The recursion that gives the start; None where these records need none."""

    @abstractmethod
    def fit(self, records: Sequence[Record], start: Array | None = None) -> Fit:
        """The fit; `start` (d,): the parameters that the recursion ended with."""


class RecursiveIdentifier(Algorithm[State], Method):
    """An algorithm whose states are the parameters of an output-error model, with their prior among its settings.

    `method`, `noise_variance`: settings that the validation of the fit reads; `lost`: what actuators do without a packet.
    """

    method: str = ""
    noise_variance: Any
    lost: str = "zero"

    @abstractmethod
    def for_channels(self, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> Self:
        """The same identifier with the channels of a record, where it has none of its own."""

    @abstractmethod
    def fitted(self, parameters: Array, dt: float) -> OutputError:
        """The model of a parameter vector (d,)."""

    @abstractmethod
    def rested(self, state: State) -> State:
        """What is believed when another record begins: the same of the parameters, and a plant at rest."""

    @property
    def has_state_prior(self) -> bool:
        """No: the prior of the parameters is a setting."""
        return False


class Anticipating(RecursiveIdentifier[State]):
    """A recursive identifier for controllers that act before a sample is measured (`acts_on` = "predicted")."""

    @abstractmethod
    def ahead(self, state: State) -> Info:
        """What is believed before the next sample; in `extra` the `past_outputs` (p, na) and `past_inputs` (m, ..)."""


class FilterIdentifier(Method, ABC):
    """A method that estimates parameters by a filter of state and parameters (`tracker`), started from the records.

    `model`: the nonlinear model; `state_prior`: of its state; `refinement`: "none" or "likelihood".
    """

    model: Any
    state_prior: Any
    refinement: Any = "none"

    @property
    @abstractmethod
    def varies(self) -> bool:
        """Whether the parameters may change in time."""

    @abstractmethod
    def begin(self, records: Sequence[Record]) -> Any:
        """Where the parameters start: `parameters` (a `Prior`), the `linear` model that says so, and `checks`."""

    @abstractmethod
    def tracker(self, parameters: Prior) -> Algorithm[Any]:
        """The filter of the state and the parameters."""

    @abstractmethod
    def known(self, parameters: Array) -> Algorithm[Any]:
        """The filter of the state alone, with parameters (k,) that are known."""


class Controller(ABC, Generic[State]):
    """A law that makes the inputs of a plant from an estimate and a reference, sample by sample. A frozen record."""

    @property
    @abstractmethod
    def size(self) -> int:
        """How many inputs it makes, m."""

    @property
    @abstractmethod
    def references(self) -> int:
        """How many references it follows, r."""

    @abstractmethod
    def init(self) -> State:
        """What is remembered before the first sample."""

    @abstractmethod
    def act(self, state: State, estimate: Info, reference: Array) -> tuple[State, Array, Mapping[str, Array]]:
        """What is remembered, the input (m,), and what is said of it, by name.

        `estimate.extra["input"]` is what the actuators do at this instant.
        """

    @property
    def acts_on(self) -> str:
        """ "filtered": it acts on a sample that was measured; "predicted": before it, so that its input may enter y at once."""
        return "filtered"

    def check(self, names: Names, faults: Faults) -> None:
        """Note what the estimator whose columns have these names lacks."""
        return

    def check_plant(self, model: StateSpace, faults: Faults) -> None:
        """Note why this plant cannot be controlled so."""
        return


class SharedController(Controller[State]):
    """A controller that can be put into `GainReconfiguration` and `Dither`, which say how much effect the inputs have left."""

    @abstractmethod
    def act(
        self, state: State, estimate: Info, reference: Array, effect: Array | float = 1.0
    ) -> tuple[State, Array, Mapping[str, Array]]:
        """As in `Controller`; what is asked of the plant is divided by `effect`, (m,), or multiplied by it where it is (m, m)."""


@runtime_checkable
class Link(Protocol):
    """What carries packets over a network. `draws`: the uniform numbers of one instant; `acknowledged`: whether the sender
    learns what arrived; `late`: "drop" or "use", of packets that come late."""

    @property
    def draws(self) -> int:
        """How many uniform numbers one instant takes."""
        ...

    @property
    def acknowledged(self) -> bool:
        """Whether the sender learns, a step later, what arrived."""
        return True

    @property
    def late(self) -> str:
        """What the receiver does with a packet that comes late: "drop" or "use"."""
        return "drop"

    def init(self) -> Any:
        """What is remembered before the first packet."""
        ...

    def send(self, state: Any, packet: Array, draw: Array) -> tuple[Any, Delivery]:
        """Send a packet (c,): what is remembered then, and what is delivered. `draw` (draws,): uniform on [0, 1)."""
        ...


class Plant(ABC):
    """A simulator that no engine can trace: its loops run in Python, sample by sample.

    `linear`: a `ControlledPlant` with its linear model, names, noises and limits.
    """

    linear: Any

    @abstractmethod
    def begin(self, dt: float) -> Any:
        """A run from trim, with samples `dt` seconds apart: `state` (n,) and `input` (m,) in deviations, `move(command)`."""


@runtime_checkable
class Resumable(Protocol):
    """A run that can be saved: `progress` is a record of all that it is, and `progress.resumed()` makes it again."""

    @property
    def progress(self) -> Any:
        """All that the run is now."""
        ...
