"""Sigma over time before any data: against the textbook filter with 60 digits, known set-ups, and what may not matter."""

import jax.numpy as jnp
import numpy as np
import pytest

from estimable import NonlinearModel, Prior, StateSpace, UnknownGain, covariance_analysis, gain_information
from estimable.errors import InputError
from oracles.many_digits import after, sigma
from oracles.stacked import covariances, explained

MOVING = StateSpace(
    [[1.0, 1.0], [0.0, 1.0]],
    C=[[1.0, 0.0]],
    Q=np.diag([0, 1e-6]),
    R=[[1e-4]],
    dt=1,
    states=["pos", "vel"],
    outputs=["gps"],
)
M, m, length, gravity = 1.0, 0.1, 0.5, 9.81
CART = StateSpace(
    [[0, 1, 0, 0], [0, -0.1, -m * gravity / M, 0], [0, 0, 0, 1], [0, 0.1 / length, (M + m) * gravity / (M * length), 0]],
    C=[[1.0, 0, 0, 0]], G=[[0], [1 / M], [0], [-1 / (M * length)]], Q=[[0.01]], R=[[1e-4]], dt=0,
    states=["x", "v", "theta", "omega"], outputs=["cart"],
)  # fmt: skip
MOTOR = StateSpace(
    [[-100, -50, 0, 0], [20, -1, 0, -100], [0, 1, 0, 0], [0, 0, 0, 0]], C=[[1, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0]],
    G=[[0], [0], [0], [1]], Q=[[0.01]], R=np.diag([0.01, 1e-4, 0.09]), dt=0,
    states=["current", "speed", "angle", "load"], outputs=["ammeter", "encoder", "tacho"],
)  # fmt: skip
UNIT = Prior(np.zeros(4), np.eye(4))


def navigation(forward=0.0):
    """INS errors of 15 states: position, velocity, tilt and heading, gyro and accelerometer biases; GPS at 1 Hz."""
    A, f = np.zeros((15, 15)), np.array([forward, 0.0, -9.81])
    A[0:3, 3:6], A[3:6, 12:15], A[6:9, 9:12] = np.eye(3), np.eye(3), -np.eye(3)
    A[3:6, 6:9] = -np.array([[0, -f[2], f[1]], [f[2], 0, -f[0]], [-f[1], f[0], 0]])
    Q = np.diag(np.repeat([0.0, 1e-4, 1e-8, 1e-14, 1e-9], 3))
    states = [f"{what}{axis}" for what in ("p", "v", "phi", "bg", "ba") for axis in "NED"]
    return StateSpace(A, C=np.eye(15)[:3], Q=Q, R=4 * np.eye(3), dt=0, states=states, outputs=["N", "E", "D"])


ALIGNMENT = Prior(np.zeros(15), np.diag([*[25.0] * 3, *[0.25] * 3, 1e-4, 1e-4, 1e-2, *[1e-8] * 3, *[1e-3] * 3]))


@pytest.mark.parametrize("variance", [1e2, 1e10, 1e20, None])
def test_a_vague_and_a_diffuse_prior_leave_the_sigma_of_the_data(variance):
    prior = Prior([0, 0], np.eye(2) * (variance or 0.0), diffuse=None if variance else np.eye(2))
    found = covariance_analysis(MOVING, prior=prior, horizon=51)
    *_, (P, _) = after(MOVING.A, MOVING.Q, MOVING.C, MOVING.R, (variance or 1e30) * np.eye(2), 51)
    assert np.allclose(found.sigma[-1], sigma(P), rtol=1e-14)
    assert found.time[-1] == 50
    if variance is None:
        assert np.array_equal(np.isinf(found.sigma[0]), [False, True])
        assert found.verdicts == ("known", "known")


def exact_variance(model, prior, samples):
    """Variances after `samples` samples from one joint Gaussian, without a recursion."""
    Π, cross, outputs = covariances(model, prior.covariance, samples - 1)
    return np.diagonal(Π - explained(cross, outputs))


