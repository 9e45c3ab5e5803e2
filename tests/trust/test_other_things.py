"""Something else than a record, a model, a fit, a link, a name, a folder or a number gets a sentence, before any work."""

import re

import numpy as np
import pytest

import estimable as es
from estimable import checks, diagnostics
from estimable.analysis.reduction import reduce
from estimable.data.trends import Trend
from estimable.design.families import DesignFamily
from estimable.design.waveforms import Waveform
from estimable.identifiers.phasor import Phasor
from estimable.models.output_error import OutputError
from estimable.models.uncorrelated import uncorrelated
from estimable.plants import f16
from estimable.results import MonteCarlo
from estimable.simulation.parts import Folder

U = np.random.default_rng(0).normal(size=30)
RECORD = es.Record(U**2, U, dt=1)
PLANT = OutputError([-0.5], [1.0], noise_variance=0.1, dt=1)
MODEL = es.StateSpace([[0.9]], [[1.0]], [[1.0]], Q=[[0.1]], R=[[0.1]], dt=1)
PRIOR = es.Prior([0.0], [[1.0]])
FIT = es.identify(es.LeastSquares(1, 0), RECORD)
RESULT = es.estimate(es.Kalman(MODEL), RECORD, prior=PRIOR)
TREND = Trend.of(RECORD)
LAW = es.StateFeedback([[0.5]], reference_gain=[[0.5]])
RUNS = MonteCarlo({"error": np.zeros(3)}, np.zeros(3, bool), 0, "xla")
GRID = np.eye(2)
CURVED = es.NonlinearModel(lambda x, u, θ: -θ * x + u, lambda x, u, θ: x, Q=[[0.1]], R=[[1.0]], dt=1, inputs=["u"],
                           parameters={"θ": 0.5})  # fmt: skip


def fly(**given):
    return es.close_loop(MODEL, LAW, es.Kalman(MODEL), **{"reference": np.ones(5), "seed": 0, "prior": PRIOR, **given})


def many(**given):
    case = es.LoopCase(MODEL, LAW, es.Kalman(MODEL), reference=np.ones(5), prior=PRIOR)
    summary = lambda closed: {"end": closed.state[-1, 0]}  # noqa: E731
    return es.monte_carlo_loops(case, **{"runs": 2, "seed": 0, "summary": summary, **given})


def draws(**given):
    draw, summary = es.drawn_from(MODEL, np.zeros(5)), lambda drawn, found: {"error": 0.0}
    return es.monte_carlo(es.Kalman(MODEL), draw, **{"prior": PRIOR, "runs": 2, "seed": 0, "summary": summary, **given})


