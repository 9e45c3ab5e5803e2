"""Slow, independent ways to the same numbers: a textbook loop that deletes rows, and one dense Gaussian."""
