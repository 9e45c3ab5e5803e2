"""What the drivers, the algorithms and the catalogue say of a wrong call, and of a run that failed."""

import sys

import numpy as np
import pytest

from estimable import (
    EstimableError,
    Kalman,
    Prior,
    Record,
    RunError,
    StateSpace,
    UnknownGain,
    catalogue,
    diagnostics,
    estimate,
    estimate_bank,
    online,
    plants,
    simulate,
    simulate_bank,
    stack,
)
from estimable.results import ModelFile

MODEL = StateSpace([[0.5]], [[1.0]], Q=[[0.1]], R=[[1.0]], dt=1, inputs=["u"], outputs=["y"])
CONTINUOUS = StateSpace([[-0.5]], [[1.0]], Q=[[0.1]], R=[[1.0]], dt=0, inputs=["u"], outputs=["y"])
NO_INPUT = StateSpace([[0.5]], Q=[[0.1]], R=[[1.0]], dt=1)
NO_NOISE = StateSpace([[0.5]], [[1.0]], dt=1, inputs=["u"], outputs=["y"])
OVER_TIME = StateSpace(np.full((3, 1, 1), 0.5), [[1.0]], R=[[1.0]], dt=1, inputs=["u"], outputs=["y"])
PRIOR, PRIOR2 = Prior([0.0], [[1.0]]), Prior([0.0, 1.0], np.eye(2))


def record(y=(1.0, 2.0, 3.0), u=(1.0, 1.0, 1.0), **given):
    return Record(y, u, **({"inputs": ["u"], "outputs": ["y"]} | ({} if "t" in given else {"dt": 1}) | given))


RECORD = record()
NO_TIME = Record([1.0, 2.0], [1.0, 1.0], inputs=["u"], outputs=["y"])
STACKED = stack([RECORD, RECORD])
KALMAN = (
    "`algorithm` must be an algorithm, such as Kalman(model), or your own class derived from estimable.Algorithm. "
    "Got {}."
)

ESTIMATES = {
    "a model": ((MODEL, RECORD, PRIOR), KALMAN.format("StateSpace")),
    "no algorithm": ((None, RECORD, PRIOR), KALMAN.format("NoneType")),
    "algorithms": (([Kalman(MODEL)], RECORD, PRIOR), KALMAN.format("list")),
    "stacked algorithms": ((stack([Kalman(MODEL)] * 2), RECORD, PRIOR), KALMAN.format("Stacked")),
    "an array": ((Kalman(MODEL), np.ones(3), PRIOR), "`record` must be a Record. Got ndarray."),
    "records": (
        (Kalman(MODEL), [RECORD], PRIOR),
        "`record` must be a Record. Got list. For several at once use estimate_bank.",
    ),
    "stacked records": (
        (Kalman(MODEL), STACKED, PRIOR),
        "`record` must be a Record. Got Stacked. For several at once use estimate_bank.",
    ),
    "no prior": ((Kalman(MODEL), RECORD, None), "`prior` must be a Prior of the state x[0]. Got NoneType."),
    "priors": (
        (Kalman(MODEL), RECORD, [PRIOR]),
        ("`prior` must be a Prior of the state x[0]. Got list. For several at once use estimate_bank."),
    ),
    "stacked priors": (
        (Kalman(MODEL), RECORD, stack([PRIOR, PRIOR])),
        ("`prior` must be a Prior of the state x[0]. Got Stacked. For several at once use estimate_bank."),
    ),
    "prior of another size": (
        (Kalman(MODEL), RECORD, PRIOR2),
        "`prior` must describe n = 1 states: `A` is 1 × 1. Got 2.",
    ),
    "no R": (
        (Kalman(NO_NOISE), RECORD, PRIOR),
        ("`R`, the covariance of the measurement noise, is needed here. For noise-free outputs give zeros."),
    ),
    "another step": (
        (Kalman(MODEL), record(dt=0.5), PRIOR),
        "the record's step is 0.5 s, the model's dt = 1 s: they must be equal.",
    ),
    "irregular": (
        (Kalman(MODEL), record(t=[0, 1, 2.5]), PRIOR),
        (
            "the record's steps vary from 1 to 1.5 s, but the model is discrete with dt = 1 s: give a "
            "continuous model (dt = 0), or insert rows of NaN where samples are missing."
        ),
    ),
    "first order, discrete": (
        (Kalman(MODEL), record(hold="first_order"), PRIOR),
        (
            'the record\'s input moves between samples (hold = "first_order"), but the model is discrete (dt '
            "= 1 s) and has no `B_end`: give the continuous model, or model.discretise(dt, "
            "hold='first_order')."
        ),
    ),
    "zero order, B_end": (
        (Kalman(CONTINUOUS.discretise(1, hold="first_order")), RECORD, PRIOR),
        (
            "the model was discretised for an input that moves between samples (it has `B_end`), but the "
            'record says hold = "zero_order".'
        ),
    ),
    "no time": (
        (Kalman(CONTINUOUS), NO_TIME, PRIOR),
        ("the model is continuous (dt = 0), but the record has no time: give it `dt` or `t`, in seconds."),
    ),
    "rows of time": (
        (Kalman(OVER_TIME), record([1.0, 2.0], [1.0, 1.0]), PRIOR),
        "the model varies over 3 rows of time, but the record has 2.",
    ),
    "fate unknown": (
        (Kalman(MODEL), record(arrived=[1, 0, np.nan]), PRIOR),
        (
            "input 'u' is unknown at u[2], row 3 of the record: it is NaN, or its arrival is unknown. This algorithm needs "
            "every input: fill in the input that the actuator applied, or cut the record there."
        ),
    ),
}


