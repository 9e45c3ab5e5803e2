"""Equal computations have equal names, in every process; whatever a function uses is part of its name."""

import functools
import importlib.util
import subprocess
import sys
import textwrap

import numpy as np
import pytest

import estimable as es
from estimable.simulation.fingerprint import UnseenError, fingerprint

SUMMARY = """
import functools
import numpy as np
import jax.numpy as jnp

LIMIT = 2.0
TABLE = np.arange(3.0)
NAMES = {"a": [1, 2]}

def helper(x):
    return deeper(x) + 1

def deeper(x):
    return x * 3

class Scale:
    factor = 4
    def __init__(self, by):
        self.by = by
    def apply(self, x):
        return self.by * x
    def __call__(self, x):
        return self.apply(x)

def keyword(x, *, power=5):
    return x ** power

def outer():
    inside = 6
    return lambda x: x + inside

scaled = Scale(7)
summaries = {
    "global": lambda x: x < LIMIT,
    "array": lambda x: x + TABLE,
    "dictionary": lambda x: NAMES["a"],
    "helper": lambda x: helper(x),
    "keyword": keyword,
    "closure": outer(),
    "method": scaled.apply,
    "instance": scaled,
    "class": lambda x: Scale(1)(x),
    "partial": functools.partial(keyword, power=8),
    "library": lambda x: jnp.sum(x),
    "nested": lambda x: [helper(y) for y in x],
    "wrapped": functools.lru_cache(helper),
}
"""
CHANGES = {
    "global": ("LIMIT = 2.0", "LIMIT = 3.0"),
    "array": ("np.arange(3.0)", "np.arange(4.0)"),
    "dictionary": ("[1, 2]", "[1, 3]"),
    "helper": ("x * 3", "x * 4"),
    "keyword": ("power=5", "power=6"),
    "closure": ("inside = 6", "inside = 7"),
    "method": ("Scale(7)", "Scale(8)"),
    "instance": ("return self.by * x", "return x * self.by"),
    "class": ("factor = 4", "factor = 5"),
    "partial": ("power=8", "power=9"),
    "library": ("jnp.sum", "jnp.max"),
    "nested": ("x * 3", "x * 4"),
    "wrapped": ("deeper(x) + 1", "deeper(x) + 2"),
}


def named(tmp_path, text):
    """The names of the summaries of a module with this text."""
    path = tmp_path / "summaries.py"
    path.write_text(text)
    spec = importlib.util.spec_from_file_location("summaries", path)
    module = importlib.util.module_from_spec(spec)
    exec(compile(text, str(path), "exec"), module.__dict__)
    return {name: fingerprint(function) for name, function in module.summaries.items()}


@pytest.fixture(scope="module")
def names(tmp_path_factory):
    return named(tmp_path_factory.mktemp("module"), SUMMARY)


def test_different_functions_have_different_names(names):
    assert len(set(names.values())) == len(names)


@pytest.mark.parametrize("name", CHANGES)
def test_a_change_of_what_a_function_uses_changes_its_name(name, names, tmp_path):
    old, new = CHANGES[name]
    assert SUMMARY.count(old) == 1
    changed = named(tmp_path, SUMMARY.replace(old, new))
    assert changed[name] != names[name]
    unchanged = {"library"} if name != "library" else {"global"}
    assert all(changed[other] == names[other] for other in unchanged)


def test_where_a_function_was_written_does_not_matter(names, tmp_path):
    assert named(tmp_path, "\n\n# moved\n" + SUMMARY) == names


def test_names_are_the_same_in_another_process():
    code = """
        import numpy as np, estimable as es
        from estimable.simulation.fingerprint import fingerprint
        def rate(x, u, θ): return -2.0 * x
        nonlinear = es.NonlinearModel(rate, lambda x, u, θ: x, Q=[[1.0]], R=[[1.0]], dt=1)
        model = es.StateSpace([[0.9]], Q=[[0.1]], R=[[0.2]], dt=1)
        parts = es.Kalman(model), nonlinear, es.BernoulliLink([0.5]), {"a": {1, 2, 3}, "b": (1, "x", None, np.float64(2))}, rate
        print(fingerprint(*parts), fingerprint(lambda closed: {"e": np.abs(closed.state).max() + len(es.__version__)}))
    """
    said = {
        subprocess.run([sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, check=True).stdout
        for _ in range(2)
    }
    assert len(said) == 1


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (1, 1.0), (True, 1), (0.0, -0.0), ((1,), [1]), ("1", 1), (None, "None"), (np.zeros(2), np.zeros((2, 1))),
        (np.zeros(2), np.zeros(2, int)), ({"a": 1}, {"a": 2}), ({1}, {2}), ([[1], 2], [[1, 2]]),
        (es.Kalman(es.StateSpace([[0.9]], R=[[1.0]], dt=1)), es.Kalman(es.StateSpace([[0.8]], R=[[1.0]], dt=1))),
        (es.BernoulliLink([0.5]), es.BernoulliLink([0.5], acknowledged=False)),
    ],
)  # fmt: skip
def test_what_differs_has_another_name(one, other):
    assert fingerprint(one) != fingerprint(other)
    assert fingerprint(one) == fingerprint(one)


def test_a_function_that_calls_itself_has_a_name():
    def again(x):
        return again(x - 1) if x else 0

    assert fingerprint(again) == fingerprint(again)


def test_what_cannot_be_seen_is_refused_with_advice(tmp_path):
    stream = open(tmp_path / "file", "w")  # noqa: SIM115
    model = es.StateSpace([[0.9]], [[0.5]], Q=[[0.01]], R=[[0.1]], dt=0.5)
    case = es.LoopCase(model, es.StateFeedback([[0.3]]), es.Kalman(model), reference=np.ones((4, 0)),
                       prior=es.Prior([1.0], [[2.0]]))  # fmt: skip

    def summary(closed):
        return {"state": closed.state[-1, 0], "closed": float(stream.closed)}

    with stream:
        with pytest.raises(UnseenError):
            fingerprint(summary)
        settings = {"runs": 2, "seed": 1, "summary": summary, "folder": tmp_path / "parts"}
        with pytest.raises(es.InputError, match="Pass `version`, a name that you change whenever"):
            es.monte_carlo_loops(case, **settings)
        found = es.monte_carlo_loops(case, **settings, version="1")
    assert len(list((tmp_path / "parts").iterdir())) == 1
    np.testing.assert_array_equal(
        found[""].values["state"], es.monte_carlo_loops(case, **settings, version="1")[""].values["state"]
    )
    es.monte_carlo_loops(case, **settings, version="2")
    assert len(list((tmp_path / "parts").iterdir())) == 2


def test_a_cached_function_is_looked_into():
    assert fingerprint(functools.lru_cache(lambda x: x + 1)) != fingerprint(functools.lru_cache(lambda x: x + 2))
