"""A few hundred wrong calls and command lines: each ends with an answer or a sentence."""

import numpy as np
import pytest

import estimable as es
from estimable import checks
from estimable.frozen import replace
from fuzz import calls, command_line
from fuzz.baselines import Baseline, baselines
from fuzz.second_way import same, second_ways

EACH = 4  # command lines of each command; `python -m tests.fuzz` runs more


def test_wrong_calls_end_with_a_sentence():
    found = baselines()
    assert len(found) > 300
    by_name = {one.name: one for one in found}  # one right call for each name
    faults = {}
    for seed in (0,):
        for i, (name, one) in enumerate(by_name.items()):
            outcome = calls.run(one, seed, check=i % 4 == 0)  # `python -m tests.fuzz` checks every answer
            if outcome.is_fault:
                faults[f"{name} seed {seed}"] = outcome
    assert not faults


@pytest.mark.parametrize("command", command_line.commands())
def test_wrong_command_lines_end_with_a_sentence(command):
    faults = {}
    for seed in range(EACH):
        outcome = command_line.run(command, seed, check=seed == 0)
        if outcome.is_fault:
            faults[seed] = outcome
    assert not faults


MODEL = es.StateSpace([[0.9, 0.1], [0.0, 0.8]], C=np.eye(2), Q=0.1 * np.eye(2), R=np.eye(2), dt=1)
GIVEN = {"algorithm": es.Kalman(MODEL), "record": es.Record(np.sin(np.arange(40.0).reshape(20, 2)), dt=1),
         "prior": es.Prior([0.0, 0.0], np.eye(2))}  # fmt: skip


def tampered(result, name, change):
    value = getattr(result.info, name).copy()
    value[-1] += change
    return replace(result, info=replace(result.info, **{name: value}))


@pytest.mark.parametrize(("name", "change", "ways"), [
    ("mean", 1e-6, {"by_the_other_engine", "sample_by_sample", "in_another_order"}),
    ("covariance", 1e-6 * np.eye(2), {"by_the_other_engine", "sample_by_sample", "in_another_order"}),
    ("covariance", np.array([[0.0, 1e-6], [0.0, 0.0]]), {"sound", "by_the_other_engine"}),
    ("covariance", -np.eye(2), {"sound", "by_the_other_engine"}),
    ("mean", np.nan, {"sound", "by_the_other_engine"}),
    ("mean", 0.0, set()),
])  # fmt: skip
def test_a_second_way_finds_a_wrong_answer(name, change, ways):
    result = tampered(es.estimate(**GIVEN), name, change)
    used, faults = second_ways("estimate", es.estimate, GIVEN, result)
    assert {"sound", "by_the_other_engine", "sample_by_sample", "in_another_order"} <= set(used)
    assert ways <= {fault.split(":")[0] for fault in faults}
    assert bool(ways) == bool(faults)


def test_a_record_that_holds_other_numbers_is_found():
    prior = es.Prior([1.0, 2.0], np.eye(2))
    given = {"mean": [2.0, 1.0], "covariance": np.eye(2)}
    assert second_ways("Prior", es.Prior, given, prior)[1] == [
        "as_given: mean holds (2,) numbers that are not those of (2,)"
    ]
    assert same(prior, replace(prior)) == []
    assert same(prior, replace(prior, mean=np.array([1.0, 2.0 + 1e-15]))) == [".mean has changed"]


def sleep():
    while True:
        pass


@pytest.mark.parametrize(
    ("function", "kind"),
    [
        (lambda: 1, "answer"),
        (lambda: checks.refuse("no"), "refused"),
        (lambda: checks.refuse("x" * 700), "long"),
        (lambda: [].append(), "raw"),
        (lambda: sleep(), "hang"),
    ],
)
def test_every_kind_of_fault_is_found(function, kind, monkeypatch):
    monkeypatch.setattr(calls, "SECONDS", 0.2)
    outcome = calls.called(Baseline("", function, {}, ()), {})
    assert outcome.kind == kind
    assert outcome.is_fault == (kind not in ("answer", "refused"))
