"""What runs where an engine fails: XLA does, with one sentence, and nobody sees a traceback."""

import logging

import numpy as np
import pytest

from cases import case
from estimable import InputError, Kalman, Prior, Record, StateSpace, estimate, estimate_bank, online
from estimable.engines import choice, native
from estimable.engines.llvm import scalars
from estimable.engines.llvm.spelling import Spelling
from estimable.engines.program import primitives
from estimable.estimation import online_steps

pytestmark = pytest.mark.engine_fails


@pytest.fixture(autouse=True)
def nothing_said(monkeypatch):
    """No reason has been said yet."""
    monkeypatch.setattr(choice, "_said", set())


@pytest.fixture
def c():
    return case(0, (2, 1, 1))


FAILURES = [
    KeyError("mul"),
    TypeError("unhashable type\nand more"),
    RuntimeError("LLVM IR parsing error\n<string>:1"),
    ValueError("shape"),
]


def failing(error):
    def fail(*_, **__):
        raise error

    return fail


def sentences(caplog):
    return [
        (record.levelname, record.getMessage(), record.exc_info)
        for record in caplog.records
        if record.name == "estimable.engines"
    ]


@pytest.mark.parametrize("error", FAILURES, ids=repr)
def test_a_failure_is_passed_over_with_one_warning(error, c, monkeypatch, caplog):
    expected = estimate(Kalman(c.model), c.record, prior=c.prior, engine="xla")
    monkeypatch.setattr(native, "write", failing(error))
    for _ in range(2):
        result = estimate(Kalman(c.model), c.record, prior=c.prior)
        assert result.engine == "xla"
        assert np.array_equal(result.mean, expected.mean)
    ((level, message, trace),) = sentences(caplog)
    assert (level, trace) == ("WARNING", None)
    assert message.startswith(f'engine = "native" failed on Kalman ({type(error).__name__}: ')
    assert "\n" not in message


def test_a_refusal_is_said_at_debug_level(c, monkeypatch, caplog):
    caplog.set_level(logging.DEBUG, "estimable.engines")
    monkeypatch.setattr(native, "scan_bank", failing(primitives.UnsupportedError("the primitive sort")))
    assert estimate(Kalman(c.model), c.record, prior=c.prior).engine == "xla"
    assert sentences(caplog) == [("DEBUG", 'engine = "native" does not run Kalman: the primitive sort', None)]


@pytest.mark.parametrize("error", FAILURES, ids=repr)
def test_an_engine_asked_for_by_name_says_what_failed(error, c, monkeypatch, caplog):
    monkeypatch.setattr(native, "write", failing(error))
    with pytest.raises(InputError) as raised:
        estimate(Kalman(c.model), c.record, prior=c.prior, engine="native")
    assert str(raised.value).startswith(f'engine = "native" cannot run Kalman here: {type(error).__name__}: ')
    assert str(raised.value).endswith('. Use "auto" or "xla".')
    assert "\n" not in str(raised.value)
    assert raised.value.__context__ is None
    assert not sentences(caplog)


def test_assembly_that_llvm_refuses_is_passed_over(monkeypatch, caplog):
    monkeypatch.setenv("ESTIMABLE_CACHE", "off")  # what was once assembled is not written again
    model = StateSpace([[0.12345]], R=[[1.0]], dt=1)
    broken = Spelling(("no such word",), (), False)
    monkeypatch.setattr(scalars, "spelled", lambda *_: broken)
    native.compiled_step.cache_clear()
    result = estimate(Kalman(model), Record(np.ones(3), dt=1), prior=Prior([0.0], [[1.0]]))
    assert result.engine == "xla"
    assert [level for level, *_ in sentences(caplog)] == ["WARNING"]


def test_a_bank_goes_on_to_xla(c, monkeypatch, caplog):
    monkeypatch.setattr(native, "scan_bank", failing(KeyError("one")))
    assert estimate_bank(Kalman(c.model), [c.record, c.record], prior=c.prior).engine == "xla"
    assert len(sentences(caplog)) == 1


@pytest.mark.parametrize("error", FAILURES, ids=repr)
def test_a_run_online_goes_on_by_xla(error, c, monkeypatch, caplog):
    expected = online(Kalman(c.model), prior=c.prior, engine="xla")
    monkeypatch.setattr(online_steps, "code_of", failing(error))
    running = online(Kalman(c.model), prior=c.prior)
    assert running.engine == "xla"
    assert np.array_equal(running.correct([1.0], [0.0]).mean, expected.correct([1.0], [0.0]).mean)
    assert len(sentences(caplog)) == 1
    with pytest.raises(InputError, match=f'"native" cannot run Kalman online: {type(error).__name__}: '):
        online(Kalman(c.model), prior=c.prior, engine="native")


def test_a_run_online_goes_on_by_xla_from_where_it_is(c, monkeypatch, caplog):
    running, by_xla = (online(Kalman(c.model), prior=c.prior, engine=engine) for engine in ("auto", "xla"))
    for k in range(4):
        if k == 2:
            monkeypatch.setattr(type(running._quick), "correct", lambda *_: None)
            monkeypatch.setattr(type(running._quick), "prepare", failing(KeyError("mul")))
        infos = [each.correct([0.1 * k], [0.0]) for each in (running, by_xla)]
        np.testing.assert_allclose(infos[0].mean, infos[1].mean, rtol=1e-12)
        for each in (running, by_xla):
            each.predict([1.0])
    assert running.engine == "xla"
    assert len(sentences(caplog)) == 1


def test_a_wrong_call_is_no_failure_of_an_engine(c, monkeypatch, caplog):
    monkeypatch.setattr(native, "write", failing(InputError("`C` must be (p, n).")))
    with pytest.raises(InputError, match="`C` must be"):
        estimate(Kalman(c.model), c.record, prior=c.prior)
    assert not sentences(caplog)
