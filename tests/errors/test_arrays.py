"""What is said of one argument: an array, a covariance, a number, a choice, a list of names."""

from fractions import Fraction

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest

from estimable import InputError, Prior, Record, StateSpace, UnknownGain

I2 = np.eye(2)
MASKED = np.ma.array(np.ones((2, 2)), mask=[[True, False], [False, False]])


def model(A=I2, *args, dt=1.0, **kwargs):
    return StateSpace(A, *args, dt=dt, **kwargs)


ARRAYS = {
    "nothing": (None, "`A` must be an array of real numbers. Got None."),
    "text": ("a", "`A` must be an array of real numbers. Got 'a'."),
    "texts of numbers": (
        [["1", "2"], ["3", "4"]],
        "`A` must be an array of real numbers. Got [['1', '2'], ['3', '4']].",
    ),
    "ragged": ([[1, 2], [3]], "`A` must be an array of real numbers. Got [[1, 2], [3]]."),
    "complex": (I2 * 1j, "`A` must be an array of real numbers. Got an array of shape (2, 2) and dtype complex128."),
    "objects": (
        I2.astype(object),
        ("`A` must be an array of real numbers. Got an array of shape (2, 2) and dtype object."),
    ),
    "dates": (
        np.array([["2026-01-01"]], "datetime64[s]"),
        ("`A` must be an array of real numbers. Got an array of shape (1, 1) and dtype datetime64[s]."),
    ),
    "mapping": ({"a": 1}, "`A` must be an array of real numbers. Got {'a': 1}."),
    "set": ({1}, "`A` must be an array of real numbers. Got {1}."),
    "too large": ([[10**400]], "`A` must be an array of real numbers. Got [[1" + "0" * 54 + "...."),
    "masked": (MASKED, "`A` has masked entries, and a mask is not read."),
    "NaN": ([[1.0, np.nan], [0.0, 1.0]], "`A` must not hold NaN. First at index (0, 1)."),
    "infinite": ([[1.0, 0.0], [-np.inf, 1.0]], "`A` must be finite. First infinite value at index (1, 0)."),
    "scalar": (1.0, "`A` must be (n, n). Got (). A matrix is needed: write nested lists, as in [[1.0]]."),
    "vector": ([1.0, 2.0], "`A` must be (n, n). Got (2,). Did you mean `np.diag(A)`?"),
    "series": (pd.Series([1.0, 2.0]), "`A` must be (n, n). Got (2,). Did you mean `np.diag(A)`?"),
    "empty": ([], "`A` must be (n, n). Got (0,). A matrix is needed: write nested lists, as in [[1.0]]."),
    "a row of nothing": ([[]], "`A` must be (n, n). Got (1, 0)."),
    "no state": (np.zeros((0, 0)), "`A` must be at least 1 × 1: a model needs a state."),
    "not square": (np.zeros((2, 3)), "`A` must be (n, n). Got (2, 3)."),
    "four axes": (np.zeros((1, 1, 1, 1)), "`A` must be (n, n). Got (1, 1, 1, 1)."),
    "no time": (np.zeros((0, 2, 2)), "`A` must have at least one row in time. Got (0, 2, 2)."),
}


@pytest.mark.parametrize(("value", "sentence"), ARRAYS.values(), ids=ARRAYS)
def test_an_array_is_refused_with_what_was_given(refused, value, sentence):
    assert refused(lambda: model(value)) == [sentence]


@pytest.mark.parametrize(
    "value",
    [
        [[1, 0], [0, 1]],
        ((1, 0), (0, 1)),
        I2.astype("f4"),
        I2.astype(np.longdouble),
        I2 == 1,
        pd.DataFrame(I2),
        jnp.eye(2),
        np.ma.array(I2),
        np.asfortranarray(I2),
        I2[::-1, ::-1],
    ],
    ids=["lists", "tuples", "float32", "long double", "boolean", "frame", "jax", "no mask set", "Fortran", "view"],
)
def test_arrays_of_numbers_are_taken_whatever_holds_them(value):
    A = model(value).A
    assert type(A) is np.ndarray
    assert A.dtype == np.float64
    np.testing.assert_array_equal(A, I2)


