"""What is said of a model, a prior, an operating point, a change of basis and a discretisation."""

import numpy as np
import pandas as pd
import pytest

from estimable import OperatingPoint, Prior, StateSpace

I2 = np.eye(2)
R1 = [[1.0]]


def model(A=I2, *args, dt=1.0, **kwargs):
    return StateSpace(A, *args, dt=dt, **kwargs)


def test_every_fault_of_a_model_is_named_at_once(refused):
    def build():
        StateSpace(
            I2,
            [[1.0, 0.0]],
            [[1.0], [0.0], [0.0]],
            Q=[[-1.0, 0.0], [0.0, 1.0]],
            R=[[1.0, 2.0], [0.0, 1.0]],
            dt=-1.0,
            states=["a"],
            inputs="u",
            outputs=["y", "y"],
        )

    assert refused(build) == [
        "`dt` must be at least 0 seconds. Got -1.",
        "`B` must be (n, m) = (2, m): `A` is 2 × 2. Got (1, 2). Did you mean `B.T`?",
        "`C` must be (p, n) = (p, 2): `A` is 2 × 2. Got (3, 1).",
        "`Q` must be positive semidefinite: its smallest eigenvalue is -1.",
        "`R` must be symmetric: it differs from its transpose by 2. If that is rounding, pass (R + R.T) / 2.",
        "`states` must hold n = 2 names: `A` is 2 × 2. Got 1: 'a'.",
        "`inputs` must be a list of names. Got the string 'u'. Did you mean ['u']?",
        "`outputs` names a channel twice: 'y'.",
    ]


SHAPES = {
    "B transposed": (
        dict(B=[[1.0, 0.0]]),
        "`B` must be (n, m) = (2, m): `A` is 2 × 2. Got (1, 2). Did you mean `B.T`?",
    ),
    "B a vector": (
        dict(B=[1.0, 0.0]),
        ("`B` must be (n, m) = (2, m): `A` is 2 × 2. Got (2,). A matrix is needed: write nested lists, as in [[1.0]]."),
    ),
    "C transposed": (
        dict(C=[[1.0], [0.0]]),
        "`C` must be (p, n) = (p, 2): `A` is 2 × 2. Got (2, 1). Did you mean `C.T`?",
    ),
    "C too wide": (dict(C=[[1.0, 0.0, 0.0]]), "`C` must be (p, n) = (p, 2): `A` is 2 × 2. Got (1, 3)."),
    "C without a row": (dict(C=np.zeros((0, 2))), "`C` must have at least one row: a model needs an output."),
    "D transposed": (
        dict(B=I2, C=[[1.0, 0.0]], D=[[0.0], [0.0]]),
        ("`D` must be (p, m) = (1, 2): `C` is 1 × 2; `B` is 2 × 2. Got (2, 1). Did you mean `D.T`?"),
    ),
    "G transposed": (
        dict(G=[[1.0, 0.0]]),
        "`G` must be (n, q) = (2, q): `A` is 2 × 2. Got (1, 2). Did you mean `G.T`?",
    ),
    "G without a column": (
        dict(G=np.zeros((2, 0))),
        ("`G` must have at least one column. If no noise enters the state, leave out `G` and `Q`."),
    ),
    "Q of another G": (dict(G=[[1.0], [0.0]], Q=I2), "`Q` must be (q, q) = (1, 1): `G` is 2 × 1. Got (2, 2)."),
    "Q without G": (dict(Q=R1), "`Q` must be (q, q) = (2, 2): without `G`, noise enters every state. Got (1, 1)."),
    "R without C": (dict(R=R1), "`R` must be (p, p) = (2, 2): without `C`, every state is an output. Got (1, 1)."),
    "R of another C": (dict(C=[[1.0, 0.0]], R=I2), "`R` must be (p, p) = (1, 1): `C` is 1 × 2. Got (2, 2)."),
    "R a number": (
        dict(C=[[1.0, 0.0]], R=1.0),
        ("`R` must be (p, p) = (1, 1): `C` is 1 × 2. Got (). A matrix is needed: write nested lists, as in [[1.0]]."),
    ),
    "S transposed": (
        dict(C=[[1.0, 0.0]], R=R1, S=[[0.0, 0.0]]),
        (
            "`S` must be (q, p) = (2, 1): without `G`, noise enters every state; `C` is 1 × 2. Got (1, 2). "
            "Did you mean `S.T`?"
        ),
    ),
    "B_end of another B": (
        dict(B=I2, B_end=[[1.0], [0.0]]),
        "`B_end` must be (n, m) = (2, 2): `A` is 2 × 2; `B` is 2 × 2. Got (2, 1).",
    ),
    "B over time, transposed": (
        dict(B=np.zeros((5, 1, 2))),
        ("`B` must be (n, m) = (2, m): `A` is 2 × 2. Got (5, 1, 2). Did you mean `np.swapaxes(B, 1, 2)`?"),
    ),
    "more rows of C than of B": (
        dict(B=np.zeros((4, 2, 1)), C=np.zeros((5, 1, 2))),
        "`C` must have 4 rows in time: `B` has 4. Got 5.",
    ),
    "inputs without B": (
        dict(inputs=["u"]),
        "`inputs` must hold m = 0 names: neither `B` nor `D` has a column. Got 1: 'u'.",
    ),
    "S without R": (dict(S=I2), "`S` needs `R`, the covariance of the measurement noise."),
    "S of a continuous model": (
        dict(R=I2, S=I2, dt=0),
        ("`S` is for noises of one sample, which a continuous model (dt = 0) does not have. Discretise it first."),
    ),
    "S too large": (
        dict(Q=I2, R=I2, S=2 * I2),
        ("[[Q, S], [S.T, R]] must be positive semidefinite: its smallest eigenvalue is -1."),
    ),
    "B_end of a continuous model": (
        dict(B=I2, B_end=I2, dt=0),
        ("`B_end` belongs to a discrete model, but dt = 0 is continuous. Use discretise(dt, hold='first_order')."),
    ),
    "point not a mapping": (
        dict(operating_point=[1.0, 2.0]),
        ("`operating_point` must be a mapping {'states': ..., 'inputs': ..., 'outputs': ...}. Got [1.0, 2.0]."),
    ),
    "point a series": (
        dict(operating_point=pd.Series({"states": 1})),
        (
            "`operating_point` must be a mapping {'states': ..., 'inputs': ..., 'outputs': ...}. Got states "
            "1 dtype: int64."
        ),
    ),
    "point of unknown key": (
        dict(operating_point={"state": [0.0, 0.0]}),
        ("`operating_point` may have the keys states, inputs and outputs. Got 'state'. Did you mean 'states'?"),
    ),
    "point of few states": (
        dict(operating_point={"states": [1.0]}),
        "`operating_point states` must be (n,) = (2,): `A` is 2 × 2. Got (1,).",
    ),
    "point of few inputs": (
        dict(B=I2, operating_point={"inputs": [1.0]}),
        "`operating_point inputs` must be (m,) = (2,): `B` is 2 × 2. Got (1,).",
    ),
    "point of many outputs": (
        dict(C=[[1.0, 0.0]], operating_point=OperatingPoint([0.0, 0.0], [], [1.0, 2.0])),
        "`operating_point outputs` must be (p,) = (1,): `C` is 1 × 2. Got (2,).",
    ),
    "point of NaN": (
        dict(operating_point={"states": [0.0, np.nan]}),
        "`operating_point states` must not hold NaN. First at index 1.",
    ),
    "point of a C that varies": (
        dict(C=np.zeros((3, 1, 2)), operating_point={"states": [1.0, 2.0]}),
        "`operating_point` must give outputs if C or D varies in time.",
    ),
}