@pytest.mark.parametrize(("things", "sentence"), ESTIMATES.values(), ids=ESTIMATES)
def test_an_estimate_is_refused_with_what_does_not_fit(refused, things, sentence):
    algorithm, data, prior = things
    assert refused(lambda: estimate(algorithm, data, prior=prior)) == [sentence]


def test_every_argument_of_an_estimate_is_named_at_once(refused):
    found = refused(lambda: estimate(MODEL, [1.0], prior=None))
    assert [sentence.split("`")[1] for sentence in found] == ["algorithm", "record", "prior"]


def test_what_does_not_fit_is_named_at_once(refused):
    data = record(dt=0.5, outputs=["z"], hold="first_order")
    found = refused(lambda: estimate(Kalman(MODEL), data, prior=PRIOR2))
    assert [sentence[:30] for sentence in found] == [
        "the record has no output named",
        "`prior` must describe n = 1 st",
        "the record's input moves betwe",
        "the record's step is 0.5 s, th",
    ]


def test_options_are_refused_with_those_there_are(refused):
    found = refused(lambda: estimate(Kalman(MODEL), RECORD, prior=PRIOR, on_failure="stop", engine="gpu", keep="mean"))
    assert len(found) == 3
    assert found[0] == "`on_failure` must be one of 'raise', 'keep'. Got 'stop'."
    assert found[1].startswith("`engine` must be one of 'auto', 'native', 'xla'")
    assert found[2] == "`keep` must be one of 'all', 'means', 'last', 'likelihood'. Got 'mean'. Did you mean 'means'?"


def test_an_output_only_algorithm_is_not_given_an_unknown_input_by_accident(refused):
    missing = record(u=[1.0, np.nan, 1.0])
    (sentence,) = refused(lambda: estimate(UnknownGain(MODEL, PRIOR), missing, prior=PRIOR, gaps="refuse"))
    assert sentence.startswith("the input is unknown from row 0 to row 2 (t = 0 s, 2 s long): give gaps = ")


def test_a_result_without_rows_is_no_table(refused):
    result = estimate(Kalman(MODEL), RECORD, prior=PRIOR, keep="likelihood")
    assert refused(result.to_pandas) == [
        'this result has no rows, because it was made with keep="likelihood". Use keep="all".'
    ]


def test_a_result_without_rows_is_no_figure(refused):
    result = estimate(Kalman(MODEL), RECORD, prior=PRIOR, keep="likelihood")
    assert refused(result.plot) == [
        'this result has no rows to draw, because it was made with keep="likelihood". Use keep="all".'
    ]


