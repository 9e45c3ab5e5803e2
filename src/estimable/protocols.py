"""The interfaces that the drivers require of an algorithm, an identifier, a controller, a link and a plant.

A class derives from its interface: abstract members are required, all others that the drivers use are hooks with a default here.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Generic, Protocol, Self, TypeVar, runtime_checkable

from .annotations import Array, Numbers
from .checks import Faults
from .data.record import Record
from .frozen import replace
from .kernels.innovation_information import Search
from .kernels.smoothing import Instant
from .models.output_error import OutputError
from .models.prior import Prior
from .models.sampled import Clock
from .models.state_space import StateSpace
from .networks.delivery import Delivery
from .results import Fit, Info, Interval, Names, Sample

State = TypeVar("State")  # the state from sample to sample: a tree of arrays with constant shapes


class Algorithm(ABC, Generic[State]):
    """A state estimator that works sample by sample: `correct` with a sample, then `predict` to the next.

    An algorithm is a frozen record of settings; its methods take and return the state, which alone changes. `model`: a
    `StateSpace`, a `NonlinearModel` or, before there is a model, `Channels`. A wrapper has none.
    """

    model: Any
    gain_is_effectiveness = False  # whether a gain of 1 is the full effect, so that 1 minus the gain is what is lost
    takes_uncertain_inputs = False  # whether `Interval.u_covariance` may be given

    @property
    @abstractmethod
    def names(self) -> Names:
        """The names of the columns of its results: states, known inputs, outputs, gains and unknown inputs."""

    @abstractmethod
    def init(self, prior: Any) -> State:
        """The belief about x[0], before y[0]. `prior`: a `Prior`, or None where `has_state_prior` is False."""

    @abstractmethod
    def correct(self, state: State, sample: Sample) -> tuple[State, Info]:
        """Update with one sample, and report the belief. `Info.outcome` must be set: 0 without a failure."""

    @abstractmethod
    def predict(self, state: State, interval: Interval) -> State:
        """Move to the next sample."""

    def restarted(self, state: State, fresh: Callable[[Any], Any]) -> State:
        """The state at a break: `fresh` restarts x in each `Belief` of a tree, and carries the rest over."""
        return fresh(state)

    def sampled(self, clock: Clock) -> Self:
        """The algorithm prepared for the steps of a record: its model discretised, its noises factored."""
        return self

    def at(self, k: int | Array) -> Self:
        """The algorithm for row k of a model that varies in time."""
        return self

    @property
    def where_all_is_seen(self) -> Self:
        """An equivalent sampled algorithm that may be faster where every output is seen and the prior is proper."""
        return self

    @property
    def result_names(self) -> Mapping[str, Any]:
        """The fields `input_delay` and `note` of `Names`, which are known only once the algorithm is sampled."""
        return {}

    @property
    def innermost(self) -> "Algorithm[Any]":
        """The algorithm inside all wrappers: the one that has a model."""
        return self

    @property
    def has_state_prior(self) -> bool:
        """Whether the functions that run it need a `prior`; False where all priors are settings of the algorithm."""
        return True

    @property
    def takes_unknown_arrivals(self) -> bool:
        """Whether the arrival of inputs may be unknown."""
        return False

    @property
    def has_innovation_covariance(self) -> bool:
        """Whether `Info.innovation_covariance` is given."""
        return True

    def check_record(self, rows: int, faults: Faults) -> None:
        """Report a fault if a record with this many rows is too short."""


class Wrapper(Algorithm[State]):
    """An algorithm around another one, its field `algorithm`. A member that it does not define is that of the inner algorithm."""

    algorithm: Any

    @property
    def names(self) -> Names:
        """Names of the columns of the wrapped algorithm."""
        return self.algorithm.names

    def init(self, prior: Any) -> State:
        """The belief of the wrapped algorithm before y[0]."""
        return self.algorithm.init(prior)

    def correct(self, state: State, sample: Sample) -> tuple[State, Info]:
        """Update the wrapped algorithm with one sample."""
        return self.algorithm.correct(state, sample)

    def predict(self, state: State, interval: Interval) -> State:
        """Move to the next sample."""
        return self.algorithm.predict(state, interval)

    def restarted(self, state: State, fresh: Callable[[Any], Any]) -> State:
        """The state where a record breaks, by the wrapped algorithm."""
        return self.algorithm.restarted(state, fresh)

    def sampled(self, clock: Clock) -> Self:
        """The same wrapper around the sampled algorithm."""
        return replace(self, algorithm=self.algorithm.sampled(clock))

    def at(self, k: int | Array) -> Self:
        """The same wrapper around the algorithm at row k of a time-varying model."""
        return replace(self, algorithm=self.algorithm.at(k))

    @property
    def result_names(self) -> Mapping[str, Any]:
        """The result names of the wrapped algorithm."""
        return self.algorithm.result_names

    @property
    def innermost(self) -> Algorithm[Any]:
        """The algorithm inside all wrappers."""
        return self.algorithm.innermost

    @property
    def has_state_prior(self) -> bool:
        """Whether the wrapped algorithm needs a `prior`."""
        return self.algorithm.has_state_prior

    @property
    def takes_unknown_arrivals(self) -> bool:
        """Whether the wrapped algorithm supports inputs of unknown arrival."""
        return self.algorithm.takes_unknown_arrivals

    @property
    def has_innovation_covariance(self) -> bool:
        """Whether the wrapped algorithm reports the covariance of its innovations."""
        return self.algorithm.has_innovation_covariance

    def check_record(self, rows: int, faults: Faults) -> None:
        """Report a fault if a record is too short for the wrapped algorithm."""
        self.algorithm.check_record(rows, faults)


class GainAlgorithm(Algorithm[State]):
    """An algorithm that estimates gains (or parameters) with the state. `gain`: their prior; None if no gain is estimated."""

    gain: Any


class JumpingGains(GainAlgorithm[State]):
    """A gain algorithm whose gains `ChangeDetection` can watch for jumps, with the members it needs."""

    uncertain_entries = 0  # entries of the model that its belief holds between the state and the gains

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
        """The report of a belief, in the user's units."""

    def skewed(self, quantiles: Array) -> Array:
        """The quantiles (p, 5) of the gains, given those of a symmetric distribution."""
        return quantiles


