"""From the logged commands of actuators to the inputs of a model."""

from typing import Any

import jax
import numpy as np

from .. import checks, forks
from ..annotations import Numbers
from ..frozen import replace
from ..models.actuator import Actuators, by_input
from ..models.chain import Chain, chain
from .record import Record


def through_actuators(record: Record, actuators: Actuators, *, start: Numbers | None = None) -> Record:
    """The same record with the positions of healthy actuators in place of their commands.

    - `record`: its inputs are commands, held from sample to sample. Lost ones count as the record's `lost` says.
    - `actuators`: an `Actuator` for all inputs, or {input: Actuator}; the other inputs do not change.
    - `start` (m,): the inputs before the first command (default None: where the first command holds the actuators).

    Returns a `Record` whose `u[k]` is the mean of each position from t[k] to t[k+1], exactly. For filters that run sample by
    sample, and for inputs that enter y directly, use `Actuated`. Raises `InputError` with every fault of the call, such as
    NaN among the commands.

    >>> record = Record([0.0, 0.0], [1.0, 1.0], dt=0.1, inputs=["valve"])
    >>> through_actuators(record, Actuator(5.0, limits=(0.0, 0.8)), start=[0.0]).u.round(4).ravel().tolist()
    [0.1704, 0.4182]
    """
    faults = checks.Faults()
    faults.instance("record", record, Record)
    faults.finish()
    each = by_input(actuators, record.inputs, "actuators", faults)
    m = record.u.shape[1]
    faults.learn("m", m, f"the record has {checks.counted(m, 'input')}")
    begin = None if start is None else faults.array("start", start, "m")
    if record.hold != "zero_order":
        faults.add('the record\'s hold must be "zero_order": commands are constant from sample to sample.')
    if record.t is None:
        faults.add("the record has no time, and actuators move in time: give it `dt` or `t`, in seconds.")
    commands = record.applied()
    columns = [record.inputs.index(name) for name in each]
    unknown = np.argwhere(np.isnan(commands[:, columns]))
    if len(unknown):
        row, channel = unknown[0]
        faults.add(
            f"the command {record.inputs[columns[channel]]!r} is unknown at u[{row}]: the position of its actuator is then "
            "unknown too. Cut the record there, or use UnknownInput for this input."
        )
    faults.finish()
    clock = record.clock(None)
    lengths = clock.lengths if clock.rows is None else clock.lengths[clock.rows]
    ready = chain(each, record.inputs, begin, clock)
    moved = _mean_positions(ready, commands, np.broadcast_to(lengths, len(record)).astype(float))
    return replace(record, u=np.where(ready.moves > 0, moved, commands), arrived=None)


@forks.jit
def _mean_positions(ready: Chain, commands: np.ndarray, lengths: np.ndarray) -> Any:
    return jax.lax.scan(lambda state, row: ready.step(state, *row), ready.init(), (commands, lengths))[1]
