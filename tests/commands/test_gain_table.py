"""Several gains in the terminal and on the page, from results made by hand: nothing is run."""

from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

import estimable as es
from estimable.commands import gain_table, gain_text
from estimable.commands.gain_report import write_gain_report
from estimable.commands.gain_summary import gain_summary
from estimable.commands.run_filter import FilterRun
from estimable.results import (
    DetectableLoss,
    Direction,
    Estimate,
    GainAssessment,
    Info,
    Names,
    Origin,
    Outcome,
    Trust,
    Untestable,
)

T, MOTORS = 401, tuple(f"motor_{i}" for i in range(1, 5))
PLANT = es.StateSpace([[0.5]], [[1.0, 1.0, 1.0, 1.0]], Q=[[0.1]], R=[[1.0]], dt=0.05, states=["rate"], inputs=MOTORS,
                      outputs=["rate_rad_s"])  # fmt: skip
ALGORITHM = es.UnknownGain(PLANT, es.Prior(np.ones(4), np.eye(4)), directions="per_input")
PRIOR = es.Prior([0.0], [[1.0]])


def least(start, end, loss, until, intervals=()):
    loss = np.stack([0.8 * np.array(loss), loss], axis=1)
    names = ALGORITHM.names.gains
    return DetectableLoss(start, end, (0.5, 0.9), loss, 0.1 * loss[:, 0], np.array(until), loss, names, intervals)


def run_of(until=(20.0, 20.0, 20.0, 20.0)):
    """Motor 3 loses 28 % at 14.14 s; the verdict names as many entries as it may."""
    rng = np.random.default_rng(0)
    t = 0.05 * np.arange(T)
    gain = np.where((t[:, None] >= 14.14) & (np.arange(4) == 2), 0.72, 1.0)
    alarm, onset, jumped = np.zeros(T, bool), np.full(T, -1), np.zeros((T, 4))
    alarm[290], onset[290], jumped[290, 2] = True, 283, 1.0
    info = Info(
        mean=np.zeros((T, 1)), covariance=np.ones((T, 1, 1)), gain=gain,
        gain_covariance=np.broadcast_to(2.5e-5 * np.eye(4), (T, 4, 4)), innovation=rng.normal(size=(T, 1)),
        innovation_covariance=np.ones((T, 1, 1)),
        extra={"alarm": alarm, "onset": onset, "onset_sigma": np.ones(T), "jumped": jumped},
    )  # fmt: skip
    record = es.Record(np.zeros((T, 1)), np.zeros((T, 4)), t=t, inputs=MOTORS, outputs=["rate_rad_s"])
    names = Names(("rate",), MOTORS, ("rate_rad_s",), ALGORITHM.names.gains)
    result = Estimate(info, t, 0.0, Outcome(0, None, None, ""), "native", names, Origin(ALGORITHM, record, PRIOR))
    hidden = tuple(
        Untestable(Direction(f"B[rate, {one}]", "B", (0, i)), f"gain_{one}", 1.0, 0.1) for i, one in enumerate(MOTORS)
    )
    parts = (least(0.0, 10.0, [0.1, 0.2, 0.3, np.inf], until), least(10.0, 20.0, [0.05] * 4, until))
    loss = least(16.1, 20.0, [0.06, 0.04, 0.05, 0.03], until, parts)
    rows = es.diagnostics.gain_rows(result, detectable=loss)
    notes = ("Q and R are fitted to 0 to 14.1 s.",)
    found = GainAssessment(
        result, ALGORITHM, ALGORITHM, Trust("believe", 0.5, {}, untestable=hidden), loss, None, notes, rows
    )
    here = Path(__file__)
    return FilterRun("mixture", ALGORITHM, PRIOR, record, result, here, here, {}, {}, result, False, found)


def printed(run):
    console = Console(width=80, highlight=False, markup=False, emoji=False)
    with console.capture() as capture:
        for line in gain_text.as_text(run, gain_summary(run.result), console):
            console.print(line)
    return capture.get().splitlines()


@pytest.mark.parametrize("until", [(20.0,) * 4, (20.0, 17.0, 20.0, 17.5)])
def test_the_verdict_the_sentence_and_a_line_for_each_in_twelve_lines_and_one_an_actuator(until):
    lines = printed(run_of(until))
    assert len(lines) <= 12 + 4
    assert all(len(line) <= 80 for line in lines)
    words = " ".join(" ".join(lines).split())
    assert words.startswith(
        "Believe, if 4 entries such as B[rate, motor_1] are right: the record agrees. "
        "motor 3 lost 28.0 % ± 1.0 % at 14.15 s; motors 1, 2, 4 unchanged. "
        "A loss of 0.06 of any other gain that began at 16.1 s would have been detected by 20 s with probability 90 %."
    )
    assert ("After 17 s the input carries no information about motor 2, motor 4." in words) == (until[1] < 20)
    [row] = [line for line in lines if line.startswith("motor 3 ") and "lost 28" not in line]
    assert " ".join(row.split()) == "motor 3 1.000 ± 0.010 0.720 ± 0.010 28.0 % ± 1.0 % 14.15 s lost"


def test_json_has_the_sentence_the_rows_and_the_intervals():
    run = run_of()
    said = gain_text.as_data(run, gain_summary(run.result))
    assert said["finding"] == "motor 3 lost 28.0 % ± 1.0 % at 14.15 s; motors 1, 2, 4 unchanged."
    assert [row["verdict"] for row in said["rows"]] == ["unchanged", "unchanged", "lost", "unchanged"]
    assert said["rows"][2]["phrase"] == "lost 28.0 % ± 1.0 % at 14.15 s"
    assert [one["loss"]["gain_motor_2"] for one in said["detectable_loss"]["intervals"]] == [0.2, 0.05]


def test_the_losses_of_each_interval_are_a_table():
    run = run_of()
    console = Console(width=80, highlight=False, markup=False)
    with console.capture() as capture:
        for line in gain_text.detectable(run):
            console.print(line)
    *_, heading, first, second = capture.get().splitlines()
    assert " ".join(heading.split()) == "interval [s] motor 1 motor 2 motor 3 motor 4"
    assert " ".join(first.split()) == "0 to 10 0.1 0.2 0.3 -"
    assert " ".join(second.split()) == "10 to 20 0.05 0.05 0.05 0.05"


def test_a_loss_that_no_input_would_show_is_said():
    run = run_of()
    assert run.assessment is not None
    loss = least(16.1, 20.0, [0.06, np.inf, 0.05, 0.03], [20.0] * 4)
    assert gain_table.shown(loss, run.assessment.rows) == (
        "Not every loss that began at 16.1 s would have been detected by 20 s.",
    )


def test_the_page_has_one_diagram_of_the_gains_a_table_of_them_and_one_of_the_losses(tmp_path):
    run = run_of((17.0,) * 4)
    write_gain_report(run, gain_summary(run.result), tmp_path / "page.html", story=(), command="")
    page = (tmp_path / "page.html").read_text()
    for heading in (
        "Gains ± 2 sigma",
        "Smallest detectable loss",
        "Each gain, with 2 sigma",
        "no information from the input",
    ):
        assert page.count(heading) >= 1
    assert page.count('<th scope="row">motor 3</th>') == 1
    assert '<td data-label="motor 4, 90 %">-</td>' in page
    assert "Q and R are fitted to 0 to 14.1 s." in page
    assert "change of motor 3 at 14.15 s" in page
