"""The exceptions and warnings of estimable.

Three kinds, never mixed: a wrong call (`InputError`), an assumption that the model or the data do not meet
(`AssumptionError`), and a failure during a run (`RunError`).
"""


class EstimableError(Exception):
    """The base class of all errors that estimable raises deliberately."""


class InputError(EstimableError, ValueError):
    """Raised for a wrong call, file or option. The message lists all faults of the call, one on each line."""

    def __init__(self, *faults: str):
        self.faults = faults
        super().__init__("\n".join(faults))


class AssumptionError(EstimableError):
    """Raised where the model or the data do not meet an assumption of the method. The message holds the number that shows it."""


class RunError(EstimableError):
    """Raised where a run fails at a sample. Its `outcome` holds the sample and the reason."""

    def __init__(self, outcome):
        self.outcome = outcome
        super().__init__(outcome.sentence)

    def __reduce__(self):
        return type(self), (self.outcome,)  # between processes: the sentence alone makes no error


class EstimableWarning(UserWarning):
    """A warning about something the user should know that does not make the result wrong."""
