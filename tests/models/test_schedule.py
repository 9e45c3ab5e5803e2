"""Matrices that follow a channel: tables, functions, and the sentences on wrong ones."""

import jax
import numpy as np
import pytest

import estimable as es

TABLE = {"at": [100.0, 150.0, 250.0], "A": [[[0.9]], [[0.8]], [[0.4]]], "R": [[[1.0]], [[2.0]], [[4.0]]]}


def scheduled(schedule, **more):
    """A model of one state whose matrices follow the airspeed."""
    return es.StateSpace([[0.9]], [[1.0]], Q=[[0.1]], R=[[1.0]], dt=1, schedule={"airspeed": schedule}, **more)


def test_a_table_is_interpolated_linearly():
    model = scheduled(TABLE).along({"airspeed": [100.0, 125.0, 200.0, 250.0]})
    assert np.allclose(model.A.ravel(), [0.9, 0.85, 0.6, 0.4], rtol=1e-15)
    assert np.allclose(model.R.ravel(), [1.0, 1.5, 3.0, 4.0], rtol=1e-15)
    assert model.varying == ("A", "R")
    assert model.schedule is None


def test_a_function_gives_what_its_table_gives():
    model = scheduled(lambda speed: {"A": [[1 - speed / 1000]]})
    assert np.array_equal(model.along({"airspeed": [100.0, 300.0, 100.0]}).A.ravel(), [0.9, 0.7, 0.9])
    at_one = model.along({"airspeed": 200.0})
    assert at_one.A.tolist() == [[0.8]]
    assert at_one.varying == ()


def test_two_channels_give_different_matrices():
    both = {"airspeed": TABLE, "level": lambda h: {"C": [[h]]}}
    model = es.StateSpace([[0.9]], [[1.0]], Q=[[0.1]], R=[[1.0]], dt=1, schedule=both)
    along = model.along({"airspeed": [100.0, 150.0], "level": [1.0, 2.0]})
    assert along.A.ravel().tolist() == [0.9, 0.8]
    assert along.C.ravel().tolist() == [1.0, 2.0]
    assert model.scheduled_by == ("airspeed", "level")


def test_the_matrices_of_a_table_are_leaves():
    leaves = [np.shape(leaf) for leaf in jax.tree_util.tree_leaves(scheduled(TABLE))]
    assert leaves.count((3, 1, 1)) == 2


def test_tables_are_written_to_model_files_and_saved(tmp_path):
    model, prior = scheduled(TABLE), es.Prior([0.0], [[1.0]])
    es.write_model(tmp_path / "model.toml", model, prior)
    es.save(tmp_path / "model.npz", model)
    for back in (es.read_model(tmp_path / "model.toml").model, es.load(tmp_path / "model.npz")):
        speeds = {"airspeed": [110.0, 240.0]}
        assert np.array_equal(back.along(speeds).A, model.along(speeds).A)


WRONG_SCHEDULES = {
    "must be a mapping of a channel": 3,
    "must be a function of the value that returns": {"airspeed": 3},
    "must be at least two increasing values. Got [2, 1]": {"airspeed": {"at": [2, 1], "A": [[[1]], [[1]]]}},
    "B has 1 matrix, and `at` has 2 values": {"airspeed": {"at": [1, 2], "B": [[[1]]]}},
    "may give 'A', 'B', 'C', 'D', 'Q', 'R', 'G', 'S'. Got 'E'": {"airspeed": {"at": [1, 2], "E": [[[1]], [[1]]]}},
    "must be (n, n) = (1, 1)": {"airspeed": {"at": [1, 2], "A": [[[1, 2]], [[1, 2]]]}},
    "must be a list of matrices, one for each value": {"airspeed": {"at": [1, 2], "A": [1, 2]}},
    "positive semidefinite": {"airspeed": {"at": [1, 2], "R": [[[1]], [[-1]]]}},
    "gives S, but the model has none": {"airspeed": {"at": [1, 2], "S": [[[0]], [[0]]]}},
    "gives 'A' by two channels": {"a": {"at": [1, 2], "A": [[[1]], [[1]]]}, "b": {"at": [1, 2], "A": [[[1]], [[1]]]}},
}


@pytest.mark.parametrize(("words", "schedule"), WRONG_SCHEDULES.items(), ids=range(len(WRONG_SCHEDULES)))
def test_a_wrong_schedule_is_one_sentence(words, schedule):
    with pytest.raises(es.InputError) as error:
        es.StateSpace([[0.9]], [[1.0]], Q=[[0.1]], R=[[1.0]], dt=1, schedule=schedule)
    assert words in str(error.value)


def fails(speed):
    """A function with a fault of the user."""
    return {"A": [[1 / (speed - 1)]]}


WRONG_VALUES = {
    "covers 100 to 250, but the channel is 99 at row 1": (TABLE, {"airspeed": [100.0, 99.0]}),
    "the values of 'airspeed' are missing": (TABLE, {}),
    "the model follows 'airspeed', not 'speed'": (TABLE, {"airspeed": [100.0], "speed": [1.0]}),
    "must not hold NaN": (TABLE, {"airspeed": [100.0, np.nan]}),
    "`values` must be a mapping": (TABLE, [100.0]),
    "failed at 1: ZeroDivisionError": (fails, {"airspeed": 1.0}),
    "must be (n, n) = (1, 1): the model has n = 1. Got (1, 1, 2)": (lambda v: {"A": [[v, v]]}, {"airspeed": 1.0}),
    "must return the same matrices at every value": (
        lambda v: {"A" if v < 2 else "B": [[v]]},
        {"airspeed": [1.0, 3.0]},
    ),
}


@pytest.mark.parametrize(("words", "case"), WRONG_VALUES.items(), ids=range(len(WRONG_VALUES)))
def test_values_that_do_not_suit_are_one_sentence(words, case):
    with pytest.raises(es.InputError) as error:
        scheduled(case[0]).along(case[1])
    assert words in str(error.value)


def test_what_needs_one_constant_model_says_so():
    model = es.StateSpace([[-0.9]], [[1.0]], Q=[[0.1]], R=[[1.0]], dt=0, schedule={"airspeed": TABLE})
    for call in (lambda: model.discretise(0.1), lambda: model.in_basis([[2.0]])):
        with pytest.raises(es.InputError, match=r"model\.along"):
            call()
    with pytest.raises(es.InputError, match="constant nominal matrices"):
        es.StateSpace([[[0.9]]] * 3, R=[[1.0]], dt=1, schedule={"airspeed": TABLE})
    with pytest.raises(es.InputError, match="a table, or write the model in Python"):
        es.write_model("never.toml", scheduled(lambda v: {"A": [[v]]}), es.Prior([0.0], [[1.0]]))
