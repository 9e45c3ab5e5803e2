"""Save and load: every class that can be saved comes back to the last bit."""

import jax
import numpy as np
import pytest

import estimable as es
from estimable import (
    BernoulliLink,
    Bounded,
    ChangeDetection,
    DelayLink,
    ExtendedKalman,
    Gated,
    GilbertElliottLink,
    Kalman,
    MovingWindow,
    NoiseFit,
    Online,
    Outcome,
    OutputError,
    OutputErrorML,
    PerfectLink,
    Prior,
    Record,
    RecursiveOutputError,
    SecondOrderKalman,
    Smoothed,
    StateSpace,
    Trace,
    UnknownGain,
    UnknownInput,
    UnscentedKalman,
    estimate,
    estimate_bank,
    forecast,
    identify,
    load,
    online,
    save,
    simulate,
    simulate_bank,
    smooth,
    stack,
)
from estimable import store as room

MODEL = StateSpace(
    [[0.9, 0.1], [0.0, 0.8]],
    [[0.0], [1.0]],
    Q=0.1 * np.eye(2),
    R=0.2 * np.eye(2),
    dt=0.1,
    states=["α", "q"],
    inputs=["δ"],
    operating_point={"states": [1.0, 2.0], "inputs": [3.0]},
)
PRIOR = Prior([1 / 3, 0.1], np.eye(2) / 7, diffuse=[[1.0], [0.5]])
U = np.linspace(-1, 1, 12)[:, None]
RECORD = simulate(MODEL, U, seed=3).record
GAPS = Record(
    np.where(np.arange(24).reshape(12, 2) % 5 == 0, np.nan, RECORD.y),
    U,
    t=np.cumsum(np.linspace(0.1, 0.3, 12)),
    arrived=np.where(np.arange(12) % 4 == 0, 0.0, 1.0),
    lost="hold",
    inputs=["δ"],
    units={"y1": "deg"},
)
GAIN = UnknownGain(MODEL, Prior([1.0], [[0.25]]), walk=0.02, forgetting=0.99, fixed=[[0.0], [0.1]])
WATCHED = ChangeDetection(GAIN, length=4, jump=[0.3])
WINDOW = MovingWindow(GAIN, 3, state_prior=Prior([0.0, 1.0], np.eye(2)))
OVER_TIME = StateSpace(np.stack([np.eye(2)] * 3), R=np.eye(2), S=0.1 * np.eye(2), Q=np.eye(2), dt=1)


def last_state():
    algorithm = Kalman(MODEL)
    running = online(algorithm, prior=PRIOR)
    running.correct([1.0, np.nan])
    return running.progress


def fang_state():
    model = StateSpace([[0.5]], [[1.0]], D=[[1.0]], Q=[[0.1]], R=[[0.2]], dt=1)
    running = online(UnknownInput(model, unknown=["u1"], method="fang"), prior=Prior([0.0], [[1.0]]))
    running.correct([1.0])
    return running.progress.state


