"""Verdicts on a model, before any data."""
