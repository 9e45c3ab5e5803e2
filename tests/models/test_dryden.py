"""Turbulence: variances and spectra of the standard, in plants and in the models of filters."""

import itertools

import numpy as np
import pytest
from scipy import linalg, signal

import estimable as es
from estimable.frozen import replace

V, L, SPAN = 150.0, 300.0, 9.144
AIR = es.Dryden([1.0, 2.0, 3.0], L, V, SPAN)
AIRCRAFT = es.StateSpace(
    [[-1.3, 0.9], [-3.5, -1.1]], [[-0.1], [-24.0]], Q=np.diag([1e-6, 1e-6]), R=np.diag([0.03, 0.11]) ** 2, dt=0,
    states=["alpha", "q"], inputs=["elevator"], outputs=["alpha_deg", "q_deg_s"],
)  # fmt: skip
ENTRY = {"alpha": "alpha"}


def spectrum_of_w(w, sigma, length):
    """The one-sided spectrum of MIL-F-8785C §3.7.1.2 over angular frequencies w: its integral is the variance."""
    x = (length * w / V) ** 2
    return sigma**2 * length / (np.pi * V) * (1 + 3 * x) / (1 + x) ** 2


SPECTRA = {
    "gust_u": lambda w: 2 * 1.0**2 * L / (np.pi * V) / (1 + (L * w / V) ** 2),
    "gust_v": lambda w: spectrum_of_w(w, 2.0, L),
    "gust_w": lambda w: spectrum_of_w(w, 3.0, L),
    "gust_q": lambda w: (w / V) ** 2 / (1 + (4 * SPAN * w / (np.pi * V)) ** 2) * spectrum_of_w(w, 3.0, L),
    "gust_r": lambda w: (w / V) ** 2 / (1 + (3 * SPAN * w / (np.pi * V)) ** 2) * spectrum_of_w(w, 2.0, L),
    "gust_p": lambda w: 3.0**2 / (V * L) * 0.8 * (np.pi * L / (4 * SPAN)) ** (1 / 3) / (1 + (4 * SPAN * w / (np.pi * V)) ** 2),
}  # fmt: skip


def exact_spectrum(model, name, w):
    """The one-sided spectrum of a state of a model driven by unit white noise."""
    i = model.states.index(name)
    response = [np.linalg.solve(1j * x * np.eye(model.n) - model.A, model.G)[i] for x in w]
    return np.array([np.vdot(one, one).real for one in response]) / np.pi


@pytest.mark.parametrize("name", SPECTRA)
def test_the_spectra_are_those_of_the_standard(name):
    w = np.logspace(-2, 3, 30)
    assert np.allclose(exact_spectrum(AIR.model("both"), name, w), SPECTRA[name](w), rtol=1e-10)


def test_the_handbook_has_twice_the_length_across_the_path():
    handbook = es.Dryden([1.0, 2.0, 3.0], [L, L / 2, L / 2], V, SPAN, "MIL-HDBK-1797")
    assert np.allclose(handbook.model("both").A, AIR.model("both").A, rtol=1e-12)
    assert np.allclose(handbook.model("both").G, AIR.model("both").G, rtol=1e-12)


@pytest.mark.parametrize("convention", ["MIL-F-8785C", "MIL-HDBK-1797"])
def test_the_variances_of_the_velocities_are_exact(convention):
    air = es.Dryden([1.0, 2.0, 3.0], L, V, SPAN, convention)
    model = air.model("both")
    P = linalg.solve_continuous_lyapunov(model.A, -model.G @ model.G.T)
    variances = dict(zip(model.states, np.diag(P), strict=True))
    assert np.allclose([variances[f"gust_{one}"] for one in "uvw"], [1.0, 4.0, 9.0], rtol=1e-12)
    assert np.allclose(air.covariance("both"), P, rtol=1e-12)