LAW = es.StateFeedback([[0.5]], reference_gain=[[0.5]])
DRIVEN = StateSpace([[1.0]], [[1.0]], Q=[[0.1]], R=[[0.1]], dt=1)
LOOP = {"reference": np.ones(5), "seed": 0, "prior": Prior([0.0], [[1.0]])}
PLANT = OutputError([0.5], [1.0], noise_variance=0.1, dt=1)
RECURSION = RecursiveOutputError(1, 0, noise_variance=0.1)
TRACKER = es.AlphaBeta(0.5, 0.1, sigma_a2=1.0, sigma_s2=0.2)
JOINT = es.JointOutputError(1, 0, noise_variance=0.1)
THINGS = {
    "StateSpace": lambda: MODEL,
    "StateSpace over time": lambda: OVER_TIME,
    "StateSpace continuous": lambda: StateSpace([[-1.0]], dt=0).discretise(0.1, hold="first_order"),
    "OperatingPoint": lambda: MODEL.operating_point,
    "Prior": lambda: PRIOR,
    "Record": lambda: RECORD,
    "Record with gaps": lambda: GAPS,
    "Record cut": lambda: GAPS[5:],
    "Kalman": lambda: Kalman(MODEL),
    "UnknownGain": lambda: GAIN,
    "ExtendedKalman": lambda: ExtendedKalman(MODEL, iterations=2),
    "SecondOrderKalman": lambda: SecondOrderKalman(MODEL, moments="bias_only"),
    "UnscentedKalman": lambda: UnscentedKalman(MODEL, kappa=0.5),
    "UnknownGain directions": lambda: UnknownGain(MODEL, Prior([1.0], [[1.0]]), directions=np.ones((1, 2, 1))),
    "UnknownInput": lambda: UnknownInput(MODEL, unknown=["δ"], walk=0.3),
    "FangState": fang_state,
    "Estimate of an unknown input": lambda: estimate(UnknownInput(MODEL, unknown=["δ"]), RECORD, prior=PRIOR),
    "ChangeDetection": lambda: WATCHED,
    "Watch": lambda: WATCHED.init(PRIOR),
    "MovingWindow": lambda: WINDOW,
    "Copies": lambda: WINDOW.init(PRIOR),
    "Bounded": lambda: Bounded(GAIN, 0.0, 1.0),
    "Smoothed": lambda: Smoothed(WINDOW, 0.9),
    "Average": lambda: Smoothed(GAIN, 0.9).init(PRIOR),
    "Gated": lambda: Gated(Kalman(MODEL), 0.999),
    "Estimate": lambda: estimate(GAIN, RECORD, prior=PRIOR),
    "Estimate means": lambda: estimate(Kalman(MODEL), RECORD, prior=PRIOR, keep="means"),
    "Estimate likelihood": lambda: estimate(Kalman(MODEL), RECORD, prior=PRIOR, keep="likelihood"),
    "Origin": lambda: estimate(GAIN, RECORD, prior=PRIOR).origin,
    "SmoothedEstimate": lambda: smooth(Kalman(MODEL), RECORD, prior=PRIOR),
    "Forecast": lambda: forecast(estimate(GAIN, RECORD, prior=PRIOR), U[:2]),
    "NoiseFit": lambda: NoiseFit(GAIN, np.ones(1), np.eye(1), -3.0, ("R[y1]",), (), 4),
    "Info": lambda: estimate(Kalman(MODEL), RECORD, prior=PRIOR).info,
    "EstimateBank": lambda: estimate_bank(Kalman(MODEL), [RECORD, RECORD], prior=PRIOR),
    "Simulation": lambda: simulate(MODEL, U, seed=1),
    "Stacked": lambda: stack([PRIOR, PRIOR]),
    "Stacked simulations": lambda: simulate_bank(MODEL, U, seed=1, runs=3),
    "Progress": last_state,
    "Belief": lambda: last_state().state,
    "tuple": lambda: (MODEL, PRIOR),
    "OutputError": lambda: PLANT,
    "RecursiveOutputError": lambda: RECURSION,
    "RecursiveOutputError with a prior": lambda: RecursiveOutputError(
        0, 0, noise_variance=1.0, prior=Prior([1.0], [[2.0]])
    ),
    "OutputErrorML": lambda: OutputErrorML(1, 0, initial="free"),
    "Recursion": lambda: RECURSION.init(None),
    "Fit": lambda: identify(RECURSION, simulate(PLANT, np.ones(5), seed=1).record),
    "PerfectLink": PerfectLink,
    "BernoulliLink": lambda: BernoulliLink([0.5, 0.7], acknowledged=False),
    "GilbertElliottLink": lambda: GilbertElliottLink.of_rate(0.7, burst=3),
    "DelayLink": lambda: DelayLink([0.5, 0.2], late="use"),
    "Trace": lambda: Trace([0.0, np.inf, 2.0], late="use"),
    "LeastSquares": lambda: es.LeastSquares(1, 1, delay=1),
    "FixedGain": lambda: es.FixedGain(DRIVEN, [[0.5]]),
    "AlphaBeta": lambda: TRACKER,
    "Track": lambda: TRACKER.init(Prior(np.zeros(2), np.eye(2))),
    "JointOutputError": lambda: JOINT,
    "JointBelief": lambda: JOINT.init(None),
    "Tracking": lambda: es.Tracking(1, 0),
    "MinimumVariance": lambda: es.MinimumVariance(1, 1),
    "InstrumentalVariables": lambda: es.InstrumentalVariables(1, 1, offset=True),
    "PredictionError": lambda: es.PredictionError(1, 0, 1, delay=1),
    "CoupledLeastSquares": lambda: es.CoupledLeastSquares(1, 0, delay=1),
    "Phasor": lambda: es.Phasor(1, [0.5], settle=2.0, domain="continuous"),
    "ARMAX": lambda: es.ARMAX([0.5], [1.0], [0.2], noise_variance=0.1, dt=1),
    "MarkovParameters": lambda: es.MarkovParameters(4),
    "HoKalman": lambda: es.HoKalman(2),
    "Subspace": lambda: es.Subspace(2, weighting="cva"),
    "ARX": lambda: es.ARX([0.5], [1.0], noise_variance=0.1, dt=1),
    "StateFeedback": lambda: LAW,
    "ProportionalIntegral": lambda: es.ProportionalIntegral(
        [[0.5]], reference_gain=[[0.5]], integral=[[0.1]], tracked=[[1.0]], dt=1.0
    ),
    "GainReconfiguration": lambda: es.GainReconfiguration(LAW, lower=0.1),
    "ControlledPlant": lambda: es.ControlledPlant(DRIVEN, events=[es.Failure(2.0, 0.5)]),
    "Failure": lambda: es.Failure(2.0, 0.5),
    "Change": lambda: es.Change(2.0, DRIVEN),
    "ClosedLoop": lambda: es.close_loop(DRIVEN, LAW, Kalman(DRIVEN), **LOOP),
    "ClosedLoopBank": lambda: es.close_loop_bank(DRIVEN, LAW, Kalman(DRIVEN), runs=2, **LOOP),
}


