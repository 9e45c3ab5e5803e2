"""The estimate whose innovations show whether the model explains a record in which a gain may have jumped."""

import itertools
from typing import Any

import jax
import numpy as np

from ..data.record import Record
from ..frozen import replace
from ..models.prior import Prior
from ..protocols import Algorithm
from ..results import Estimate


def estimate_between_changes(algorithm: Algorithm[Any], record: Record, prior: Prior, onsets: list[int]) -> Estimate:
    """Run the algorithm again from each onset, from the state estimate at that time and the prior of the gain.

    A detected jump must not count against the model; an undetected one does. A model that varies in time cannot be cut and
    is run once over the whole record.
    """
    from ..estimation.binding import model_of
    from ..estimation.estimate import estimate

    cuts = [0, *sorted({onset for onset in onsets if 0 < onset < len(record)}), len(record)]
    if model_of(algorithm).varying or len(cuts) == 2:
        return estimate(algorithm, record, prior=prior, on_failure="keep")
    parts = []
    for start, stop in itertools.pairwise(cuts):
        part, last = _with_next_row_unseen(record, start, stop)
        found = estimate(algorithm, part, prior=prior, on_failure="keep")
        if not last:
            prior = Prior(found.mean[-1], found.covariance[-1], diffuse=_columns(found.diffuse_covariance))
        rows = slice(stop - start)
        parts.append(replace(found, info=jax.tree_util.tree_map(lambda leaf, rows=rows: leaf[rows], found.info)))
    info = jax.tree_util.tree_map(lambda *leaves: np.concatenate(leaves), *(part.info for part in parts))
    return replace(parts[-1], info=info, t=record.t, log_likelihood=sum(part.log_likelihood for part in parts))


def _with_next_row_unseen(record: Record, start: int, stop: int) -> tuple[Record, bool]:
    """Rows start to stop, and the next one (if any) without outputs: its estimate is the prediction."""
    last = stop == len(record)
    part = record[start : stop if last else stop + 1]
    return (part, True) if last else (replace(part, y=np.concatenate([part.y[:-1], np.nan * part.y[-1:]])), False)


def _columns(diffuse: np.ndarray) -> Any:
    """Columns that span the unknown directions at the last row; None if there are none."""
    if diffuse is None:
        return None
    values, vectors = np.linalg.eigh(diffuse[-1])
    known = values <= 1e-9 * max(values[-1], 1e-300)
    return None if np.all(known) else vectors[:, ~known] * np.sqrt(values[~known])