class Smoothable(Algorithm[State]):
    """An algorithm that `smooth` can run: each row has a linear Gaussian model. `smooth` refuses a `forgetting` below 1."""

    forgetting: Any = 1.0

    @abstractmethod
    def instant(self, sample: Sample, interval: Interval) -> Instant:
        """The model of this row: how the state moves, and the measurement."""

    @abstractmethod
    def tell(self, state: State) -> Info:
        """The report of a belief, in the user's units."""

    @property
    def for_smoothing(self) -> Self:
        """The algorithm in the form that the smoother needs. Raises `InputError` where it cannot be smoothed."""
        return self


class Method:
    """The methods of `identify` and `compare`: a batch, a recursive or a filter identifier."""

    cannot_weigh: str = ""  # why it cannot weigh samples by `sigma` of the record; empty: it does
    fits_series = False  # whether it fits a record without inputs
    in_a_loop = "holds"  # or "white": under feedback only white noise of the outputs does no harm; or "biased"

    @property
    def label(self) -> str:
        """The name in a comparison."""
        return type(self).__name__


class Identifier(Method, ABC):
    """A method that fits a model to one record, or to several records of one plant with the same channels and time step."""

    takes_unknown_inputs = False  # where inputs were not logged; `identify` estimates those for other methods
    cannot_weigh = "it takes the noise of all rows as equal"

    @abstractmethod
    def fit(self, records: Sequence[Record]) -> Fit:
        """Fit a model to the records. Raises `InputError` for unsuitable records."""


class StartedIdentifier(Identifier):
    """An identifier whose search has an additional start, from a recursive identifier that `identify` runs first."""

    @abstractmethod
    def check(self, records: Sequence[Record]) -> None:
        """Raise `InputError` for unsuitable records, before the recursion runs."""

    @abstractmethod
    def starter(self, records: Sequence[Record]) -> "RecursiveIdentifier[Any] | None":
        """The recursion that provides the start; None where these records need none."""

    @abstractmethod
    def fit(self, records: Sequence[Record], start: Array | None = None, search: Search | None = None) -> Fit:
        """The fit; `start` (d,): the final parameters of the recursion; `search`: for likelihoods that engines run."""