SENTENCES = {
    "information of no model": (
        lambda: diagnostics.information("x", RECORD),
        "`model` must be an OutputError. Got 'x'.",
    ),
    "cramer_rao of no record": (lambda: diagnostics.cramer_rao(PLANT, [1.0]), "`record` must be a Record. Got [1.0]."),
    "efficient_estimate of neither": (
        lambda: diagnostics.efficient_estimate(1, 2),
        "`model` must be an OutputError. Got 1.\n`record` must be a Record. Got 2.",
    ),
    "efficiency of text": (
        lambda: diagnostics.efficiency("x", np.ones((1, 1, 1))),
        "`error` must be an array of real numbers. Got 'x'.",
    ),
    "efficiency of no bound": (
        lambda: diagnostics.efficiency([[1.0]], [[[0.0]]]),
        "`bound` must be positive definite in every run.",
    ),
    "nis of text": (lambda: diagnostics.nis("x", [[[1.0]]]), "`innovation` must be an array of real numbers. Got 'x'."),
    "standardised of text": (
        lambda: diagnostics.standardised([[1.0]], "x"),
        "`innovation_covariance` must be an array of real numbers. Got 'x'.",
    ),
    "whiteness of text": (lambda: diagnostics.whiteness("x"), "`e` must be an array of real numbers. Got 'x'."),
    "check_innovations of no lags": (
        lambda: diagnostics.check_innovations(RESULT, RECORD, lags=GRID),
        "`lags` must be an integer of at least 1. Got an array of shape (2, 2) and dtype float64.",
    ),
    "check_innovations of no result": (
        lambda: diagnostics.check_innovations(None, RECORD),
        "`result` must be an Estimate. Got None.",
    ),
    "spread_of no fit": (lambda: diagnostics.spread_of("x"), "`fit` must be a Fit. Got 'x'."),
    "poles of no fit": (lambda: diagnostics.poles([1]), "`fit` must be a Fit. Got [1]."),
    "zeros of no output": (lambda: diagnostics.zeros(FIT, output=3), "`output` must be at most 0. Got 3."),
    "frequency_response at no frequency": (
        lambda: diagnostics.frequency_response(FIT, ["a"]),
        "`frequencies` must be an array of real numbers. Got ['a'].",
    ),
    "frequency_response at a grid": (
        lambda: diagnostics.frequency_response(FIT, GRID),
        "`frequencies` must be (K,), in hertz. Got (2, 2).",
    ),
    "step_response without end": (
        lambda: diagnostics.step_response(FIT, 10**9),
        "`steps` must be at most 100000. Got 1000000000.",
    ),
    "step_response of no steps": (
        lambda: diagnostics.step_response(FIT, "x"),
        "`steps` must be an integer of at least 0. Got 'x'.",
    ),
    "simulation_sigma of other inputs": (
        lambda: diagnostics.simulation_sigma(FIT, np.ones((3, 2)), [0.0]),
        "`u` must be (T, 1). Got (3, 2).",
    ),
    "nonlinearity of no record": (
        lambda: diagnostics.nonlinearity(CURVED, RESULT, "x"),
        "`record` must be a Record. Got 'x'.",
    ),
    "excitation of no model": (lambda: es.excitation(1.0, RECORD), "`model` must be an OutputError. Got 1.0."),
    "positive_real_margin of no model": (
        lambda: es.positive_real_margin(None),
        "`model` must be an OutputError. Got None.",
    ),
    "uncorrelated of no model": (lambda: uncorrelated("x"), "`model` must be a StateSpace. Got 'x'."),
    "reduce by no method": (
        lambda: reduce(MODEL, method=GRID),
        "`method` must be one of 'output_process', 'minimal', 'balanced'. Got an array of shape (2, 2) and dtype float64.",
    ),
    "trend of no record": (lambda: Trend.of(1.0), "`records` must be a Record, or a list of them. Got 1.0."),
    "trend of degree": (
        lambda: Trend.of(RECORD, GRID),
        "`degree` must be 0 (levels) or 1 (straight lines). Got an array of shape (2, 2) and dtype float64.",
    ),
    "trend of other channels": (
        lambda: Trend.of([RECORD, es.Record(U, dt=1)]),
        "all `records` must have the same channels. Got (inputs, outputs) = (0, 1), (1, 1).",
    ),
    "no trend of no record": (lambda: Trend.none("x"), "`record` must be a Record. Got 'x'."),
    "trend from no record": (lambda: TREND.taken_from([1]), "`record` must be a Record. Got [1]."),
    "trend from another record": (
        lambda: TREND.taken_from(es.Record(U, dt=1)),
        "`record` must have the channels of the trend, 1 input and 1 output. Got 0 and 1.",
    ),
    "model of no order": (
        lambda: OutputError.of_parameters([1.0], na="x", nb=0, noise_variance=0.1, dt=1),
        "`na` must be an integer of at least 0. Got 'x'.",
    ),
    "model of too few parameters": (
        lambda: OutputError.of_parameters([1.0], na=1, nb=0, noise_variance=0.1, dt=1),
        "`parameters` must be (d,) = (2,): na = 1, nb = 0, 1 input, 1 output. Got (1,).",
    ),
    "family at no number": (
        lambda: DesignFamily([[1.0]], Q1=[[1.0]]).at([1.0]),
        "`eta` must be a finite number. Got [1.0].",
    ),
    "family of no model": (lambda: DesignFamily.approach("x"), "`model` must be a StateSpace. Got 'x'."),
    "error family of no model": (lambda: DesignFamily.approach_of_error(1), "`model` must be a StateSpace. Got 1."),
    "each of no waveform": (
        lambda: Waveform.each(Waveform.ramp(), "x"),
        "`waveforms[1]` must be a Waveform. Got 'x'.",
    ),
    "each of none": (lambda: Waveform.each(), "`each` needs at least one waveform."),
    "sum of no waveform": (lambda: Waveform.ramp() + 1, "`other` must be a Waveform. Got 1."),
    "gains of no choice": (
        lambda: es.alpha_beta_gains(["kalata"]),
        "`choice` must be one of 'least_worst', 'kalata', 'benedict_bordner', 'critically_damped'. Got ['kalata'].",
    ),
    "tracker covariance beyond floats": (
        lambda: es.alpha_beta_covariance(0.5, 0.1, dt=1e-300, sigma_a2=1.0, sigma_s2=1.0),
        "the covariance is not finite for `dt` = 1e-300 s and these densities: choose other units.",
    ),
    "sensors of no size": (lambda: f16.short_period(sigma_q=[1]), "`sigma_q` must be a finite number. Got [1]."),
    "loop of no gain": (lambda: f16.closed_loop([1.0]), "`gain` must be a finite number. Got [1.0]."),
    "law of no flag": (
        lambda: f16.law(integral=GRID),
        "`integral` must be True or False. Got an array of shape (2, 2) and dtype float64.",
    ),
    "flight of no seed": (lambda: f16.flight(0.5, seed="x"), "`seed` must be an integer of at least 0. Got 'x'."),
    "flight of no time": (
        lambda: f16.drawn_flight(0.5, failure_time="x"),
        "`failure_time` must be a finite number of seconds. Got 'x'.",
    ),
    "phasor of no frequencies": (
        lambda: Phasor(1, ...),
        "`frequencies` must be an array of real numbers. Got Ellipsis.",
    ),
    "second order of no number": (
        lambda: Phasor.second_order([0.0], -1.0, 1.0),
        "`in_phase` must be a finite number. Got [0.0].",
    ),
    "unknown inputs of no method": (
        lambda: es.UnknownInput(MODEL, unknown=["u1"], method=GRID),
        "`method` must be one of 'auto', 'feedthrough', ",
    ),
    "unknown inputs of no name": (
        lambda: es.UnknownInput(MODEL, unknown=1j),
        "`unknown` must be a list of input names or columns. Got 1j.",
    ),
    "parameters that are no prior": (
        lambda: es.AdaptiveIdentification(CURVED, PRIOR, parameters=[1.0]),
        "`parameters` must be a Prior. Got [1.0].",
    ),
    "a million orders": (lambda: es.LeastSquares(10**6, 0), "`na` must be at most 10000. Got 1000000."),
    "a subspace of a million": (lambda: es.Subspace(10**6), "`order` must be at most 10000. Got 1000000."),
    "orders beyond the record": (
        lambda: es.identify(es.OutputErrorML(3000, 0), RECORD),
        "a model with na = 3000, nb = 0 and delay = 0 reaches 3000 rows back, but the longest record has 30: lower the orders.",
    ),
    "a recursion beyond the record": (
        lambda: es.identify(es.RecursiveOutputError(0, 100, noise_variance=0.1), RECORD),
        "a model with na = 0, nb = 100 and delay = 0 reaches 100 rows back, but the longest record has 30: lower the orders.",
    ),
    "a change sought without end": (
        lambda: es.ChangeDetection(es.UnknownGain(MODEL, es.Prior([1.0], [[0.0]])), jump=1.0, slots=10**9),
        "`slots` must be at most 10000. Got 1000000000.",
    ),
    "a horizon without end": (
        lambda: es.estimability(MODEL, horizon=10**9),
        "`horizon` may be at most 200000 steps with 1 state. Got 1000000000.",
    ),
    "iterations without end": (
        lambda: es.ExtendedKalman(CURVED, iterations=10**9),
        "`iterations` must be at most 100. Got 1000000000.",
    ),
    "a delay without end": (
        lambda: OutputError([-0.5], [1.0], delay=10**9, noise_variance=0.1, dt=1),
        "`delay` must be at most 10000. Got 1000000000.",
    ),
    "family beyond floats": (
        lambda: DesignFamily([[1.0]], Q1=[[1.0]]).at(1e300),
        "`eta` must be at most 1e+100. Got 1e+300.",
    ),
    "tracker choices beyond floats": (
        lambda: es.alpha_beta_choices(dt=1e300, sigma_a2=1.0, sigma_s2=1.0),
        "the tracking index dt² (sigma_a2 / sigma_s2)^½ is inf: choose other units.",
    ),
    "responses without rows": (
        lambda: es.MarkovParameters(3, weighting="best", noise_covariance=np.zeros((1, 0))),
        "`noise_covariance` must begin with variances greater than 0. Got [].",
    ),
    "identification from no start": (
        lambda: es.AdaptiveIdentification(CURVED, PRIOR, start=GRID),
        "`start` must be one of ",
    ),
    "tracking by no law": (
        lambda: es.Tracking(1, 0, law=GRID),
        "`law` must be one of ",
    ),
    "moments between no samples": (
        lambda: es.SecondOrderKalman(CURVED, between=GRID),
        "`between` must be one of ",
    ),
    "events in a buffer": (
        lambda: es.ControlledPlant(MODEL, events=memoryview(GRID)),
        "`events` must be a list of Failure(time, gain), Stuck(time, input) and other events. Got <memory at",
    ),
    "the same fault of many orders": (
        lambda: es.select_order(RECORD, orders="x" * 900),
        "`orders` must be an integer of at least 1. Got 'x'.",
    ),
    "many different faults": (
        lambda: es.select_order(RECORD, orders=[f"order {i}" for i in range(900)]),
        "`orders` must be an integer of at least 1. Got 'order 0'.",
    ),
    "orders in a buffer": (
        lambda: es.select_order(RECORD, delays=memoryview(GRID)),
        "`delays` must be an integer of at least 0. Got <memory at",
    ),
    "a long string for names": (
        lambda: es.StateSpace([[0.9]], dt=1, states="x" * 5000),
        "`states` must be a list of names. Got the string 'xxxx",
    ),
    "names that are one number": (
        lambda: es.StateSpace([[0.9]], dt=1, states=np.array(1.0)),
        "`states` must be a list of names, in order. Got an array of shape () and dtype float64.",
    ),
    "a delay beyond floats": (
        lambda: es.Trace(10**400),
        "`delay` must be (T, c): 0 if in time, an integer number of steps if late, infinite if lost.",
    ),
    "a response to rows of two lengths": (
        lambda: PLANT.response([[1.0], [1.0, 2.0]]),
        "`u` must be an array of real numbers. Got [[1.0], [1.0, 2.0]].",
    ),
    "a nonlinear model without a size": (
        lambda: es.NonlinearModel(CURVED.f, CURVED.h, Q=[[0.1]], R=[[1.0]], dt=1, states=4.0),
        "`states` must be a list of names, in order. Got 4.0.",
    ),
    "a walk of two lengths": (
        lambda: es.SecondOrderKalman(CURVED, parameters=PRIOR, walk=[[1.0], [1.0, 2.0]]),
        "`walk` must be an array of real numbers. Got [[1.0], [1.0, 2.0]].",
    ),
    "a reference of two lengths": (
        lambda: fly(reference=[[1.0], [1.0, 2.0]]),
        "`reference` must be an array of real numbers. Got [[1.0], [1.0, 2.0]].",
    ),
    "a gain of two lengths": (
        lambda: es.Failure(1.0, [[1.0], [1.0, 2.0]]),
        "`gain` must be an array of real numbers. Got [[1.0], [1.0, 2.0]].",
    ),
    "a noise variance of two lengths": (
        lambda: OutputError([-0.5], [1.0], noise_variance=[[1.0], [1.0, 2.0]], dt=1),
        "`noise_variance` must be an array of real numbers. Got [[1.0], [1.0, 2.0]].",
    ),
    "limits of two lengths": (
        lambda: es.ControlledPlant(MODEL, limits=[[1.0], [1.0, 2.0]]),
        "`limits` must be an array of real numbers. Got [[1.0], [1.0, 2.0]].",
    ),
    "an amplitude of two lengths": (
        lambda: es.Dither(LAW, amplitude=[[1.0], [1.0, 2.0]], period=4, sigma=0.1),
        "`amplitude` must be an array of real numbers. Got [[1.0], [1.0, 2.0]].",
    ),
    "a delay of two lengths": (
        lambda: es.BernoulliLink([[1.0], [1.0, 0.5]]),
        "`arrival` must be an array of real numbers. Got [[1.0], [1.0, 0.5]].",
    ),
    "a link of another number of outputs": (
        lambda: es.simulate(PLANT, U, seed=0, output_link=es.BernoulliLink([0.5, 0.5])),
        "`output_link` must carry 1 output: its settings need one number, or one for each.",
    ),
    "a link of another number of inputs": (
        lambda: fly(input_link=es.Trace(np.zeros((5, 3)))),
        "`input_link` must carry 1 input: its settings need one number, or one for each.",
    ),
    "errors whose squares overflow": (
        lambda: diagnostics.nis([[1e300]], [[[1.0]]]),
        "the squared errors, relative to their covariances, overflow: no covariance explains such errors.",
    ),
    "weights that vary without a horizon": (
        lambda: es.regulability(MODEL, np.ones((3, 1, 1)), [[1.0]]),
        "`L` varies over 3 rows: give a discrete model and a `horizon` of at most these steps.",
    ),
    "weights that vary over fewer rows than the horizon": (
        lambda: es.regulability(MODEL, [[1.0]], np.ones((3, 1, 1)), horizon=5),
        "`M` varies over 3 rows: give a discrete model and a `horizon` of at most these steps.",
    ),
    "packets and a grid for the hold": (
        lambda: es.Record(U, U, dt=1, arrived=np.ones(30), hold=np.zeros(2)),
        "`hold` must be one of 'zero_order', 'first_order'.",
    ),
    "excitation without noise": (
        lambda: es.excitation(OutputError([-0.5], [1.0], noise_variance=0.0, dt=1), RECORD),
        "`model` must have a noise variance greater than 0: without noise the information is infinite.",
    ),
    "false alarms without a time": (
        lambda: es.AdaptiveIdentification(CURVED, PRIOR, seconds_between_false_alarms=[[1.0]]),
        "`seconds_between_false_alarms` must be a finite number. Got [[1.0]].",
    ),
    "orders that are bytes": (
        lambda: es.choose_orders(RECORD, na=b"a"),
        "`na` must be an integer of at least 0. Got b'a'.",
    ),
    "no law and no quantities": (
        lambda: es.GainReconfiguration(-1, allocation=[[1.0]]),
        "`controller` must be",
    ),
    "a nonlinear model without a state": (
        lambda: es.NonlinearModel(CURVED.f, CURVED.h, Q=[[0.1]], R=[[1.0]], dt=1, states=[]),
        "`states` must name at least one state.",
    ),
    "information of inputs beyond squares": (
        lambda: es.gain_information(MODEL, [[1.0], [1e300]]),
        "`u` must hold numbers of at most 1e+150, whose squares are finite.",
    ),
    "orders of no number": (
        lambda: es.select_order(RECORD, orders=[GRID]),
        "`orders` must be an integer of at least 1. Got an array of shape (2, 2) and dtype float64.",
    ),
    "orders by the million": (
        lambda: es.choose_orders(RECORD, na=range(10**6)),
        "`na` must hold at most 1000 numbers to try.",
    ),
    "compare with no progress": (
        lambda: es.compare([es.LeastSquares(1, 0)], RECORD, progress=GRID),
        "`progress` must be a function: it is called with the name of a method, the number done and the total. Got an array",
    ),
    "fit_noise of no names": (
        lambda: es.fit_noise(es.Kalman(MODEL), RECORD, prior=PRIOR, free=GRID),
        "`free` must name covariances: 'Q', 'R', 'S'. Got an array of shape (2, 2) and dtype float64.",
    ),
    "fit_noise of no record": (
        lambda: es.fit_noise(es.Kalman(MODEL), "x", prior=PRIOR),
        "`record` must be a Record, or a list of them. Got 'x'.",
    ),
    "simulate at no step": (
        lambda: es.simulate(MODEL, U, seed=0, dt=GRID),
        "`dt` must be a finite number of seconds. Got an array of shape (2, 2) and dtype float64.",
    ),
    "simulate with no hold": (
        lambda: es.simulate(MODEL, U, seed=0, hold=GRID),
        "`hold` must be one of 'zero_order', 'first",
    ),
    "simulate a billion rows": (
        lambda: es.simulate(es.StateSpace([[0.9]], Q=[[0.1]], R=[[0.1]], dt=1), seed=0, steps=10**9),
        "`steps` must be at most 100000000. Got 1000000000.",
    ),
    "loop with no link": (
        lambda: fly(input_link={}),
        "`input_link` must be a link, such as BernoulliLink(0.8). Got {}.",
    ),
    "loops in no folder": (lambda: many(folder=re), "`folder` must be the name of a folder. Got <module 're'"),
    "loops in a folder of no name": (
        lambda: many(folder="a\0b"),
        "`folder` must be a writable folder. Got 'a\\x00b': a character that is not allowed in a name.",
    ),
    "loops with no progress": (lambda: many(progress=GRID), "`progress` must be True or False. Got an array"),
    "runs with no progress": (lambda: draws(progress=GRID), "`progress` must be True or False. Got an array"),
    "runs by the billion": (lambda: draws(runs=10**10), "`runs` must be at most 100000000. Got 10000000000."),
    "mean of no name": (lambda: RUNS.mean("erro"), "`name` must be 'error'. Got 'erro'. Did you mean 'error'?"),
    "sigma of no name": (lambda: RUNS.sigma([1]), "`name` must be 'error'. Got [1]."),
    "standard error of no name": (lambda: RUNS.standard_error(None), "`name` must be 'error'. Got None."),
    "dither of no model": (
        lambda: es.Dither.sized(LAW, 1, sigma=0.1, seconds=1.0, period=4, dt=0.1),
        "`model` must be a StateSpace. Got 1.",
    ),
    "dither without end": (
        lambda: es.Dither.sized(LAW, MODEL, sigma=0.1, seconds=1e12, period=4, dt=1),
        "`seconds` must be at most 100,000,000 samples of `dt`. Got 1e+12 s of 1 s.",
    ),
    "dither of no sizes": (
        lambda: es.Dither.sized(LAW, MODEL, sigma=0.1, seconds=9.0, period=4, dt=1, each=print),
        "`each` must be an array of real numbers. Got <built-in function print>.",
    ),
    "a path of no length": (lambda: checks.existing_file("x" * 5000), "x" * 300 + "... does not exist."),
    "names in a grid": (
        lambda: es.StateSpace([[0.9]], dt=1, states=memoryview(GRID)),
        "`states` must be a list of names, in order. Got <memory at",
    ),
}


