"""Measurements of the accuracy of the engines, not of their speed."""
