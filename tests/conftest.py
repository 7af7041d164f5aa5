"""Strict settings for all tests: float64 unless a test asks for less, no silent rank promotion."""

import jax

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.devices()  # from here on `fuse_loops`, which commands call, changes the environment only: gradients compile
