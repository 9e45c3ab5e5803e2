"""Speed and accuracy: `python -m benchmarks` (see `--help`)."""