@pytest.mark.parametrize(("given", "sentence"), SHAPES.values(), ids=SHAPES)
def test_a_model_is_refused_with_the_argument_at_fault(refused, given, sentence):
    assert refused(lambda: model(**given)) == [sentence]


def test_a_fault_in_one_argument_does_not_hide_those_of_others(refused):
    found = refused(lambda: model(B="b", C=[[1.0, 0.0]], R=[[-2.0]]))
    assert found == [
        "`B` must be an array of real numbers. Got 'b'.",
        "`R` must be positive semidefinite: its smallest eigenvalue is -2.",
    ]


@pytest.mark.parametrize("A", [None, [[1.0, 2.0]], "a"])
def test_without_a_good_A_nothing_is_said_of_what_follows_from_it(refused, A):
    assert len(refused(lambda: model(A, R=R1))) == 1


def test_dt_has_no_default():
    with pytest.raises(TypeError, match="dt"):
        StateSpace(I2)


BASES = {
    "singular": (
        [[1.0, 2.0], [2.0, 4.0]],
        "`T` must be invertible: with rows and columns scaled, its condition number is ",
    ),
    "a zero row": (
        [[1.0, 0.0], [0.0, 0.0]],
        "`T` must be invertible: with rows and columns scaled, its condition number is inf.",
    ),
    "another size": (np.eye(3), "`T` must be (n, n) = (2, 2): the model has 2 states. Got (3, 3)."),
    "not square": (np.ones((3, 2)), "`T` must be (n, n) = (2, 2): the model has 2 states. Got (3, 2)."),
    "NaN": ([[1.0, np.nan], [0.0, 1.0]], "`T` must not hold NaN. First at index (0, 1)."),
}


@pytest.mark.parametrize(("T", "sentence"), BASES.values(), ids=BASES)
def test_a_change_of_basis_is_refused(refused, T, sentence):
    (found,) = refused(lambda: model(R=I2).in_basis(T))
    assert found.startswith(sentence)


