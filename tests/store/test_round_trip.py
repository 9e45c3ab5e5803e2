"""Save and load: every public record comes back to the last bit, or is in a short list with the reason why not."""

import dataclasses
import importlib
import pkgutil
import subprocess
import sys
import typing

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
from estimable.frozen import RECORDS, field_names, replace, saved
from estimable.results import Direction, NoiseFit, Online, Outcome, Suspect, Untestable

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
WATCHED = ChangeDetection(GAIN, slots=4, levels=1, jump=[0.3])
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


MIXED = es.Mixture([GAIN, GAIN], probability=[0.3, 0.7])
LAW = es.StateFeedback([[0.5]], reference_gain=[[0.5]])
DRIVEN = StateSpace([[1.0]], [[1.0]], Q=[[0.1]], R=[[0.1]], dt=1)
LOOP = {"reference": np.ones(5), "seed": 0, "prior": Prior([0.0], [[1.0]])}
PLANT = OutputError([0.5], [1.0], noise_variance=0.1, dt=1)
RECURSION = RecursiveOutputError(1, 0, noise_variance=0.1)
TRACKER = es.AlphaBeta(0.5, 0.1, sigma_a2=1.0, sigma_s2=0.2)
JOINT = es.JointOutputError(1, 0, noise_variance=0.1)
CLOSED = es.close_loop(DRIVEN, LAW, Kalman(DRIVEN), **LOOP)
CLOSED_BANK = es.close_loop_bank(DRIVEN, LAW, Kalman(DRIVEN), runs=2, **LOOP)
SEEN = StateSpace([[0.7, -0.1], [1, 0]], [[1.0], [0.0]], [[1.0, -2.0]], G=[[1.0], [0.0]], Q=[[1.0]], R=[[0.3]], dt=1)
UNSTABLE = StateSpace([[1.25]], Q=[[1.0]], R=[[1.0]], dt=1)
MEASURED = simulate(PLANT, np.random.default_rng(0).normal(size=200), seed=1).record
FITTED = identify(OutputErrorML(1, 0), MEASURED)
PROPER = Prior([1.0, 2.0], np.eye(2))
FILTERED = estimate(Kalman(MODEL), RECORD, prior=PROPER)
RUNAWAY = estimate(
    Kalman(StateSpace([[1e99]], C=[[0.0]], Q=[[1.0]], R=[[1.0]], dt=1)), Record(np.zeros(6), dt=1),
    prior=Prior([1.0], [[1.0]]), on_failure="keep",
)  # fmt: skip
LONG = simulate(MODEL, np.zeros((60, 1)), seed=3).record
FILTERED_LONG = estimate(Kalman(MODEL), LONG, prior=PROPER)
CURVED = es.NonlinearModel(lambda x, u, θ: x, lambda x, u, θ: x**2, Q=[[0.0]], R=[[0.1]], dt=1)
DECAY = es.NonlinearModel(lambda x, u, θ: θ * x, lambda x, u, θ: x, Q=[[0.1]], R=[[0.1]], dt=1, parameters={"a": 0.9})
TWO_ROWS = Record([np.nan, 5.0], dt=1)
BENT = estimate(ExtendedKalman(CURVED), TWO_ROWS, prior=Prior([2.0], [[1.0]]))
MASS = StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], dt=0)
SYNTHESIS = es.rho_synthesis(MASS, eta=[0.5, 1.0, 2.0])
LEAST = es.results.DetectableLoss(
    0.0, 1.0, (0.9,), *(np.array(value) for value in ([[0.1]], [0.01], [1.0], [[0.2]])), ("gain",)
)
WRONG = Direction("B[x1, u1]", "B", (0, 0))
THINGS = {
    "StateSpace": lambda: MODEL,
    "StateSpace over time": lambda: OVER_TIME,
    "Dryden": lambda: es.Dryden(1.0, 500.0, 100.0, 9.0),
    "Turbulence": lambda: es.Turbulence(es.Dryden(1.0, 500.0, 100.0, 9.0), {"alpha": "alpha"}, angle="deg"),
    "StateSpace with a schedule": lambda: StateSpace(
        [[0.9]], R=[[1.0]], dt=1, schedule={"speed": {"at": [1.0, 2.0], "A": [[[0.9]], [[0.8]]]}}
    ),
    "StateSpace with a disturbance": lambda: es.markov_disturbance(DRIVEN, time_constant=0.5, density=1.0),
    "ModelUncertainty": lambda: es.ModelUncertainty(A=[[0.1]]),
    "Mixture": lambda: MIXED,
    "Members": lambda: MIXED.init(PRIOR),
    "BatchGain": lambda: es.batch_gain(
        UnknownGain(DRIVEN, Prior([1.0], [[1.0]])), Record([0.0, 1.0], [1.0, 1.0], dt=1), prior=Prior([0.0], [[1.0]])
    ),
    "StateSpace continuous": lambda: StateSpace([[-1.0]], dt=0).discretise(0.1, hold="first_order"),
    "OperatingPoint": lambda: MODEL.operating_point,
    "Prior": lambda: PRIOR,
    "Record": lambda: RECORD,
    "Record with gaps": lambda: GAPS,
    "Record cut": lambda: GAPS[5:],
    "Outputs": lambda: FILTERED.outputs(),
    "Log": lambda: es.Log([es.Topic("imu", [0, 4], 1e-3, {"gx": [0.0, np.nan]}, {"gx": "rad/s"}, "boot")], notes=["all"]),
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
    "Estimate that failed": lambda: RUNAWAY,
    "Origin": lambda: estimate(GAIN, RECORD, prior=PRIOR).origin,
    "SmoothedEstimate": lambda: smooth(Kalman(MODEL), RECORD, prior=PRIOR),
    "Forecast": lambda: forecast(estimate(GAIN, RECORD, prior=PRIOR), U[:2]),
    "NoiseFit": lambda: NoiseFit(GAIN, np.ones(1), np.eye(1), -3.0, ("R[y1]",), (), 4),
    "Info": lambda: estimate(Kalman(MODEL), RECORD, prior=PRIOR).info,
    "EstimateBank": lambda: estimate_bank(Kalman(MODEL), [RECORD, RECORD], prior=PRIOR),
    "Simulation": lambda: simulate(MODEL, U, seed=1),
    "Stacked": lambda: stack([PRIOR, PRIOR]),
    "Stacked algorithms": lambda: stack([GAIN, GAIN]),
    "Stacked estimates": lambda: stack([FILTERED, FILTERED]),
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
    "Remembered": lambda: es.Tracking(1, 0).init(),
    "MinimumVariance": lambda: es.MinimumVariance(1, 1),
    "InstrumentalVariables": lambda: es.InstrumentalVariables(1, 1, offset=True),
    "PredictionError": lambda: es.PredictionError(1, 0, 1, delay=1),
    "PredictorSubspace": lambda: es.PredictorSubspace(2, weighting="pbsid", past=9, blocks=12),
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
    "ClosedLoop": lambda: CLOSED,
    "ClosedLoopBank": lambda: CLOSED_BANK,
    "Dither": lambda: es.Dither(LAW, amplitude=0.5, period=4, sigma=0.1),
    "StructuralIdentifiability": lambda: es.structural_identifiability(CURVED, points=1),
    "SensorSelection": lambda: es.sensor_selection(SEEN, prior=Prior(np.zeros(SEEN.n), np.eye(SEEN.n)), choose=1, horizon=3),
    "Remedy": lambda: es.results.Remedy("half the noise of y1", np.ones(2), np.array([np.nan, 1.0])),
    "KalmanGain": lambda: es.kalman_gain(MODEL),
    "FeedbackGain": lambda: es.lqr_gain(MODEL, np.eye(2), [[1.0]]),
    "Estimability": lambda: es.estimability(SEEN),
    "CovarianceAnalysis": lambda: es.covariance_analysis(SEEN, prior=Prior(np.zeros(SEEN.n), np.eye(SEEN.n)), horizon=3),
    "Regulability": lambda: es.regulability(DRIVEN, [[1.0]], [[1.0]], horizon=3),
    "Observability": lambda: es.observability(SEEN),
    "Reachability": lambda: es.reachability(MODEL),
    "Reduction": lambda: es.reduce(SEEN),
    "GainInformation": lambda: es.gain_information(MODEL, U, state=Prior([0.0, 0.0], np.eye(2)), gain=Prior([1.0], [[1.0]])),
    "Score": lambda: es.score(Kalman(MODEL), RECORD, prior=Prior([0.0, 0.0], np.eye(2)), with_respect_to=["R[y1]"]),
    "Trust": lambda: es.trust(
        UnknownGain(replace(MODEL, R=MODEL.R / 9), Prior([1.0], [[1.0]])), RECORD, prior=Prior([0.0, 0.0], np.eye(2))
    )._replace(suspects=(Suspect(WRONG, 0.1, 0.02, 5.0),), untestable=(Untestable(WRONG, "gain", -1.0, -0.1),)),
    "Gap": lambda: es.results.Gap(1, 3, 0.1, 0.2, "bridge"),
    "Gaps": lambda: es.Gaps("bridge"),
    "GainAssessment": lambda: es.results.GainAssessment(
        FILTERED, MIXED, UnknownGain(MODEL, Prior([1.0], [[1.0]])), es.results.Trust("believe", 0.5, {"size": 0.5}), LEAST,
        None, ("as given",), (es.results.GainRow("gain", 1.0, 0.1, 0.7, 0.1, (3.0,), True, True, "lost"),),
    ),
    "DeadTime": lambda: es.dead_time(RECORD, most=2),
    "UnknownInputExistence": lambda: es.unknown_input_existence(MODEL, unknown=["δ"], seen=np.ones((4, 2))),
    "UnknownInputExistence not": lambda: es.unknown_input_existence(SEEN, unknown=["u1"]),
    "LossTolerance": lambda: es.loss_tolerance(UNSTABLE),
    "ArrivalCovariance": lambda: es.loss_tolerance(UNSTABLE).at(0.3),
    "RhoMargin": lambda: es.rho_margin(MODEL.A, dt=0.1),
    "Perturbed": lambda: es.rho_margin(MODEL.A, dt=0.1).perturbed(0.01, 1.0),
    "StabilityRadius": lambda: es.stability_radius(MODEL.A, dt=0.1),
    "RhoSynthesis": lambda: SYNTHESIS,
    "Optimum": lambda: SYNTHESIS.optima["rho"],
    "TransKalman": lambda: es.trans_kalman(DRIVEN, noises=[([[0.1]], [[1.0]]), ([[10.0]], [[1.0]])]),
    "DisturbanceAccommodation": lambda: es.disturbance_accommodation(
        DRIVEN, es.Waveform.constant(), through=[[2.0]], L=[[1.0]], M=[[1.0]]
    ),
    "TrackerChoices": lambda: es.alpha_beta_choices(dt=1, sigma_a2=1, sigma_s2=1),
    "DesignFamily": lambda: es.DesignFamily([[1.0]], Q0=[[0.0]], Q1=[[1.0]]),
    "Waveform": lambda: es.Waveform.ramp(),
    "Trend": lambda: es.Trend.of(RECORD, 1),
    "Excitation": lambda: es.excitation(PLANT, MEASURED),
    "OrderSelection": lambda: es.select_order(MEASURED),
    "OrderRanking": lambda: es.choose_orders(MEASURED, na=(1,), nb=(0, 1)),
    "Comparison": lambda: es.compare([es.LeastSquares(1, 0), es.MarkovParameters(200)], MEASURED),
    "Fit of a state space": lambda: es.identify(es.Subspace(1), MEASURED),
    "Fit by Ho-Kalman": lambda: es.identify(es.HoKalman(1), MEASURED),
    "Fit with what is undetermined": lambda: es.identify(es.LeastSquares(1, 1), Record(np.ones(50), np.zeros(50), dt=1)),
    "MonteCarlo": lambda: es.monte_carlo(
        Kalman(DRIVEN), es.drawn_from(DRIVEN, np.ones(4)), prior=LOOP["prior"], runs=3, seed=1,
        summary=lambda drawn, estimate: {"error": estimate.mean[-1, 0] - drawn.state[-1, 0]},
    ),
    "LoopCase": lambda: es.LoopCase(DRIVEN, LAW, Kalman(DRIVEN), reference=np.ones(5), prior=LOOP["prior"]),
    "ModelFile": lambda: es.read_model(es.packaged.path("f16-model.toml")),
    "Delivery": lambda: DelayLink([0.5, 0.3]).send(DelayLink([0.5, 0.3]).init(), np.array([1.0]), np.array([0.6]))[1],
    "Sample": lambda: es.results.Sample(np.ones(2), np.array([True, False]), np.zeros(1)),
    "Interval": lambda: es.results.Interval(np.zeros(1), np.zeros(1), None, 0.1),
    "Check": lambda: es.results.Check("whiteness", np.bool_(True), np.float64(0.5), 1.0, "The residuals are white."),
    "SecondOrder": lambda: es.Phasor.second_order(0.0, -1.0, 0.5),
    "InnovationChecks": lambda: es.diagnostics.check_innovations(FILTERED_LONG, LONG),
    "Consistency": lambda: es.diagnostics.nis(FILTERED.innovation, FILTERED.innovation_covariance),
    "Correlations": lambda: es.diagnostics.whiteness(LONG.y[:, 0]),
    "Feedback": lambda: es.diagnostics.feedback(LONG),
    "DetectedChange": lambda: es.diagnostics.DetectedChange("gain", 4, 8, None, None, 1.0, 0.5, 0.01, 1.5, None),
    "Efficiency": lambda: es.diagnostics.efficiency(np.ones((4, 2)), np.stack([np.eye(2)] * 4)),
    "Nonlinearity": lambda: es.diagnostics.nonlinearity(CURVED, BENT, TWO_ROWS),
    "Roots": lambda: es.diagnostics.poles(FITTED),
    "Response": lambda: es.diagnostics.step_response(FITTED, 3),
    "FrequencyResponse": lambda: es.diagnostics.frequency_response(FITTED, [0.0, 0.1]),
    "Spread": lambda: es.diagnostics.spread_of(FITTED),
    "Flight": lambda: es.plants.f16.flight(0.5, seed=1),
    "Failed": lambda: es.plants.f16_failure.Failed(np.arange(5.0), np.ones(5), CLOSED_BANK, CLOSED_BANK),
    "Flown": lambda: es.plants.f16_in_jsbsim.Flown(CLOSED, CLOSED, CLOSED),
    "records in a list, with numbers that are not finite": lambda: [RECORD, {"a": (np.nan, -np.inf), ("b", 1): np.float64(0.5)}],
}  # fmt: skip


