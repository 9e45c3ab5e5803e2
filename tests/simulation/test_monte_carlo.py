"""`monte_carlo`: many runs, each drawn by its own key."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from estimable import (
    InputError,
    Kalman,
    Prior,
    Record,
    RunError,
    StateSpace,
    drawn_from,
    estimate,
    monte_carlo,
    simulate_bank,
)

MODEL = StateSpace([[0.9, 0.1], [0.0, 0.8]], [[0.0], [1.0]], [[1.0, 0.0]], Q=0.1 * np.eye(2), R=[[0.2]], dt=1)
PRIOR = Prior([1.0, 0.0], np.eye(2))
INPUT = np.sin(np.arange(30.0))[:, None]


def last(drawn, result):
    return {"error": (result.mean - drawn.state)[-1], "likelihood": result.log_likelihood}


def run(**changes):
    call = {"prior": PRIOR, "runs": 10, "seed": 3, "summary": last} | changes
    return monte_carlo(Kalman(MODEL), drawn_from(MODEL, INPUT, prior=PRIOR), **call)


@pytest.mark.parametrize("engine", ["native", "xla"])
def test_values_do_not_depend_on_the_chunk_or_on_the_number_of_runs(engine):
    whole = run(engine=engine)
    for other in (run(engine=engine, chunk=4), run(engine=engine, chunk=1), run(engine=engine, runs=7)):
        for name in ("error", "likelihood"):
            expected = whole.values[name][: len(other)]
            np.testing.assert_allclose(other.values[name], expected, rtol=1e-13, atol=1e-14)
    assert whole.engine == engine


def test_a_run_is_what_estimate_says_of_the_record_of_simulate_bank():
    found, bank = run(), simulate_bank(MODEL, INPUT, seed=3, runs=10, prior=PRIOR).items
    for i in (0, 9):
        record = Record(bank.record.y[i], INPUT, dt=1, outputs=MODEL.outputs, inputs=MODEL.inputs)
        result = estimate(Kalman(MODEL), record, prior=PRIOR)
        assert found.values["likelihood"][i] == pytest.approx(result.log_likelihood, rel=1e-12)
        np.testing.assert_allclose(found.values["error"][i], (result.mean - bank.state[i])[-1], rtol=1e-10)


def test_mean_sigma_and_standard_error_leave_out_what_is_not_known():
    def summary(drawn, result):
        value = drawn.record.y[0, 0]
        return {"positive": value if value > 0 else np.nan}

    found = run(runs=50, summary=summary)
    known = found.values["positive"][~np.isnan(found.values["positive"])]
    assert 0 < len(known) < 50
    assert found.mean("positive") == pytest.approx(known.mean())
    assert found.sigma("positive") == pytest.approx(known.std(ddof=1))
    assert found.standard_error("positive") == pytest.approx(known.std(ddof=1) / len(known) ** 0.5)
    assert "50 runs" in repr(found)


def test_a_record_can_be_drawn_by_the_users_own_function():
    def draw(key):
        return Record(jnp.sin(jnp.arange(20.0)) + jax.random.normal(key, (20,)), np.ones(20), dt=1, inputs=["u1"])

    found = monte_carlo(
        Kalman(MODEL), draw, prior=PRIOR, runs=3, seed=0, summary=lambda drawn, _: {"first": drawn.y[0, 0]}
    )
    assert len(set(found.values["first"])) == 3


def test_runs_that_failed_are_raised_or_kept():
    model = StateSpace([[1.0]], Q=[[0.0]], R=[[0.0]], dt=1)
    exact = Prior([0.0], [[0.0]])

    def draw(key):
        return Record(jnp.where(jax.random.uniform(key) > 0.5, 1.0, 0.0) * jnp.ones(2), dt=1)

    def call(**how):
        return monte_carlo(
            Kalman(model), draw, prior=exact, runs=20, seed=1, summary=lambda drawn, _: {"y": drawn.y[0, 0]}, **how
        )

    kept = call(on_failure="keep")
    assert 0 < kept.failed.sum() < 20
    np.testing.assert_array_equal(kept.failed, kept.values["y"] == 1)
    with pytest.raises(RunError, match=f"Run {np.argmax(kept.failed)}: At sample 0"):
        call(chunk=3)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"runs": 0}, "`runs` must be an integer of at least 1"),
        ({"seed": -1}, "`seed` must be an integer of at least 0"),
        ({"chunk": 0}, "`chunk` must be an integer"),
        ({"summary": 3}, "`summary` must be a function"),
        ({"summary": lambda drawn, result: 1.0}, "`summary` must return {name: number or array}"),
        (
            {"summary": lambda drawn, result: {"a" if drawn.record.y[0, 0] > 1 else "b": 1.0}},
            "the same names for every run",
        ),
        ({"engine": "fast"}, "`engine` must be one of"),
    ],
)
def test_wrong_calls(changes, sentence):
    with pytest.raises(InputError, match=sentence):
        run(**changes)


def test_what_is_drawn_must_hold_a_record():
    with pytest.raises(InputError, match="`draw` must return a Record"):
        monte_carlo(Kalman(MODEL), lambda key: key, prior=PRIOR, runs=1, seed=0, summary=last)
    with pytest.raises(InputError, match="`draw` must be a function: write drawn_from"):
        monte_carlo(Kalman(MODEL), MODEL, prior=PRIOR, runs=1, seed=0, summary=last)
