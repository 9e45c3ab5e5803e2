"""The derivatives of a likelihood with respect to named numbers."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from .. import checks
from ..data.record import Record
from ..engines import choice
from ..errors import RunError
from ..models.prior import Prior
from ..protocols import Algorithm
from ..results import Outcome, Score
from .binding import bind
from .following import along_record
from .named_numbers import NamedNumber, Setup, fields_of
from .slopes import Rows, ascent


def score(
    algorithm: Algorithm[Any],
    record: Record,
    *,
    prior: Prior | None,
    with_respect_to: Sequence[str],
    engine: str = "auto",
) -> Score:
    """Differentiate the log-likelihood of a record with respect to named numbers, and give Fisher's information about them.

    - `algorithm`, `record`, `prior` and `engine` are as in `estimate`.
    - `with_respect_to`: the names of the numbers, a list. "A[q, alpha]" is the entry in row q and column alpha of the matrix
      A of the model; B, C, D, Q, R, S and G are named in the same way, for continuous and discrete models. "Q[q]" and "R[y1]"
      are variances. A covariance off the diagonal appears twice in its matrix, and changes in both places. "x0[q]" is the
      prior mean of the state q, "gain[gain]" is the prior mean of a gain, and "walk[gain]" is the variance of its walk. A
      parameter of a `NonlinearModel` has its own name, without brackets.

    The derivatives are exact: each step of the filter is differentiated. The information is that of the innovations and of
    their covariances.

    Returns a `Score`. Raises `InputError` with every fault of the call. Raises `RunError` where the calculation failed; the
    message names the sample.

    Cost: for each 8 numbers about 15 runs of the filter (n = 4, p = 2), calculated together in machine code.

    Reference: K. J. Åström, Automatica 16 (1980) 551-574; N. K. Gupta, R. K. Mehra, IEEE TAC 19 (1974) 774-783.

    >>> model = StateSpace([[0.9]], Q=[[0.2]], R=[[0.5]], dt=1)
    >>> found = score(Kalman(model), simulate(model, seed=1, steps=400).record, prior=Prior([0.0], [[1.0]]),
    ...               with_respect_to=["A[x1, x1]", "R[y1]"])
    >>> found.names, found.information.shape
    (('A[x1, x1]', 'R[y1]'), (2, 2))
    """
    faults = checks.Faults()
    choice.check(engine, faults)
    faults.finish()
    bound = bind(algorithm, record, prior)
    if not algorithm.has_innovation_covariance:
        checks.refuse(
            f"`algorithm` must report the covariance of its innovations: {type(algorithm).__name__} reports none."
        )
    entries = _read(algorithm, prior, with_respect_to)
    start = Setup(along_record(algorithm, record), prior)
    ran, found = ascent(lambda by: start.moved(entries, by), np.zeros(len(entries)), Rows.of(bound), engine)
    outcome = Outcome.of(found.code, found.failed_at, bound.t)
    if outcome.code:
        raise RunError(outcome)
    names = tuple(entry.name for entry in entries)
    return Score(found.log_likelihood, found.score, found.information, names, ran)


def _read(algorithm: Algorithm[Any], prior: Prior | None, texts: Sequence[str]) -> list[NamedNumber]:
    faults = checks.Faults()
    if isinstance(texts, str) or not isinstance(texts, list | tuple) or not texts:
        faults.add(f"`with_respect_to` must be a list of names of entries. Got {checks.short(texts)}.")
        faults.finish()
    fields = fields_of(algorithm, prior)
    entries = [NamedNumber.read(text, fields, faults) for text in texts]
    faults.finish()
    return [entry for entry in entries if entry is not None]