def test_it_is_the_variance_of_the_joint_gaussian():
    rng = np.random.default_rng(0)
    T, prior = 7, Prior([0.0, 0.0], [[2.0, 0.3], [0.3, 1.0]])
    A = np.array([[1.0, 0.5], [-0.2, 0.9]]) + 0.1 * rng.normal(size=(T, 2, 2))
    model = StateSpace(A, C=rng.normal(size=(T, 2, 2)), Q=np.diag([0.1, 0.0]), R=np.diag([0.2, 0.5]), dt=0.5)
    arrival = rng.integers(0, 2, size=(T, 2))
    lossy = StateSpace(
        A, C=model.C * arrival[:, :, None], Q=model.Q, R=model.R, dt=0.5
    )  # a channel of noise alone shows as much as none
    found = covariance_analysis(model, prior=prior, arrival=arrival)
    for k in (0, 3, 6):
        assert np.allclose(found.sigma[k] ** 2, exact_variance(lossy, prior, k + 1), rtol=1e-10)
    crossed = StateSpace([[0.9]], Q=[[1.0]], R=[[0.5]], S=[[0.4]], dt=1)
    found = covariance_analysis(crossed, prior=Prior([0.0], [[3.0]]), horizon=9)
    assert found.sigma[-1] ** 2 == pytest.approx(exact_variance(crossed, Prior([0.0], [[3.0]]), 9), rel=1e-11)


def test_gains_are_as_well_known_as_their_information_says():
    model = StateSpace([[0.8, 0.1], [0.0, 0.7]], np.eye(2), [[1.0, 0.5]], Q=0.01 * np.eye(2), R=[[0.04]], dt=1)
    u = np.random.default_rng(1).normal(size=(9, 2))
    state, gain = Prior(np.zeros(2), np.eye(2)), Prior(np.ones(2), 4 * np.eye(2))
    found = covariance_analysis(UnknownGain(model, gain, directions="per_input"), prior=state, u=u)
    bound = gain_information(model, u, directions="per_input", state=state, gain=gain)
    assert found.names == ("x1", "x2", "gain_u1", "gain_u2")
    assert np.allclose(found.sigma[-1, 2:], bound.sigma, rtol=1e-10)
    walking = covariance_analysis(UnknownGain(model, gain, directions="per_input", walk=0.1), prior=state, u=u)
    A = np.stack([np.block([[model.A, np.diag(row)], [np.zeros((2, 2)), np.eye(2)]]) for row in u])
    joint = StateSpace(A, C=[[1.0, 0.5, 0, 0]], Q=np.diag([0.01, 0.01, 0.1, 0.1]), R=model.R, dt=1)
    both = Prior(np.zeros(4), np.diag([1.0, 1.0, 4.0, 4.0]))
    assert np.allclose(walking.sigma[-1] ** 2, exact_variance(joint, both, 9), rtol=1e-10)


def test_the_time_to_a_requirement_is_exact_to_the_sample():
    prior = Prior([0, 0], np.eye(2))
    exact = np.array([sigma(P) for P, _ in after(MOVING.A, MOVING.Q, MOVING.C, MOVING.R, np.eye(2), 130, dps=30)])
    for r in (3e-3, 2.5e-3, 2.2e-3):
        found = covariance_analysis(MOVING, prior=prior, horizon=130, requirement={"vel": r})
        assert found.time_to_requirement[1] == np.flatnonzero(exact[:, 1] > r)[-1] + 1
        assert found.verdicts[1] == "known"
        assert found.met
    found = covariance_analysis(MOVING, prior=prior, requirement={"vel": 1e-3})
    assert (found.verdicts[1], found.met) == ("improves no further", False)
    assert f"settles at {found.limit[1]:.3g}" in found.sentences[1]
    found = covariance_analysis(MOVING, prior=prior, horizon=6, requirement={"vel": 1e-3})
    assert found.verdicts[1] == "still improving"


