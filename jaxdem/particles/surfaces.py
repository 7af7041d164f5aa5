"""Walls beside the sides of the box: surfaces given by a signed distance, positive where particles may be.

A particle feels the nearest point of the surface as a flat wall with the normal there: the overlap is the radius
less the distance, the normal the gradient of the distance. A surface that a particle can touch at two points at
once, as a groove, is therefore two surfaces.

The surfaces here give the overlap and not the distance. It is small where it matters, and in float32 it is
computed from the position's leading part without cancellation: to 2e-11 m in a box of metres, as measured in
`tests/particles`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.numerics import compensated, vectors
from jaxdem.numerics.compensated import Low, Pair
from jaxdem.numerics.placement import Placement
from jaxdem.numerics.stages import stage
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector


class Surface(Protocol):
    """A wall; static and hashable."""

    def overlap(self, x: Array, radius: Array) -> Array:
        """radius - distance(x).

        Args:
            x: (D,) a centre [m].
            radius: () [m].

        Returns:
            () depth by which the particle reaches into the wall, negative for a gap [m].
        """
        ...


@static
class Plane:
    """distance(x) = n . (x - point), n the unit vector along `normal`.

    Attributes:
        point: a point of the plane, D numbers [m].
        normal: towards the particles, D numbers of any length.
    """

    point: tuple[float, ...]
    normal: tuple[float, ...]

    def overlap(self, x: Array, radius: Array) -> Array:
        """See `Surface`."""
        unit = _unit(np.asarray(self.normal))
        offset = float(unit @ np.asarray(self.point))
        return _value(compensated.affine(x, (-unit).tolist(), offset, radius))


@static
class Cylinder:
    """distance(x) = R - rho inside and rho - R outside, rho the distance from the axis; in 2-D a circle.

    Attributes:
        center: a point of the axis, D numbers [m].
        radius: R [m].
        axis: direction of the axis, three numbers of any length; None in 2-D.
        inside: whether the particles are inside.
    """

    center: tuple[float, ...]
    radius: float
    axis: tuple[float, ...] | None
    inside: bool

    def overlap(self, x: Array, radius: Array) -> Array:
        """See `Surface`: radius + rho - R inside, radius + R - rho outside, as the overlap of two spheres."""
        center = np.asarray(self.center)
        (first, low), second = (
            compensated.affine(x, direction.tolist(), -float(direction @ center)) for direction in self._across()
        )
        sign = -1.0 if self.inside else 1.0
        contact = compensated.affine(sign * radius[None], (1.0,), self.radius)
        # On the axis the distance from it has no slope.
        apart = (first != 0.0) | (second[0] != 0.0)
        separation = ((jnp.where(apart, first, 1.0), low), second)
        overlap = compensated.overlap_of_spheres(separation, *contact)
        return sign * jnp.where(apart, overlap, contact[0])

    def _across(self) -> np.ndarray:
        """(2, D) orthonormal vectors across the axis; those of the coordinates where the axis is the third."""
        if self.axis is None:
            return np.eye(2)
        axis = _unit(np.asarray(self.axis))
        first, second = (k for k in range(3) if k != int(np.argmax(np.abs(axis))))
        a = _unit(np.eye(3)[first] - axis[first] * axis)
        b = np.eye(3)[second] - axis[second] * axis
        return np.stack([a, _unit(b - (b @ a) * a)])


@static
class DistanceFunction:
    """A surface given by a function of the user's.

    What float32 resolves is what the function resolves: about 6e-8 of the largest number in it, at best of the
    particle's distance from the point that it measures from. Its slope must have length one at the surface; and
    it must be finite wherever a particle may be if gradients are wanted.

    Attributes:
        distance: x (D,) [m] -> () [m], positive where particles may be; in JAX's functions.
    """

    distance: Callable[[Array], Array]

    def overlap(self, x: Array, radius: Array) -> Array:
        """See `Surface`."""
        return radius - self.distance(x)


@static
class MovedSurface:
    """A surface x = R X + s away from where it was made, at rest there: where packs of particles may lie. In float32
    its overlap is that of a position rounded to one float.

    Attributes:
        surface: in its own frame.
        rotation: R, D rows of D numbers.
        shift: s, D numbers [m].
    """

    surface: Surface
    rotation: tuple[tuple[float, ...], ...]
    shift: tuple[float, ...]

    def overlap(self, x: Array, radius: Array) -> Array:
        """See `Surface`."""
        turn, shift = np.asarray(self.rotation), np.asarray(self.shift)
        own = [_value(compensated.affine(x, column.tolist(), -float(column @ shift))) for column in turn.T]
        return self.surface.overlap(jnp.stack(own), radius)


def wedge(apex: tuple[float, ...], directions: tuple[tuple[float, ...], ...]) -> tuple[Plane, Plane]:
    """Two planes that meet, with the particles between them.

    Args:
        apex: a point of the edge where they meet, D numbers [m].
        directions: a, b: along either plane away from the edge and across it, less than a half turn apart.

    Returns:
        The planes through the apex along a and along b; the normal of the first is the part of b across a.
    """
    a, b = (_unit(np.asarray(direction)) for direction in directions)
    return Plane(apex, tuple((b - (a @ b) * a).tolist())), Plane(apex, tuple((a - (a @ b) * b).tolist()))


def surface_contacts(
    surfaces: tuple[Surface, ...],
    position: Vector,
    low: tuple[Low, ...],
    radius: Array,
    placements: Sequence[Placement | None] = (),
) -> tuple[Array, Vector]:
    """Overlap with all surfaces, and unit normals from them towards the particles.

    The overlap is evaluated at the leading part of the position; the trailing part, a millionth of a millimetre
    or less, adds its product with the gradient.

    Args:
        surfaces: S of them; static.
        position: D arrays (N,), leading part [m].
        low: D arrays (N,) or Nones, trailing part [m].
        radius: () or (N,) [m].
        placements: of each surface, and perhaps of further walls, None for one at rest; empty where all are.

    Returns:
        overlap (S, N), negative for a gap [m]; normal, D arrays (S, N).
    """
    x = jnp.stack(position, axis=1)
    found = [
        _contacts(surface, x, low, radius) if placed is None else _placed(surface, placed, position, low, radius)
        for surface, placed in zip(surfaces, placements[: len(surfaces)] or (None,) * len(surfaces), strict=True)
    ]
    overlaps, normals = zip(*found, strict=True)
    return jnp.stack(overlaps), tuple(jnp.stack(component) for component in zip(*normals, strict=True))


def _placed(
    surface: Surface, placed: Placement, position: Vector, low: tuple[Low, ...], radius: Array
) -> tuple[Array, Vector]:
    """The same with one surface (N,) that has moved."""

    def evaluated() -> tuple[Array, Vector]:
        own, own_low = stage(there, lambda: placed.to_body(position, low))
        overlap, normal = _contacts(surface, jnp.stack(own, axis=1), own_low, radius)
        return overlap, placed.to_box(normal)

    # Stages, or the place in the body would be computed anew for every component of every force.
    there = ~(placed.shift[0] > jnp.inf)  # always, also for what is not a number
    return stage(there, evaluated)


def _contacts(surface: Surface, x: Array, low: tuple[Low, ...], radius: Array) -> tuple[Array, Vector]:
    """Overlap (N,) and normals with one surface in its own frame, of leading parts x (N, D)."""
    sizes = None if radius.ndim == 0 else 0
    value, slope = jax.vmap(jax.value_and_grad(surface.overlap), in_axes=(0, sizes))(x, radius)
    direction = tuple(-slope[:, k] for k in range(len(low)))
    squared = vectors.dot(direction, direction)
    sloped = squared > 0
    for component, trailing in zip(direction, low, strict=True):
        if trailing is not None:
            value = value - jnp.where(sloped, component * trailing, 0.0)
    # Where there is no direction, as on the axis of a tube, nothing touches and any finite normal does. A
    # contact without one gets a normal that is not a number, which stops the run.
    usable = sloped | (value > 0)
    inverse = 1.0 / jnp.sqrt(jnp.where(usable, squared, 1.0))
    return value, tuple(jnp.where(usable, component, 0.0) * inverse for component in direction)


def _value(pair: Pair) -> Array:
    return pair[0] if pair[1] is None else pair[0] + pair[1]


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / math.hypot(*vector)
