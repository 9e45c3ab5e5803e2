"""Wrong arguments by the thousand: every outcome is an answer or an `EstimableError`. `python -m tests.fuzz --minutes 30`."""