def test_a_model_keeps_a_copy_of_nothing_it_could_be_changed_through():
    given = np.eye(2)
    held = model(given)
    given[0, 0] = 7.0
    np.testing.assert_array_equal(held.A, np.eye(2))


def test_a_vector_is_asked_for_as_a_vector(refused):
    assert refused(lambda: Prior(1.0, [[1.0]])) == ["`mean` must be (n,). Got (). A list is needed, as in [1.0]."]
    assert refused(lambda: Prior([[1.0]], [[1.0]])) == [
        "`mean` must be (n,). Got (1, 1). Did you mean `np.ravel(mean)`?"
    ]


def test_a_stack_is_asked_for_as_a_stack(refused):
    (sentence,) = refused(lambda: UnknownGain(model(I2, I2), Prior([1.0], [[1.0]]), directions=[[1.0]]))
    assert sentence.startswith("`directions` must be (p, n, m) = (p, 2, 2): ")
    assert sentence.endswith("Got (1, 1). A stack of matrices is needed: write nested lists, as in [[[1.0]]].")


def test_a_mask_over_inputs_says_how_to_write_what_is_not_known(refused):
    assert refused(lambda: Record(np.zeros(len(MASKED)), MASKED)) == [
        "`u` has masked entries, and a mask is not read: pass u.filled(np.nan), where NaN means unknown."
    ]


COVARIANCES = {
    "not symmetric": (
        [[1.0, 2.0], [3.0, 4.0]],
        ("must be symmetric: it differs from its transpose by 1. If that is rounding, pass ({0} + {0}.T) / 2."),
    ),
    "upper triangle": (
        [[1.0, 0.5], [0.0, 1.0]],
        ("must be symmetric: it differs from its transpose by 0.5. If that is rounding, pass ({0} + {0}.T) / 2."),
    ),
    "indefinite": ([[1.0, 2.0], [2.0, 1.0]], "must be positive semidefinite: its smallest eigenvalue is -1."),
    "negative variance": (
        [[-0.25, 0.0], [0.0, 1.0]],
        "must be positive semidefinite: its smallest eigenvalue is -0.25.",
    ),
    "small negative variance": (
        [[1e6, 0.0], [0.0, -1e-8]],
        "must be positive semidefinite: its smallest eigenvalue is -1e-08.",
    ),
    "variances only": ([1.0, 2.0], "Did you mean `np.diag({0})`?"),
}
WHERE = {
    "Q": lambda value: model(Q=value),
    "R": lambda value: model(R=value),
    "covariance": lambda value: Prior([0.0, 0.0], value),
    "walk": lambda value: UnknownGain(model(I2, I2), Prior([0.0, 0.0], I2), directions="per_input", walk=value),
}


@pytest.mark.parametrize(
    ("name", "case"),
    [(name, case) for name in WHERE for case in COVARIANCES if (name, case) != ("walk", "variances only")],
)
def test_a_covariance_is_refused_with_the_number_that_shows_why(refused, name, case):
    value, words = COVARIANCES[case]
    (sentence,) = refused(lambda: WHERE[name](value))
    assert sentence.startswith(f"`{name}` must be ")
    assert sentence.endswith(words.format(name))


@pytest.mark.parametrize(("wrong", "words"), [([[1.0, 2.0], [0.0, 1.0]], "symmetric"), (-I2, "positive semidefinite")])
def test_a_covariance_over_time_is_refused_with_its_row(refused, wrong, words):
    Q = np.stack([1e6 * I2, I2, np.asarray(wrong)])
    (sentence,) = refused(lambda: model(Q=Q))
    assert sentence.startswith(f"`Q` must be {words}: at row 2 ")


@pytest.mark.parametrize("size", [1e-30, 1.0, 1e30])
def test_rounding_is_no_fault_of_a_covariance(size):
    exact = size * np.array([[1.0, 1.0], [1.0, 1.0]])
    rounded = exact * [[1, 1 + 1e-15], [1 - 1e-15, 1 - 1e-15]]
    kept = Prior([0.0, 0.0], rounded).covariance
    np.testing.assert_array_equal(kept, kept.T)
    np.testing.assert_allclose(kept, exact, rtol=2e-15)