def test_a_requirement_may_be_lost_again():
    """The pendulum from a good start: theta drifts to .60 by the noise, seen by the cart alone."""
    found = covariance_analysis(CART, prior=Prior(np.zeros(4), 0.01 * np.eye(4)), dt=0.02, requirement={"theta": 0.2})
    assert found.verdicts[2] == "lost again"
    assert found.limit[2] == pytest.approx(0.597, abs=5e-4)
    assert not found.met


def test_navigation_at_rest_names_the_textbook_pair_and_a_manoeuvre_breaks_it():
    found = covariance_analysis(navigation(), prior=ALIGNMENT, dt=1.0, horizon=300.0)
    assert found.verdicts[8] == found.verdicts[11] == "never"
    pair = found.indistinguishable[2]
    assert pair[7] == pytest.approx(0.00306, abs=5e-6)
    assert pair[12] / pair[7] == pytest.approx(9.81, rel=1e-3)
    assert 1 - found.share_left[2] < 1e-9
    two = {forward: navigation(forward).discretise(1.0) for forward in (0.0, 2.0)}
    rows = [two[2.0 if 60 <= k < 80 else 0.0] for k in range(301)]
    moving = StateSpace(
        np.stack([row.A for row in rows]), C=np.eye(15)[:3], Q=np.stack([row.Q for row in rows]), R=4 * np.eye(3), dt=1
    )
    heading = covariance_analysis(moving, prior=ALIGNMENT).sigma[:, 8]
    assert heading[[59, 120, 300]] == pytest.approx([0.1002, 0.0063, 0.0232], rel=0.01)


def test_what_is_never_shown_is_not_settled_by_rounding():
    """Height of a car's body by the stroke of its suspension: rounding would 'settle' it at 9378 m."""
    ms, mu, ks, cs, kt = 300.0, 40.0, 18e3, 1200.0, 180e3
    A = [[0, 1, 0, 0, 0], [-ks / ms, -cs / ms, ks / ms, cs / ms, 0], [0, 0, 0, 1, 0],
         [ks / mu, cs / mu, -(ks + kt) / mu, -cs / mu, kt / mu], [0] * 5]  # fmt: skip
    car = StateSpace(
        A, C=[[1.0, 0, -1, 0, 0]], G=[[0], [0], [0], [0], [1]], Q=[[2e-3]], R=[[1e-6]], dt=0,
        states=["body", "body_speed", "wheel", "wheel_speed", "road"], outputs=["stroke"],
    )  # fmt: skip
    prior = Prior(np.zeros(5), np.diag(np.square([0.05, 0.5, 0.05, 0.5, 0.05])))
    found = covariance_analysis(car, prior=prior, dt=0.005, requirement={"body": 0.02, "body_speed": 0.2})
    assert found.verdicts[0] == found.verdicts[4] == "never"
    assert found.verdicts[1] == "known"
    stroke = {"stroke": [1.0, 0, -1, 0, 0]}
    assert covariance_analysis(car, prior=prior, dt=0.005, wanted=stroke).limit[0] < 1e-3


@pytest.mark.parametrize("continuous", [False, True])
def test_units_do_not_matter(continuous):
    units = np.diag([1e3, 1e-6, 57.3, 1e6])
    turned = StateSpace(
        units @ CART.A @ np.linalg.inv(units), C=1e-5 * CART.C @ np.linalg.inv(units), G=units @ CART.G, Q=CART.Q,
        R=1e-10 * CART.R, dt=0, states=CART.states,
    )  # fmt: skip
    how = {"horizon": 5.0} if continuous else {"dt": 0.02, "horizon": 4.0}
    prior = Prior(np.zeros(4), 0.04 * np.eye(4))
    found = covariance_analysis(CART, prior=prior, requirement={"theta": 0.7}, **how)
    other = covariance_analysis(turned, prior=prior.in_basis(units), requirement={"theta": 0.7 * 57.3}, **how)
    assert np.allclose(other.sigma, found.sigma * np.diag(units), rtol=1e-9)
    assert other.verdicts == found.verdicts
    assert np.allclose(other.time_to_requirement, found.time_to_requirement, equal_nan=True)
    assert np.allclose(other.squared_correlations, found.squared_correlations, rtol=1e-6, atol=1e-12)


