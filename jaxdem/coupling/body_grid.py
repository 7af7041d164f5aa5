"""The signed distance of a body that moves, known on a mesh of its own that moves with it; arrays of NumPy or JAX."""

from __future__ import annotations

import itertools

import numpy as np
from jax import Array

from jaxdem.fluid.grid import sum_of
from jaxdem.numerics.host import namespace
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector


@static
class BodyGrid:
    """A regular mesh in the frame of a body; static. The distance is linear between its corners along every axis, and
    beyond it that of its next corner, which is wider than any that counts.

    Attributes:
        origin: its first corner [m].
        spacing: of the corners [m].
    """

    origin: tuple[float, ...]
    spacing: tuple[float, ...]

    def distance(self, values: Array, points: Vector) -> Array:
        """The distance at points, D arrays of any shape [m].

        Args:
            values: at the corners [m].
            points: in the frame of the body [m].
        """
        xp, lower, share = namespace(points[0]), [], []
        for x, first, h, count in zip(points, self.origin, self.spacing, values.shape, strict=True):
            place = xp.clip((x - first) / h, 0.0, count - 1.0)
            low = xp.minimum(xp.floor(place), count - 2.0)
            lower.append(low.astype(np.int32))
            share.append(place - low)
        terms = []
        for ends in itertools.product((0, 1), repeat=len(points)):
            weight: Array | float = 1.0
            for end, part in zip(ends, share, strict=True):
                weight = weight * (part if end else 1.0 - part)
            terms.append(weight * values[tuple(low + end for low, end in zip(lower, ends, strict=True))])
        found: Array = sum_of(terms)
        return found
