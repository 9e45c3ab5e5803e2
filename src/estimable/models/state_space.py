"""The linear state-space model with its noises."""

from collections.abc import Mapping
from dataclasses import KW_ONLY, field
from typing import Any

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..frozen import frozen, replace, set_field, static
from . import angles, forms
from .control import arguments_of, to_control
from .discretisation import HOLDS, over, read_steps
from .operating_point import OperatingPoint
from .schedule import along, read_schedule, read_values

MATRICES = ("A", "B", "C", "D", "Q", "R", "G", "S", "B_end")
SINGULAR = 1e14  # condition number above which a change of basis loses all digits


@frozen
class StateSpace:
    """A linear model with noise, discrete (dt > 0) or continuous (dt = 0), constant or varying in time.

    Discrete: x[k+1] = A x[k] + B u[k] + G w[k], y[k] = C x[k] + D u[k] + v[k]. The covariances are cov w = Q, cov v = R,
    cov(w, v) = S. Continuous: dx/dt = A x + B u + G w, where Q is a density (per second). y[k] is a sample as before, and R
    its covariance. (In the functions that solve continuous Riccati equations, and in `estimability`, R is a density.)

    Settings:

    - A (n, n), B (n, m), C (p, n), D (p, m), G (n, q), Q (q, q), R (p, p), S (q, p). By default B and D are zero, C and G the
      identity, Q and S zero. R has no default; functions that need it raise an error without it. Any matrix may have a
      leading time axis: its row k holds from t[k] to t[k+1].
    - `dt`: the step in seconds, 0 for a continuous model.
    - `states`, `inputs`, `outputs`: names of the channels (default x1.., u1.., y1..). The names match a record to the model.
    - `operating_point`: {"states", "inputs", "outputs"}, the point about which the model is linear, in absolute units. With
      it records, priors and results are in absolute units too.
    - `schedule`: {channel: table or function}: matrices that follow a measured channel of the record, such as the airspeed. A
      table is {"at": values (S,), "A": (S, n, n), ..}, with linear interpolation; a function returns {"A": .., ..} at one
      value of the channel. The drivers read the channel from the record by name. A, B, .. themselves are then nominal: they
      hold where the schedule gives nothing, and in the functions that analyse a model.
    - `angles`: which states and outputs are angles, {name: "rad", "deg", a period, or a range (lower, upper)}. The filters then
      take an innovation to the nearest turn, and results are in the range, by default from minus to plus half a turn.
    - `B_end` (n, m): the effect of u[k+1] on x[k+1], for an input that moves linearly between samples (first-order hold).

    Raises `InputError` with all faults at once: wrong shapes, covariances not symmetric or indefinite, wrong names.

    >>> model = StateSpace([[0.9]], [[1.0]], [[1.0]], Q=[[0.1]], R=[[0.2]], dt=0.5, states=["level"])
    >>> model.n, model.m, model.p, model.outputs
    (1, 1, 1, ('y1',))
    """

    A: Any
    B: Any = None
    C: Any = None
    D: Any = None
    _: KW_ONLY
    Q: Any = None
    R: Any = None
    G: Any = None
    S: Any = None
    B_end: Any = None
    dt: float = static()
    states: Any = static(default=None)
    inputs: Any = static(default=None)
    outputs: Any = static(default=None)
    operating_point: Any = None
    schedule: Any = None
    disturbance: Any = field(default=None, init=False)
    angles: Any = static(default=())
    varying: tuple[str, ...] = static(default=(), init=False)

    def __post_init__(self):
        faults = checks.Faults()
        dt = faults.number("dt", self.dt, lower=0.0, unit="seconds")
        matrices = _read_matrices(self, faults)
        if not faults.sentences:
            matrices = _complete(matrices)
            _check_noise(matrices, dt, faults)
        names = {
            "states": faults.names("states", self.states, "n", "x"),
            "inputs": faults.names("inputs", self.inputs, "m", "u"),
            "outputs": faults.names("outputs", self.outputs, "p", "y"),
        }
        turns = angles.read(self.angles, names["states"] + names["outputs"], "a state or an output", faults)
        point = schedule = None
        if not faults.sentences:
            point = OperatingPoint.of(self.operating_point, matrices["C"], matrices["D"], faults)
            schedule = read_schedule(self.schedule, matrices, faults)
            if schedule and (_varying(matrices) or matrices["B_end"] is not None):
                faults.add("a model with a `schedule` must have constant nominal matrices and no `B_end`.")
        faults.finish()
        set_field(
            self,
            dt=dt,
            operating_point=point,
            schedule=schedule,
            varying=_varying(matrices),
            angles=turns,
            **matrices,
            **names,
        )

    @property
    def n(self) -> int:
        """Number of states."""
        return self.A.shape[-1]

    @property
    def size_source(self) -> str:
        """The source of the number of states, for messages."""
        return f"`A` is {self.n} × {self.n}"

    @property
    def m(self) -> int:
        """Number of inputs."""
        return self.B.shape[-1]

    @property
    def p(self) -> int:
        """Number of outputs."""
        return self.C.shape[-2]

    def feeds_through(self, inputs: list[int]) -> bool:
        """Whether an input enters an output directly. `inputs` selects columns of u."""
        tables = [one.tables["D"] for one in self.schedule or () if one.tables and "D" in one.tables]
        return any(bool(np.any(D[..., inputs])) for D in (self.D, *tables))

    @property
    def is_continuous(self) -> bool:
        """Whether dt = 0."""
        return self.dt == 0

    @property
    def steps(self) -> int | None:
        """The number of rows in time of the matrices that vary; None for a constant model."""
        return getattr(self, self.varying[0]).shape[0] if self.varying else None

    @property
    def scheduled_by(self) -> tuple[str, ...]:
        """The channels that the matrices follow."""
        return tuple(one.channel for one in self.schedule or ())

    @property
    def nominal(self) -> "StateSpace":
        """The constant model with the nominal matrices."""
        return replace(self, schedule=None)

    def along(self, values: Mapping[str, Numbers]) -> "StateSpace":
        """The model at given values of the channels of its `schedule`: constant at one number each, varying in time along
        arrays (T,).

        Raises `InputError` with every fault: a channel without values, a value outside its table, a matrix of a wrong shape.

        >>> table = {"at": [100.0, 200.0], "B": [[[1.0]], [[4.0]]]}
        >>> model = StateSpace([[0.9]], [[1.0]], R=[[1.0]], dt=1, schedule={"airspeed": table})
        >>> model.along({"airspeed": 150.0}).B.tolist(), model.along({"airspeed": [100.0, 200.0]}).B.ravel().tolist()
        ([[2.5]], [1.0, 4.0])
        """
        rows, constant = read_values(self.scheduled_by, values)
        found = along(self.schedule or (), rows)
        matrices = {name: M[0] if constant else M for name, M in found.items()}
        varying = () if constant else tuple(name for name in MATRICES if name in matrices)
        model = replace(self, schedule=None, varying=varying, **matrices)
        if self.S is not None or "S" in matrices:
            faults = checks.Faults()
            _check_noise({name: getattr(model, name) for name in MATRICES}, self.dt, faults)
            faults.finish()
        return model

    def at(self, k: int) -> "StateSpace":
        """The constant model of row k of a model that varies in time; itself where it is constant."""
        return replace(self, varying=(), **{name: getattr(self, name)[k] for name in self.varying})

    def discretise(self, dt: float, *, hold: str = "zero_order") -> "StateSpace":
        """The discrete model of a continuous one over steps of `dt` seconds: one number, or an array (T,) with one for each row.

        `hold`: the input is constant over a step ("zero_order") or moves linearly to its next value ("first_order").
        The process noise is that which accumulates over the step (Van Loan, IEEE TAC 23, 1978).

        Raises `InputError` if the model is already discrete, `dt` is not positive or `hold` is unknown.

        >>> slow = StateSpace([[-1.0]], [[1.0]], Q=[[2.0]], R=[[1.0]], dt=0).discretise(0.1)
        >>> bool(np.isclose(slow.A[0, 0], np.exp(-0.1))), bool(np.isclose(slow.Q[0, 0], 1 - np.exp(-0.2)))
        (True, True)
        """
        refuse_schedule(self)
        faults = checks.Faults()
        faults.choice("hold", hold, HOLDS)
        if not self.is_continuous:
            faults.add(f"only a continuous model (dt = 0) can be discretised. This one has dt = {self.dt:g} s.")
        steps = read_steps(dt, self.steps, faults)
        faults.finish()
        Φ, B, B_end, Qd = over(self.A, self.B, self.G @ self.Q @ np.swapaxes(self.G, -1, -2), steps, hold=hold)
        discrete = StateSpace(
            Φ, B, self.C, self.D, Q=Qd, R=self.R, B_end=B_end, dt=float(np.mean(steps)),
            states=self.states, inputs=self.inputs, outputs=self.outputs, operating_point=self.operating_point,
            angles=self.angles,
        )  # fmt: skip
        return replace(discrete, disturbance=self.disturbance and replace(self.disturbance, discretised=True))

    def in_basis(self, T: Numbers) -> "StateSpace":
        """The same model in the states T x, named x1... Raises `InputError` if T (n, n) is singular.

        >>> StateSpace([[0.5]], [[1.0]], [[1.0]], R=[[1.0]], dt=1).in_basis([[2.0]]).C
        array([[0.5]])
        """
        refuse_schedule(self)
        faults = checks.Faults()
        faults.learn("n", self.n, f"the model has {checks.counted(self.n, 'state')}")
        T = np.asarray(faults.array("T", T, "n n"))
        faults.finish()
        if (condition := _condition(T)) > SINGULAR:
            checks.refuse(
                f"`T` must be invertible: with rows and columns scaled, its condition number is {condition:.3g}."
            )
        back = np.linalg.inv(T)
        point = self.operating_point
        return StateSpace(
            T @ self.A @ back, T @ self.B, self.C @ back, self.D, Q=self.Q, R=self.R, G=T @ self.G, S=self.S,
            B_end=None if self.B_end is None else T @ self.B_end, dt=self.dt, inputs=self.inputs, outputs=self.outputs,
            operating_point=point and OperatingPoint(T @ point.states, point.inputs, point.outputs),
            angles=tuple(one for one in self.angles if one[0] in self.outputs),
        )  # fmt: skip

    def in_coordinates(self, form: str) -> "StateSpace":
        """The same constant model in states with a meaning.

        `form`: "outputs": the first states are the outputs without noise, the others their later values; "balanced": each state
        is as easily excited as it is seen (discrete, stable); "modal": one state for a real pole, two for a complex pair.

        Raises `InputError` where the model has no such states.

        >>> turned = StateSpace([[0.5]], [[1.0]], [[2.0]], R=[[1.0]], dt=1).in_coordinates("outputs")
        >>> turned.C.tolist(), turned.B.tolist()
        ([[1.0]], [[2.0]])
        """
        refuse_schedule(self)
        faults = checks.Faults()
        faults.choice("form", form, forms.FORMS)
        if self.varying:
            faults.add("only a constant model has such coordinates: take one row with `at(k)`.")
        if form == "balanced" and self.is_continuous:
            faults.add('form = "balanced" needs a discrete model: discretise it first.')
        faults.finish()
        return self.in_basis(forms.coordinates(self.A, self.B, self.C, form))

    def continuous(self, *, hold: str = "zero_order") -> "StateSpace":
        """The continuous model that this discrete one samples: the inverse of `discretise`.

        `hold`: how the input moves between samples. With "first_order" the direct term of samples becomes part of the dynamics.
        The process noise becomes a density, where one has that sum over a step; that of a model with cross noise S, such as an
        innovations form, has none, and Q is left out.

        Raises `InputError` where there is no such model: a pole at 0 (a dead time is no pole: leave it out) or on the negative
        axis, or one that turns by more than 120 degrees a step, which may be an alias.

        >>> slow = StateSpace([[-1.0]], [[1.0]], Q=[[2.0]], R=[[1.0]], dt=0)
        >>> again = slow.discretise(0.1).continuous()
        >>> again.A.round(9).tolist(), again.B.round(9).tolist(), again.Q.round(9).tolist()
        ([[-1.0]], [[1.0]], [[2.0]])
        """
        refuse_schedule(self)
        faults = checks.Faults()
        faults.choice("hold", hold, HOLDS)
        if self.is_continuous or self.varying:
            faults.add("only a constant discrete model has a continuous one.")
        faults.finish()
        assert self.dt is not None
        F, B, ramp = forms.continuous_matrices(self.A, self.B, self.B_end, self.dt, hold)
        D = self.D - self.C @ ramp @ B
        Q = None if self.S is not None else forms.noise_density(F, self.A, self.G @ self.Q @ self.G.T)
        return StateSpace(
            F, B, self.C, D, Q=Q, R=self.R, dt=0, states=self.states, inputs=self.inputs, outputs=self.outputs,
            operating_point=self.operating_point, angles=self.angles,
        )  # fmt: skip

    @staticmethod
    def from_control(
        system,
        *,
        Q: Numbers | None = None,
        R: Numbers | None = None,
        G: Numbers | None = None,
        S: Numbers | None = None,
    ) -> "StateSpace":
        """A model from a `control.StateSpace` (dt = 0 is continuous there too), and its noise covariances.

        Needs the extra `control`. Raises `InputError` if the system's dt is not a number.
        """
        return StateSpace(**arguments_of(system), Q=Q, R=R, G=G, S=S)

    def to_control(self):
        """This model as a `control.StateSpace`, without its noise covariances and operating point. Needs the extra `control`."""
        refuse_schedule(self)
        return to_control(self)