@pytest.mark.parametrize("name", SENTENCES)
def test_other_things_get_a_sentence(name):
    call, sentence = SENTENCES[name]
    with pytest.raises(es.InputError, match="^" + re.escape(sentence)) as raised:
        call()
    assert len(str(raised.value)) <= 600


def test_a_folder_is_named_by_text_or_a_path(tmp_path):
    assert Folder(tmp_path / "a").path.is_dir()
    assert Folder(str(tmp_path / "b")).path.is_dir()


def test_of_very_many_faults_the_others_are_counted():
    with pytest.raises(es.InputError, match=r"There are \d+ more faults\.$"):
        SENTENCES["many different faults"][0]()


def test_orders_are_tried_from_one_integer_an_array_or_a_generator():
    assert es.select_order(RECORD, orders=1, delays=[0]).order == 1
    assert list(es.select_order(RECORD, orders=np.array([2, 1]), delays=np.array([0])).orders) == [1, 2]
    assert list(es.select_order(RECORD, orders=(n for n in (1, 2)), delays=0).orders) == [1, 2]
    assert es.choose_orders(RECORD, na=np.int8(1), nb=0).best.na == 1


def test_a_probability_is_any_number():
    exact = diagnostics.nis([[1.0]], [[[1.0]]], probability=0.99)
    assert diagnostics.nis([[1.0]], [[[1.0]]], probability=np.array(0.99)) == exact


def test_a_lag_beyond_the_record_uses_every_sample():
    whole = es.smooth(es.Kalman(MODEL), RECORD, prior=PRIOR)
    lagged = es.smooth(es.Kalman(MODEL), RECORD, prior=PRIOR, lag=10**9)
    np.testing.assert_allclose(lagged.mean, whole.mean, rtol=1e-9)
    assert (lagged.used == len(RECORD) - 1).all()
