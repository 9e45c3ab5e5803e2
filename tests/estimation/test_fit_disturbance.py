"""fit_noise of lasting disturbances."""

import numpy as np
from numpy.testing import assert_allclose

from estimable import Kalman, Prior, Record, StateSpace, estimate, fit_noise, markov_disturbance, simulate_bank
from estimable.checks import Faults
from estimable.estimation.fit_noise import parts, tuned
from estimable.frozen import replace

PLANT = StateSpace(
    [[-1.0, 0.5], [0.0, -2.0]], Q=np.diag([0.01, 0.02]), R=0.01 * np.eye(2), dt=0, states=["slow", "fast"]
)
START = Prior([0.0, 0.0], 0.1 * np.eye(2))


def drawn(density, runs):
    true = markov_disturbance(PLANT, time_constant=[0.3, 1.0], density=density).discretise(0.05)
    every = Prior(np.zeros(4), np.diag([0.1, 0.1, *true.disturbance.variance]))
    found = simulate_bank(true, np.zeros((3000, 0)), seed=3, runs=runs, prior=every).items
    return [Record(y, dt=0.05) for y in found.record.y]


def test_noise_density_and_time_constant_of_each_input_are_found_within_their_errors():
    records = drawn([0.2, 0.6], 6)
    begin = markov_disturbance(PLANT, time_constant=0.6, density=[0.3, 0.3])
    fits = [
        fit_noise(Kalman(begin), record, prior=START, free=("R", "disturbance"), progress=False) for record in records
    ]
    names = ("R[y1]", "R[y2]", "density[disturbance_slow]", "density[disturbance_fast]",
             "time_constant[disturbance_slow]", "time_constant[disturbance_fast]")  # fmt: skip
    assert fits[0].names == names
    true = [0.01, 0.01, 0.2, 0.6, 0.3, 1.0]
    z = np.array(
        [np.log(fit.parameters / true) / (fit.sigma / fit.parameters) for fit in fits]
    )  # their errors are skew
    assert np.abs(z).max() < 4
    assert np.sqrt(np.mean(z**2)) < 1.5
    found = fits[0].algorithm.model
    again = markov_disturbance(
        replace(PLANT, R=found.R), time_constant=fits[0].parameters[4:], density=fits[0].parameters[2:4]
    )
    assert_allclose(found.A, again.A)
    assert_allclose(found.Q, again.Q)


def test_its_derivatives_are_those_of_the_likelihood():
    one = drawn([0.2, 0.6], 1)[0][:200]
    algorithm = Kalman(markov_disturbance(PLANT, time_constant=None, density=0.3))
    algorithm = Kalman(markov_disturbance(algorithm.model, time_constant=0.6, density=0.3))
    found = parts(algorithm, ("Q", "disturbance"), Faults())
    size = sum(part.size for part in found)
    assert size == 2 + 4 + 2

    def log_likelihood(θ):
        return estimate(tuned(algorithm, found, θ), one, prior=START).log_likelihood

    from estimable.estimation.binding import bind
    from estimable.estimation.named_numbers import Setup
    from estimable.estimation.slopes import Rows, ascent

    θ, h = 0.1 * np.arange(size), 1e-5
    _, exact = ascent(lambda θ: Setup(tuned(algorithm, found, θ), START), θ, Rows.of(bind(algorithm, one, START)))
    steps = [(log_likelihood(θ + h * e) - log_likelihood(θ - h * e)) / (2 * h) for e in np.eye(size)]
    assert_allclose(exact.score, steps, rtol=1e-5, atol=1e-6)
    assert_allclose(exact.log_likelihood, log_likelihood(θ), rtol=1e-12)


def test_a_density_that_the_record_does_not_show_is_zero_and_its_time_constant_unknown():
    [record] = drawn([0.2, 1e-12], 1)
    begin = Kalman(markov_disturbance(PLANT, time_constant=0.6, density=[0.3, 0.01]))
    fit = fit_noise(begin, record, prior=START, free=("disturbance",), progress=False)
    if "density[disturbance_fast]" in fit.at_zero:
        assert np.isnan(fit.sigma[3])
        assert fit.parameters[1] == 0
    else:
        assert fit.parameters[1] < 2 * fit.sigma[1]
    assert np.isfinite(fit.sigma[[0, 2]]).all()
