"""A few hundred wrong calls and command lines: each ends with an answer or a sentence."""

import pytest

from estimable import checks
from fuzz import calls, command_line
from fuzz.baselines import Baseline, baselines

EACH = 8  # command lines of each command


def test_wrong_calls_end_with_a_sentence():
    found = baselines()
    assert len(found) > 300
    by_name = {one.name: one for one in found}  # one right call for each name
    faults = {}
    for seed in (0,):
        for name, one in by_name.items():
            outcome = calls.run(one, seed)
            if outcome.is_fault:
                faults[f"{name} seed {seed}"] = outcome
    assert not faults


@pytest.mark.parametrize("command", command_line.commands())
def test_wrong_command_lines_end_with_a_sentence(command):
    faults = {}
    for seed in range(EACH):
        outcome = command_line.run(command, seed)
        if outcome.is_fault:
            faults[seed] = outcome
    assert not faults


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
