"""The exceptions and warnings of estimable.

Three kinds, never mixed: a wrong call (`InputError`), an assumption that the model or the data do not meet
(`AssumptionError`), and a failure during a run (`RunError`).
"""


class EstimableError(Exception):
    """Base of every error that estimable raises on purpose."""


class InputError(EstimableError, ValueError):
    """A wrong call, file or option. The message names every fault of the call, one a line."""

    def __init__(self, *faults: str):
        self.faults = faults
        super().__init__("\n".join(faults))


class AssumptionError(EstimableError):
    """The model or the data do not meet what the method needs; the message carries the number that shows it."""


class RunError(EstimableError):
    """A run went wrong at one sample; `outcome` says which and why."""

    def __init__(self, outcome):
        self.outcome = outcome
        super().__init__(outcome.sentence)


class EstimableWarning(UserWarning):
    """Something the user should know, which does not make the answer wrong."""
