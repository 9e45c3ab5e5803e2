"""Speed beside accuracy: `python -m benchmarks` (see `--help`)."""
