"""Does the input excite what is to be identified?"""

import numpy as np

from .. import checks
from ..data.record import Record
from ..kernels import output_error as kernel
from ..models.output_error import OutputError
from ..results import Check, Excitation

UNTOLD = 1e-9  # eigenvalue of the scaled information, of its largest, below which a direction counts as not told of
WEAK = 1e-4  # below which it is told of, and poorly
SHOWN = 500  # rows at which the smallest eigenvalue is worked out


def excitation(model: OutputError, record: Record) -> Excitation:
    """How much the outputs seen in `record` tell of the parameters of `model`, direction by direction.

    The information is that of the model given, from the inputs applied and the outputs seen: run it on a nominal model before an
    experiment, or on a fitted one after it. Condition (A3) of Fang (2009) asks that the smallest eigenvalue stays above zero.

    Raises `InputError` where an input is not known.

    >>> plant = OutputError([-0.5], [1.0], noise_variance=0.1, dt=1)
    >>> step = Record(np.ones(200), np.ones(200), dt=1)
    >>> excitation(plant, step).check.passed, excitation(plant, Record(np.ones(200), np.zeros(200), dt=1)).directions.shape
    (True, (2, 2))
    """
    u, seen = applied(model, record), record.seen
    samples = np.unique(np.linspace(0, len(record) - 1, min(SHOWN, len(record))).astype(int))
    blocks, paths, bases = [], [], []
    for i in range(model.p):
        a, b = np.asarray(model.a)[i], np.asarray(model.b)[i]
        ψ = kernel.slopes(a, b, model.delay, u, kernel.response(a, b, model.delay, u))
        blocks.append(kernel.information(ψ, seen[:, i], 1.0))
        paths.append(_path(ψ, seen[:, i], blocks[-1], samples))
        bases.append(undetermined(blocks[-1]))
    smallest = np.min(paths, axis=0)
    information = _block_diagonal(
        [block / max(r, 1e-300) for block, r in zip(blocks, model.noise_variance, strict=True)]
    )
    directions = _block_diagonal(bases)
    return Excitation(information, samples, smallest, directions, _verdict(smallest, directions, model.parameter_names))


def applied(model: OutputError, record: Record) -> np.ndarray:
    """The inputs that were applied (T, m), all of them known."""
    faults = checks.Faults()
    if (len(record.inputs), len(record.outputs)) != (model.m, model.p):
        faults.add(
            f"the model has {checks.counted(model.m, 'input')} and {checks.counted(model.p, 'output')}, the record "
            f"{len(record.inputs)} and {len(record.outputs)}."
        )
    u = np.asarray(record.applied())
    if np.isnan(u).any():
        faults.add(
            f"an input is not known at row {checks.first_index(np.isnan(u))}: NaN, or nobody knows whether it arrived."
        )
    faults.finish()
    return u


def undetermined(M: np.ndarray) -> np.ndarray:
    """An orthonormal basis (d, r) of what the information M (d, d) does not tell of, whatever the units."""
    scale = _scale(M)
    values, vectors = np.linalg.eigh(M * scale[:, None] * scale[None, :])
    largest = values.max(initial=0.0)
    if largest <= 0:
        return np.eye(len(M))
    basis = vectors[:, values <= UNTOLD * largest] * np.where(scale > 0, scale, 1.0)[:, None]
    return np.linalg.qr(basis)[0] if basis.shape[1] else basis


def _scale(M: np.ndarray) -> np.ndarray:
    """What makes the diagonal of M one; zero where it is zero."""
    size = np.sqrt(np.diagonal(M))
    return np.where(size > 0, 1 / np.where(size > 0, size, 1.0), 0.0)


def _path(ψ: np.ndarray, seen: np.ndarray, M: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """The smallest eigenvalue of the scaled information gathered up to each of `samples`."""
    if not len(M):
        return np.ones(len(samples))
    scaled = np.where(seen[:, None], ψ * _scale(M), 0.0)
    ends = np.append(samples, len(ψ) - 1)
    gathered, told = np.zeros((len(samples), len(M), len(M))), np.zeros_like(M)
    for i, (first, last) in enumerate(zip(np.append(0, ends[:-2] + 1), ends[:-1], strict=True)):
        told = told + scaled[first : last + 1].T @ scaled[first : last + 1]
        gathered[i] = told
    return np.maximum(np.linalg.eigvalsh(gathered)[:, 0], 0.0)


def _block_diagonal(blocks: list[np.ndarray]) -> np.ndarray:
    from scipy.linalg import block_diag

    return np.asarray(block_diag(*blocks))


def _verdict(path: np.ndarray, directions: np.ndarray, names: tuple[str, ...]) -> Check:
    value = float(path[-1]) if len(path) else 0.0
    if directions.shape[1]:
        shown = "; ".join(_combination(column, names) for column in directions.T[:4])
        more = f" and {directions.shape[1] - 4} more" if directions.shape[1] > 4 else ""
        sentence = (
            f"Excitation: these data tell nothing about {shown}{more}. Apply an input that moves at more frequencies, lower "
            "the orders, or gather more samples."
        )
        return Check("excitation", False, value, UNTOLD, sentence)
    passed = value > WEAK
    advice = "" if passed else " Vary the input more, or lower the orders: such directions are known poorly."
    sentence = f"Excitation: the smallest eigenvalue of the scaled information is {value:.3g} (1: the best).{advice}"
    return Check("excitation", passed, value, WEAK, sentence)


def _combination(direction: np.ndarray, names: tuple[str, ...]) -> str:
    """'0.8 a1 - 0.6 b0'."""
    terms = [(x, name) for x, name in zip(direction, names, strict=True) if abs(x) > 0.05]
    if len(terms) == 1:
        return terms[0][1]
    text = " ".join(f"{'-' if x < 0 else '+'} {abs(x):.2g} {name}" for x, name in terms)
    return text.removeprefix("+ ")
