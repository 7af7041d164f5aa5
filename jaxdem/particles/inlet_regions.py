"""Where the particles of an inlet may come in: parts of space from which points are drawn evenly.

Points in a disc, a ball and a cylinder are drawn by the inverse of their distribution, so that every one is inside.
Those of a polygon are drawn in the rectangle round it, and the ones outside do not count. Other parts of space, such as
the inside of a mesh, are cubes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.numerics.static import static


class InletRegion(Protocol):
    """A part of space; static and hashable."""

    def places(self, u: Array, own: Array) -> tuple[Array, Array]:
        """Points anywhere in the region at which a particle is wholly inside.

        Args:
            u: (T, D) even random numbers, 0 to 1.
            own: () radius of the particle [m].

        Returns:
            (T, D) points [m]; (T,) bool, which of them are inside.
        """
        ...


@static
class Round:
    """A disc in 2-D, a ball in 3-D.

    Attributes:
        center: D numbers [m].
        radius: [m].
    """

    center: tuple[float, ...]
    radius: float

    def places(self, u: Array, own: Array) -> tuple[Array, Array]:
        """See `InletRegion`. The radius R of a point has the distribution (r/R)^D."""
        dimension = len(self.center)
        away = (self.radius - own) * u[:, 0] ** (1.0 / dimension)
        angle = 2.0 * math.pi * u[:, 1]
        across = jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=1)
        if dimension == 3:
            height = 2.0 * u[:, 2:] - 1.0
            across = jnp.concatenate([jnp.sqrt(jnp.maximum(1.0 - height**2, 0.0)) * across, height], axis=1)
        points = jnp.asarray(self.center, u.dtype)[None] + away[:, None] * across
        return points, jnp.ones(len(u), bool)


@static
class Tube:
    """A cylinder in 3-D.

    Attributes:
        base: middle of its first end [m].
        axis: direction to the second end, of length one.
        radius: [m].
        length: [m].
    """

    base: tuple[float, ...]
    axis: tuple[float, ...]
    radius: float
    length: float

    def places(self, u: Array, own: Array) -> tuple[Array, Array]:
        """See `InletRegion`."""
        along = np.asarray(self.axis)
        first = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
        first /= np.linalg.norm(first)
        frame = jnp.asarray(np.stack([first, np.cross(along, first), along]), u.dtype)
        away, angle = (self.radius - own) * jnp.sqrt(u[:, 0]), 2.0 * math.pi * u[:, 1]
        height = own + u[:, 2] * (self.length - 2.0 * own)
        local = jnp.stack([away * jnp.cos(angle), away * jnp.sin(angle), height], axis=1)
        points = jnp.asarray(self.base, u.dtype)[None] + jnp.matmul(local, frame, precision="highest")
        return points, jnp.ones(len(u), bool)


@static
class Prism:
    """A polygon in the plane of the first and the last axis; in 3-D it extends along the second.

    Attributes:
        vertices: corners in order [m].
        across: ends along the second axis [m]; () in 2-D.
    """

    vertices: tuple[tuple[float, float], ...]
    across: tuple[float, ...] = ()

    def places(self, u: Array, own: Array) -> tuple[Array, Array]:
        """See `InletRegion`."""
        corners = np.asarray(self.vertices)
        low, high = corners.min(axis=0), corners.max(axis=0)
        ends = [(low[0], high[0]), *([self.across] if self.across else []), (low[1], high[1])]
        lower, upper = (jnp.asarray([end[k] for end in ends], u.dtype) for k in (0, 1))
        points = lower[None] + own + u * (upper - lower - 2.0 * own)[None]
        x, z = points[:, 0], points[:, -1]
        inside, clear = jnp.zeros(len(u), bool), jnp.ones(len(u), bool)
        for (ax, az), (bx, bz) in zip(self.vertices, (*self.vertices[1:], self.vertices[0]), strict=True):
            spans = (az > z) != (bz > z)
            inside ^= spans & (x < (bx - ax) * (z - az) / ((bz - az) or 1.0) + ax)
            squared = (bx - ax) ** 2 + (bz - az) ** 2
            part = jnp.clip(((x - ax) * (bx - ax) + (z - az) * (bz - az)) / (squared or 1.0), 0.0, 1.0)
            gap = (x - ax - part * (bx - ax)) ** 2 + (z - az - part * (bz - az)) ** 2
            clear &= gap >= own**2
        return points, inside & clear


@static
class Cubes:
    """Cubes of a lattice, in which a centre may lie.

    Attributes:
        origin: corner of the lattice [m].
        edge: of a cube [m].
        counts: cubes of the lattice along each axis.
        chosen: numbers of the cubes in the lattice, the last axis first; int32 as bytes, which compare at once.
    """

    origin: tuple[float, ...]
    edge: float
    counts: tuple[int, ...]
    chosen: bytes

    @property
    def number(self) -> np.ndarray:
        """(K,) int32."""
        return np.frombuffer(self.chosen, np.int32)

    def places(self, u: Array, own: Array) -> tuple[Array, Array]:
        """See `InletRegion`. What the first random number leaves within its cube is the place in it along the axis."""
        dimension, count = len(self.origin), len(self.number)
        drawn = u[:, 0] * count
        row = jnp.minimum(drawn.astype(jnp.int32), count - 1)
        cell = jnp.stack(jnp.unravel_index(jnp.asarray(self.number)[row], self.counts), axis=1)
        within = jnp.concatenate([(drawn - row)[:, None], u[:, 1:dimension]], axis=1)
        points = jnp.asarray(self.origin, u.dtype)[None] + self.edge * (cell.astype(u.dtype) + within)
        return points, jnp.ones(len(u), bool)


def cubes_in(
    inside: Callable[[np.ndarray, float], np.ndarray], bounds: tuple[np.ndarray, np.ndarray], edge: float, own: float
) -> Cubes | None:
    """The cubes of a lattice whose every point is so far inside as a particle is large; None without. Host.

    Args:
        inside: which of points (N, D) lie so far inside [m].
        bounds: corners of the box around the part of space [m].
        edge: of a cube [m].
        own: radius of the particle [m].
    """
    low, high = bounds
    counts = np.maximum(np.ceil((high - low) / edge).astype(int), 1)
    middles = np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in counts), indexing="ij"), axis=-1).reshape(-1, len(low))
    fits = inside(low + edge * middles, own + 0.5 * edge * math.sqrt(len(low)))
    chosen = np.flatnonzero(fits).astype(np.int32)
    if not len(chosen):
        return None
    return Cubes(tuple(low.tolist()), edge, tuple(counts.tolist()), chosen.tobytes())
