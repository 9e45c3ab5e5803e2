"""A step as a program of operations: on scalars, or on arrays."""
