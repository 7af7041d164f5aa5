"""Boxes over which quantities are averaged: what part of a particle, of a branch or of a cell each holds."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.grid import Grid
from jaxdem.numerics.static import static


@static
class Boxes:
    """R boxes, such as the slices of a box; static, or traced by its numbers.

    Attributes:
        lower, upper: (R, D) corners [m].
        cut: axes along which a box is smaller than the domain; only these are compared.
        depth: extent of the third direction in 2-D; 1 in 3-D [m].
    """

    lower: tuple[tuple[float, ...], ...]
    upper: tuple[tuple[float, ...], ...]
    cut: tuple[int, ...]
    depth: float = 1.0


def slices(size: tuple[float, ...], axis: int, edges: tuple[float, ...], depth: float = 1.0) -> Boxes:
    """Slices of the domain along an axis.

    Args:
        size: side lengths of the domain [m].
        axis: number of the axis.
        edges: R + 1 coordinates that ascend [m].
        depth: of the domain in 2-D [m].
    """
    pairs = list(zip(edges[:-1], edges[1:], strict=True))
    lower = tuple(tuple(low if k == axis else 0.0 for k in range(len(size))) for low, _ in pairs)
    upper = tuple(tuple(high if k == axis else length for k, length in enumerate(size)) for _, high in pairs)
    return Boxes(lower, upper, (axis,), depth)


class Box(NamedTuple):
    """One of the boxes, traced.

    Attributes:
        lower, upper: (D,) corners [m].
    """

    lower: Array
    upper: Array


@static
class Parts:
    """What part of things lies in a box; static.

    Attributes:
        size: side lengths of the domain [m].
        periodic: whether each axis is periodic.
        cut: see `Boxes`.
    """

    size: tuple[float, ...]
    periodic: tuple[bool, ...]
    cut: tuple[int, ...]

    def of_spheres(self, box: Box, centres: Array, radius: Array) -> Array:
        """(N,) part of the volume of each sphere [-].

        Of a slice, cut along one axis, the exact part: of a sphere that below a plane at the distance t r from the
        centre is (2 + 3 t - t^3) / 4. What reaches into a wall is in no slice. Of a box that is cut along several axes
        1 where the centre lies in it, and 0 elsewhere.

        Args:
            box: the box.
            centres: (N, D) in the domain [m].
            radius: () or (N,) [m].
        """
        lower, upper = box
        if len(self.cut) != 1:
            inside = jnp.ones(centres.shape[0], bool)
            for k in self.cut:
                # The upper end of the domain belongs to the last box.
                last = (upper[k] >= self.size[k]) & (centres[:, k] <= upper[k])
                inside = inside & (centres[:, k] >= lower[k]) & ((centres[:, k] < upper[k]) | last)
            return inside.astype(centres.dtype)
        (axis,) = self.cut
        part = jnp.zeros(centres.shape[0], centres.dtype)
        for image in self._images(axis):
            place = centres[:, axis] + image
            part = part + _below((upper[axis] - place) / radius) - _below((lower[axis] - place) / radius)
        return part

    def of_branches(self, box: Box, start: Array, branch: Array) -> Array:
        """(P,) part of the length of each straight branch [-].

        Args:
            box: the box.
            start: (P, D) one end, in the domain [m].
            branch: (P, D) from there to the other end [m].
        """
        zero = jnp.zeros(start.shape[0], start.dtype)
        return self._clipped(box, self.cut, (start, branch), (zero, zero + 1.0))

    def _clipped(
        self, box: Box, cut: tuple[int, ...], line: tuple[Array, Array], between: tuple[Array, Array]
    ) -> Array:
        """What is left of the lines start + s branch, between two values of s, in the box and all its images."""
        if not cut:
            return jnp.maximum(between[1] - between[0], 0.0)
        axis, (start, branch) = cut[0], line
        lower, upper, along = box.lower[axis], box.upper[axis], branch[:, axis]
        total, moves = jnp.zeros_like(along), along != 0
        inverse = 1.0 / jnp.where(moves, along, 1.0)
        for image in self._images(axis):
            place = start[:, axis] + image
            ends = (lower - place) * inverse, (upper - place) * inverse
            # A line along the side of the box lies in it as a whole or not at all.
            outside = jnp.where((place >= lower) & (place < upper), 0.0, 1.0)
            enters = jnp.where(moves, jnp.minimum(*ends), outside)
            leaves = jnp.where(moves, jnp.maximum(*ends), 1.0 - outside)
            inner = jnp.maximum(enters, between[0]), jnp.minimum(leaves, between[1])
            total = total + self._clipped(box, cut[1:], line, inner)
        return total

    def of_cells(self, box: Box, grid: Grid) -> Array:
        """Part of every cell of the fluid, in the shape of the cells [-]."""
        dtype = box.lower.dtype
        part = jnp.ones(grid.cells, dtype)
        for k in self.cut:
            faces = grid.spacing[k] * jnp.arange(grid.cells[k] + 1, dtype=dtype)
            covered = jnp.minimum(faces[1:], box.upper[k]) - jnp.maximum(faces[:-1], box.lower[k])
            share = jnp.clip(covered / grid.spacing[k], 0.0, 1.0)
            part = part * share.reshape((1,) * k + (-1,) + (1,) * (grid.dimension - 1 - k))
        return part

    def _images(self, axis: int) -> tuple[float, ...]:
        """By how much what reaches over a periodic side is moved to be seen at the other one [m]."""
        length = self.size[axis]
        return (0.0, -length, length) if self.periodic[axis] else (0.0,)


def _below(t: Array) -> Array:
    """Part of a sphere below a plane at the distance t of its radius."""
    t = jnp.clip(t, -1.0, 1.0)
    return 0.25 * (2.0 + t * (3.0 - t * t))
