"""A process that is killed loses nothing that was finished, and the next one continues to the same bits."""

import hashlib

import pytest
from benchmarks.figures import kill


def digest(kind, folder):
    return hashlib.sha256(kill.WORK[kind](folder)).hexdigest()


@pytest.mark.parametrize(("kind", "moment"), [("loops", 0.5), ("save", 0.4), ("compile", 0.3)])
def test_a_killed_process_is_continued_to_the_same_bits(kind, moment, tmp_path, monkeypatch):
    again = digest if kind != "compile" else lambda *work: kill.process(*work).digest
    undisturbed = digest(kind, tmp_path)
    found = kill.killed(kind, iter([moment, moment / 2, moment / 4]).__next__, undisturbed, again)
    assert found.faults == ()