def test_a_symmetric_covariance_is_kept_to_the_last_bit():
    P = np.array([[0.1, 0.03], [0.03, 1 / 3]])
    np.testing.assert_array_equal(Prior([0.0, 0.0], P).covariance, P)


NUMBERS = {
    "negative": (-1, "`dt` must be at least 0 seconds. Got -1."),
    "NaN": (np.nan, "`dt` must be a finite number of seconds. Got nan."),
    "infinite": (np.inf, "`dt` must be a finite number of seconds. Got inf."),
    "too large": (10**400, "`dt` must be a finite number of seconds. Got 1" + "0" * 56 + "...."),
    "text": ("0.1", "`dt` must be a finite number of seconds. Got '0.1'."),
    "nothing": (None, "`dt` must be a finite number of seconds. Got None."),
    "boolean": (True, "`dt` must be a finite number of seconds. Got True."),
    "complex": (np.array(1j), "`dt` must be a finite number of seconds. Got 1j."),
    "array": (
        np.array([0.1]),
        ("`dt` must be a finite number of seconds. Got an array of shape (1,) and dtype float64."),
    ),
    "duration": (pd.Timedelta("1s"), "`dt` must be a finite number of seconds. Got Timedelta('0 days 00:00:01')."),
}


@pytest.mark.parametrize(("value", "sentence"), NUMBERS.values(), ids=NUMBERS)
def test_a_number_is_refused_with_what_was_given(refused, value, sentence):
    assert refused(lambda: model(dt=value)) == [sentence]


@pytest.mark.parametrize("value", [1, 1.0, np.int64(1), np.float32(1), np.array(1.0), jnp.asarray(1.0), Fraction(1)])
def test_numbers_are_taken_whatever_holds_them(value):
    dt = model(dt=value).dt
    assert type(dt) is float
    assert dt == 1.0


@pytest.mark.parametrize(
    ("value", "sentence"),
    [(0, "`forgetting` must be greater than 0. Got 0."), (1.5, "`forgetting` must be at most 1. Got 1.5.")],
)
def test_a_number_out_of_its_bounds_is_refused(refused, value, sentence):
    assert refused(lambda: UnknownGain(model(I2, I2), Prior([1.0], [[1.0]]), forgetting=value)) == [sentence]


@pytest.mark.parametrize(
    ("value", "end"),
    [
        ("zero-order", "Got 'zero-order'. Did you mean 'zero_order'?"),
        ("zoh", "Got 'zoh'."),
        (None, "Got None."),
        (["zero_order"], "Got ['zero_order']. Did you mean 'zero_order'?"),
        (np.array(["zero_order", "first_order"]), "Got an array of shape (2,) and dtype <U11."),
    ],
)
def test_a_choice_is_refused_with_the_choices_there_are(refused, value, end):
    (sentence,) = refused(lambda: Record([1.0], hold=value))
    assert sentence == "`hold` must be one of 'zero_order', 'first_order'. " + end


def test_a_choice_of_one_is_not_called_one_of_them(refused):
    assert refused(lambda: UnknownGain(model(I2, I2), Prior([1.0], [[1.0]]), feedthrough="scale")) == [
        "`feedthrough` must be 'scaled'. Got 'scale'. Did you mean 'scaled'?"
    ]


NAMES = {
    "text": ("ab", "`states` must be a list of names. Got the string 'ab'. Did you mean ['ab']?"),
    "number": (3, "`states` must be a list of names, in order. Got 3."),
    "mapping": ({"a": 1, "b": 2}, "`states` must be a list of names, in order. Got {'a': 1, 'b': 2}."),
    "numbers": ([1, 2], "`states` must be nonempty strings. Got (1, 2)."),
    "nothing": ([None, None], "`states` must be nonempty strings. Got (None, None)."),
    "empty names": (["a", " "], "`states` must be nonempty strings. Got ('a', ' ')."),
    "twice": (["a", "a"], "`states` names a channel twice: 'a'."),
    "too many": (list("abc"), "`states` must hold n = 2 names: `A` is 2 × 2. Got 3: 'a', 'b', 'c'."),
    "none of them": ([], "`states` must hold n = 2 names: `A` is 2 × 2. Got 0: none."),
}