def test_the_error_budget_ranks_the_remedies():
    found = covariance_analysis(MOTOR, prior=UNIT, dt=0.01)
    budget = found.error_budget["load"]
    assert sum(budget.values()) == pytest.approx(1.0, abs=1e-12)
    assert budget["process noise of load"] == pytest.approx(0.7455, abs=1e-4)
    assert found.without("ammeter").limit[3] / found.limit[3] == pytest.approx(1.09, abs=5e-3)
    best = found.remedies()[0]
    assert best.change.startswith("a sensor of")
    assert np.all(best.sigma <= found.sigma[-1] * (1 + 1e-9))
    asked = covariance_analysis(MOTOR, prior=UNIT, dt=0.01, requirement={"load": 0.02})
    assert all("encoder" not in remedy.change for remedy in asked.remedies())  # 3 % of the variance: no remedy


def test_noise_free_sensors_and_exact_priors_are_ordinary():
    exact = StateSpace(
        [[1.0, 0.1], [0.0, 0.9]], C=[[1.0, 0.0]], G=[[0.0], [1.0]], Q=[[0.09]], R=[[0.0]], dt=1, states=["a", "b"]
    )
    found = covariance_analysis(exact, prior=Prior([0.0, 0.0], np.eye(2)), horizon=20)
    assert np.allclose(found.sigma[-1], [0.0, 0.3], atol=1e-12)
    known = covariance_analysis(MOVING, prior=Prior([0, 0], np.zeros((2, 2))), horizon=20, requirement={"pos": 1.0})
    assert known.verdicts[0] == "known already"
    still = StateSpace([[1.0]], R=[[1.0]], dt=1)
    assert covariance_analysis(still, prior=Prior([0.0], [[0.0]])).sentences == (
        "x1 is known already: it has no variance.",
    )
    grows = StateSpace(np.diag([3.0, 0.5]), C=[[0.0, 1.0]], Q=np.eye(2), R=[[1.0]], dt=1)
    found = covariance_analysis(grows, prior=Prior([0.0, 0.0], np.eye(2)), horizon=10_000)
    assert found.verdicts == ("never", "known")
    assert found.until is not None
    assert "grows until numbers overflow" in found.sentences[-1]


def test_another_prior_and_a_combination():
    found = covariance_analysis(MOVING, prior=Prior([0, 0], np.eye(2)), horizon=9, wanted={"ahead": [1.0, 5.0]})
    ahead = MOVING.in_basis([[1.0, 5.0], [0.0, 1.0]])
    variance = exact_variance(ahead, Prior([0, 0], np.eye(2)).in_basis([[1.0, 5.0], [0.0, 1.0]]), 9)
    assert found.sigma[-1, 0] ** 2 == pytest.approx(variance[0], rel=1e-10)
    other = found.at(Prior([0, 0], 9 * np.eye(2)))
    assert other.sigma[0, 0] > found.sigma[0, 0]
    figure = found.plot()
    assert figure.layout.annotations[0].text == "ahead"


def bearings(turn):
    """A target in the plane at constant velocity, seen by its bearing from an observer that may turn; x of the target."""
    return NonlinearModel(
        lambda x, u, θ: jnp.array([x[0] + x[2], x[1] + x[3], x[2], x[3]]),
        lambda x, u, θ: jnp.arctan2(x[1] - u[1], x[0] - u[0])[None],
        Q=np.zeros((4, 4)), R=[[1e-6]], dt=1, inputs=["east", "north"], states=["x", "y", "vx", "vy"],
    ), np.stack([np.where(np.arange(41) < 20, 20.0 * np.arange(41), 400.0), np.where(
        np.arange(41) < 20, 0.0, 20.0 * (np.arange(41) - 20) * turn)], axis=1)  # fmt: skip


