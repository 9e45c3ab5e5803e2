"""Whether the input excites the parameters to be identified."""

import numpy as np

from .. import checks
from ..data.record import Record
from ..diagnostics.cramer_rao import UNTOLD, check_noise, scale_of, slopes, undetermined
from ..kernels import output_error_response as kernel
from ..models.output_error import OutputError
from ..results import Check, Excitation

WEAK = 1e-4  # below which a direction is determined, but poorly
SHOWN = 500  # rows at which the smallest eigenvalue is computed


def excitation(model: OutputError, record: Record) -> Excitation:
    """The information in `record` about the parameters of `model`, for each direction of the parameters.

    It is the Fisher information of that model, computed from the applied inputs and from the mask of the seen outputs. Use a
    nominal model before an experiment, and a fitted one after it. A direction without information is a combination of
    parameters that the record does not determine. Condition (A3) of Fang (2009) requires that the smallest eigenvalue of the
    information stays above zero.

    `model`: an `OutputError`. Returns an `Excitation`. Raises `InputError` where an input is unknown, or an
    output has no noise.

    >>> plant = OutputError([-0.5], [1.0], noise_variance=0.1, dt=1)
    >>> step = Record(np.ones(200), np.ones(200), dt=1)
    >>> excitation(plant, step).check.passed, excitation(plant, Record(np.ones(200), np.zeros(200), dt=1)).directions.shape
    (True, (2, 2))
    """
    checks.require(model=(model, OutputError), record=(record, Record))
    check_noise(model)
    samples = np.unique(np.linspace(0, len(record) - 1, min(SHOWN, len(record))).astype(int))
    outputs = list(zip(slopes(model, record), record.seen.T, strict=True))
    M = _block_diagonal(
        [kernel.information(ψ, seen, r) for (ψ, seen), r in zip(outputs, model.noise_variance, strict=True)]
    )
    paths = [_path(ψ, seen, kernel.information(ψ, seen, 1.0), samples) for ψ, seen in outputs]
    return Excitation(M, samples, np.min(paths, axis=0), undetermined(M), excitation_check(M, model.parameter_names))


def _path(ψ: np.ndarray, seen: np.ndarray, M: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """The smallest eigenvalue of the scaled information gathered up to each of `samples`."""
    if not len(M):
        return np.ones(len(samples))
    scaled = np.where(seen[:, None], ψ * scale_of(M), 0.0)
    ends = np.append(samples, len(ψ) - 1)
    gathered, so_far = np.zeros((len(samples), len(M), len(M))), np.zeros_like(M)
    for i, (first, last) in enumerate(zip(np.append(0, ends[:-2] + 1), ends[:-1], strict=True)):
        so_far = so_far + scaled[first : last + 1].T @ scaled[first : last + 1]
        gathered[i] = so_far
    return np.maximum(np.linalg.eigvalsh(gathered)[:, 0], 0.0)


def _block_diagonal(blocks: list[np.ndarray]) -> np.ndarray:
    from scipy.linalg import block_diag

    return np.asarray(block_diag(*blocks))


def excitation_check(M: np.ndarray, names: tuple[str, ...], directions: np.ndarray | None = None) -> Check:
    """Check that the information M (d, d) determines every direction of the parameters.

    `directions` (d, r): the undetermined ones, where they are known better than from M.
    """
    scale = scale_of(M)
    directions = undetermined(M) if directions is None else directions
    value = max(float(np.linalg.eigvalsh(M * np.outer(scale, scale)).min(initial=1.0)), 0.0)
    if directions.shape[1]:
        shown = "; ".join(_combination(column, names) for column in directions.T[:4])
        more = f" and {directions.shape[1] - 4} more" if directions.shape[1] > 4 else ""
        sentence = (
            f"Excitation: these data carry no information about {shown}{more}. Apply an input with more frequencies, lower "
            "the orders, or record more samples."
        )
        return Check("excitation", False, value, UNTOLD, sentence)
    passed = value > WEAK
    advice = "" if passed else " Some directions are poorly determined: vary the input more, or lower the orders."
    sentence = f"Excitation: the smallest eigenvalue of the scaled information is {value:.3g} (1: the best).{advice}"
    return Check("excitation", passed, value, WEAK, sentence)


def _combination(direction: np.ndarray, names: tuple[str, ...]) -> str:
    """'0.8 a1 - 0.6 b0'."""
    terms = [(x, name) for x, name in zip(direction, names, strict=True) if abs(x) > 0.05]
    if len(terms) == 1:
        return terms[0][1]
    text = " ".join(f"{'-' if x < 0 else '+'} {abs(x):.2g} {name}" for x, name in terms)
    return text.removeprefix("+ ")