class RecursiveIdentifier(Algorithm[State], Method):
    """An algorithm whose states are the parameters of an output-error model. `lost`: what actuators do without a packet."""

    method: str = ""
    noise_variance: Any
    lost: str = "zero"

    @abstractmethod
    def for_channels(self, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> Self:
        """The same identifier with the channels of a record, unless its own channels are set."""

    @abstractmethod
    def fitted(self, parameters: Array, dt: float) -> OutputError:
        """The model with the parameters (d,)."""

    @abstractmethod
    def rested(self, state: State) -> State:
        """The belief when another record begins: the parameters as before, and a plant at rest."""

    @property
    def has_state_prior(self) -> bool:
        """False, because the prior of the parameters is a setting."""
        return False


class Anticipating(RecursiveIdentifier[State]):
    """A recursive identifier for controllers that act before a sample is measured (`acts_on` = "predicted")."""

    @abstractmethod
    def ahead(self, state: State) -> Info:
        """The belief before the next sample; in `extra` the `past_outputs` (p, na) and `past_inputs` (m, ..)."""


class FilterIdentifier(Method, ABC):
    """A method that estimates parameters by a filter of state and parameters (`tracker`), started from the records.

    `model`: the nonlinear model; `state_prior`: of its state; `refinement`: "none" or "likelihood"."""

    model: Any
    state_prior: Any
    refinement: Any = "none"

    @property
    @abstractmethod
    def varies(self) -> bool:
        """Whether the parameters may change in time."""

    @abstractmethod
    def begin(self, records: Sequence[Record]) -> Any:
        """The start of the parameters: `parameters` (a `Prior`), the `linear` model behind it, and `checks`."""

    @abstractmethod
    def tracker(self, parameters: Prior) -> Algorithm[Any]:
        """The filter of the state and the parameters."""

    @abstractmethod
    def known(self, parameters: Array) -> Algorithm[Any]:
        """The filter of the state alone, with known parameters (k,)."""


class Controller(ABC, Generic[State]):
    """A control law that computes the inputs of a plant from an estimate and a reference, sample by sample."""

    @property
    @abstractmethod
    def size(self) -> int:
        """The number of inputs, m."""

    @property
    @abstractmethod
    def references(self) -> int:
        """The number of references, r."""

    @abstractmethod
    def init(self) -> State:
        """The state of the controller before the first sample."""

    @abstractmethod
    def act(self, state: State, estimate: Info, reference: Array) -> tuple[State, Array, Mapping[str, Array]]:
        """The next state of the controller, the input (m,), and a report by name.

        `estimate.extra["input"]` is the position of the actuators at this instant.
        """

    @property
    def acts_on(self) -> str:
        """ "filtered": it acts after a sample is measured; "predicted": before it, so that its input may enter y at once."""
        return "filtered"

    def check(self, names: Names, faults: Faults) -> None:
        """Report a fault if an estimator whose columns have these names does not suit this controller."""

    def check_plant(self, model: StateSpace, faults: Faults) -> None:
        """Report a fault if this law cannot control this plant."""


class SharedController(Controller[State]):
    """A controller for use inside `GainReconfiguration` and `Dither`, which pass the remaining effect of the inputs."""

    @abstractmethod
    def act(
        self, state: State, estimate: Info, reference: Array, effect: Array | float = 1.0
    ) -> tuple[State, Array, Mapping[str, Array]]:
        """As in `Controller`; the demand on the plant is divided by `effect`, (m,), or multiplied by it where it is (m, m)."""


@runtime_checkable
class Link(Protocol):
    """A network link that carries packets.

    `draws`: the number of uniform random numbers that it needs at each instant. `acknowledged`: whether the sender is
    notified which packets arrived. `late`: what the receiver does with late packets, "drop" or "use"."""

    @property
    def draws(self) -> int:
        """The number of uniform numbers per instant."""
        ...

    @property
    def acknowledged(self) -> bool:
        """Whether the sender is notified, a step later, which packets arrived."""
        return True

    @property
    def late(self) -> str:
        """The treatment of a late packet by the receiver: "drop" or "use"."""
        return "drop"

    def init(self) -> Any:
        """The state before the first packet."""
        ...

    def send(self, state: Any, packet: Array, draw: Array) -> tuple[Any, Delivery]:
        """Send a packet (c,). Returns the next state and the delivery. `draw` (draws,): uniform random numbers on [0, 1)."""
        ...


class Plant(ABC):
    """A simulator that no engine can run, as a plant for `close_loop`, which then runs in Python. `linear`: its linear model."""

    linear: Any

    @abstractmethod
    def begin(self, dt: float) -> Any:
        """A run with steps `dt`: deviations `state`, `input`, `output`, and `move(command, e)` with unit normal e (n,)."""
