"""The benchmarks: every contender gives the numbers of the exact loop, and the page says what was measured."""

import os

import jax
import numpy as np
import pytest
from benchmarks import __main__ as command
from benchmarks import filtering, handwritten, likelihoods, peers, plain_jax, report, smoothers
from benchmarks.common import problem, recorded, row, textbook

MODEL, PRIOR = problem(4, 2)
RECORDS = {missing: recorded(MODEL, PRIOR, 20, missing).y for missing in (0.0, 0.3)}
EXACT = {missing: textbook(MODEL, PRIOR, y) for missing, y in RECORDS.items()}
needs_compiler = pytest.mark.skipif(
    handwritten.library("handwritten.c") is None, reason="there is no C compiler on this machine"
)


def theirs(test):
    """The strictness of these tests, about promotion and warnings, is ours alone."""
    return pytest.mark.usefixtures("lenient")(pytest.mark.filterwarnings("ignore")(test))


@pytest.fixture
def lenient():
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        yield


def agrees(run, missing):
    if isinstance(run, str):
        pytest.skip(run)
    means, total = run()
    np.testing.assert_allclose(means, EXACT[missing][0], atol=1e-8)
    assert total is None or total == pytest.approx(EXACT[missing][1], rel=1e-9)


@theirs
@pytest.mark.parametrize("missing", RECORDS)
@pytest.mark.parametrize("keep", ["all", "means"])
@pytest.mark.parametrize("name", filtering.LIBRARIES)
def test_a_library_filters_the_record_as_the_loop_does(name, keep, missing):
    agrees(filtering.LIBRARIES[name](MODEL, PRIOR, RECORDS[missing], keep), missing)


@theirs
def test_a_library_steps_as_the_loop_does():
    agrees(peers.kalman_py_online(MODEL, PRIOR, RECORDS[0.0], "means"), 0.0)


@theirs
@pytest.mark.parametrize("missing", RECORDS)
@pytest.mark.parametrize("keep", ["all", "means"])
def test_the_plain_scan_filters_the_record_as_the_loop_does(keep, missing):
    agrees(plain_jax.contender(MODEL, PRIOR, RECORDS[missing], keep), missing)


@theirs
def test_large_models_run_with_channels_missing():
    rows = list(filtering.large("W13", 12, 3, 20, "all", 0.3))
    assert [each["contender"] for each in rows[:2]] == ["estimable native", "estimable xla"]
    assert "plain lax.scan, masked Joseph" in [each["contender"] for each in rows]
    for each in rows:
        assert each["absent"] or each["error"] < 1e-8, each["contender"]


@theirs
@pytest.mark.parametrize("missing", [0.0, 0.3])
def test_every_smoother_gives_the_same(missing):
    rows = list(smoothers.smoothers("W15", 60, missing))
    assert {"estimable native", "estimable xla"} <= {each["contender"] for each in rows if each["error"] is not None}
    for each in rows:
        assert each["error"] is None or each["error"] < 1e-8, each["contender"]
    assert not any(each["absent"] for each in smoothers.nonlinear_smoothers("W15", 60, missing))


@pytest.mark.parametrize("missing", [0.0, 0.3])
def test_every_way_to_a_score_gives_the_same(missing):
    for each in likelihoods.score("W12", 60, missing):
        assert each["absent"] or each["log_likelihood_error"] < 1e-12, each["contender"]
        assert not each["error"] or each["error"] < 1e-10, each["contender"]


@theirs
def test_every_search_for_noises_ends_at_one_maximum():
    for each in likelihoods.fitted("W14", 200):
        assert each["absent"] or each["log_likelihood_error"] < 1e-5, each["contender"]


@needs_compiler
@pytest.mark.parametrize("missing", RECORDS)
@pytest.mark.parametrize("form", ["kalman", "kalman_ud"])
def test_the_hand_written_record_is_that_of_the_loop(form, missing):
    agrees(handwritten.contender(MODEL, PRIOR, RECORDS[missing], form), missing)


def a_bank(runs, missing):
    """Different models, more than one group of lanes and not a multiple of them: matrices, records, likelihoods."""
    models = [problem(4, 2, seed)[0] for seed in range(runs)]
    y = np.stack([recorded(MODEL, PRIOR, 12, missing).y + i for i in range(runs)])
    totals = np.array([textbook(model, PRIOR, each)[1] for model, each in zip(models, y, strict=True)])
    return [np.stack([getattr(model, letter) for model in models]) for letter in "ACQR"], y, totals


