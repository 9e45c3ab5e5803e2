"""H. Fang (2009), chapter 2: simultaneous input and state estimation, over many draws; the thesis shows one."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..annotations import Array
from ..data.record import Record
from ..filters.unknown_input import UnknownInput
from ..frozen import frozen
from ..kernels.steady_unknown_input import covariance, exact_step, fang_step
from ..models.prior import Prior
from ..models.state_space import StateSpace
from ..results import Estimate
from ..simulation.monte_carlo import monte_carlo
from .entries import Reproduced, ReproducedRow, drawn

A, B = np.diag([0.67, 0.53]), np.array([[1.0], [0.53]])
C, D = np.array([[0.55, 0.11], [0.0, 0.29]]), np.array([[0.40], [0.20]])
VAGUE = Prior([0.0, 0.0], 1e6 * np.eye(2))
NEAR = Prior(
    [0.0, 0.0], np.eye(2)
)  # of the example with levels: VAGUE leaves the first level open, and its input is 0 ± 10
WIDEST = 30**0.5  # a uniform input of variance 10
LEVELS = (-10.0, 10.0)
SEED = 2009
FANG, EXACT, OWN = "Algorithm 1", "Gillijns & De Moor", "Algorithm 1's own P"
NORMS = ("input, 2-norm", "input, largest", "x1, 2-norm", "x1, largest", "x2, 2-norm", "x2, largest")


class InputExample(NamedTuple):
    """One of the examples: the noise variance, the number of samples that fits its printed norms, and those norms."""

    noise: float
    samples: int
    printed: dict[str, tuple[float, ...]]
    levels: bool = False

    @property
    def model(self) -> StateSpace:
        """The plant of all three examples."""
        return StateSpace(A, B, C, D, Q=self.noise * np.eye(2), R=self.noise * np.eye(2), dt=1, inputs=["u"])


FIRST = InputExample(
    0.08, 150,
    {FANG: (17.6932, 4.7194, 11.4800, 3.2039, 6.9794, 1.4978), EXACT: (17.0132, 3.6580, 11.5034, 3.1733, 6.9855, 1.5098)},
)  # fmt: skip
SECOND = InputExample(
    0.8, 115,
    {FANG: (46.5408, 10.2476, 31.4444, 6.6983, 19.5499, 4.4089), EXACT: (45.8290, 10.3013, 31.5030, 6.7860, 19.6002, 4.3822)},
)  # fmt: skip
THIRD = FIRST._replace(printed={}, levels=True)
LENGTH_REMARK = "The thesis does not print the number of samples. Its norms fit about {}, which is used here."
STATE_REMARK = "States are one-step predictions, x[k] from y[0..k-1], for both algorithms, as in the thesis."


@frozen
class DrawnRecord:
    """A record with its unmeasured input and states."""

    record: Any
    u: Any
    x: Any


def draw(example: InputExample) -> Any:
    """A function of a random key that draws a record of the example."""

    def one(key: Array) -> DrawnRecord:
        of_u, of_w, of_v = jax.random.split(key, 3)
        T, sigma = example.samples, example.noise**0.5
        u = jax.random.uniform(of_u, (T,), minval=-WIDEST, maxval=WIDEST)
        if example.levels:
            u = jnp.where(u > 0, LEVELS[1], LEVELS[0])
        w, v = (sigma * jax.random.normal(of, (T, 2)) for of in (of_w, of_v))

        def move(x: Array, row: tuple[Array, Array, Array]):
            u, w, v = row
            return A @ x + B[:, 0] * u + w, (x, C @ x + D[:, 0] * u + v)

        x, y = jax.lax.scan(move, jnp.zeros(2), (u, w, v))[1]
        leaves, structure = jax.tree_util.tree_flatten(Record(np.zeros((T, 2)), dt=1))
        return DrawnRecord(jax.tree_util.tree_unflatten(structure, [y, *leaves[1:]]), u, x)

    return one


def errors(drawn: DrawnRecord, estimate: Estimate) -> dict[str, Any]:
    """Errors of the input and of the states predicted one step ahead, for each sample."""
    predicted = estimate.mean
    if not estimate.names.note.startswith("Fang"):
        moved = estimate.mean @ A.T + estimate.unknown_input @ B.T
        predicted = np.vstack([VAGUE.mean, moved[:-1]])
    return {"u": estimate.unknown_input[:, 0] - drawn.u, "x": predicted - drawn.x, "estimated_u": estimate.unknown_input[:, 0],
            "estimated_x": predicted, "true_u": drawn.u, "true_x": drawn.x}  # fmt: skip


def filter_of(example: InputExample, name: str) -> UnknownInput:
    """The algorithm with a name."""
    if example.levels:
        return UnknownInput(example.model, unknown=["u"], levels=LEVELS)
    return UnknownInput(example.model, unknown=["u"], method="fang" if name == FANG else "auto")


def run(example: InputExample, name: str, draws: int) -> Any:
    """The errors of all draws."""
    prior = NEAR if example.levels else VAGUE
    return monte_carlo(
        filter_of(example, name), draw(example), prior=prior, runs=draws, seed=SEED, summary=errors
    ).values


def table(example: InputExample) -> Any:
    """Tables 2.1 and 2.2: norms of the errors of both algorithms."""

    def compute(draws: int) -> Reproduced:
        rows = []
        for name in (FANG, EXACT):
            found = run(example, name, draws)
            errors = (found["u"], found["x"][..., 0], found["x"][..., 1])
            norms = [f(e) for e in errors for f in (_two_norm, _largest)]
            rows += [drawn(f"{label}, {name}", "", value, norm)
                     for label, value, norm in zip(NORMS, example.printed[name], norms, strict=True)]  # fmt: skip
        return Reproduced(tuple(rows), lambda: _compare(rows), (LENGTH_REMARK.format(example.samples), STATE_REMARK))

    return compute


def _two_norm(e: np.ndarray) -> np.ndarray:
    return np.sqrt(np.sum(e**2, axis=-1))


def _largest(e: np.ndarray) -> np.ndarray:
    return np.abs(e).max(axis=-1)


def _compare(rows: list[ReproducedRow]) -> Any:
    from . import plots

    return plots.next_to_ours(rows, [row.quantity for row in rows], x="error and norm", y="norm of the error")


def estimates(example: InputExample) -> Any:
    """Figs. 2.2, 2.4 and 2.6: the input and the states with their estimates."""

    def compute(draws: int) -> Reproduced:
        found = run(example, FANG, draws)
        rows = [
            drawn(f"RMS error of {what}", "", None, np.sqrt(np.mean(e**2, axis=-1)))
            for what, e in (("u", found["u"]), ("x1", found["x"][..., 0]), ("x2", found["x"][..., 1]))
        ]
        remarks = [STATE_REMARK]
        if example.levels:
            wrong = np.mean(np.abs(found["u"]) > 1e-6, axis=-1)
            rows.append(drawn("share of samples decided wrongly", "", None, wrong))
            remarks.append(
                "The belief is the sum over the levels, which leaves one of them. The thesis prints no number."
            )
        return Reproduced(tuple(rows), lambda: _draw_estimates(found), tuple(remarks))

    return compute


def _draw_estimates(found: dict[str, np.ndarray]) -> Any:
    from . import plots

    k = np.arange(found["u"].shape[1])
    panels = []
    for label, true, estimated in (
        ("input u", found["true_u"][0], found["estimated_u"][0]),
        ("state x1", found["true_x"][0, :, 0], found["estimated_x"][0, :, 0]),
        ("state x2", found["true_x"][0, :, 1], found["estimated_x"][0, :, 1]),
    ):
        lines = [plots.Line("true", k, true, plots.INK, width=1.5), plots.Line("estimated", k, estimated, 1, "dash")]
        panels.append(plots.Panel(label, lines))
    return plots.over_time(panels, x="sample")


def traces(example: InputExample) -> Any:
    """Figs. 2.3 and 2.5: the trace of the true covariance of the predicted state."""
    printed = {FANG: (0.8671 + 0.3431) * example.noise / 0.08, EXACT: None}

    def compute(draws: int) -> Reproduced:
        found = {name: trace(example, name) for name in (FANG, EXACT)}
        rows = [
            ReproducedRow(f"trace of P in the steady state, {name}", "", printed[name], float(found[name][-1]))
            for name in found
        ]
        own = float(trace(example, OWN)[-1])
        rows.append(ReproducedRow("trace of Algorithm 1's own P", "", (0.5037 + 0.2256) * example.noise / 0.08, own))
        remark = "Nothing is drawn at random. P is the true covariance; Algorithm 1 computes its gains from its own, smaller P."
        return Reproduced(tuple(rows), lambda: _draw_traces(found), (remark,))

    return compute


def trace(example: InputExample, name: str, steps: int = 40) -> np.ndarray:
    """The trace of the true covariance, from P = 1e6 I on."""
    Q = R = example.noise * np.eye(2)
    S, P, own, found = np.zeros((2, 2)), 1e6 * np.eye(2), 1e6 * np.eye(2), []
    for _ in range(steps):
        found.append(np.trace(own if name == OWN else P))
        if name != EXACT:
            K, own = fang_step(A, B, C, D, Q, R, own)
            P = covariance(A - K @ C, K, P, Q, R, S)
        else:
            P = exact_step(A, B, C, D, Q, R, S, P)[1]
    return np.array(found)


def _draw_traces(found: dict[str, np.ndarray]) -> Any:
    from . import plots

    lines = [
        plots.Line(name, np.arange(len(values)), values, i, ("solid", "dash")[i])
        for i, (name, values) in enumerate(found.items())
    ]
    limit = max(float(values[-1]) for values in found.values())
    return plots.over_time([plots.Panel("trace of P", lines, (0.8 * limit, 2.5 * limit))], x="sample")
