"""Strict arithmetic for every test: no silent rank or dtype promotion."""

import jax

import estimable  # noqa: F401  enables float64 before any array is made

jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")