def test_bearings_from_a_fixed_observer_never_show_the_range_and_one_turn_does():
    prior = Prior([1000.0, 500.0, 10.0, -5.0], np.diag([1e4, 1e4, 100.0, 100.0]))
    model, path = bearings(1.0)
    fixed = covariance_analysis(model, prior=prior, u=0 * path)
    turned = covariance_analysis(model, prior=prior, u=path)
    assert turned.sigma[-1, 0] < 0.3 * fixed.sigma[-1, 0]
    diffuse = Prior(prior.mean, np.zeros((4, 4)), diffuse=np.eye(4))
    assert np.all(np.isinf(covariance_analysis(model, prior=diffuse, u=0 * path).sigma[-1]))
    assert np.all(np.isfinite(covariance_analysis(model, prior=diffuse, u=path).sigma[-1]))
    # the bound of Cramér and Rao: the information of all bearings by differences
    x0, h = np.array([1000.0, 500.0, 10.0, -5.0]), np.array([1e-3, 1e-3, 1e-5, 1e-5])
    k = np.arange(41)

    def seen(x):
        return np.arctan2(x[1] + k * x[3] - path[:, 1], x[0] + k * x[2] - path[:, 0])

    J = np.stack([(seen(x0 + d) - seen(x0 - d)) / (2 * d.max()) for d in np.diag(h)], axis=1)
    P0 = np.linalg.inv(np.linalg.inv(prior.covariance) + J.T @ J / 1e-6)
    F = np.block([[np.eye(2), 40 * np.eye(2)], [np.zeros((2, 2)), np.eye(2)]])
    assert np.allclose(turned.sigma[-1] ** 2, np.diagonal(F @ P0 @ F.T), rtol=1e-5)
    drawn = covariance_analysis(model, prior=prior, u=path, draws=5)
    low, high = drawn.sigma_range
    assert np.all((low <= drawn.sigma + 1e-12) & (drawn.sigma <= high * 1.5))


def test_parameters_along_a_continuous_trajectory():
    """A time constant and a gain from a step; exact sensitivities of the solution."""
    model = NonlinearModel(
        lambda x, u, θ: -θ[0] * x + θ[1] * u, lambda x, u, θ: x, Q=[[0.0]], R=[[0.01]], dt=0, inputs=["u"],
        parameters={"rate": 0.5, "gain": 2.0}, states=["level"], substeps=8,
    )  # fmt: skip
    prior, t = Prior([0.0], [[0.0]]), 0.1 * np.arange(40)
    parameters = Prior([0.5, 2.0], np.diag([0.04, 0.25]))
    found = covariance_analysis(model, prior=prior, parameters=parameters, u=np.ones((40, 1)), dt=0.1)
    assert found.names == ("level", "rate", "gain")
    a, b = 0.5, 2.0
    J = np.stack([-b / a**2 * -np.expm1(-a * t) + b / a * t * np.exp(-a * t), -np.expm1(-a * t) / a], axis=1)
    P = np.linalg.inv(np.diag([25.0, 4.0]) + J.T @ J / 0.01)
    assert np.allclose(found.sigma[-1, 1:], np.sqrt(np.diagonal(P)), rtol=1e-5)