FUNCTIONS = {  # records that no file can hold, for they hold functions of the user's
    "NonlinearModel": lambda: CURVED,
    "AdaptiveIdentification": lambda: es.AdaptiveIdentification(DECAY, Prior([0.0], [[1.0]])),
}
SIDES = {"u": es.Actuator(5.0, limits=(-1.0, 1.0), rate=2.0, delay=0.1, floats_to=0.5)}
WORLD = StateSpace([[-1.0]], [[1.0]], R=[[1.0]], dt=0, states=["x"], inputs=["u"], outputs=["y"])
EVENTS = [
    es.Failure(1.0, 0.5, "u"), es.Stuck(2.0, "u", 0.3), es.Floating(3.0, "u"), es.HardOver(4.0, "u", 1.0),
    es.Offset(5.0, "u", 0.1), es.ActuatorChange(6.0, "u", limits=(-0.5, 0.5)), es.Upset(7.0, {"x": 1.0}, 8.0),
    es.Gust(8.0, 1.0, 0.5), es.SensorFault(9.0, "y", "frozen"),
]  # fmt: skip


def commanded():
    """An online run of an algorithm that moves actuators."""
    running = es.online(es.Actuated(Kalman(StateSpace([[0.9]], [[1.0]], R=[[1.0]], dt=0.1, inputs=["u"])), SIDES),
                        prior=es.Prior([0.0], [[1.0]]))  # fmt: skip
    running.correct([0.0])
    running.predict([1.0])
    return running.progress


