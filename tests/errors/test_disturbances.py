"""The sentences of markov_disturbance."""

import numpy as np

from estimable import Kalman, Prior, Record, StateSpace, estimate, markov_disturbance

PLANT = StateSpace([[-1.0, 0.3], [0.0, -2.0]], Q=0.1 * np.eye(2), R=0.01 * np.eye(2), dt=0, states=["slow", "fast"])
RECORD = Record(np.zeros((3, 2)), dt=0.1)


def test_each_fault_of_a_disturbance_has_a_sentence(refused):
    def of(**settings):
        return refused(lambda: markov_disturbance(PLANT, **{"time_constant": 1.0, "density": 1.0, **settings}))[0]

    assert of(density=-1.0) == "`density` must be at least 0. Got -1.0."
    assert "above 0 for at least one state" in of(density=[0.0, 0.0])
    assert "`time_constant` must be above 0 seconds, or None" in of(time_constant=0.0)
    assert "`density` must be (states,) = (2,)" in of(density=[1.0, 2.0, 3.0])
    assert "`states` must name states: 'slow', 'fast'. Got 'fats'. Did you mean" in of(states=["fats"])
    assert "StateSpace" in refused(lambda: markov_disturbance(3, time_constant=1.0, density=1.0))[0]
    short = Prior([0.0], [[1.0]])
    lasting = markov_disturbance(PLANT, time_constant=1.0, density=1.0)
    assert (
        "or the 2 of them that are not disturbances"
        in refused(lambda: estimate(Kalman(lasting), RECORD, prior=short))[0]
    )
