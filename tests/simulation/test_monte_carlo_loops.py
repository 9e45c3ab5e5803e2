"""Many loops: the same runs wherever they are flown, and none twice."""

import warnings

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import estimable as es
from estimable.simulation import monte_carlo_loops as module

MODEL = es.StateSpace([[0.9]], [[0.5]], Q=[[0.01]], R=[[0.1]], dt=0.5)
START = es.Prior([1.0], [[2.0]])


def case(gain=0.3):
    law = es.StateFeedback([[gain]], reference_gain=[[0.4]])
    return es.LoopCase(MODEL, law, es.Kalman(MODEL), reference=np.ones(23), prior=START)


CASES = es.loop_grid(case, gain=[0.3, 0.6])


def last(closed):
    return {"state": closed.state[-1, 0], "mean": closed.mean[:2, 0]}


def fly(cases=CASES, **given):
    return es.monte_carlo_loops(cases, **{"runs": 7, "seed": 3, "summary": last, **given})


def values(found):
    return {name: one.values for name, one in found.items()}


def assert_same(found, other):
    for name in found:
        for key in ("state", "mean"):
            assert_array_equal(found[name].values[key], other[name].values[key])


def test_a_run_is_that_of_close_loop_whatever_the_parts_and_the_number():
    found = fly()
    assert list(found) == ["gain=0.3", "gain=0.6"]
    assert found["gain=0.3"].values["mean"].shape == (7, 2)
    assert_same(fly(chunk=3), found)
    few = fly(runs=4)
    assert_array_equal(few["gain=0.6"].values["state"], found["gain=0.6"].values["state"][:4])
    one = CASES["gain=0.6"]
    closed = es.close_loop_bank(
        MODEL, one.controller, one.estimator, reference=np.ones(23), prior=START, seed=3, runs=7
    )
    assert_array_equal(found["gain=0.6"].values["state"], closed.runs.state[:, -1, 0])
    assert_array_equal(fly(one)[""].values["state"], found["gain=0.6"].values["state"])


def test_what_was_stopped_goes_on_where_it_was(tmp_path, monkeypatch):
    flown, fly_part = [], module.fly_part

    def watched(case, seed, first, *rest):
        if first == 6 and len(flown) < 3:
            raise KeyboardInterrupt
        flown.append(first)
        return fly_part(case, seed, first, *rest)

    monkeypatch.setattr(module, "fly_part", watched)
    with pytest.raises(KeyboardInterrupt):
        fly(folder=tmp_path, chunk=3)
    assert flown == [0, 3]
    flown.append("again")
    found = fly(folder=tmp_path, chunk=3)
    assert flown == [0, 3, "again", 6, 0, 3, 6]
    assert_same(found, fly())
    before = len(flown)
    next(iter(tmp_path.glob("*-0-3.npz"))).write_bytes(b"torn")
    assert_same(fly(folder=tmp_path, chunk=3), found)
    assert flown[before:] == [0]  # the torn one
    fly(folder=tmp_path, chunk=3, seed=4)
    fly(folder=tmp_path, chunk=3, summary=lambda closed: {"state": closed.state[-2, 0]})
    assert len(flown) == before + 13  # other seeds and summaries are other computations


@pytest.mark.parametrize("damage", [
    lambda file, other: file.write_bytes(b""),
    lambda file, other: file.write_bytes(file.read_bytes()[:-40]),
    lambda file, other: file.write_bytes(file.read_bytes()[: len(file.read_bytes()) // 2]),
    lambda file, other: file.write_bytes(b"PK\x03\x04" + bytes(99)),
    lambda file, other: file.write_bytes(other.read_bytes()),
    lambda file, other: np.savez(file, failed=np.zeros(3, bool)),
    lambda file, other: (file.unlink(), file.mkdir()),
], ids=["empty", "torn", "half", "garbage", "another's", "foreign", "folder"])  # fmt: skip
def test_a_part_that_is_damaged_is_flown_again_with_a_warning(damage, tmp_path, caplog):
    found = fly(folder=tmp_path, chunk=3)
    file, other, *_ = sorted(tmp_path.glob("*-0-3.npz"))
    damage(file, other)
    if file.is_dir():
        with pytest.raises(es.InputError, match="could not be written: it is a folder"):
            fly(folder=tmp_path, chunk=3)
    else:
        assert_same(fly(folder=tmp_path, chunk=3), found)
    assert [record.getMessage() for record in caplog.records if record.name == "estimable.simulation"] == [
        f"{file} is damaged, or of another computation: its runs are computed again."
    ]
    caplog.clear()
    if not file.is_dir():
        assert_same(fly(folder=tmp_path, chunk=3), found)
        assert not [record for record in caplog.records if record.name == "estimable.simulation"]


def test_a_changed_summary_is_computed_again(tmp_path):
    scale = 1.0

    def summary(closed):
        return {"state": scale * closed.state[-1, 0]}

    first = fly(folder=tmp_path, summary=summary)
    scale = 2.0
    second = fly(folder=tmp_path, summary=summary)
    assert_array_equal(second["gain=0.3"].values["state"], 2 * first["gain=0.3"].values["state"])


def test_a_cluster_flies_the_same_runs():
    distributed = pytest.importorskip("distributed", reason="needs dask[distributed]")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its own, of sockets and ports
        with distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, protocol="tcp://", dashboard_address=None
        ) as cluster:
            found = fly(scheduler=cluster.scheduler_address, chunk=4)
    assert_same(found, fly())


def test_a_scheduler_that_is_not_there_is_one_sentence(monkeypatch):
    pytest.importorskip("distributed", reason="needs dask[distributed]")
    monkeypatch.setattr("estimable.simulation.cluster.PATIENCE", 0.2)
    with pytest.raises(es.InputError, match=r"no Dask scheduler answers at 'tcp://127\.0\.0\.1:1'"):
        fly(scheduler="tcp://127.0.0.1:1")


def test_runs_that_fail_are_named_or_kept():
    exact = es.StateSpace([[0.9]], [[0.5]], Q=[[0.0]], R=[[0.0]], dt=0.5)
    noisy = es.StateSpace([[0.9]], [[0.5]], Q=[[0.0]], R=[[0.1]], dt=0.5)
    bad = es.LoopCase(noisy, es.StateFeedback([[0.3]]), es.Kalman(exact), reference=np.ones((4, 0)),
                      prior=es.Prior([0.0], [[0.0]]))  # fmt: skip
    with pytest.raises(es.RunError, match="Run 0 of bad: At sample 0"):
        fly({"bad": bad})
    assert fly({"bad": bad}, on_failure="keep")["bad"].failed.all()


@pytest.mark.parametrize(("given", "sentence"), [
    ({"cases": 3}, "`cases` must be a LoopCase"),
    ({"cases": {}}, "`cases` must be a LoopCase"),
    ({"summary": 3}, "`summary` must be a function of a ClosedLoop"),
    ({"runs": 0}, "`runs` must be an integer"),
    ({"chunk": 0}, "`chunk` must be an integer"),
    ({"scheduler": 8786}, "`scheduler` must be an address"),
    ({"on_failure": "stop"}, "`on_failure` must be one of"),
    ({"summary": lambda closed: 1.0}, r"`summary` must return \{name: number or array\}"),
    ({"version": 1}, "`version` must be a text"),
    ({"folder": "/dev/null/x"}, "`folder` must be a writable folder"),
])  # fmt: skip
def test_a_wrong_call_is_refused_in_one_sentence(given, sentence):
    with pytest.raises(es.InputError, match=sentence):
        fly(**given)