THINGS |= {
    "Actuated": commanded,
    "ControlledPlant with events": lambda: es.ControlledPlant(WORLD, actuator=SIDES, position_sigma=0.1, events=EVENTS),
}
WITHIN_ONE_CALL = {  # records that a driver or a step makes and uses up: no user gets one to save
    "About", "Along", "Assessment", "Awaited", "Backward", "Backwards", "ByRow", "Chain", "ControlLoop", "Decided",
    "DrawnRecord", "Forward", "Functions", "Judging", "KnownJumps", "LoopInputs", "LoopState", "Matrices", "Merging",
    "Motion", "Moved", "PassInfo", "PassedRow", "Piece", "Reordered", "Replayed", "Reported", "Responding", "Restarting",
    "SampledModel", "Sensed", "Sloped", "SmootherRows", "Steps", "Stretch", "Tangents", "UncertainInputStep",
    "UnknownInputs", "WindowRow",
}  # fmt: skip


@pytest.mark.parametrize("name", THINGS)
def test_what_is_saved_comes_back_to_the_last_bit(same, tmp_path, name):
    thing = THINGS[name]()
    save(tmp_path / "thing.npz", thing)
    back = load(str(tmp_path / "thing.npz"))
    same(back, thing)


def is_record(cls):
    return isinstance(cls, type) and (dataclasses.is_dataclass(cls) or hasattr(cls, "_fields"))