def refuse_schedule(model: StateSpace) -> None:
    """Raise an error for a model whose matrices follow a channel, where one constant model is needed."""
    if model.schedule:
        names = checks.listed(model.scheduled_by)
        example = ", ".join(f'"{name}": value' for name in model.scheduled_by)
        checks.refuse(
            f"the matrices of the model follow {names}, and their values are not given here: use model.along({{{example}}})."
        )


def _varying(matrices: dict) -> tuple[str, ...]:
    """The names of the matrices with a time axis."""
    return tuple(name for name in MATRICES if matrices[name] is not None and np.ndim(matrices[name]) == 3)


def _condition(T: np.ndarray) -> float:
    """The condition number after scaling rows and columns, which removes the units of the states."""
    with np.errstate(invalid="ignore", divide="ignore"):
        scaled = T / np.abs(T).max(axis=1, keepdims=True)
        scaled = scaled / np.abs(scaled).max(axis=0)
    return float(np.linalg.cond(scaled)) if np.all(np.isfinite(scaled)) else np.inf


def _read_matrices(model: StateSpace, faults: checks.Faults) -> dict:
    """Each matrix, checked against those before it; None if not given or at fault."""
    read = {"A": faults.array("A", model.A, "n n", leading="T")}
    for name, axes in (("B", "n m"), ("C", "p n"), ("D", "p m"), ("G", "n q"), ("B_end", "n m")):
        value = getattr(model, name)
        if name == "C" and value is None and "n" in faults.sizes:
            faults.learn("p", faults.sizes["n"], "without `C`, every state is an output")
        if name == "G" and value is None and "n" in faults.sizes:
            faults.learn("q", faults.sizes["n"], "without `G`, noise enters every state")
        read[name] = None if value is None else faults.array(name, value, axes, leading="T")
    for name, axes in (("Q", "q q"), ("R", "p p")):
        value = getattr(model, name)
        read[name] = None if value is None else faults.covariance(name, value, axes, leading="T")
    read["S"] = None if model.S is None else faults.array("S", model.S, "q p", leading="T")
    if faults.sizes.get("n") == 0:
        faults.add("`A` must be at least 1 × 1: a model needs a state.")
    elif faults.sizes.get("p") == 0:
        faults.add("`C` must have at least one row: a model needs an output.")
    elif faults.sizes.get("q") == 0:
        faults.add("`G` must have at least one column. If no noise enters the state, leave out `G` and `Q`.")
    return read