@pytest.mark.parametrize("name", THINGS)
def test_what_is_saved_comes_back_to_the_last_bit(same, tmp_path, name):
    thing = THINGS[name]()
    save(tmp_path / "thing.npz", thing)
    back = load(str(tmp_path / "thing.npz"))
    same(back, thing)


def test_every_class_that_can_be_saved_is_tried():
    assert {type(thing()).__name__ for thing in THINGS.values()} >= set(room.RECORDS)


def test_fields_have_their_kinds_again(tmp_path):
    save(tmp_path / "thing.npz", estimate(Kalman(MODEL), RECORD, prior=PRIOR))
    back = load(tmp_path / "thing.npz")
    assert type(back.outcome) is Outcome
    assert type(back.log_likelihood) is float
    assert back.names.states == ("α", "q")
    assert hash(jax.tree_util.tree_structure(back)) is not None


def test_names_given_as_an_array_are_texts_again(tmp_path):
    save(tmp_path / "thing.npz", Record([1.0, 2.0], outputs=np.array(["a"])))
    assert load(tmp_path / "thing.npz").outputs == ("a",)


def test_what_comes_back_works_as_before(tmp_path):
    save(tmp_path / "algorithm.npz", GAIN)
    save(tmp_path / "record.npz", RECORD)
    before = estimate(GAIN, RECORD, prior=PRIOR)
    after = estimate(load(tmp_path / "algorithm.npz"), load(tmp_path / "record.npz"), prior=PRIOR)
    np.testing.assert_array_equal(before.gain, after.gain)
    np.testing.assert_array_equal(before.covariance, after.covariance)


@pytest.mark.parametrize("corrected", [True, False])
def test_a_run_goes_on_where_it_was_saved(tmp_path, corrected):
    running = online(GAIN, prior=PRIOR)
    running.correct(RECORD.y[0])
    if not corrected:
        running.predict(RECORD.u[0])
    running.save(tmp_path / "run.npz")
    resumed = load(tmp_path / "run.npz")
    assert isinstance(resumed, Online)
    for run in (running, resumed):
        if corrected:
            run.predict(RECORD.u[0])
        run.correct(RECORD.y[1])
    np.testing.assert_array_equal(resumed.info.mean, running.info.mean)
    np.testing.assert_array_equal(resumed.info.gain_covariance, running.info.gain_covariance)


def test_saving_again_writes_over_what_was_there(same, tmp_path):
    save(tmp_path / "thing.npz", RECORD)
    save(tmp_path / "thing.npz", PRIOR)
    same(load(tmp_path / "thing.npz"), PRIOR)


def test_nothing_in_a_file_is_a_pickle(tmp_path):
    save(tmp_path / "thing.npz", GAPS)
    with np.load(tmp_path / "thing.npz", allow_pickle=False) as file:
        assert all(file[name].dtype != object for name in file.files)
