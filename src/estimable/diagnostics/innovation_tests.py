"""All consistency tests of the innovations of a result, in one list."""

from typing import NamedTuple

import numpy as np

from .. import checks
from ..data.record import Record
from ..frozen import saved
from ..results import Estimate
from .consistency import Consistency, nis
from .innovations import LAGS, Correlations, cross_correlation, standardised, whiteness


@saved
class InnovationChecks(NamedTuple):
    """The result of `check_innovations`: tests of the innovations of a filter.

    - `nis`: the test of the size of all innovations together.
    - `outputs`: for each output, the test of the size of its innovations.
    - `whiteness`: for each output, the test whether its innovations are white.
    - `cross_correlation`: for each pair (output, input), the test whether the innovations depend on the input.
    - `false_alarm`: the probability with which a correct model fails any of the tests.
    """

    nis: Consistency
    outputs: dict[str, Consistency]
    whiteness: dict[str, Correlations]
    cross_correlation: dict[tuple[str, str], Correlations]
    false_alarm: float

    @property
    def passed(self) -> bool:
        """Whether the innovations are consistent with the model."""
        return not self.faults

    @property
    def faults(self) -> tuple[str, ...]:
        """A sentence for each failed test: first inputs, then whiteness, then sizes, so that the most specific come first."""
        inputs = [c for c in self.cross_correlation.values() if not c.passed]
        found = [c.sentence for c in sorted(inputs, key=lambda c: c.p_value)]
        found += [c.sentence for c in sorted(self.whiteness.values(), key=lambda c: c.p_value) if not c.passed]
        found += [self._level(name) for name, c in self.outputs.items() if not c.consistent]
        return tuple(found if found or self.nis.consistent else [self.nis.sentence])

    def _level(self, name: str) -> str:
        """The sentence on the level of an output. The sign of the correlation at lag 1 distinguishes Q from R."""
        level, first = self.outputs[name], self.whiteness[name]
        small = level.mean > level.expected
        found = (
            f"mean squared innovation of {name} {level.mean:.2f}, expected 1 ({level.lower:.2f} to {level.upper:.2f})"
        )
        if abs(first.values[0]) <= 2 / np.sqrt(max(first.pairs[0], 1)):
            which = "Q and R"
        else:
            which = "Q" if (first.values[0] > 0) == small else f"R of {name}"
        return f"{found}: {which} probably too {'small' if small else 'large'}"

    def __str__(self) -> str:
        return "\n".join(self.faults) if self.faults else "consistent with the model"


def check_innovations(
    result: Estimate, record: Record, *, lags: int = LAGS, false_alarm: float = 0.01
) -> InnovationChecks:
    """Test the innovations of a result: for each output their size, their whiteness, and their correlation with each input.

    `result`: the result of `estimate`, with its covariances. `record`: the record of that estimate, for its inputs.
    `false_alarm`: the probability that a correct model fails any of the tests, of which each gets an equal share. Feedback
    from the outputs to an input does not disturb the tests if it acts with a delay of at least one sample.

    Returns an `InnovationChecks`. Raises `InputError` if the result has no innovations, or if the record is another one.

    >>> model = StateSpace([[0.9]], Q=[[0.1]], R=[[0.2]], dt=1)
    >>> drawn = simulate(model, seed=1, steps=300, prior=Prior([0.0], [[1.0]]))
    >>> result = estimate(Kalman(model), drawn.record, prior=Prior([0.0], [[1.0]]))
    >>> str(diagnostics.check_innovations(result, drawn.record))
    'consistent with the model'
    """
    e, u, inputs, false_alarm = _read(result, record, lags, false_alarm)
    outputs = result.names.outputs
    lags = max(1, min(lags, len(e) // 4))
    tests = 1 + len(outputs) * (2 + len(inputs))
    probability = 1 - checks_share(false_alarm, tests)
    S = np.asarray(result.innovation_covariance)
    levels, white, crossed = {}, {}, {}
    for i, name in enumerate(outputs):
        if np.sum(~np.isnan(e[:, i])) <= 2 * lags:
            continue
        levels[name] = nis(result.innovation[:, i : i + 1], S[:, i : i + 1, i : i + 1], probability=probability)
        white[name] = whiteness(e[:, i], name=name, lags=lags, probability=probability)
        for j, input_name in enumerate(inputs):
            if np.ptp(u[:, j]) > 0:
                crossed[name, input_name] = cross_correlation(
                    e[:, i], u[:, j], name=name, input_name=input_name, lags=lags, probability=probability
                )
    together = nis(result.innovation, S, probability=probability)
    return InnovationChecks(together, levels, white, crossed, false_alarm)


def checks_share(false_alarm: float, tests: int) -> float:
    """The false-alarm probability of each of several tests, such that the probability that any fails is `false_alarm`
    (Bonferroni).
    """
    faults = checks.Faults()
    faults.number("false_alarm", false_alarm, above=0.0, upper=1.0)
    faults.finish()
    return false_alarm / tests


def _read(
    result: Estimate, record: Record, lags: int, false_alarm: float
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...], float]:
    faults = checks.Faults()
    faults.instance("result", result, Estimate)
    faults.instance("record", record, Record)
    faults.whole("lags", lags, 1)
    false_alarm = faults.number("false_alarm", false_alarm, above=0.0, upper=1.0)
    faults.finish()
    innovation, S = result.innovation, result.innovation_covariance
    if innovation is None or S is None:
        checks.refuse('`result` has no innovations with covariances. Make it by estimate(..., keep="all").')
    if len(record) != len(innovation):
        checks.refuse(f"`record` must be the record of the result, with {len(innovation)} rows.")
    return standardised(innovation, S), np.asarray(record.applied(), float), tuple(record.inputs), false_alarm
