"""What is said of unknown inputs that cannot be estimated, or are asked for wrongly."""

import numpy as np
import pytest

from estimable import InputError, Prior, Record, RunError, StateSpace, UnknownInput, estimate, unknown_input_existence

A, B = np.diag([0.67, 0.53]), np.array([[1.0], [0.53]])
C, D = np.array([[0.55, 0.11], [0.0, 0.29]]), np.array([[0.4], [0.2]])
EXAMPLE = StateSpace(A, B, C, D, Q=np.eye(2), R=np.eye(2), dt=1, inputs=["leak"])


def model(A=A, B=B, C=C, D=None, **more):
    return StateSpace(A, B, C, D, Q=np.eye(len(A)), R=np.eye(len(C)), dt=1, **more)


MORE_THAN_OUTPUTS = model(B=np.eye(2), C=np.array([[1.0, 1.0]]), inputs=["a", "b"])
ZERO_OUTSIDE = model(np.array([[0.5]]), np.array([[1.0]]), np.array([[1.0]]), np.array([[0.5]]))  # zero at -1.5
SILENT = model(B=np.array([[0.0], [1.0]]), C=np.array([[1.0, 0.0]]))
FANG = {"unknown": ["leak"], "method": "fang"}


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: UnknownInput(EXAMPLE, unknown=["leek"]),
         ["'leek'", "not an input of the model: 'leak'", "Did you mean 'leak'?"]),
        (lambda: UnknownInput(EXAMPLE, unknown=[3]), ["names 3", "not an input"]),
        (lambda: UnknownInput(EXAMPLE, unknown=[]), ["`unknown` must name at least one input"]),
        (lambda: UnknownInput(EXAMPLE, unknown=["leak", 0]), ["names an input twice"]),
        (lambda: UnknownInput(EXAMPLE, unknown=["leak"], method="Fang"), ["`method` must be", "Did you mean 'fang'?"]),
        (lambda: UnknownInput(EXAMPLE, unknown=["leak"], delay=-1), ["`delay` must be an integer of at least 0"]),
        (lambda: UnknownInput(EXAMPLE, unknown=["leak"], variance=-1.0), ["`variance` must be variances, at least 0"]),
        (lambda: UnknownInput(EXAMPLE, unknown=["leak"], walk=[1.0, 2.0]), ["`walk` must be (d,) = (1,)", "names 1 input"]),
        (lambda: UnknownInput(EXAMPLE, unknown=["leak"], levels=[]), ["`levels` must hold at least one value"]),
        (lambda: UnknownInput(EXAMPLE, **FANG, walk=1.0), ['"fang" takes no', "`walk`"]),
        (lambda: UnknownInput("plant", unknown=["leak"]), ["`model` must be a StateSpace"]),
        (lambda: UnknownInput(MORE_THAN_OUTPUTS, unknown=["a", "b"]), ["2 unknown inputs ('a', 'b')", "1 output"]),
        (lambda: UnknownInput(ZERO_OUTSIDE, unknown=["u1"]), ["invariant zero -1.5", "not inside the unit circle", "`variance`"]),
        (lambda: UnknownInput(SILENT, unknown=["u1"]), ["never distinguish 'u1' from zero", "rank D is 0"]),
        (
            lambda: UnknownInput(model(), unknown=["u1"], method="fang"),
            ["Fang's Algorithm 1 needs D of full column rank", "rank 0", 'method="auto"'],
        ),
        (lambda: UnknownInput(ZERO_OUTSIDE, unknown=["u1"], method="fang"), ["invariant zero -1.5"]),
        (
            lambda: UnknownInput(model(), unknown=["u1"], method="feedthrough"),
            ["`method` = 'feedthrough' does not fit", "rank D = 0", "after 1 sample", "'no_feedthrough'"],
        ),
    ],
)  # fmt: skip
def test_a_filter_that_cannot_be_made_says_why(make, said):
    with pytest.raises(InputError) as raised:
        make()
    assert all(words in str(raised.value) for words in said), raised.value


def test_a_continuous_model_is_judged_at_the_steps_of_the_record():
    position = StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], Q=np.eye(2), R=[[1.0]], dt=0)
    algorithm = UnknownInput(position, unknown=["u1"])
    with pytest.raises(InputError, match="invariant zero -1 is not inside the unit circle"):
        estimate(algorithm, Record(np.zeros((5, 1)), dt=0.1), prior=Prior([0.0, 0.0], np.eye(2)))
    short = UnknownInput(position, unknown=["u1"], method="exact")
    result = estimate(short, Record(np.zeros((5, 1)), dt=0.1), prior=Prior([0.0, 0.0], np.eye(2)))
    assert np.all(np.isfinite(result.covariance))


def test_fang_says_at_which_sample_too_little_was_seen():
    y = np.zeros((5, 2))
    y[3] = np.nan
    with pytest.raises(RunError, match=r"At sample 3.*method=\"auto\""):
        estimate(UnknownInput(EXAMPLE, **FANG), Record(y, dt=1), prior=Prior([0.0, 0.0], np.eye(2)))
    with pytest.raises(InputError, match="no diffuse start"):
        estimate(UnknownInput(EXAMPLE, **FANG), Record(y, dt=1), prior=Prior([0.0, 0.0], np.eye(2), diffuse=np.eye(2)))


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        (lambda: unknown_input_existence("plant", unknown=["u1"]), "`model` must be a StateSpace"),
        (lambda: unknown_input_existence(EXAMPLE, unknown=["leak"], seen=[[1, 0, 1]]), r"`seen` must be \(T, p\) = \(T, 2\)"),
        (
            lambda: unknown_input_existence(StateSpace([[-1.0]], [[1.0]], dt=0), unknown=[0], seen=[[1]]),
            "`seen` refers to samples, but the model is continuous",
        ),
    ],
)  # fmt: skip
def test_a_question_asked_wrongly_is_refused(ask, said):
    with pytest.raises(InputError, match=said):
        ask()