@needs_compiler
@pytest.mark.parametrize("missing", [0.0, 0.3])
@pytest.mark.parametrize("runs", [1, 19])
@pytest.mark.parametrize("threads", [1, 2])
def test_the_hand_written_bank_is_that_of_the_loop(threads, runs, missing):
    matrices, y, totals = a_bank(runs, missing)
    np.testing.assert_allclose(handwritten.bank(threads, *matrices, PRIOR, y)(), totals, rtol=1e-12)


@theirs
@pytest.mark.parametrize("name", filtering.BANKS)
def test_a_library_filters_the_bank_as_the_loop_does(name):
    matrices, y, totals = a_bank(3, 0.0)
    run = filtering.BANKS[name](*matrices, PRIOR, y)
    if isinstance(run, str):
        pytest.skip(run)
    np.testing.assert_allclose(run(), totals, rtol=1e-8)


def test_a_library_that_is_not_there_is_absent():
    @peers.library
    def nowhere(model):
        import nowhere_to_be_found  # noqa: F401

    @peers.library
    def outdated(model):
        from numpy import no_longer_there  # noqa: F401

    assert nowhere(MODEL) == "not installed"
    assert outdated(MODEL).startswith("cannot be imported: cannot import name 'no_longer_there'")
    told = filtering.compared("W", "nowhere", nowhere(MODEL), None, 1, "library")
    assert told["absent"] == "not installed"
    assert told["seconds"] is None


ROWS = [
    row("W1", "estimable", 2.0, 3.0, 1e-15, 0.0),
    row("W1", "slow", 50.0, whose="library"),
    row("W1", "fast", 5.0, whose="library"),
    row("W1", "none", absent="not installed", whose="library"),
    row("W1", "C", 1.0, whose="by hand"),
    row("W2", "estimable", 1.0),
    row("W3", "estimable", absent="too large"),
    row("W3", "other", 1.0, whose="library"),
]


def test_the_summary_names_the_fastest_of_each_kind():
    lines = report.summary(ROWS).splitlines()
    assert lines[2:] == ["| W1 | 2 | fast | 2.5 | C | 0.5 |"]  # W2 ran alone, and W3 without ours


def test_the_table_has_every_row_and_ratios_to_the_first_that_ran():
    lines = report.table(ROWS).splitlines()
    assert len(lines) == 2 + len(ROWS)
    assert lines[2] == "| W1 | estimable | 2 | 1.00 | 3 | 1e-15 | 0 |"
    assert lines[3] == "| W1 | slow | 50 | 25.00 |  |  |  |"
    assert lines[5] == "| W1 | none | absent: not installed |  |  |  |  |"
    assert lines[9] == "| W3 | other | 1 | 1.00 |  |  |  |"


def test_the_page_says_how_it_was_made():
    page = report.page(ROWS, "--quick --markdown")
    assert "`python -m benchmarks --quick --markdown`" in page
    assert f"{os.cpu_count()} processors" in page
    assert report.summary(ROWS) in page
    assert report.table(ROWS) in page


def test_workloads_are_chosen_by_their_names():
    names = [each[1].split()[0] for each in command.chosen(command.workloads(quick=True), "W1, W9")]
    assert names == ["W1", "W9"]  # and not W10
    everything = [each[1].split()[0] for each in command.chosen(command.workloads(quick=False), "")]
    assert set(everything) == {f"W{i}" for i in (*range(1, 16), 17)}


@pytest.mark.parametrize(
    ("arguments", "told"), [("--only W1 --markdown", "leave out --only"), ("--only W1,W99", "--only knows W1, W2")]
)
def test_what_makes_no_page_is_refused(arguments, told, capsys):
    with pytest.raises(SystemExit):
        command.main(arguments.split())
    assert told in capsys.readouterr().err


def test_what_was_measured_is_printed_and_what_has_run_is_told(monkeypatch, capsys):
    monkeypatch.setattr(
        command, "workloads", lambda quick: [(lambda name: [row(name, "estimable", 1.0)], "W0 nothing")]
    )
    command.main(["--json"])
    printed = capsys.readouterr()
    assert '"contender": "estimable"' in printed.out
    assert "W0 nothing: estimable" in printed.err
