"""What a record says about its rows: breaks, date of t = 0, grid, sources, notes."""

from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pandas as pd
import pytest

import estimable as es

NOON = datetime(2026, 3, 2, 12, tzinfo=UTC)
FACTS = {
    "breaks": [3, 7], "origin": NOON, "grid": 0.1, "sources": {"y1": "imu/gx"}, "notes": ["the time is in us"],
}  # fmt: skip


def record(**given):
    return es.Record(np.arange(10.0), np.zeros(10), dt=0.1, **(FACTS | given))


def test_facts_are_read_and_ordered():
    found = record(breaks=np.array([7, 3, 7]), origin=pd.Timestamp(NOON))
    assert (found.breaks, found.grid, found.sources) == ((3, 7), 0.1, (("y1", "imu/gx"),))
    assert (type(found.origin), found.origin, found.notes) == (datetime, NOON, ("the time is in us",))


def test_facts_are_saved_and_loaded(same, tmp_path):
    for origin in (NOON, datetime(2026, 3, 2, 12, 0, 0, 250), NOON.astimezone(timezone(timedelta(hours=2)))):
        whole = record(origin=origin)
        es.save(tmp_path / "record.npz", whole)
        found = es.load(tmp_path / "record.npz")
        same(found, whole)
        assert (found.notes, found.origin.utcoffset()) == (whole.notes, origin.utcoffset())


@pytest.mark.parametrize(("rows", "breaks"), [
    (slice(0, 10), (3, 7)), (slice(3, 10), (4,)), (slice(2, 7), (1,)), (slice(4, 6), ()), (slice(6, 8), (1,)),
])  # fmt: skip
def test_a_cut_keeps_the_breaks_inside_it(rows, breaks):
    assert record()[rows].breaks == breaks


def test_the_parts_of_a_record_are_cut_at_its_breaks():
    parts = record().parts
    assert [part.y[0, 0] for part in parts] == [0.0, 3.0, 7.0]
    assert sum(map(len, parts)) == 10
    assert all(part.breaks == () for part in parts)


def test_breaks_follow_rows_that_are_merged():
    y = np.array([[1.0, np.nan], [np.nan, 1.0], [2.0, np.nan], [np.nan, 2.0]])
    assert es.Record(y, t=[0.0, 0.0, 1.0, 1.0], breaks=[2]).breaks == (1,)
    assert es.Record(y, t=[0.0, 0.0, 1.0, 1.0], breaks=[1]).breaks == ()


def test_records_of_two_days_can_be_stacked():
    both = es.stack([record(), record(origin=None, notes=["another file"])])
    assert len(both) == 2


REFUSED = {
    "beyond": ({"breaks": [10]}, "`breaks` must be rows after the first and before the end, 1 to 9. Got 10."),
    "first": ({"breaks": [0]}, "`breaks` must be rows after the first and before the end, 1 to 9. Got 0."),
    "mask": ({"breaks": [True]}, "`breaks` must be a list of rows, as in [120, 455]. Got [True]."),
    "number": ({"breaks": 3}, "`breaks` must be a list of rows, as in [120, 455]. Got 3."),
    "origin": (
        {"origin": "2026-03-02"},
        "`origin` must be the date of t = 0, as in datetime(2026, 1, 31, 12, tzinfo=timezone.utc). Got '2026-03-02'.",
    ),
    "grid": ({"grid": 0}, "`grid` must be greater than 0 seconds. Got 0."),
    "sources": (
        {"sources": {"y2": "imu/gx"}},
        "`sources` names channels that the record does not have: 'y2'.",
    ),
    "notes": ({"notes": "text"}, "`notes` must be a list of sentences. Got 'text'."),
}


@pytest.mark.parametrize(("given", "sentence"), REFUSED.values(), ids=REFUSED)
def test_a_wrong_fact_is_refused(given, sentence):
    with pytest.raises(es.InputError) as raised:
        record(**given)
    assert str(raised.value) == sentence
