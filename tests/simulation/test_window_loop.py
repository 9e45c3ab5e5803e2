"""Windows in blocks inside a loop say what windows worked out copy by copy say."""

import jax
import numpy as np
import pytest
from numpy.testing import assert_allclose

import estimable as es
from estimable.engines import choice
from estimable.simulation import window_loop

MODEL = es.StateSpace([[0.9]], [[0.5]], Q=[[0.01]], R=[[0.1]], dt=0.5)
LAW = es.StateFeedback([[0.3]], reference_gain=[[0.4]])
PRIOR = es.Prior([1.0], [[2.0]])
GAIN = es.UnknownGain(MODEL, es.Prior([1.0], [[0.5]]), walk=0.01)
ESTIMATORS = {
    "state": es.MovingWindow(es.Kalman(MODEL), 4),
    "chain": es.Smoothed(es.Bounded(es.MovingWindow(GAIN, 5), 0, 1), 0.5),
}


def run(estimator, T=23, runs=3, **given):
    law = es.GainReconfiguration(LAW) if estimator.names.gains else LAW
    return es.close_loop_bank(
        es.ControlledPlant(MODEL, events=[es.Failure(5.0, 0.5)]), law, estimator, reference=np.sin(np.arange(T)), seed=2,
        runs=runs, prior=PRIOR, **given,
    )  # fmt: skip


@pytest.fixture
def copied(monkeypatch):
    """How many loops were given back, to be worked out copy by copy."""
    sizes, in_blocks = [], window_loop._in_blocks

    def watched(*arguments):
        run = in_blocks(*arguments)
        sizes.append(int(run.info[1].any(axis=1).sum()))
        return run

    monkeypatch.setattr(window_loop, "_in_blocks", watched)
    return sizes


@pytest.mark.parametrize(("name", "arrival"), [("chain", 0.4), ("state", None)])
def test_blocks_and_copies_agree(name, arrival, copied):
    given = {} if arrival is None else {"output_link": es.BernoulliLink(arrival)}
    blocks, copies = (run(ESTIMATORS[name], engine=engine, **given) for engine in ("auto", "xla"))
    assert (copied[0] > 0) == (arrival is not None)
    for one, other in zip(*map(jax.tree_util.tree_leaves, (blocks.runs, copies.runs)), strict=True):
        assert_allclose(one, other, rtol=1e-10, atol=1e-11)


def test_one_sample_fills_no_window(copied):
    blocks, copies = (run(ESTIMATORS["state"], 1, engine=engine) for engine in ("auto", "xla"))
    assert copied == [0]
    assert_allclose(blocks.runs.info.mean, copies.runs.info.mean, rtol=1e-12)


@pytest.mark.engine_fails
def test_blocks_that_fail_are_worked_out_copy_by_copy(monkeypatch, caplog):
    expected = run(ESTIMATORS["state"])

    def fail(*_):
        raise KeyError("mul")

    monkeypatch.setattr(window_loop, "_in_blocks", fail)
    monkeypatch.setattr(choice, "_said", set())
    copies = run(ESTIMATORS["state"])
    assert_allclose(copies.runs.info.mean, expected.runs.info.mean, rtol=1e-10, atol=1e-11)
    assert [record.levelname for record in caplog.records if record.name == "estimable.engines"] == ["WARNING"]