def test_simulated_variances_and_spectra_are_those_of_the_model():
    """The spectrum of samples has the power above the Nyquist frequency folded into it."""
    model, dt, runs, T = AIR.model("both"), 0.05, 32, 2**13
    prior = es.Prior(np.zeros(8), AIR.covariance("both"))
    drawn = np.asarray(es.simulate_bank(model, seed=5, runs=runs, steps=T, dt=dt, prior=prior).items.state)
    ends = drawn[:, :: T // 8]  # 51 s apart: independent
    found, count = ends.var(axis=(0, 1)), ends.shape[0] * ends.shape[1]
    exact = np.diag(AIR.covariance("both"))
    assert np.all(np.abs(found - exact) < 3 * exact * np.sqrt(2 / count))
    slow = ("gust_u", "gust_v", "gust_w")
    for name in SPECTRA:
        f, power = signal.welch(drawn[..., model.states.index(name)], 1 / dt, nperseg=4096, axis=1)
        w, mean = 2 * np.pi * f, power.mean(axis=0) / (2 * np.pi)
        folded = sum(SPECTRA[name](np.abs(w + 2 * np.pi * k / dt)) for k in range(-20, 21))
        edges = (0.05 if name in slow else 0.3) * np.logspace(0, 2, 11)  # [rad/s]: two decades about the corner
        for low, high in itertools.pairwise(edges):
            band = (w >= low) & (w <= high)
            assert abs(10 * np.log10(mean[band].sum() / folded[band].sum())) < 1.0, (name, low)


def test_by_altitude_and_severity_the_numbers_are_those_of_the_figures():
    ground = es.Dryden.at(100 * 0.3048, 80.0, severity="light")
    shape = 0.177 + 0.0823
    assert ground.sigma[2] == pytest.approx(0.1 * 15 * 0.514444)
    assert ground.sigma[0] == pytest.approx(ground.sigma[2] / shape**0.4)
    assert ground.scale / 0.3048 == pytest.approx([100 / shape**1.2] * 2 + [100.0])
    high = [
        es.Dryden.at(7500 * 0.3048, 275.0, severity=one).sigma[0] / 0.3048 for one in ("light", "moderate", "severe")
    ]
    assert high == pytest.approx([6.7, 10.1, 23.6])
    below, between, above = (es.Dryden.at(h * 0.3048, 100.0).scale for h in (1000, 1500, 2000))
    assert between == pytest.approx((below + above) / 2)
    assert above == pytest.approx([1750 * 0.3048] * 3)


def test_turbulence_enters_through_the_aerodynamic_columns():
    entry = {"alpha": "alpha", "q": "q"}
    model = es.with_turbulence(AIRCRAFT, AIR, entry, angle="deg", kinematics=[("alpha", "q")])
    w, q = model.states.index("gust_w"), model.states.index("gust_q")
    degree = 180 / np.pi
    assert np.allclose(model.A[:2, w], AIRCRAFT.A[:, 0] * degree / V, rtol=1e-14)
    assert np.allclose(model.A[:2, q], [0.0, -1.1 * degree], rtol=1e-14)
    assert np.allclose(model.C[:, w], [degree / V, 0.0])  # the vane sees the gust, the gyro does not
    inertial = es.with_turbulence(AIRCRAFT, AIR, entry, angle="deg", vanes=())
    assert np.all(inertial.C[:, 2:] == 0)
    assert np.array_equal(model.A[2:, 2:], AIR.model().A)


def test_turbulence_acts_through_the_matrices_of_a_schedule():
    """First the turbulence and then the value, or first the value: the same model. Also where the plant of a loop follows it."""
    air = es.Turbulence(AIR, ENTRY, angle="deg")
    A, C = AIRCRAFT.A, AIRCRAFT.C
    table = {"at": [1.0, 3.0], "A": [A, 3 * A], "C": [C, 3 * C]}
    for given in (table, lambda v: {"A": v * A, "C": (v * C).tolist()}):
        own = replace(
            AIRCRAFT, schedule=es.StateSpace(A, AIRCRAFT.B, C, R=AIRCRAFT.R, dt=0, schedule={"v": given}).schedule
        )
        for value in (1.0, 2.2):
            first, then = air.into(own).along({"v": value}), air.into(own.along({"v": value}))
            for name in "ABCDGQR":
                assert np.allclose(getattr(first, name), getattr(then, name), rtol=1e-14), name
    plant = es.ControlledPlant(own, actuator=20.0, turbulence=air)
    law, given = es.StateFeedback([[0.0, -0.5]]), {"seed": 1, "prior": es.Prior([0.0, 0.0], np.eye(2)), "dt": 0.01}
    flown = es.close_loop(
        plant, law, es.Kalman(own), reference=np.zeros((20, 0)), schedule={"v": np.linspace(1, 2, 20)}, **given
    )
    assert flown.state.shape == (20, 6)


def test_a_filter_that_knows_of_the_turbulence_is_consistent_and_one_that_does_not_is_not():
    air = es.Turbulence(es.Dryden.at(6000.0, 275.0), ENTRY, angle="deg")
    model, prior = air.into(AIRCRAFT), es.Prior([0.0, 0.0], 0.01 * np.eye(2))
    u = np.zeros((2000, 1))
    record = es.simulate(model, u, seed=1, dt=0.01, prior=air.prior(prior)).record
    knows = es.estimate(es.Kalman(model), record, prior=air.prior(prior))
    blind = es.estimate(es.Kalman(AIRCRAFT), record, prior=prior)
    check = es.diagnostics.nis
    assert check(knows.innovation, knows.innovation_covariance).consistent
    assert not check(blind.innovation, blind.innovation_covariance).consistent


def test_a_plant_flies_in_turbulence():
    air = es.Turbulence(es.Dryden.at(6000.0, 275.0), ENTRY, angle="deg")
    after = es.StateSpace(AIRCRAFT.A, 0.5 * AIRCRAFT.B, Q=AIRCRAFT.Q, R=AIRCRAFT.R, dt=0, states=AIRCRAFT.states,
                          inputs=AIRCRAFT.inputs, outputs=AIRCRAFT.outputs)  # fmt: skip
    plant = es.ControlledPlant(AIRCRAFT, actuator=20.0, turbulence=air, events=[es.Change(1.0, after)])
    law = es.StateFeedback([[0.0, -0.5]])
    calm = es.ControlledPlant(AIRCRAFT, actuator=20.0, events=[es.Change(1.0, after)])
    prior = es.Prior([0.0, 0.0], 0.01 * np.eye(2))
    flown = {}
    for name, one in (("rough", plant), ("calm", calm)):
        loop = es.close_loop(one, law, es.Kalman(AIRCRAFT), reference=np.zeros((300, 0)), seed=1, prior=prior, dt=0.01)
        flown[name] = loop.state
    assert flown["rough"].shape == (300, 6)
    assert flown["calm"].shape == (300, 2)
    assert flown["rough"][:, 1].std() > 3 * flown["calm"][:, 1].std()


WRONG_AIR = {
    "`airspeed` must be greater than 0 m/s. Got 0": lambda: es.Dryden(1.0, 500.0, 0.0, 9.0),
    "`airspeed` must be greater than 0 m/s. Got -1": lambda: es.Dryden.at(1000.0, -1.0),
    "`span` must be greater than 0 m": lambda: es.Dryden(1.0, 500.0, 100.0, 0.0),
    "`sigma` must be at least 0, in m/s": lambda: es.Dryden(-1.0, 500.0, 100.0, 9.0),
    "`scale` must be positive, in m": lambda: es.Dryden(1.0, [500.0, 0.0, 500.0], 100.0, 9.0),
    "`convention` must be one of": lambda: es.Dryden(1.0, 500.0, 100.0, 9.0, "Dryden"),
    "`severity` must be one of": lambda: es.Dryden.at(1000.0, 100.0, severity="mild"),
    "`altitude` must be at least 0 m": lambda: es.Dryden.at(-1.0, 100.0),
    "`which` must be one of": lambda: AIR.model("vertical"),
    "`entry` must be a mapping of states to gusts": lambda: es.with_turbulence(AIRCRAFT, AIR, "alpha"),
    "`entry` must be one of": lambda: es.with_turbulence(AIRCRAFT, AIR, {"alpha": "z"}),
    "the model has no state 'beta'": lambda: es.with_turbulence(AIRCRAFT, AIR, {"beta": "beta"}),
    "`vanes` names 'x'": lambda: es.with_turbulence(AIRCRAFT, AIR, ENTRY, vanes=["x"]),
    "`model` must be continuous": lambda: es.with_turbulence(AIRCRAFT.discretise(0.1), AIR, ENTRY),
    "already has states of turbulence": lambda: es.with_turbulence(
        es.with_turbulence(AIRCRAFT, AIR, ENTRY), AIR, ENTRY
    ),
    "`turbulence` must be a Turbulence": lambda: es.ControlledPlant(AIRCRAFT, turbulence=AIR),
    "`kinematics` must be a list": lambda: es.Turbulence(AIR, ENTRY, kinematics=3),
}


@pytest.mark.parametrize("words", WRONG_AIR)
def test_wrong_turbulence_is_one_sentence(words):
    with pytest.raises(es.InputError) as error:
        WRONG_AIR[words]()
    assert words in str(error.value)