@pytest.mark.parametrize(
    ("T", "sentence"),
    [
        (np.eye(3), "`T` must be (k, n) = (k, 2): `mean` has 2 entries. Got (3, 3)."),
        (
            2.0,
            (
                "`T` must be (k, n) = (k, 2): `mean` has 2 entries. Got (). A matrix is needed: write nested "
                "lists, as in [[1.0]]."
            ),
        ),
        ("T", "`T` must be an array of real numbers. Got 'T'."),
    ],
)
def test_a_change_of_basis_of_a_prior_is_refused(refused, T, sentence):
    assert refused(lambda: Prior([0.0, 1.0], I2).in_basis(T)) == [sentence]


PRIORS = {
    "sizes": (dict(mean=[0.0]), "`covariance` must be (n, n) = (1, 1): `mean` has 1 entry. Got (2, 2)."),
    "a number": (
        dict(covariance=1.0),
        (
            "`covariance` must be (n, n) = (2, 2): `mean` has 2 entries. Got (). A matrix is needed: write "
            "nested lists, as in [[1.0]]."
        ),
    ),
    "variances": (
        dict(covariance=[1.0, 2.0]),
        ("`covariance` must be (n, n) = (2, 2): `mean` has 2 entries. Got (2,). Did you mean `np.diag(covariance)`?"),
    ),
    "infinite variance": (
        dict(covariance=np.diag([1.0, np.inf])),
        "`covariance` must be finite. First infinite value at index (1, 1).",
    ),
    "empty": (dict(mean=[], covariance=np.zeros((0, 0))), "`mean` must have at least one entry."),
    "diffuse a vector": (
        dict(diffuse=[1.0, 0.0]),
        (
            "`diffuse` must be (n, r) = (2, r): `mean` has 2 entries. Got (2,). A matrix is needed: write "
            "nested lists, as in [[1.0]]."
        ),
    ),
    "diffuse transposed": (
        dict(diffuse=[[1.0, 0.0]]),
        ("`diffuse` must be (n, r) = (2, r): `mean` has 2 entries. Got (1, 2). Did you mean `diffuse.T`?"),
    ),
    "diffuse dependent": (
        dict(diffuse=[[1.0, 2.0], [2.0, 4.0]]),
        "`diffuse` must have independent columns. Got 2 columns of rank 1.",
    ),
    "diffuse zero": (dict(diffuse=[[0.0], [0.0]]), "`diffuse` must have independent columns. Got 1 column of rank 0."),
}


@pytest.mark.parametrize(("given", "sentence"), PRIORS.values(), ids=PRIORS)
def test_a_prior_is_refused_with_the_argument_at_fault(refused, given, sentence):
    assert refused(lambda: Prior(**({"mean": [0.0, 0.0], "covariance": I2} | given))) == [sentence]


DISCRETISATIONS = {
    "discrete already": (
        1.0,
        0.5,
        "zero_order",
        "only a continuous model (dt = 0) can be discretised. This one has dt = 1 s.",
    ),
    "no step": (0.0, None, "zero_order", "`dt` must be a positive number of seconds. Got None."),
    "zero": (0.0, 0.0, "zero_order", "`dt` must be a positive number of seconds. Got 0.0."),
    "negative": (0.0, -0.5, "zero_order", "`dt` must be a positive number of seconds. Got -0.5."),
    "NaN": (0.0, np.nan, "zero_order", "`dt` must be a positive number of seconds. Got nan."),
    "infinite": (0.0, np.inf, "zero_order", "`dt` must be a positive number of seconds. Got inf."),
    "none of many": (0.0, [], "zero_order", "`dt` must be a positive number of seconds. Got []."),
    "one of many": (0.0, [0.1, -0.1], "zero_order", "`dt` must be a positive number of seconds. Got [0.1, -0.1]."),
    "hold": (
        0.0,
        0.5,
        "first-order",
        ("`hold` must be one of 'zero_order', 'first_order'. Got 'first-order'. Did you mean 'first_order'?"),
    ),
}


@pytest.mark.parametrize(("dt", "step", "hold", "sentence"), DISCRETISATIONS.values(), ids=DISCRETISATIONS)
def test_a_discretisation_is_refused(refused, dt, step, hold, sentence):
    assert refused(lambda: model(dt=dt).discretise(step, hold=hold)) == [sentence]


@pytest.mark.parametrize(
    ("A", "step"),
    [(I2, "a"), (I2, [[0.1], [0.1, 0.2]]), (I2, [[0.1, 0.2]]), (I2, True), (np.zeros((3, 2, 2)), [0.1, 0.2])],
    ids=["text", "ragged", "two axes", "boolean", "not as many as rows"],
)
def test_a_step_that_does_not_fit_is_refused_by_name(A, step):
    sentence = ""
    try:
        model(A, dt=0).discretise(step)
    except ValueError as error:
        sentence = str(error)
    assert sentence.startswith("`dt` must ")


@pytest.mark.parametrize("hold", ["zero_order", "first_order"])
def test_a_step_over_which_the_model_overflows_is_refused(refused, hold):
    assert refused(lambda: model(1e4 * I2, dt=0).discretise(1.0, hold=hold)) == [
        "the model overflows within a step of 1 s: its fastest entry is 1e+04 per second. Are A and dt in seconds?"
    ]