def test_without_xarray_it_says_what_to_install(refused, monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    result = estimate(Kalman(MODEL), RECORD, prior=PRIOR)
    assert refused(result.to_xarray) == ["xarray is not installed: pip install 'estimable[xarray]'."]


UNSTABLE = StateSpace([[1e200]], [[1.0]], R=[[1.0]], dt=1, inputs=["u"], outputs=["y"])
EXACT = StateSpace([[1.0]], R=[[0.0]], dt=1, outputs=["y"])
NOT_FINITE = "the estimate is no longer finite: the model may be unstable and unobserved, or numbers overflowed."
CONTRADICTED = (
    "an output contradicts a value that is known exactly, or one so large that the output is lost in its rounding: give the "
    "output or the state some noise; if the model is unstable, its state has diverged."
)


def overflowing(**time):
    return Record(np.zeros(6), np.ones(6), inputs=["u"], outputs=["y"], **time)


def test_a_run_that_overflows_says_when(refused):
    with pytest.raises(RunError) as caught:
        estimate(Kalman(UNSTABLE), overflowing(dt=1), prior=PRIOR)
    sample = caught.value.outcome.sample
    assert isinstance(caught.value, EstimableError)
    assert 0 < sample < 6
    assert str(caught.value) == f"At sample {sample} (t = {sample} s): {NOT_FINITE}"


def test_a_run_without_time_says_at_which_sample():
    with pytest.raises(RunError, match=r"^At sample \d: the estimate is no longer finite"):
        estimate(Kalman(UNSTABLE), overflowing(), prior=PRIOR)


def test_a_contradiction_says_when():
    data = Record([0.0, 1.0], dt=0.5, outputs=["y"])
    with pytest.raises(RunError) as caught:
        estimate(Kalman(StateSpace([[1.0]], R=[[0.0]], dt=0.5)), data, prior=Prior([0.0], [[0.0]]))
    assert str(caught.value) == f"At sample 1 (t = 0.5 s): {CONTRADICTED}"
    assert caught.value.outcome.code == 2


def test_a_bank_says_which_run_failed():
    algorithms = [Kalman(MODEL), Kalman(UNSTABLE)]
    with pytest.raises(RunError, match=r"^Run 1: At sample \d \(t = \d s\): the estimate is no longer finite"):
        estimate_bank(algorithms, overflowing(dt=1), prior=PRIOR)


def test_online_says_at_which_sample():
    running = online(Kalman(EXACT), prior=Prior([0.0], [[0.0]]))
    running.correct([0.0])
    running.predict()
    with pytest.raises(RunError) as caught:
        running.correct([1.0])
    assert str(caught.value) == f"At sample 1: {CONTRADICTED}"


BANKS = {
    "nothing stacked": (
        (Kalman(MODEL), RECORD, PRIOR),
        ("nothing here is stacked: use estimate for one run, or stack([...]) algorithms, records or priors."),
    ),
    "sizes": (
        ([Kalman(MODEL)] * 2, [RECORD] * 3, PRIOR),
        ("all stacked arguments must have the same size: `algorithms` holds 2, `records` holds 3."),
    ),
    "no algorithm": (([], RECORD, PRIOR), "`items` must hold at least one thing to stack."),
    "kinds": (
        ([Kalman(MODEL), UnknownGain(MODEL, PRIOR)], RECORD, PRIOR),
        "only objects of one kind can be stacked: item 0 is a Kalman, item 1 a UnknownGain.",
    ),
    "lengths": (
        (Kalman(MODEL), [RECORD, RECORD[:2]], PRIOR),
        "item 1 differs from item 0 in shape: `y` is (3, 1) and (2, 1).",
    ),
    "names": (
        (Kalman(MODEL), [RECORD, record(outputs=["z"])], PRIOR),
        "item 1 differs from item 0 in `outputs`: ('y',) and ('z',).",
    ),
    "models": (([MODEL, MODEL], RECORD, PRIOR), KALMAN.format("StateSpace")),
    "no prior": (([Kalman(MODEL)] * 2, RECORD, None), "`prior` must be a Prior of the state x[0]. Got NoneType."),
    "times": (
        (Kalman(CONTINUOUS), [record(t=[0, 1, 3]), record(t=[0, 1, 3]), record(t=[0, 2, 3])], PRIOR),
        ("the records of a bank must have the same time steps: record 2 differs from record 0."),
    ),
    "one input not logged": (
        (Kalman(MODEL), [RECORD, record(u=[1.0, 1.0, np.nan])], PRIOR),
        "the records of a bank must have inputs that are NaN in the same rows. Run them one by one.",
    ),
}


@pytest.mark.parametrize(("things", "sentence"), BANKS.values(), ids=BANKS)
def test_a_bank_is_refused_with_what_does_not_fit(refused, things, sentence):
    algorithms, records, prior = things
    assert refused(lambda: estimate_bank(algorithms, records, prior=prior)) == [sentence]


STACKS = {
    "nothing": ([], "`items` must hold at least one thing to stack."),
    "kinds": ([PRIOR, Kalman(MODEL)], "only objects of one kind can be stacked: item 0 is a Prior, item 1 a Kalman."),
    "shapes": ([PRIOR, PRIOR, PRIOR2], "item 2 differs from item 0 in shape: `mean` is (1,) and (2,)."),
    "what is given": (
        [PRIOR, Prior([0.0], [[1.0]], diffuse=[[1.0]])],
        "item 1 differs from item 0 in `diffuse`: None and an array of shape (1, 1) and dtype float64.",
    ),
}


@pytest.mark.parametrize(("items", "sentence"), STACKS.values(), ids=STACKS)
def test_unlike_things_do_not_stack(refused, items, sentence):
    assert refused(lambda: stack(items)) == [sentence]


WITH_D = StateSpace([[0.5]], [[1.0]], D=[[1.0]], Q=[[0.1]], R=[[1.0]], dt=1)
WITH_S = StateSpace([[0.5]], Q=[[0.1]], R=[[1.0]], S=[[0.1]], dt=1)


def running(model=MODEL, **options):
    return online(Kalman(model), prior=PRIOR, **options)


def corrected_twice():
    run = running(WITH_S)
    run.correct([1.0])
    run.correct([1.0])


def past_the_end():
    run = running(OVER_TIME)
    for _ in range(4):
        run.correct([1.0])
        run.predict([1.0])


ONLINE = {
    "no prior": (lambda: online(Kalman(MODEL), prior=None), "`prior` must be a Prior of the state x[0]. Got NoneType."),
    "prior of another size": (
        lambda: online(Kalman(MODEL), prior=PRIOR2),
        "`prior` must describe n = 1 states: `A` is 1 × 1. Got 2.",
    ),
    "first order, discrete": (
        lambda: running(hold="first_order"),
        (
            'the record\'s input moves between samples (hold = "first_order"), but the model is discrete (dt '
            "= 1 s) and has no `B_end`: give the continuous model, or model.discretise(dt, "
            "hold='first_order')."
        ),
    ),
    "outputs": (lambda: running().correct([1.0, 2.0]), "`y` must be (p,) = (1,): the model has 1 output"),
    "a number": (lambda: running().correct(1.0), "`y` must be (p,) = (1,): the model has 1 output"),
    "infinite output": (lambda: running().correct([np.inf]), "`y` must be finite. First infinite value at index 0."),
    "no u for D": (
        lambda: running(WITH_D).correct([1.0]),
        "`u` must be given to correct: the input enters y directly (`D` is not zero).",
    ),
    "corrected twice": (
        corrected_twice,
        ("`correct` was called twice without `predict`: the cross noise `S` of a sample can be used only once."),
    ),
    "past the end": (past_the_end, "the model varies over 3 rows of time, and all of them have been used."),
    "no u": (lambda: running().predict(), "`u` must be given to predict: the model has 1 input."),
    "inputs": (lambda: running().predict([1.0, 2.0]), "`u` must be (m,) = (1,): the model has 1 input"),
    "u not known": (lambda: running().predict([np.nan]), "`u` must not hold NaN. First at index 0."),
    "no packet": (
        lambda: running().predict([1.0], arrived=[2]),
        "`arrived` must be 1 (applied) or 0 (lost): this algorithm needs every input.",
    ),
    "fate unknown": (
        lambda: running().predict([1.0], arrived=[np.nan]),
        "`arrived` must be 1 (applied) or 0 (lost): this algorithm needs every input.",
    ),
    "another step": (
        lambda: running().predict([1.0], dt=2),
        ("`dt` = 2 s, but the model is discrete with dt = 1 s: a continuous one is needed."),
    ),
    "negative step": (
        lambda: running(CONTINUOUS).predict([1.0], dt=-1),
        "`dt` must be greater than 0 seconds. Got -1.",
    ),
    "no step": (
        lambda: running(CONTINUOUS).predict([1.0]),
        "`dt` must be given to the first predict, in seconds: the model is continuous.",
    ),
    "no end of u": (
        lambda: running(CONTINUOUS, hold="first_order").predict([1.0], dt=1),
        ('`u_end` must be given to predict: the input moves between samples (hold = "first_order").'),
    ),
    "end of a held u": (
        lambda: running().predict([1.0], u_end=[1.0]),
        ('`u_end` needs online(..., hold="first_order"): this input is constant between samples.'),
    ),
    "no R": (
        lambda: running(NO_NOISE).correct([1.0]),
        ("`R`, the covariance of the measurement noise, is needed here. For noise-free outputs give zeros."),
    ),
}


@pytest.mark.parametrize(("call", "sentence"), ONLINE.values(), ids=ONLINE)
def test_online_is_refused_with_what_does_not_fit(refused, call, sentence):
    (found,) = refused(call)
    assert found.startswith(sentence)


def test_a_refused_step_online_changes_nothing(refused):
    run = running()
    run.correct([1.0])
    before = run.progress
    refused(lambda: run.predict([1.0, 2.0]))
    refused(lambda: run.correct([1.0, 2.0]))
    assert run.progress is before


def test_options_of_online_are_named_at_once(refused):
    found = refused(lambda: online(Kalman(MODEL), prior=PRIOR, engine="gpu", hold="first", lost="keep"))
    assert [sentence.split("`")[1] for sentence in found] == ["engine", "hold", "lost"]


SIMULATIONS = {
    "no u": (lambda: simulate(MODEL, seed=1, steps=3), "`u` must be (T, m) = (T, 1): the model has 1 input."),
    "no model": (
        lambda: simulate(3, seed=1),
        "`model` must be a StateSpace, a NonlinearModel or an OutputError. Got 3.",
    ),
    "no steps": (lambda: simulate(NO_INPUT, seed=1), "`steps` must be the number of rows to draw, as there is no `u`."),
    "no time": (
        lambda: simulate(CONTINUOUS, [1.0], seed=1),
        "`dt` or `t` must be given, in seconds: the model is continuous.",
    ),
    "another step": (
        lambda: simulate(MODEL, [1.0], seed=1, dt=2),
        "the model is discrete with a fixed dt = 1 s: leave out `dt` and `t`.",
    ),
    "times": (
        lambda: simulate(MODEL, [1.0], seed=1, t=[0.0]),
        "the model is discrete with a fixed dt = 1 s: leave out `dt` and `t`.",
    ),
    "inputs": (
        lambda: simulate(MODEL, np.ones((3, 2)), seed=1),
        "`u` must be (T, m) = (T, 1): the model has 1 input. Got (3, 2).",
    ),
    "u not known": (
        lambda: simulate(MODEL, [1.0, np.nan], seed=1),
        "`u` must not hold NaN: a simulation needs every input.",
    ),
    "steps and u": (
        lambda: simulate(MODEL, [1.0, 1.0], seed=1, steps=3),
        "`steps` = 3, but `u` has 2 rows: leave `steps` out.",
    ),
    "rows of time": (
        lambda: simulate(OVER_TIME, [1.0, 1.0], seed=1),
        "the model varies over 3 rows of time, but the input has 2.",
    ),
    "hold": (
        lambda: simulate(MODEL, [1.0], seed=1, hold="first_order"),
        (
            'the record\'s input moves between samples (hold = "first_order"), but the model is discrete (dt '
            "= 1 s) and has no `B_end`: give the continuous model, or model.discretise(dt, "
            "hold='first_order')."
        ),
    ),
    "prior of another size": (
        lambda: simulate(MODEL, [1.0], seed=1, prior=PRIOR2),
        "`prior` must describe n = 1 states: `A` is 1 × 1. Got 2.",
    ),
    "diffuse prior": (
        lambda: simulate(MODEL, [1.0], seed=1, prior=Prior([0.0], [[1.0]], diffuse=[[1.0]])),
        ("`prior` must not have diffuse directions: a state cannot be drawn from an infinite variance."),
    ),
    "no R": (
        lambda: simulate(NO_NOISE, [1.0], seed=1),
        ("`R`, the covariance of the measurement noise, is needed here. For noise-free outputs give zeros."),
    ),
    "no row": (
        lambda: simulate_bank(NO_INPUT, seed=1, runs=2, steps=0),
        "`steps` must be an integer of at least 1. Got 0.",
    ),
}


@pytest.mark.parametrize(("call", "sentence"), SIMULATIONS.values(), ids=SIMULATIONS)
def test_a_simulation_is_refused_with_what_does_not_fit(refused, call, sentence):
    assert refused(call) == [sentence]


MOVING = CONTINUOUS.discretise(0.1, hold="first_order")
NO_BLOCKS = (
    "the model was discretised for an input that moves between samples (it has `B_end`). `fixed` and `directions` "
    "as matrices have no meaning for it: give the continuous model (dt = 0)."
)
GAINS = {
    "directions of a model with B_end": (
        lambda: UnknownGain(MOVING, PRIOR, directions=np.ones((1, 1, 1))),
        [NO_BLOCKS],
    ),
    "fixed of a model with B_end": (lambda: UnknownGain(MOVING, PRIOR, fixed=[[1.0]]), [NO_BLOCKS]),
    "every entry of a model with B_end": (lambda: UnknownGain(MOVING, PRIOR, directions="every_entry"), [NO_BLOCKS]),
    "no model": (
        lambda: UnknownGain(3, PRIOR),
        ["`model` must be a StateSpace. Got 3."],
    ),
    "no prior": (
        lambda: UnknownGain(MODEL, [1.0]),
        ["`gain` must be a Prior. Got [1.0]."],
    ),
    "no input": (
        lambda: UnknownGain(NO_INPUT, PRIOR),
        ["the model has no input, and a gain multiplies B u: give `B`."],
    ),
    "directions": (
        lambda: UnknownGain(MODEL, PRIOR, directions="per input"),
        [("`directions` must be one of 'one', 'per_input', 'every_entry'. Got 'per input'. Did you mean 'per_input'?")],
    ),
    "scaled feedthrough of what": (
        lambda: UnknownGain(MODEL, PRIOR, directions="every_entry", feedthrough="scaled"),
        [('`feedthrough` = "scaled" needs directions "one" or "per_input"; otherwise give (p, outputs, m).')],
    ),
    "negative walk": (
        lambda: UnknownGain(MODEL, PRIOR, walk=-1.0),
        ["`walk` must be variances per second, at least 0. Got -1.0."],
    ),
    "walk a text": (
        lambda: UnknownGain(MODEL, PRIOR, walk="slow"),
        ["`walk` must be an array of real numbers. Got 'slow'."],
    ),
}


@pytest.mark.parametrize(("call", "sentences"), GAINS.values(), ids=GAINS)
def test_an_unknown_gain_is_refused_with_what_does_not_fit(refused, call, sentences):
    assert refused(call) == sentences


@pytest.mark.parametrize(
    ("settings", "start"),
    [
        (dict(directions=np.ones((2, 1, 1))), "`gain` must be a prior of 2 gains: `directions` is 2 × 1 × 1. Got 1."),
        (dict(fixed=[1.0]), "`fixed` must be (n, m) = (1, 1): "),
        (dict(walk=[1.0, 2.0]), "`walk` must be (gains,) = (1,): "),
        (dict(feedthrough=np.ones((1, 2, 1))), "`feedthrough` must be (p, outputs, m) = (1, 1, 1): "),
    ],
    ids=["directions", "fixed", "walk", "feedthrough"],
)
def test_a_setting_of_an_unknown_gain_of_a_wrong_shape_is_named(refused, settings, start):
    assert refused(lambda: UnknownGain(MODEL, PRIOR, **settings))[0].startswith(start)


FILE = ModelFile(MODEL, PRIOR)
OTHERS = {
    "no such algorithm": (
        lambda: catalogue.entry("kalmann"),
        "there is no algorithm 'kalmann'. The algorithms are 'kalman', ",
    ),
    "no such setting": (
        lambda: catalogue.build("kalman", FILE, walk=1.0),
        "kalman has no setting 'walk': it has 'uncertainty'.",
    ),
    "no gain in the file": (
        lambda: catalogue.build("unknown-gain", FILE),
        ("the model file has no section [gain]: give the prior of the gain there (mean, covariance)."),
    ),
    "nothing seen": (
        lambda: diagnostics.nis(np.full((3, 1), np.nan), np.ones((3, 1, 1))),
        ("there is no innovation to judge: no output with a finite, nonzero innovation variance was seen."),
    ),
    "known exactly": (
        lambda: diagnostics.nees(np.ones((3, 1)), np.zeros((3, 1, 1))),
        "there is no error to judge: every covariance is zero.",
    ),
    "another simulation": (
        lambda: plants.f16.flight(0.5, seed=1, simulation="held"),
        ("`simulation` must be one of 'continuous_actuator', 'held_elevator'. Got 'held'."),
    ),
    "no gain": (lambda: plants.f16.flight("half", seed=1), "`gain_after` must be a finite number. Got 'half'."),
}


@pytest.mark.parametrize(("call", "sentence"), OTHERS.values(), ids=OTHERS)
def test_the_other_rooms_refuse_in_words(refused, call, sentence):
    (found,) = refused(call)
    assert found.startswith(sentence)


def test_every_setting_that_is_not_there_is_named(refused):
    found = refused(lambda: catalogue.build("unknown-gain", FILE, wolk=1.0, forget=0.9))
    assert "Did you mean 'walk'?" in found[0]
    assert found[1].startswith("unknown-gain has no setting 'forget'")
    assert len(found) == 3


UNGUARDED = {
    "a class for an algorithm": lambda: estimate(Kalman, RECORD, prior=PRIOR),
    "a Kalman filter of no model": lambda: estimate(Kalman(3), RECORD, prior=PRIOR),
    "a model online": lambda: online(MODEL, prior=PRIOR),
    "a number to stack": lambda: stack(3),
    "texts to stack": lambda: stack(["a", "b"]),
    "a ragged walk": lambda: UnknownGain(MODEL, PRIOR, walk=[[1.0, 2.0], [3.0]]),
    "a simulation of no model": lambda: simulate(3, [1.0], seed=1),
    "a simulation under a number": lambda: simulate(MODEL, 1.0, seed=1),
    "a simulation from no prior": lambda: simulate(MODEL, [1.0], seed=1, prior=[0.0]),
    "a seed that is no whole number": lambda: simulate(MODEL, [1.0], seed=1.5),
    "steps that are no whole number": lambda: simulate(NO_INPUT, seed=1, steps=2.5),
    "a negative number of steps": lambda: simulate(NO_INPUT, seed=1, steps=-1),
    "no runs": lambda: simulate_bank(NO_INPUT, seed=1, runs=0, steps=1),
}


@pytest.mark.parametrize("call", UNGUARDED.values(), ids=UNGUARDED)
def test_a_call_that_python_refuses_is_refused_in_words(refused, call):
    assert refused(call)
