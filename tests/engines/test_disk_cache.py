"""What one process leaves for the next is found under a name made of all that it depends on, and under no other."""

from dataclasses import dataclass
from functools import partial

import jax
import numpy as np
import pytest

from estimable import ExtendedKalman, Kalman, NonlinearModel, Prior, Record, StateSpace, UnknownGain, estimate
from estimable.engines import disk_cache, lowering
from estimable.engines.program.primitives import UnsupportedError
from estimable.estimation.binding import select
from estimable.estimation.windows import Replayed
from estimable.results import Interval, Sample

MODEL = StateSpace([[0.5]], [[1.0]], C=[[1.0]], R=[[1.0]], dt=1)


def structure(algorithm):
    return jax.tree_util.tree_structure(algorithm)


def test_a_name_tells_apart_what_differs():
    prior = Prior([1.0], [[1.0]])
    parts = [structure(Kalman(MODEL)), structure(UnknownGain(MODEL, prior)), structure(StateSpace([[0.5]], R=[[1.0]], dt=1)),
             1, 1.0, True, "1", None, (1, "a"), (1, "a", 2), ("1, 'a'",), ((1,), "a"), select, Kalman]  # fmt: skip
    names = [disk_cache.name_of(part) for part in parts]
    assert len(set(names)) == len(names)
    assert disk_cache.name_of(structure(Kalman(MODEL))) == names[0]


@dataclass(frozen=True)
class Foreign:
    """Not of this package: its source may be another tomorrow."""

    number: int = 1


@pytest.mark.parametrize(
    "part",
    [lambda x: x, np.sin, Foreign(), partial(select, keep="all"), Replayed(1).at, {"a": 1}, {1}],
    ids=lambda part: type(part).__name__,
)
def test_what_has_no_name_beyond_this_process_gets_none(part):
    with pytest.raises(disk_cache.UnnamedError):
        disk_cache.name_of(part)


def test_a_model_with_a_function_of_the_user_gets_no_name():
    model = NonlinearModel(lambda x, u, θ: x, lambda x, u, θ: x, Q=[[1.0]], R=[[1.0]], dt=1)
    with pytest.raises(disk_cache.UnnamedError):
        disk_cache.name_of(structure(ExtendedKalman(model)))


def test_a_step_is_written_out_once_for_all_processes(tmp_path, monkeypatch):
    monkeypatch.setenv("ESTIMABLE_CACHE", str(tmp_path))
    record, prior = Record([1.0, 2.0], u=[0.0, 1.0], dt=1), Prior([0.0], [[1.0]])

    def run():
        lowering.write_shapes.cache_clear()  # as in a new process
        return estimate(Kalman(MODEL), record, prior=prior, engine="native", keep="last").log_likelihood

    first, (file,) = run(), tmp_path.glob("*.json")
    with monkeypatch.context() as m:
        m.setattr(jax, "make_jaxpr", None)  # nothing is traced
        assert run() == first
    file.write_bytes(file.read_bytes()[:-1])
    assert run() == first  # damaged: made again


def test_why_a_step_cannot_be_written_out_is_kept_too(tmp_path, monkeypatch):
    monkeypatch.setenv("ESTIMABLE_CACHE", str(tmp_path))
    reasons = [disk_cache.once(lowering.attempt, *arguments) for arguments in 2 * [_too_large()]]
    assert all(isinstance(reason, UnsupportedError) for reason in reasons)
    assert str(reasons[0]) == str(reasons[1]) != ""
    assert len(list(tmp_path.glob("*.json"))) == 1


def _too_large():
    """What `write` asks for of a model with many states."""
    algorithm = Kalman(StateSpace(0.9 * np.eye(40), R=np.eye(40), dt=1))
    ready = algorithm.sampled(Record(np.zeros((3, 40)), dt=1).clock(1.0))
    sample = Sample(np.zeros(40), np.ones(40, bool), np.zeros(0), None)
    interval = Interval(np.zeros(0), np.zeros(0), None, np.zeros(()))
    leaves, tree = jax.tree_util.tree_flatten((ready, Prior(np.zeros(40), np.eye(40)), sample, interval))
    return tree, tuple((np.shape(x), np.asarray(x).dtype.str) for x in leaves), "all", select, ()
