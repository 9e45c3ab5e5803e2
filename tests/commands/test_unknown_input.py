"""`estimable estimate --filter unknown-input`."""

import numpy as np
import pandas as pd
import pytest

from estimable import UnknownInput, estimate, read_model, read_record

CALL = ("estimate", "flight.csv", "--model", "model.toml", "--filter", "unknown-input", "--hold", "zero_order")


def directly(**settings):
    file = read_model("model.toml")
    record = read_record("flight.csv", outputs=file.model.outputs, inputs=(), time="time_s")
    return estimate(UnknownInput(file.model, unknown=["elevator_deg"], **settings), record, prior=file.prior)


def test_the_unknown_input_is_named_on_the_command_line(run):
    said, result = run(*CALL, "--unknown", "elevator_deg", "--json").json, directly()
    assert said["unknown_input"] == pytest.approx({"elevator_deg": result.unknown_input[-1, 0]}, rel=1e-9)
    sigma = result.unknown_input_covariance[-1, 0, 0] ** 0.5
    assert said["unknown_input_sigma"] == pytest.approx({"elevator_deg": sigma}, rel=1e-9)
    assert said["unknown_input_delay"] == 1
    assert "Gillijns & De Moor (2007a)" in said["note"]
    assert said["nis"]["degrees"] == 19 + 1  # one of two outputs is spent on the input, but for the first sample


def test_or_in_the_model_file_with_settings(run, change_model):
    run("--version")
    change_model("[unknown]\ninputs = []", '[unknown]\ninputs = ["elevator_deg"]')
    said, result = run(*CALL, "--set", "walk=4.0", "--json").json, directly(walk=4.0)
    assert said["unknown_input"] == pytest.approx({"elevator_deg": result.unknown_input[-1, 0]}, rel=1e-9)
    assert said["unknown_input_delay"] == 0


def test_people_read_which_input_it_is_and_the_table_puts_it_in_its_row(run, tmp_path):
    answer = run(*CALL, "--unknown", "elevator_deg", "--out", "table.csv", width=100)
    assert answer.code == 0
    assert "elevator_deg, 1 sample earlier" in answer.stdout
    table, result = pd.read_csv(tmp_path / "table.csv"), directly()
    assert np.isnan(table["elevator_deg"].iloc[-1])
    assert table["elevator_deg"].iloc[:-1].tolist() == pytest.approx(result.unknown_input[1:, 0].tolist(), rel=1e-9)


def test_without_a_name_it_asks_for_one(run):
    answer = run(*CALL)
    assert answer.code == 2
    assert "no unknown input is named" in answer.stderr
    wrong = run(*CALL, "--unknown", "elevator")
    assert wrong.code == 2
    assert "'elevator'" in wrong.stderr
    assert "Did you mean 'elevator_deg'?" in wrong.stderr