def test_the_true_error_of_a_filter_with_fewer_states_and_wrong_noises():
    """Against the joint Gaussian: x^ is a linear map of the outputs, by the gains of the filter's own recursion."""
    true = StateSpace(
        [[0.95, 0.2, 0.0], [0.0, 0.9, 0.1], [0.0, 0.0, 1.0]], C=[[1.0, 0.0, 0.0], [0.0, 1.0, 0.5]], Q=np.diag([0.1, 0.2, 0.0]),
        R=np.diag([0.3, 0.4]), dt=1, states=["a", "b", "bias"],
    )  # fmt: skip
    small = StateSpace(
        [[0.9, 0.2], [0.0, 0.9]],
        C=[[1.0, 0.0], [0.0, 1.0]],
        Q=np.diag([0.01, 0.3]),
        R=np.diag([0.1, 0.4]),
        dt=1,
        states=["a", "b"],
    )
    prior, T = Prior(np.zeros(3), np.diag([1.0, 2.0, 0.5])), 6
    found = covariance_analysis(true, prior=prior, filter=small, horizon=T)
    P, gains, claimed = np.diag([1.0, 2.0]), [], []
    for k in range(T):
        P = small.A @ P @ small.A.T + small.Q if k else P
        K = P @ small.C.T @ np.linalg.inv(small.C @ P @ small.C.T + small.R)
        P = P - K @ small.C @ P
        gains.append(K)
        claimed.append(np.sqrt(np.diagonal(P)))
    Π, cross, Y = covariances(true, prior.covariance, T - 1)
    W = np.zeros((2, 0))  # x^ = W Y
    for k, K in enumerate(gains):
        W = np.hstack([(np.eye(2) - K @ small.C) @ (small.A if k else np.eye(2)) @ W, K])
    E = Π[:2, :2] - cross[:2] @ W.T - W @ cross[:2].T + W @ Y @ W.T
    assert np.allclose(found.sigma[-1, :2] ** 2, np.diagonal(E), rtol=1e-9)
    assert found.sigma[-1, 2] == pytest.approx(np.sqrt(0.5))
    assert np.allclose(found.claimed_sigma[:, :2], claimed, rtol=1e-10)
    assert "claims too small a sigma for a" in " ".join(found.sentences)
    same = covariance_analysis(true, prior=prior, filter=true, horizon=T)
    assert np.allclose(same.sigma, same.claimed_sigma, rtol=1e-10)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"requirement": {"vel": 0.0}}, r"`requirement\['vel'\]` must be greater than 0"),
        ({"requirement": {"speed": 1.0}}, "names 'speed', which is not among 'pos', 'vel'"),
        ({"wanted": {"sum": [1.0, 1.0, 1.0]}}, r"`wanted\['sum'\]` must be \(n,\) = \(2,\)"),
        ({"prior": Prior([0.0], [[1.0]])}, "must describe n = 2 states"),
        ({"horizon": 0}, "`horizon` must be"),
        ({"arrival": [1.0, 0.5]}, "1 for what arrives and 0 for what is lost"),
        ({"arrival": np.ones((3, 2))}, r"must be \(T,\) or \(T, p\) with T = 3 samples and p = 1"),
        ({"dt": 0.5}, "`dt` is for continuous models"),
        ({"u": np.ones((3, 1))}, "are for unknown gains"),
        ({"model": UnknownGain(StateSpace([[0.5]], [[1.0]], R=[[1.0]], dt=1), Prior([1.0], [[1.0]]))}, "`u` or `record`"),
        ({"model": StateSpace([[0.5]], dt=1)}, "has no R"),
        ({"model": StateSpace([[0.5]], C=[[1.0], [2.0]], R=np.zeros((2, 2)), dt=1), "prior": Prior([0.0], [[1.0]])},
         "y1 and y2 repeat each other and have no noise"),
        ({"model": bearings(1.0)[0], "prior": UNIT}, "`u` or `record` must be given: the tangents"),
        ({"filter": CART}, "has states that the model does not have"),
        ({"draws": 3}, "are for a `NonlinearModel`"),
        ({"model": CART, "prior": UNIT, "arrival": [1.0]}, "`arrival` concerns samples"),
    ],
)  # fmt: skip
def test_bad_input_is_refused_with_every_fault(options, message):
    given = {"model": MOVING, "prior": Prior([0, 0], np.eye(2))} | options
    with pytest.raises(InputError, match=message):
        covariance_analysis(given.pop("model"), **given)


@pytest.mark.parametrize("name", ["wanted", "requirement", "record", "arrival", "dt", "draws", "filter"])
@pytest.mark.parametrize("value", [5, "x", [1, 2], np.ones((2, 2)), {1: 2}])
def test_arguments_of_another_kind_end_in_an_error_message(name, value):
    with pytest.raises(InputError):
        covariance_analysis(MOVING, prior=Prior([0, 0], np.eye(2)), **{name: value})