def records_in(thing):
    """The classes of all records in a thing."""
    if is_record(type(thing)):
        yield type(thing)
        for name in field_names(type(thing)):
            yield from records_in(getattr(thing, name))
    elif isinstance(thing, tuple | list | dict):
        for item in thing.values() if isinstance(thing, dict) else thing:
            yield from records_in(item)


def records_of(hint):
    """The records that an annotation names."""
    if is_record(hint):
        yield hint
    for inner in typing.get_args(hint):
        yield from records_of(inner)


def public_records():
    """Every record that a user can name, or is given by a public function."""
    for thing in [getattr(room, name) for room in (es, es.results, es.diagnostics, es.plants) for name in room.__all__]:
        given = thing if isinstance(thing, type) or not callable(thing) else typing.get_type_hints(thing).get("return")
        yield from records_of(given)


def fields_of(cls):
    """The records that the fields of a record name."""
    hints = typing.get_type_hints(cls)
    return {inner for name in field_names(cls) for inner in records_of(hints[name])}


def test_every_public_record_is_saved_above_or_cannot_be():
    for module in pkgutil.walk_packages(es.__path__, "estimable."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    tried = {cls for thing in THINGS.values() for cls in records_in(thing())}
    public = set(public_records())
    assert len(public) > 80
    assert names(public - tried) == set(FUNCTIONS)
    within = set().union(*map(fields_of, public | tried))
    assert names(within - tried) - set(FUNCTIONS) == {"Chain", "SampledModel"}  # in an algorithm while a driver runs it
    assert set(RECORDS) - names(tried) == WITHIN_ONE_CALL | set(FUNCTIONS)


def names(classes):
    return {cls.__name__ for cls in classes}


def named(name, module):
    return type(name, (tuple,), {"__module__": module, "_fields": ("x",)})


def test_two_records_of_the_package_have_two_names():
    with pytest.raises(TypeError, match="both have a record Prior"):
        saved(named("Prior", "estimable.elsewhere"))
    saved(named("Prior", "mine"))  # not a record of the package
    assert RECORDS["Prior"] is Prior


@pytest.mark.parametrize("name", FUNCTIONS)
def test_what_holds_functions_is_refused(tmp_path, name):
    with pytest.raises(es.InputError) as caught:
        save(tmp_path / "thing.npz", FUNCTIONS[name]())
    where = "thing.f" if name == "NonlinearModel" else "thing.model.f"
    assert str(caught.value) == f"`thing` cannot be saved: {where} is a function, which a file cannot hold."
    assert not (tmp_path / "thing.npz").exists()


def test_a_run_that_failed_is_saved_with_what_is_not_finite():
    assert RUNAWAY.outcome.code == 1
    assert not np.isfinite(RUNAWAY.covariance).all()


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


def test_runs_are_saved_with_other_things(same, tmp_path):
    running = online(GAIN, prior=PRIOR)
    save(tmp_path / "thing.npz", {"run": running, "record": RECORD})
    back = load(tmp_path / "thing.npz")
    assert isinstance(back["run"], Online)
    same(back["run"].progress, running.progress)
    same(back["record"], RECORD)


@pytest.mark.parametrize("engine", ["native", "xla"])
def test_what_a_run_says_is_saved_as_an_info(same, tmp_path, engine):
    info = online(GAIN, prior=PRIOR, engine=engine).correct(RECORD.y[0])
    save(tmp_path / "thing.npz", info)
    back = load(tmp_path / "thing.npz")
    assert type(back) is es.results.Info
    same(back.covariance, np.asarray(info.covariance))


def test_arrays_are_read_by_numpy_under_the_names_of_their_fields(tmp_path):
    save(tmp_path / "thing.npz", {"δ.f": FILTERED, "δ": {"f": PRIOR}})
    with np.load(tmp_path / "thing.npz") as file:
        assert file["thing[δ.f].info.mean"].tobytes() == FILTERED.mean.tobytes()
        assert file["thing[δ][f].mean"].tobytes() == PRIOR.mean.tobytes()


def test_entries_that_would_have_one_name_are_kept_apart(same, tmp_path):
    thing = {"a b": np.ones(1), "a-b": np.zeros(1), "a?b": np.ones(2)}
    save(tmp_path / "thing.npz", thing)
    same(load(tmp_path / "thing.npz"), thing)


LOADS = "import sys, estimable; before = set(sys.modules); print(type(estimable.load(sys.argv[1])).__name__); "
SHOWS = "print(*sorted(name for name in set(sys.modules) - before if name.startswith('estimable.')))"


@pytest.mark.parametrize(
    ("thing", "rooms"),
    [(PRIOR, {"models"}), (LAW, {"controllers"}), (FILTERED, {"models", "filters", "kernels"})],
)
def test_a_fresh_process_loads_the_modules_of_what_is_in_the_file_and_no_others(tmp_path, thing, rooms):
    save(tmp_path / "thing.npz", thing)
    call = [sys.executable, "-c", LOADS + SHOWS, str(tmp_path / "thing.npz")]
    name, loaded = subprocess.run(call, capture_output=True, text=True, check=True).stdout.splitlines()
    assert name == type(thing).__name__
    found = {module.split(".")[1] for module in loaded.split()}
    assert found >= rooms
    assert not found & {"estimation", "identification", "simulation", "identifiers", "analysis", "catalogue", "plants"}


def test_nothing_in_a_file_is_a_pickle(tmp_path):
    save(tmp_path / "thing.npz", GAPS)
    with np.load(tmp_path / "thing.npz", allow_pickle=False) as file:
        assert all(file[name].dtype != object for name in file.files)
