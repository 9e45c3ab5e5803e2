"""Levels and straight drifts of the signals of a record: found by least squares and subtracted."""

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from .. import checks
from ..frozen import replace, saved
from .record import Record, several

DEGREES = (0, 1)


@saved
class Trend(NamedTuple):
    """The trend to subtract from each channel of a record: a constant level or a straight line.

    `inputs` (2, m) and `outputs` (2, p): the first row holds the value at row 0 of the record, the second the change per row.
    """

    inputs: Annotated[np.ndarray, "2 m"]
    outputs: Annotated[np.ndarray, "2 p"]

    @staticmethod
    def of(records: Sequence[Record], degree: int = 0) -> "Trend":
        """The levels (degree 0) or straight lines (degree 1) of records, fitted to the known samples by least squares.

        Several records share one trend. Inputs are those that were applied.

        >>> Trend.of(Record([1.0, 2.0, 3.0], [4.0, 4.0, 4.0], dt=1), 1).outputs.round(9).ravel().tolist()
        [1.0, 1.0]
        """
        faults = checks.Faults()
        if not isinstance(degree, int | np.integer) or isinstance(degree, bool) or degree not in DEGREES:
            faults.add(f"`degree` must be 0 (levels) or 1 (straight lines). Got {checks.short(degree)}.")
        records = several("records", records, faults)
        if len(counts := {(len(one.inputs), len(one.outputs)) for one in records}) > 1:
            faults.add(
                f"all `records` must have the same channels. Got (inputs, outputs) = {checks.listed(sorted(counts))}."
            )
        faults.finish()
        u, y = (np.concatenate(columns) for columns in zip(*((r.applied(), r.y) for r in records), strict=True))
        rows = np.concatenate([np.arange(len(record)) for record in records])
        return Trend(*(_lines(rows, values, degree) for values in (u, y)))

    @staticmethod
    def none(record: Record) -> "Trend":
        """The zero trend of a record."""
        checks.require(record=(record, Record))
        return Trend(np.zeros((2, len(record.inputs))), np.zeros((2, len(record.outputs))))

    def at(self, row: float) -> tuple[np.ndarray, np.ndarray]:
        """Inputs (m,) and outputs (p,) of the trend at a row."""
        return tuple(line[0] + row * line[1] for line in self)  # type: ignore[return-value]

    def taken_from(self, record: Record) -> Record:
        """The record without the trend. The inputs are those that were applied.

        >>> record = Record([1.0, 2.0], [4.0, 4.0], dt=1)
        >>> Trend.of(record).taken_from(record).y.ravel().tolist()
        [-0.5, 0.5]
        """
        checks.require(record=(record, Record))
        m, p = self.inputs.shape[1], self.outputs.shape[1]
        if (len(record.inputs), len(record.outputs)) != (m, p):
            checks.refuse(
                f"`record` must have the channels of the trend, {checks.counted(m, 'input')} and {checks.counted(p, 'output')}. "
                f"Got {len(record.inputs)} and {len(record.outputs)}."
            )
        rows = np.arange(len(record))[:, None]
        u, y = (line[0] + rows * line[1] for line in self)
        return replace(record, y=record.y - y, u=record.applied() - u, arrived=None)


def _lines(rows: np.ndarray, values: np.ndarray, degree: int) -> np.ndarray:
    """The lines (2, channels); zero for a channel without known samples."""
    found = np.zeros((2, values.shape[1]))
    for i, column in enumerate(values.T):
        known = ~np.isnan(column)
        if degree == 0:
            found[0, i] = column[known].mean() if known.any() else 0.0
            continue
        Φ = np.vander(rows[known].astype(float), degree + 1, increasing=True)
        found[: degree + 1, i] = np.linalg.lstsq(Φ, column[known], rcond=None)[0] if known.any() else 0.0
    return found
