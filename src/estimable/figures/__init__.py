"""Figures of results. These modules are imported only when a figure is made."""
