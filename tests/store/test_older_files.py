"""Files that were written before are read: every one in `files/`, one a format, by the version that it names."""

from pathlib import Path

import numpy as np
import pytest

import estimable as es

FILES = Path(__file__).parent / "files"
MODEL = es.StateSpace(
    [[0.9, 0.1], [0.0, 0.8]], [[0.0], [1.0]], Q=0.1 * np.eye(2), R=0.2 * np.eye(2), dt=0.1, states=["α", "q"], inputs=["δ"],
    operating_point={"states": [1.0, 2.0], "inputs": [3.0]},
)  # fmt: skip
PRIOR = es.Prior([0.25, 0.1], np.eye(2) / 4, diffuse=[[1.0], [0.5]])
RECORD = es.Record([[1.0, np.nan], [0.5, 0.25]], [0.0, 1.0], dt=0.1, inputs=["δ"], units={"y1": "deg"})
GAIN = es.UnknownGain(MODEL, es.Prior([1.0], [[0.25]]), walk=0.02, forgetting=0.99)
THINGS = {
    "model": MODEL,
    "prior": PRIOR,
    "record": RECORD,
    "algorithm": es.Gated(GAIN, 0.999),
    "links": (es.BernoulliLink([0.5]), es.DelayLink([0.5, 0.2], late="use")),
    "fit": es.results.Fit(
        es.ARX([0.5], [1.0], noise_variance=0.1, dt=1), np.array([0.5, 1.0]), np.eye(2), ("a1", "b0")
    ),
    "numbers": [1, 2.5, np.inf, True, None, "α", np.float32(0.5)],
}


def written_anew(name):
    """Write a file of today's format: once a format, and as often as one that is not released changes."""
    running = es.online(GAIN, prior=PRIOR)
    running.correct(RECORD.y[0])
    es.save(FILES / name, {**THINGS, "run": running, "estimate": es.estimate(GAIN, RECORD, prior=PRIOR)})


@pytest.mark.parametrize("path", sorted(FILES.iterdir()), ids=lambda path: path.stem)
def test_a_file_that_was_written_before_is_read(same, path):
    found = es.load(path)
    same({name: found[name] for name in THINGS}, THINGS)
    again = es.estimate(GAIN, RECORD, prior=PRIOR)
    np.testing.assert_allclose(found["estimate"].gain, again.gain, rtol=1e-12)
    found["run"].predict(RECORD.u[0])
    np.testing.assert_allclose(found["run"].correct(RECORD.y[1]).gain, again.gain[1], rtol=1e-12)
