"""The shapes of a scene: clumps of spheres in their principal axes. Host, numpy."""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

from jaxdem.particles.union import covered, shadows, union_of
from jaxdem.scene import Particles
from jaxdem.scene.shapes import SPHERE, Shape
from jaxdem.setup.bodies import Bodies
from jaxdem.setup.turns import turned

ALIKE = 1e-9
"""Moments of inertia that differ by less than this part are equal, and products that are smaller are none."""

LEVEL = 0.02
"""Members that end so near to a plane, in radii of the smallest, touch it together with those that touch it [-]."""


class Template(NamedTuple):
    """A shape in its principal axes, for a body whose sphere of the same volume has the radius 1.

    Attributes:
        centres: (m, D) of the spheres, from the centre of mass [-].
        radii: (m,) [-].
        inertia: principal moments over m r^2: 3, in 2-D the one across the plane [-].
        sphericity: [-].
        shadow: (D,) areas of the projections along the principal axes over pi r^2 [-].
        axes: (3, 3) the principal axes, its columns, in those in which the shape is given; in 2-D turned in the plane.
        within: number of spheres that lie within others and touch nothing.
    """

    centres: np.ndarray
    radii: np.ndarray
    inertia: np.ndarray
    sphericity: float
    shadow: np.ndarray
    axes: np.ndarray
    within: int

    @property
    def reach(self) -> float:
        """Of the sphere about the centre of mass that holds it [-]."""
        return float(np.max(np.linalg.norm(self.centres, axis=1) + self.radii))

    @property
    def parts(self) -> np.ndarray:
        """(m,) of the volume that its spheres stand for; overlaps are shared out in proportion [-]."""
        volumes = self.radii**3
        return volumes / volumes.sum()

    @property
    def share_felt(self) -> float:
        """Mass that the contacts of a sphere have to feel for the stable step of the clump, over the body's [-].

        Along a unit vector n at the arm a: 1/m* = 1/m + (a x n).I^-1 (a x n). Along the normal of a contact the arm to
        the centre of a member counts, and the largest eigenvalue over n; across it the arm to its surface, and the
        least moment. A sphere has 1/m and 7/2 of that.
        """
        moments, felt = self.inertia, 1.0
        for centre, radius in zip(self.centres, self.radii, strict=True):
            distance = float(np.linalg.norm(centre))
            if len(centre) == 2:
                largest = distance**2 / float(moments[0])
            else:
                x, y, z = centre
                cross = np.asarray([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
                largest = float(np.linalg.eigvalsh(cross.T @ (cross / moments[:, None]))[-1])
            across = 1.0 + (distance + radius) ** 2 / float(moments.min())
            felt = min(felt, 1.0 / (1.0 + largest), 3.5 / across)
        return felt

    @property
    def crowding(self) -> float:
        """Surface on which centres of touching spheres lie, of the smallest member's size, over that of a sphere."""
        if len(self.radii) == 1:
            return 1.0
        small = float(self.radii.min())
        centres = self.centres if self.centres.shape[1] == 3 else np.insert(self.centres, 1, 0.0, axis=1)
        around = union_of(tuple(map(tuple, centres.tolist())), tuple((self.radii + small).tolist()))
        return around.surface / (16.0 * math.pi * small**2)

    @property
    def facing(self) -> float:
        """Contacts that it may have at once with one body of its shape, all nearly along one line.

        F members touch one plane: all of those in a row or of a flat shape, else the most on a face of the hull of
        the centres. The members of the other body stand between them: two rows have 2 F - 1 contacts, two square
        faces (2 sqrt(F) - 1)^2.
        """
        if len(self.radii) == 1:
            return 1.0
        dimension, apart = self.centres.shape[1], self.centres - self.centres.mean(axis=0)
        sizes = np.linalg.svd(apart, compute_uv=False)
        rank = int(np.sum(sizes > ALIKE * sizes[0]))
        most = len(self.radii)
        if rank == dimension:
            planes = ConvexHull(self.centres).equations
            height = self.centres @ planes[:, :-1].T + self.radii[:, None]
            most = int(np.max(np.sum(height > np.max(height, axis=0) - LEVEL * self.radii.min(), axis=0)))
        in_a_row = rank == 1 or dimension == 2
        return 2.0 * most - 1.0 if in_a_row else (2.0 * math.sqrt(most) - 1.0) ** 2


def template(shape: Shape | None, dimension: int) -> Template:
    """What a shape is; None is a sphere."""
    if shape is None:
        inertia = np.full(1 if dimension == 2 else 3, 0.4)
        return Template(np.zeros((1, dimension)), np.ones(1), inertia, 1.0, np.ones(dimension), np.eye(3), 0)
    given = shape.spheres(dimension)
    centres, radii = np.asarray(given[0], float), np.asarray(given[1], float)
    kept = ~covered(centres, radii)
    if kept.sum() == 1:
        return template(None, dimension)._replace(within=len(kept) - 1)
    union = shape.union(dimension)
    axes = principal_axes(union.moments, dimension)
    inside = (centres[kept] - union.centre) @ axes / union.radius
    moments = np.diag(axes.T @ union.moments @ axes) / union.radius**2
    moments = _made_equal(moments)
    areas = shadows(inside, radii[kept] / union.radius) / math.pi
    rows = [0, 2] if dimension == 2 else [0, 1, 2]
    return Template(
        inside[:, rows],
        radii[kept] / union.radius,
        moments[1:2] if dimension == 2 else moments,
        union.sphericity,
        areas[rows],
        axes,
        int(len(kept) - kept.sum()),
    )


def _unique_basis(vectors: np.ndarray) -> np.ndarray:
    """An orthonormal basis (3, k) of the space that k vectors span, whatever basis of it they are.

    The axes of the box in turn, as far as they lie in that space and are not nearly along those before.
    """
    basis = np.zeros((3, 0))
    for axis in vectors @ vectors.T:
        rest = axis - basis @ (basis.T @ axis)
        if basis.shape[1] < vectors.shape[1] and np.linalg.norm(rest) > 0.3:
            basis = np.column_stack([basis, rest / np.linalg.norm(rest)])
    return basis


def principal_axes(moments: np.ndarray, dimension: int) -> np.ndarray:
    """(3, 3) principal axes, right-handed; the given ones where they are, and in 2-D the second stays.

    They are the same on every machine, and so are quaternions and random orientations: the signs of eigenvectors, and
    all of those of equal moments, depend on the processor.
    """
    size = ALIKE * np.trace(moments)
    if np.abs(moments - np.diag(np.diag(moments))).max() < size:
        return np.eye(3)
    if dimension == 3:
        values, found = np.linalg.eigh(moments)
        groups = np.concatenate([[0], np.cumsum(np.diff(values) > size)])
        axes = np.concatenate([_unique_basis(found[:, groups == k]) for k in range(groups[-1] + 1)], axis=1)
        return axes * (1.0 if np.linalg.det(axes) > 0.0 else np.asarray([1.0, 1.0, -1.0]))
    angle = 0.5 * math.atan2(2.0 * moments[0, 2], moments[0, 0] - moments[2, 2])
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.asarray([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]])


def _made_equal(moments: np.ndarray) -> np.ndarray:
    """The moments, those that differ by rounding alone made equal: a body of revolution has two."""
    found = moments.copy()
    for k in range(3):
        near = np.abs(found - found[k]) < ALIKE * found[k]
        found[near] = found[k]
    return found


@dataclasses.dataclass(frozen=True)
class ShapeTable:
    """The shapes of a scene by number; 0 is the sphere.

    Attributes:
        names: of the shapes.
        templates: of the same.
        dimension: of the scene.
    """

    names: tuple[str, ...]
    templates: tuple[Template, ...]
    dimension: int

    @cached_property
    def reach(self) -> np.ndarray:
        """Radii of the spheres that hold the shapes, of bodies of radius 1 [-]."""
        return np.asarray([one.reach for one in self.templates])

    def outer(self, bodies: Bodies) -> np.ndarray:
        """() or (N,) radius of the sphere about the centre of mass that holds a body [m]."""
        found: np.ndarray = self.reach[bodies.shape] * bodies.radius
        return found

    def arm(self, bodies: Bodies) -> float:
        """Farthest that the centre of a sphere is from that of its body [m]."""
        arms = np.asarray([np.linalg.norm(one.centres, axis=1).max() for one in self.templates])
        return float(np.max(arms[bodies.shape] * bodies.radius))

    def members(self, shape: np.ndarray) -> int:
        """m, most spheres of a body."""
        return max(len(self.templates[number].radii) for number in np.unique(shape))

    def padded(self, shape: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]:
        """Of the shapes: offsets (m, N, D), radii (m, N), parts of the volume (m, N), and (m, N) bool, which spheres
        there are, None if all; N = 1 where all bodies are alike. Spheres that are not there are as the first one."""
        number = np.atleast_1d(shape)
        size = self.members(shape)
        offset = np.stack([_filled(one.centres, size) for one in self.templates])[number]
        radius = np.stack([_filled(one.radii, size) for one in self.templates])[number]
        count = np.asarray([len(one.radii) for one in self.templates])[number]
        there = np.arange(size)[:, None] < count[None]
        part = np.stack([_filled(one.parts, size) for one in self.templates])[number].T * there
        return np.moveaxis(offset, 1, 0), radius.T, part, None if there.all() else there

    def spheres(self, bodies: Bodies) -> Bodies:
        """What touches: the members that there are, with the density and material of their bodies."""
        _, radius, _, there = self.padded(bodies.shape)
        count = np.broadcast(*(np.atleast_1d(column) for column in bodies)).size
        each = np.broadcast_to(radius * np.atleast_1d(bodies.radius)[None], (len(radius), count))
        shown = np.full(each.shape, True) if there is None else np.broadcast_to(there, each.shape)

        def rows(column: np.ndarray) -> np.ndarray:
            return column if column.ndim == 0 else np.broadcast_to(column[None], each.shape)[shown]

        flat = each[shown]
        if (flat == flat[0]).all():
            flat = flat[0].reshape(())
        return Bodies(flat, rows(bodies.density), rows(bodies.material))

    def placed(
        self, bodies: Bodies, position: np.ndarray, orientation: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Centres (M, D) [m] and radii (M,) [m] of all members, and (M,) the body that each is a part of.

        Args:
            bodies: (N,) each.
            position: (N, D) [m].
            orientation: (N, 4) or (N, 1), of the principal axes.
        """
        centres, radii, owner = [], [], []
        for kind in np.unique(bodies.shape):
            here, one = np.flatnonzero(bodies.shape == kind), self.templates[kind]
            arm = turned(orientation[here], np.broadcast_to(one.centres, (len(here), *one.centres.shape)))
            size = bodies.radius[here]
            centres.append((position[here, None] + size[:, None, None] * arm).reshape(-1, position.shape[1]))
            radii.append((size[:, None] * one.radii[None]).ravel())
            owner.append(np.repeat(here, len(one.radii)))
        if not centres:
            return position, np.zeros(0), np.zeros(0, int)
        return np.concatenate(centres), np.concatenate(radii), np.concatenate(owner)


def _filled(rows: np.ndarray, size: int) -> np.ndarray:
    return np.concatenate([rows, np.repeat(rows[:1], max(size - len(rows), 0), axis=0)])[:size]


def shape_table(particles: Particles, dimension: int) -> ShapeTable | None:
    """The shapes of a scene; None in a scene of spheres."""
    if not particles.has_clumps:
        return None
    names = (SPHERE, *(shape.name for shape in particles.shapes))
    templates = (template(None, dimension), *(template(shape, dimension) for shape in particles.shapes))
    return ShapeTable(names, templates, dimension)
