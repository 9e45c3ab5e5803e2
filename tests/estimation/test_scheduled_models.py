"""Every driver reads the channels that the matrices of a model follow, and gives what the model that varies by row gives."""

import numpy as np
import pytest
from benchmarks.figures import scheduled_gain

import estimable as es

T, DT = 60, 0.05
SPEED = np.linspace(100.0, 200.0, T)
PRIOR = es.Prior([0.0, 0.0], 0.1 * np.eye(2))
GAIN = es.Prior([1.0], [[0.25]])


def matrices(speed):
    """A, B and C at an airspeed."""
    v = speed / 100
    return {"A": [[-v, 1.0], [-3 * v, -v]], "B": [[0.1], [-5 * v**2]], "C": [[1.0, 0.0], [0.0, v]]}


def model(schedule=matrices, **changed):
    """A continuous model of two states."""
    given = dict(Q=np.diag([1e-3, 0.1]), R=np.diag([1e-3, 1e-2]), dt=0, inputs=["elevator"], outputs=["alpha", "q"])
    return es.StateSpace(**matrices(100.0), schedule={"airspeed": schedule}, **(given | changed))


def record():
    """A record of that model, with the airspeed as an output."""
    u = np.sign(np.sin(np.arange(T) / 3))[:, None]
    drawn = es.simulate(model(), u, seed=3, dt=DT, schedule={"airspeed": SPEED}).record
    return es.Record(drawn.y, u, dt=DT, inputs=["elevator"], outputs=["alpha", "q", "airspeed"])


RECORD = record()
ALGORITHMS = {
    "kalman": es.Kalman,
    "gain": lambda model: es.UnknownGain(model, GAIN, walk=0.01),
    "bounded": lambda model: es.Bounded(es.UnknownGain(model, GAIN), 0.0, 2.0),
    "changes": lambda model: es.ChangeDetection(es.UnknownGain(model, es.Prior([1.0], [[0.0]])), jump=0.25),
    "input": lambda model: es.UnknownInput(model, unknown=["elevator"], walk=1.0),
    "window": lambda model: es.MovingWindow(es.Kalman(model), 5),
}


def test_a_simulation_follows_the_channel_and_records_it():
    along = model().along({"airspeed": SPEED})
    alone = es.simulate(along, RECORD.u, seed=3, dt=DT).record
    assert np.array_equal(RECORD.y[:, :2], alone.y)
    assert np.array_equal(RECORD.y[:, 2], SPEED)


@pytest.mark.parametrize("name", ALGORITHMS)
def test_estimates_are_those_of_the_model_that_varies_by_row(name):
    make = ALGORITHMS[name]
    found = es.estimate(make(model()), RECORD, prior=PRIOR)
    known = es.estimate(make(model().along({"airspeed": SPEED})), RECORD, prior=PRIOR)
    assert found.engine == "native"
    assert np.array_equal(found.mean, known.mean)
    assert found.log_likelihood == known.log_likelihood


def online_means(running, **given):
    """The means of a run, with the airspeed passed at each call."""
    means = []
    for k in range(T):
        airspeed = {"airspeed": SPEED[k]}
        means.append(running.correct(RECORD.y[k, :2], schedule=airspeed).mean)
        running.predict(RECORD.u[k], dt=DT, schedule=airspeed)
    return np.array(means)


@pytest.mark.parametrize("engine", ["native", "xla"])
def test_online_gives_what_the_record_gives(engine):
    algorithm = ALGORITHMS["gain"](model())
    known = es.estimate(algorithm, RECORD, prior=PRIOR, engine="native").mean
    running = es.online(algorithm, prior=PRIOR, engine=engine)
    assert np.allclose(online_means(running), known, rtol=1e-12, atol=1e-12)
    assert running.engine == engine


def test_a_table_runs_online_is_saved_and_resumes(tmp_path):
    at = [100.0, 150.0, 200.0]
    table = {"at": at, **{name: [matrices(v)[name] for v in at] for name in "ABC"}}
    algorithm = es.Kalman(model(table))
    known = es.estimate(algorithm, RECORD, prior=PRIOR).mean
    running = es.online(algorithm, prior=PRIOR)
    for k in range(30):
        running.correct(RECORD.y[k, :2], schedule={"airspeed": SPEED[k]})
        running.predict(RECORD.u[k], dt=DT)  # the value holds
    running.save(tmp_path / "run.npz")
    for one in (running, es.load(tmp_path / "run.npz")):
        assert np.allclose(one.correct(RECORD.y[30, :2], schedule={"airspeed": SPEED[30]}).mean, known[30], rtol=1e-12)


def test_a_channel_of_the_model_itself_is_read_from_y():
    changed = dict(C=[[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]], R=np.eye(3), outputs=["alpha", "q", "airspeed"])
    only_B = lambda speed: {"B": matrices(speed)["B"]}  # noqa: E731
    own = es.StateSpace(**(matrices(100.0) | changed), dt=0, inputs=["elevator"], schedule={"airspeed": only_B})
    running = es.online(es.Kalman(own), prior=PRIOR)
    known = es.estimate(es.Kalman(own), RECORD, prior=PRIOR).mean
    for k in range(T):
        mean = running.correct(RECORD.y[k]).mean
        running.predict(RECORD.u[k], dt=DT)
    assert np.allclose(mean, known[-1], rtol=1e-12)


