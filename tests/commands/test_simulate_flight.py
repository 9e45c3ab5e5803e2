"""`estimable simulate f16`: the failing elevator, for machines and for people."""

import pytest


@pytest.fixture
def simulate(run):
    return lambda *arguments: run("simulate", *arguments)


def test_the_numbers_of_the_failing_elevator(simulate):
    told = simulate("f16", "--loss", "0.8", "--runs", "20", "--seed", "1", "--json").json
    assert told["outcome"] == {"code": 0, "sentence": ""}
    assert told["adaptive_rms_after"] <= 0.05
    assert told["adaptive_rms_transient"] <= 0.48
    assert 4.2 < told["fixed_rms_after"] < 4.6
    assert told["detection_delay_s"] <= 0.06
    words = simulate("f16", "--loss", "0.8", "--runs", "20", "--seed", "1")
    assert "loses 80 % of its effect. The loss was detected 0.04 s later (median of 20)" in " ".join(
        words.stdout.split()
    )


@pytest.mark.parametrize(("arguments", "sentence"), [
    (("f16", "--loss", "1.5"), "`--loss` must be at most 1"),
    (("f16", "--runs", "0"), "`--runs` must be an integer of at least 1"),
    (("f16", "--rows", "5"), "--rows does not apply to f16"),
    (("output-error", "--rows", "10000000000"), "`--rows` must be at most 100000000. Got 10000000000."),
    (("output-error", "--loss", "0.5"), "--loss applies only to f16"),
    (("f16", "--plant", "cessna"), "`--plant` must be one of 'short-period', 'jsbsim', 'jsbsim-untrimmed'"),
    (("f16", "--plant", "jsbsim", "--folder", "parts"), "--folder applies only to --plant short-period"),
    (("output-error", "--plant", "jsbsim"), "--plant applies only to f16"),
    (("f18",), "`MODEL` must be one of 'output-error', 'f16'"),
])  # fmt: skip
def test_a_wrong_call_is_one_sentence(simulate, arguments, sentence):
    shown = simulate(*arguments)
    assert shown.code == 2
    assert sentence in shown.stderr
