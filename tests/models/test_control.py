"""python-control in and out."""

import control
import numpy as np
import pytest

from estimable import StateSpace


@pytest.mark.parametrize("dt", [0.0, 0.1])
def test_out_and_in_again_loses_only_what_python_control_does_not_carry(full, dt):
    model = full(dt=dt)
    system = model.to_control()
    back = StateSpace.from_control(system, Q=model.Q, R=model.R, G=model.G, S=model.S)
    for name in ("A", "B", "C", "D", "Q", "R", "G"):
        np.testing.assert_array_equal(getattr(back, name), getattr(model, name))
    assert (back.S is None) == (model.S is None)
    assert (back.states, back.inputs, back.outputs, back.dt) == (model.states, model.inputs, model.outputs, dt)
    assert back.operating_point is None
    assert system.isctime() == (dt == 0)


def test_a_system_gives_its_labels_as_names():
    system = control.ss([[0.5]], [[1.0]], [[1.0]], [[0.0]], 0.2, states=["level"], inputs=["valve"], outputs=["height"])
    model = StateSpace.from_control(system)
    assert (model.states, model.inputs, model.outputs, model.dt) == (("level",), ("valve",), ("height",), 0.2)
    assert model.R is None
    np.testing.assert_array_equal(model.Q, [[0.0]])


@pytest.mark.parametrize("h", [0.01, 0.5])
def test_a_zero_order_hold_agrees_with_control_c2d(full, h):
    model = full(dt=0.0)
    theirs = control.c2d(model.to_control(), h, "zoh")
    ours = model.discretise(h)
    for name in ("A", "B", "C", "D"):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), rtol=1e-12, atol=1e-14)


def test_an_input_goes_the_same_way_through_both(full):
    model, u = full(operating_point=None), np.random.default_rng(4).normal(size=(20, 2))
    theirs = control.forced_response(model.to_control(), T=np.arange(20) * model.dt, U=u.T)
    x, outputs = np.zeros(3), []
    for row in u:
        outputs.append(model.C @ x + model.D @ row)
        x = model.A @ x + model.B @ row
    np.testing.assert_allclose(np.array(outputs), theirs.outputs.T, rtol=1e-10, atol=1e-12)
