"""Stokes drag of one sphere."""

from __future__ import annotations

import numpy as np
from jax import Array

from jaxdem.closures.correlation import Correlation
from jaxdem.numerics.host import namespace


class Stokes(Correlation):
    """Creeping flow past one sphere, whatever its neighbours do.

    F = 1, that is force = 3 pi mu d (u - v).

    Valid for Re << 1 and solid fraction << 1; used as verification case beyond that.
    Source: G. G. Stokes (1851), Trans. Cambridge Phil. Soc. 9, part II, 8-106.
    """

    def stokes_multiple(self, solid_fraction: Array, reynolds: Array) -> Array:
        """F = 1 for every solid fraction and Reynolds number [-]."""
        return namespace(reynolds).ones(
            np.broadcast_shapes(solid_fraction.shape, reynolds.shape),
            namespace(reynolds).result_type(solid_fraction, reynolds),
        )
