"""Figures of how right the engines are, in place of how fast."""
