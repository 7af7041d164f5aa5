"""Boxes over which quantities are averaged: what part of a particle, of a branch or of a cell each holds."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxdem.errors import InputError
from jaxdem.fluid.grid import Grid
from jaxdem.fluid.mesh import face_places
from jaxdem.numerics.products import PRECISION
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector
from jaxdem.observables.arguments import require_numbers

SHORT = 1e-30
"""Extents below this are none; its inverse is finite in float32 [m]."""


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

    Raises:
        InputError: there is no such axis, or the coordinates do not ascend.
    """
    require_numbers("axis", (axis,), len(size), "axes")
    if len(edges) < 2 or not all(low < high for low, high in itertools.pairwise(edges)):
        raise InputError("edges", list(edges), "must ascend, two coordinates at least", "sort them")
    pairs = list(zip(edges[:-1], edges[1:], strict=True))
    lower = tuple(tuple(low if k == axis else 0.0 for k in range(len(size))) for low, _ in pairs)
    upper = tuple(tuple(high if k == axis else length for k, length in enumerate(size)) for _, high in pairs)
    return Boxes(lower, upper, (axis,), depth)


AT_ONCE = 1 << 20
"""Numbers of the weights of the boxes that are treated at once."""

Result = TypeVar("Result")


class Box(NamedTuple):
    """One of the boxes, traced.

    Attributes:
        lower, upper: (D,) corners [m].
    """

    lower: Array
    upper: Array


def of_boxes(in_box: Callable[[Box], Result], boxes: Boxes, like: Array) -> Result:
    """What a function gives for each box; for as many at once as their weights take little memory.

    Args:
        in_box: pure, of one box.
        boxes: R of them.
        like: (P,) of the type and the size of the weights of a box.

    Returns:
        its results with R in front.
    """
    corners = Box(jnp.asarray(boxes.lower, like.dtype), jnp.asarray(boxes.upper, like.dtype))
    count, most = len(boxes.lower), max(AT_ONCE // max(like.shape[0], 1), 1)
    if count <= most:
        return jax.vmap(in_box)(corners)
    blocks = -(-count // most)
    result: Result = lax.map(in_box, corners, batch_size=-(-count // blocks))
    return result


def _part(value: Array) -> Array:
    """Within 0 and 1; without a slope at both."""
    return lax.clamp(jnp.zeros((), value.dtype), value, jnp.ones((), value.dtype))


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

    def of_branches(self, box: Box, start: Vector, branch: Vector) -> Array:
        """(P,) part of the length of each straight branch; of one along the side of a box all or nothing [-].

        Args:
            box: the box.
            start: D arrays (P,), one end, in the domain [m].
            branch: D arrays (P,), from there to the other end [m].
        """
        if len(self.cut) == 1:
            return self._between(box, self.cut[0], start, branch)
        zero = jnp.zeros_like(start[0])
        return self._clipped(box, self.cut, (start, branch), (zero, zero + 1.0))

    def _between(self, box: Box, axis: int, start: Vector, branch: Vector) -> Array:
        """Part of each branch between two planes; from its lower end at a to a + b it has (e - a) / b below a plane at
        e, within 0 and 1."""
        along, total = jnp.abs(branch[axis]), jnp.zeros_like(start[axis])
        lower_end = start[axis] + jnp.minimum(branch[axis], 0.0)
        # Of a branch along the plane the part jumps from 0 to 1; the clamp then has no slope.
        inverse = 1.0 / jnp.maximum(along, SHORT)
        for image in self._images(axis):
            place = lower_end + image
            upper, lower = (_part((end[axis] - place) * inverse) for end in (box.upper, box.lower))
            total = total + (upper - lower)
        return total

    def _clipped(
        self, box: Box, cut: tuple[int, ...], line: tuple[Vector, Vector], between: tuple[Array, Array]
    ) -> Array:
        """What is left of the lines start + s branch, between two values of s, in the box and all its images."""
        if not cut:
            return jnp.maximum(between[1] - between[0], 0.0)
        axis, (start, branch) = cut[0], line
        lower, upper, along = box.lower[axis], box.upper[axis], branch[axis]
        total, moves = jnp.zeros_like(along), along != 0
        inverse = 1.0 / jnp.where(moves, along, 1.0)
        for image in self._images(axis):
            place = start[axis] + image
            ends = (lower - place) * inverse, (upper - place) * inverse
            # A line along the side of the box lies in it as a whole or not at all.
            outside = jnp.where((place >= lower) & (place < upper), 0.0, 1.0)
            enters = jnp.where(moves, jnp.minimum(*ends), outside)
            leaves = jnp.where(moves, jnp.maximum(*ends), 1.0 - outside)
            inner = jnp.maximum(enters, between[0]), jnp.minimum(leaves, between[1])
            total = total + self._clipped(box, cut[1:], line, inner)
        return total

    def sum_over_cells(self, box: Box, grid: Grid, fields: Array) -> Array:
        """(K,) integral of fields over the part of every cell that lies in the box.

        Args:
            box: the box.
            grid: of the fluid.
            fields: (K, *cells) with the axes that the box does not cut summed over, of size 1.
        """
        dtype = box.lower.dtype
        for k in reversed(range(grid.dimension)):
            if k not in self.cut:
                fields = fields[..., 0]
                continue
            faces = face_places(grid, k, dtype)
            covered = jnp.minimum(faces[1:], box.upper[k]) - jnp.maximum(faces[:-1], box.lower[k])
            fields = jnp.matmul(fields, jnp.clip(covered / grid.spacing[k], 0.0, 1.0), precision=PRECISION)
        return fields * jnp.asarray(grid.cell_volume, dtype)

    def _images(self, axis: int) -> tuple[float, ...]:
        """By how much what reaches over a periodic side is moved to be seen at the other one [m]."""
        length = self.size[axis]
        return (0.0, -length, length) if self.periodic[axis] else (0.0,)


def _below(t: Array) -> Array:
    """Part of a sphere below a plane at the distance t of its radius."""
    t = jnp.clip(t, -1.0, 1.0)
    return 0.25 * (2.0 + t * (3.0 - t * t))