def test_a_bank_has_its_own_airspeed_in_each_run():
    slow = es.Record(RECORD.y * [1, 1, 0.9], RECORD.u, dt=DT, inputs=RECORD.inputs, outputs=RECORD.outputs)
    for one, many in ((es.estimate, es.estimate_bank), (es.smooth, es.smooth_bank)):
        bank = many(es.Kalman(model()), [RECORD, slow], prior=PRIOR)
        single = one(es.Kalman(model()), slow, prior=PRIOR)
        assert np.allclose(bank.mean[1], single.mean, rtol=1e-12, atol=1e-14)


def test_a_forecast_holds_the_last_value():
    result = es.estimate(es.Kalman(model()), RECORD, prior=PRIOR)
    ahead = es.forecast(result, np.zeros((3, 1)))
    now = model().along({"airspeed": SPEED[-1]})
    assert np.allclose(ahead.output, ahead.mean @ now.C.T, rtol=1e-12)


def test_noises_are_fitted_along_each_record():
    fit = es.fit_noise(es.Kalman(model()), [RECORD, RECORD[:40]], prior=PRIOR, free=("R",))
    along = es.Kalman(model().along({"airspeed": SPEED}))
    assert np.isfinite(fit.sigma).all()
    assert fit.algorithm.model.schedule is not None
    slope = es.score(es.Kalman(model()), RECORD, prior=PRIOR, with_respect_to=["R[alpha]"])
    assert slope.log_likelihood == pytest.approx(
        es.score(along, RECORD, prior=PRIOR, with_respect_to=["R[alpha]"]).log_likelihood
    )
    with pytest.raises(es.InputError, match="`R` must be a single matrix"):
        es.fit_noise(es.Kalman(model(lambda v: {"R": np.eye(2)})), RECORD, prior=PRIOR, free=("R",))


def test_a_missing_value_is_the_one_before_it():
    y = RECORD.y.copy()
    y[10:13, 2] = np.nan
    gaps = es.Record(y, RECORD.u, dt=DT, inputs=RECORD.inputs, outputs=RECORD.outputs)
    y[10:13, 2] = y[9, 2]
    held = es.Record(y, RECORD.u, dt=DT, inputs=RECORD.inputs, outputs=RECORD.outputs)
    found, known = (es.estimate(es.Kalman(model()), one, prior=PRIOR).mean for one in (gaps, held))
    assert np.array_equal(found, known)


def test_missing_channels_are_one_sentence():
    without = es.Record(RECORD.y[:, :2], RECORD.u, dt=DT, inputs=["elevator"], outputs=["alpha", "q"])
    late = es.Record(np.where(np.arange(T)[:, None] < 1, np.nan, RECORD.y), RECORD.u, dt=DT, inputs=RECORD.inputs,
                     outputs=RECORD.outputs)  # fmt: skip
    running = es.online(es.Kalman(model()), prior=PRIOR)
    plain = es.online(es.Kalman(model().nominal), prior=PRIOR)
    calls = {
        "the record has no such channel": lambda: es.estimate(es.Kalman(model()), without, prior=PRIOR),
        "the first row of the record must have 'airspeed'": lambda: es.estimate(es.Kalman(model()), late, prior=PRIOR),
        "give its value, schedule={'airspeed': ..}": lambda: running.correct([0.0, 0.0]),
        "`schedule` must be a mapping": lambda: running.correct([0.0, 0.0], schedule=3),
        "of this one follow no channel": lambda: plain.correct([0.0, 0.0], schedule={"airspeed": 1.0}),
        "the values of 'airspeed' are missing": lambda: es.simulate(model(), RECORD.u, seed=1, dt=DT),
    }
    for words, call in calls.items():
        with pytest.raises(es.InputError) as error:
            call()
        assert words in str(error.value)


def test_a_speed_change_is_not_read_as_a_lost_gain():
    found = scheduled_gain.figure(50)
    assert found["scheduled"][0] <= 1.2
    assert found["constant"][0] > 10
    assert abs(found["constant"][1] - 1) > 0.2


def test_a_mixture_follows_with_all_its_members():
    def mixture(model):
        return es.Mixture([es.UnknownGain(model, GAIN, walk=walk) for walk in (0.0, 0.1)])

    found = es.estimate(mixture(model()), RECORD, prior=PRIOR)
    known = es.estimate(mixture(model().along({"airspeed": SPEED})), RECORD, prior=PRIOR)
    assert found.extra["probability"].shape == (T, 2)
    assert np.array_equal(found.gain, known.gain)
    for call in (lambda: es.fit_noise(mixture(model()), RECORD, prior=PRIOR),
                 lambda: es.score(mixture(model()), RECORD, prior=PRIOR, with_respect_to=["R[q]"])):  # fmt: skip
        with pytest.raises(es.InputError, match="a Mixture has several models"):
            call()


@pytest.mark.parametrize("place", [0, 1])
def test_one_scheduled_member_makes_a_mixture_vary(place):
    """Online, gaps need models that are constant: of every member."""
    members = [es.UnknownGain(model().along({"airspeed": 100.0}), GAIN) for _ in range(2)]
    members[place] = es.UnknownGain(model(), GAIN)
    with pytest.raises(es.InputError, match="needs a model that does not vary in time"):
        es.online(es.Mixture(members), prior=PRIOR, gaps=es.Gaps("bridge", diffusion=[1.0]))