def _complete(given: dict) -> dict:
    """Fill in the defaults: zero B and D, identity C and G, zero Q."""
    n = given["A"].shape[-1]
    p = n if given["C"] is None else given["C"].shape[-2]
    inputs = next((given[name].shape[-1] for name in ("B", "D", "B_end") if given[name] is not None), 0)
    noises = n if given["G"] is None else given["G"].shape[-1]
    defaults = {
        "B": np.zeros((n, inputs)), "C": np.eye(n), "D": np.zeros((p, inputs)),
        "G": np.eye(n), "Q": np.zeros((noises, noises)),
    }  # fmt: skip
    return {name: defaults.get(name) if value is None else value for name, value in given.items()}


def _check_noise(matrices: dict, dt: float | None, faults: checks.Faults) -> None:
    """Check the noise covariances together."""
    faults.learn("m", matrices["B"].shape[-1], "neither `B` nor `D` has a column")
    if dt == 0 and matrices["B_end"] is not None:
        faults.add(
            "`B_end` belongs to a discrete model, but dt = 0 is continuous. Use discretise(dt, hold='first_order')."
        )
    Q, R, S = (matrices[name] for name in ("Q", "R", "S"))
    if S is None or checks.is_traced(Q, R, S):
        return
    if dt == 0:
        faults.add(
            "`S` is for noises of one sample, which a continuous model (dt = 0) does not have. Discretise it first."
        )
    elif R is None:
        faults.add("`S` needs `R`, the covariance of the measurement noise.")
    else:
        joint_shape = np.broadcast_shapes(Q.shape[:-2], R.shape[:-2], S.shape[:-2])
        Q, R, S = (np.broadcast_to(M, (*joint_shape, *M.shape[-2:])) for M in (Q, R, S))
        joint = np.block([[Q, S], [np.swapaxes(S, -1, -2), R]])
        smallest = np.linalg.eigvalsh(joint).min()
        if smallest < -checks.ROUNDING * np.abs(joint).max() * joint.shape[-1]:
            faults.add(f"[[Q, S], [S.T, R]] must be positive semidefinite: its smallest eigenvalue is {smallest:.6g}.")


def between_samples(model: StateSpace, hold: str) -> StateSpace:
    """A discrete model of samples u[k], y[k] as one for records of a given hold.

    It already contains what the input does between its samples: with first-order hold as part of D, and `B_end` is zero.
    """
    faults = checks.Faults()
    faults.choice("hold", hold, HOLDS)
    faults.finish()
    if hold == HOLDS[0] or model.B_end is not None:
        return model
    return replace(model, B_end=np.zeros((model.n, model.m)))
