"""Whether the outputs of a nonlinear model can determine its states and parameters at all, decided with many digits."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Numbers
from ..kernels import flow
from ..kernels.replay import NoReplayError, Precise, Replay
from ..models.nonlinear_model import NonlinearModel
from ..results import StructuralIdentifiability

Real = np.ndarray
EVEN = 1e-8  # of a combination: entries smaller than this are rounding
TRIES = 20  # draws of a point until f and h are defined along its path
WEAK = 1e-9  # singular value in floats above which many digits are not needed


def structural_identifiability(
    model: NonlinearModel, *, u: Numbers | None = None, points: int = 4, length: int | None = None, digits: int = 60
) -> StructuralIdentifiability:
    """Whether noise-free outputs determine every state and parameter of a model, and if not, which combinations they do.

    The derivatives of the outputs by (x[0], θ) are computed with many digits along random paths. A direction that is hidden by
    the structure has a singular value of zero at every point, to all digits; one that is only weakly seen has a small one. In
    floats the two cannot be distinguished. The combinations that are identifiable are named where a scaling of the quantities
    (products and quotients) or a shift (sums) explains what is hidden.

    - `u` (T, m): the inputs; None: random ones. `points`: random values of (x[0], θ), θ around those of the model.
    - `length`: the number of samples; None: twice the number of unknowns. `digits`: those of the computation; a singular value
      counts as zero below 10^-(2/3 digits).

    A continuous model is judged by short Runge-Kutta steps. Returns a `StructuralIdentifiability`. Raises `InputError` for a
    model whose functions use a primitive that cannot be replayed, by its name.

    Cost: under a second for six unknowns; it grows with the square of their number.

    References: A. Sedoglavic, J. Symbolic Computation 33 (2002) 735-755 (generic rank); E. Hubert, G. Labahn, Found. Comput.
    Math. 13 (2013) 479-516 (scalings).

    >>> import jax.numpy as jnp
    >>> tank = NonlinearModel(lambda x, u, θ: 0.9 * x + θ[0] * θ[1] * u, lambda x, u, θ: x, Q=[[0.0]], R=[[1.0]], dt=1,
    ...                       inputs=["pump"], states=["level"], parameters={"valve": 1.0, "gain": 2.0})
    >>> structural_identifiability(tank).identifiable_combinations
    ('level', 'valve * gain')
    """
    import mpmath

    faults = checks.Faults()
    if not faults.instance("model", model, NonlinearModel):
        faults.finish()
    faults.learn("m", model.m, f"the model has {checks.counted(model.m, 'input')}")
    given = None if u is None else faults.array("u", u, "T m")
    faults.whole("points", points, 1, 100)
    faults.whole("digits", digits, 20, 1000)
    if length is not None:
        faults.whole("length", length, 1, 10_000)
    faults.finish()
    size = model.n + len(model.parameters)
    T = length or (2 * size if given is None else min(len(given), 2 * size))
    tester = _Tester(model, T, None if given is None else given[:T], mpmath.mp)
    with mpmath.workdps(digits):
        found = [tester.at_random(np.random.default_rng(i)) for i in range(points)]
    return _named(model, found, 10.0 ** (-2 * digits / 3))


def hidden_parameters(model: NonlinearModel, x: Real, u: Real) -> Real | None:
    """The directions (k, r) of the parameters alone that the structure hides, at the parameters of the model and the state x.

    None: there is none, or it is not decided. Floats decide unless a direction is nearly hidden. A direction that moves the
    start as well is not counted: the prior of the state carries information about it.
    """
    import mpmath

    n, k = model.n, len(model.parameters)
    T = min(len(u), 2 * (n + k))
    ζ = np.concatenate([np.asarray(x, float), np.asarray(model.parameters, float)])
    try:
        quick = _Tester(model, T, u[:T], mpmath.fp).at(ζ)
        if quick is None or quick.σ.min() > WEAK:
            return None
        structure = structural_identifiability(model)
    except (NoReplayError, checks.InputError):
        return None
    if structure.identifiable:
        return None
    with mpmath.workdps(60):
        here = _Tester(model, 2 * (n + k), None, mpmath.mp).at(ζ)
    if here is None:
        return None
    from scipy.linalg import null_space

    hidden = np.where(np.abs(here.V) < EVEN, 0.0, here.V)[:, here.σ < 1e-40]
    hidden = hidden @ null_space(hidden[:n]) if n and hidden.shape[1] else hidden
    return np.linalg.qr(hidden[n:])[0] if hidden.shape[1] else None


class _Point:
    """The singular values σ (n + k,) of the tangents with unit columns, their directions V in the quantities, and ζ = (x, θ)."""

    def __init__(self, σ: Real, V: Real, ζ: Real, branches: list[Any]):
        self.σ, self.V, self.ζ, self.branches = σ, V, ζ, branches


class _Tester:
    """The tangents of T outputs by (x[0], θ), on numbers of a context of mpmath."""

    def __init__(self, model: NonlinearModel, T: int, u: Real | None, numbers: Precise):
        self.model, self.T, self.u = model, T, u
        self.numbers: Any = numbers
        n, k = model.n, len(model.parameters)
        shapes = [(n + k,), (model.m,), (n + k,)]
        try:
            self.move = Replay(lambda z, v, t: jax.jvp(lambda w: self._step(w, v), (z,), (t,)), shapes, numbers)
            self.see = Replay(lambda z, v, t: jax.jvp(lambda w: model.h(w[:n], v, w[n:]), (z,), (t,)), shapes, numbers)
        except NoReplayError as missing:
            checks.refuse(f"the functions of the model use {missing}, which cannot be evaluated with many digits.")

    def _step(self, w: jax.Array, v: jax.Array) -> jax.Array:
        n, f = self.model.n, self.model.f
        if not self.model.is_continuous:
            return jnp.concatenate([f(w[:n], v, w[n:]), w[n:]])
        move = lambda t, x: f(x, v, w[n:])  # noqa: E731
        return jnp.concatenate([flow.runge_kutta(move, w[:n], 0.05, 1), w[n:]])

    def at_random(self, rng: np.random.Generator) -> _Point:
        """At a random point, at which the functions are defined."""
        n, θ = self.model.n, np.asarray(self.model.parameters, float)
        for _ in range(TRIES):
            about = np.where(θ == 0, 1.0, θ)
            ζ = np.concatenate([rng.uniform(0.5, 1.5, n), about * rng.uniform(0.6, 1.4, len(θ))])
            found = self.at(ζ, rng)
            if found is not None:
                return found
        checks.refuse("`f` or `h` is not defined along random paths from states between 0.5 and 1.5: scale the model.")

    def at(self, ζ: Real, rng: np.random.Generator | None = None) -> _Point | None:
        """At one point; None where a value is complex or not finite."""
        rng = rng or np.random.default_rng(0)
        u = rng.uniform(0.2, 1.2, (self.T, self.model.m)) if self.u is None else np.asarray(self.u)
        number = np.vectorize(lambda x: self.numbers.mpf(float(x)), otypes=[object])
        size = len(ζ)
        z, columns = number(ζ), [number(row) for row in np.eye(size)]
        rows, branches = [], []
        try:
            for v in u:
                v = number(v) if len(v) else np.zeros(0, object)
                rows.append(np.stack([self.see(z, v, t)[1] for t in columns], axis=-1))
                moved = [self.move(z, v, t) for t in columns]
                branches.append((self.see.branches, self.move.branches))
                z, columns = moved[0][0], [one[1] for one in moved]
        except NoReplayError as missing:
            checks.refuse(f"the functions of the model use {missing}, which cannot be evaluated with many digits.")
        except (ZeroDivisionError, ValueError, OverflowError, TypeError):
            return None
        return self._singular(np.concatenate(rows), ζ, branches)

    def _singular(self, J: Real, ζ: Real, branches: list[Any]) -> _Point | None:
        numbers = self.numbers
        if any(isinstance(x, complex) or (hasattr(x, "imag") and x.imag != 0) for x in J.ravel()):
            return None
        if not all(numbers.isfinite(x) for x in J.ravel()):
            return None
        norms = [numbers.sqrt(sum((x * x for x in column), numbers.mpf(0))) for column in J.T]
        unit = np.array([norm if norm > 0 else numbers.mpf(1) for norm in norms], object)
        U = J / unit
        if numbers.__class__.__name__ == "FPContext":
            _, σ, Vt = np.linalg.svd(U.astype(float), full_matrices=True)
            σ = np.append(σ, np.zeros(len(Vt) - len(σ)))
            return _Point(σ, Vt.T / unit.astype(float)[:, None], ζ, branches)
        with numbers.workdps(2 * numbers.dps):
            λ, Q = numbers.eigsy(numbers.matrix((U.T @ U).tolist()))
            σ = np.array([float(numbers.sqrt(abs(x))) for x in λ])
            V = np.array(Q.tolist(), object) / unit[:, None]
        V = V / np.abs(V).max(axis=0)
        return _Point(σ, V.astype(float), ζ, branches)


def _named(model: NonlinearModel, found: Sequence[_Point], zero: float) -> StructuralIdentifiability:
    """The combinations that are identifiable, where a scaling or a shift explains what is hidden at every point."""
    names = (*model.states, *model.parameter_names)
    hidden = min(int(np.sum(point.σ < zero)) for point in found)
    nulls = [point.V[:, np.argsort(point.σ)[:hidden]] for point in found]
    σ = np.array([np.sort(point.σ)[::-1] for point in found])
    one_branch = all(point.branches == found[0].branches for point in found)
    kind, combinations = "all", names
    if hidden:
        relative = [null / point.ζ[:, None] for null, point in zip(nulls, found, strict=True)]
        kind, combinations = "local", ()
        for what, spans in (("products", relative), ("sums", nulls)):
            basis = _common(spans, hidden)
            if basis is not None:
                kind, combinations = what, _combinations(basis, names, products=what == "products")
                break
    return StructuralIdentifiability(
        hidden == 0, names, combinations, kind, np.linalg.qr(nulls[0])[0].T if hidden else np.zeros((0, len(names))), σ,
        one_branch,
    )  # fmt: skip


def _common(spans: Sequence[Real], hidden: int) -> Real | None:
    """An orthonormal basis of the span, where it is the same at all points; else None."""
    unit = np.hstack([span / np.linalg.norm(span, axis=0) for span in spans])
    U, σ, _ = np.linalg.svd(unit, full_matrices=False)
    return U[:, :hidden] if len(σ) == hidden or σ[hidden] < EVEN * σ[0] else None


def _combinations(null: Real, names: tuple[str, ...], *, products: bool) -> tuple[str, ...]:
    """The complement of the hidden directions in echelon form, as products or sums."""
    from scipy.linalg import null_space

    rows = _echelon(null_space(null.T).T)
    return tuple(_text(row, names, products) for row in rows)


def _echelon(M: Real) -> Real:
    """Reduced row echelon form."""
    M, r = M.copy(), 0
    for c in range(M.shape[1]):
        if r == len(M):
            break
        pivot = r + int(np.argmax(np.abs(M[r:, c])))
        if abs(M[pivot, c]) < EVEN:
            continue
        M[[r, pivot]] = M[[pivot, r]]
        M[r] /= M[r, c]
        others = [i for i in range(len(M)) if i != r]
        M[others] -= np.outer(M[others, c], M[r])
        r += 1
    return np.where(np.abs(M) < EVEN, 0.0, M)


def _text(row: Real, names: tuple[str, ...], products: bool) -> str:
    parts = []
    for value, name in zip(row, names, strict=True):
        if value == 0:
            continue
        size = f"{abs(value):.6g}"
        if products:
            power = name if size == "1" else f"{name}^{size}"
            parts.append(
                ("" if not parts and value > 0 else "1 / " if not parts else " * " if value > 0 else " / ") + power
            )
        else:
            term = name if size == "1" else f"{size} {name}"
            parts.append(
                ("" if not parts and value > 0 else "-" if not parts else " + " if value > 0 else " - ") + term
            )
    return "".join(parts)