@pytest.mark.parametrize(("value", "sentence"), NAMES.values(), ids=NAMES)
def test_names_are_refused_with_what_was_given(refused, value, sentence):
    assert refused(lambda: model(states=value)) == [sentence]


def test_a_set_has_no_order_to_name_channels_by(refused):
    (sentence,) = refused(lambda: model(states={"a", "b"}))
    assert sentence.startswith("`states` must be a list of names, in order. Got {")


@pytest.mark.parametrize("names", [("a", "b"), np.array(["a", "b"]), pd.Index(["a", "b"]), (c for c in "ab")])
def test_names_are_taken_whatever_holds_them(names):
    states = model(states=names).states
    assert states == ("a", "b")
    assert {type(name) for name in states} == {str}


def test_a_sentence_does_not_list_hundreds_of_names(refused):
    (sentence,) = refused(lambda: Record(np.zeros((1, 2)), outputs=[f"c{i}" for i in range(500)]))
    assert sentence.endswith("'c39' and 460 more.")


JUNK = [
    None,
    True,
    0,
    -1,
    1e400,
    np.nan,
    "a",
    b"a",
    [],
    [[]],
    [1, [2]],
    {},
    {1},
    object(),
    np.zeros(0),
    np.zeros((0, 0)),
    np.zeros((2, 2, 2, 2)),
    np.array(None),
    np.array(["a"]),
    1j,
    I2 * 1j,
    MASKED,
    pd.Series(["a"]),
    pd.DataFrame(),
    pd.Timestamp("2026-01-01"),
    10**400,
    float,
    lambda: None,
]
TAKE_ANYTHING = {
    **{
        name: lambda v, name=name: StateSpace(**({"A": I2, "dt": 1.0} | {name: v}))
        for name in (
            "A",
            "B",
            "C",
            "D",
            "Q",
            "R",
            "G",
            "S",
            "B_end",
            "dt",
            "states",
            "inputs",
            "outputs",
            "operating_point",
        )
    },
    **{
        f"prior {name}": lambda v, name=name: Prior(**({"mean": [0.0], "covariance": [[1.0]]} | {name: v}))
        for name in ("mean", "covariance", "diffuse")
    },
    **{
        f"record {name}": lambda v, name=name: Record(**({"y": [1.0], "u": [1.0]} | {name: v}))
        for name in ("y", "u", "dt", "t", "inputs", "outputs", "arrived", "lost", "hold", "units")
    },
    "states of the point": lambda v: model(operating_point={"states": v}),
    "basis": lambda v: model(R=I2).in_basis(v),
    "basis of a prior": lambda v: Prior([0.0], [[1.0]]).in_basis(v),
    "split": lambda v: Record([1.0, 2.0]).split(v),
    "rows": lambda v: Record([1.0, 2.0])[v],
    "first row": lambda v: Record([1.0, 2.0])[v:],
    "columns of a frame": lambda v: Record.from_pandas(pd.DataFrame({"y": [1.0]}), outputs=v),
    "frame": lambda v: Record.from_pandas(v, outputs=["y"]),
    "arrived columns": lambda v: Record.from_pandas(pd.DataFrame({"y": [1.0]}), outputs=["y"], inputs=["y"], arrived=v),
    "time column": lambda v: Record.from_pandas(pd.DataFrame({"y": [1.0]}), outputs=["y"], time=v),
}


@pytest.mark.parametrize("where", TAKE_ANYTHING)
@pytest.mark.parametrize(
    "junk",
    JUNK,
    ids=lambda value: type(value).__name__ if " at 0x" in repr(value) else " ".join(repr(value).split())[:24],
)
def test_junk_is_taken_or_refused_in_words_and_never_breaks(where, junk):
    faults = ()
    try:
        TAKE_ANYTHING[where](junk)
    except InputError as error:
        faults = error.faults
    assert all(fault.endswith((".", "?")) for fault in faults)
