"""Which grains are near a mesh, and which of its faces, edges and corners each of them may touch.

Made with the neighbour list, by `mesh_search`, and good for as long: until a grain has moved half of the skin. Of what
is listed the list keeps the overlap and the place at its build, computed in pairs of floats, and a contact step only
adds the motion since then, as for two grains. Grains that are near a mesh have a row; the others cost a contact step
nothing.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxdem.errors import required
from jaxdem.numerics import compensated
from jaxdem.numerics.compensated import Low
from jaxdem.numerics.placement import Placement
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.mesh_near import Near, NearCorners, NearEdges, NearFaces
from jaxdem.particles.mesh_room import MeshRoom
from jaxdem.particles.mesh_surface import MeshSurface, Places
from jaxdem.particles.pairs import at


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class MeshList:
    """Grains near a mesh, M rows, and what each may touch.

    Attributes:
        surface: the mesh; None in a checkpoint.
        row: (M,) int32, the grain of each row; the number of grains in an empty row.
        faces: (K, M) of each; None without room for any.
        edges: the same.
        corners: the same.
        contacts: C, room for contacts of a grain; static.
        looks: see `MeshRoom`; static.
        placement: of the mesh at the build, with a rotation; None of one at rest.
        reference: (M,) grains of the rows at the build, in the frame of the mesh; None of one at rest.
        images: (M,) whole periods by which they were moved into the box; None without, and of one at rest.
    """

    surface: MeshSurface | None
    row: Array
    faces: NearFaces | None
    edges: NearEdges | None
    corners: NearCorners | None
    contacts: int = dataclasses.field(metadata={"static": True})
    looks: tuple[int, int, int] = dataclasses.field(metadata={"static": True})
    placement: Placement | None = None
    reference: Places | None = None
    images: Places | None = None

    def moved(self, placed: Placement, position: Vector, low: tuple[Low, ...]) -> Vector:
        """D arrays (M,), motion of the grains of the rows since the build in the frame of a mesh that moves [m].

        Args:
            placed: the mesh now.
            position, low: D arrays (N,), all grains now [m].
        """
        reference, images = required(self.reference, "reference"), required(self.images, "images")
        grain = jnp.minimum(self.row, max(position[0].shape[0] - 1, 0))
        now = Places(position, low).of(grain)
        inside = [compensated.difference(*one, *image) for one, image in zip(now.pairs, images.pairs, strict=True)]
        own = placed.to_body(tuple(high for high, _ in inside), tuple(rest for _, rest in inside))
        pairs = zip(Places(*own).pairs, reference.pairs, strict=True)
        return tuple(compensated.rounded_difference(*one, *before) for one, before in pairs)

    def way(self, placed: Placement) -> Array:
        """() how far a point of the mesh has moved at most since the build [m]."""
        hull = required(required(self.surface, "surface").hull, "hull")
        before = required(self.placement, "placement")

        def places(placement: Placement) -> Array:
            found = hull if placement.rotation is None else hull @ placement.rotation.T
            return found + placement.shift[None]

        return jnp.sqrt(jnp.max(jnp.sum((places(placed) - places(before)) ** 2, axis=1)))

    @property
    def near(self) -> tuple[Near, ...]:
        """What there is of the three kinds."""
        return tuple(kind for kind in (self.faces, self.edges, self.corners) if kind is not None)

    @property
    def room(self) -> MeshRoom:
        """What there is room for."""
        faces, edges, corners = (
            0 if kind is None else int(kind.overlap.shape[-2]) for kind in (self.faces, self.edges, self.corners)
        )
        return MeshRoom(self.row.shape[-1], self.contacts, self.looks, (faces, edges, corners))

    def of_rows(self, values: Vector) -> Vector:
        """Values (M,) of (N,); of an empty row those of some grain."""
        count = values[0].shape[0]
        return at(values, jnp.minimum(self.row, max(count - 1, 0)))

    def added(self, totals: Vector, values: Vector) -> Vector:
        """Totals (N,) with values (M,) of the rows."""
        return tuple(
            total.at[self.row].add(value, mode="drop", unique_indices=True, indices_are_sorted=True)
            for total, value in zip(totals, values, strict=True)
        )

    def radius_of_rows(self, radius: Array) -> Array:
        """() unchanged, (M,) of (N,)."""
        return radius if radius.ndim == 0 else self.of_rows((radius,))[0]

    def with_radius(self, radius: Array, before: Array) -> MeshList:
        """The same with the overlaps of other radii, () or (N,) [m], and with their slopes by these.

        Args:
            radius: now.
            before: at the build.
        """
        change = self.radius_of_rows(radius) - lax.stop_gradient(self.radius_of_rows(before))
        if change.ndim:
            change = change[None]

        def changed(kind: Near | None) -> Any:
            return None if kind is None else kind._replace(overlap=lax.stop_gradient(kind.overlap) + change)

        return dataclasses.replace(
            self, faces=changed(self.faces), edges=changed(self.edges), corners=changed(self.corners)
        )


def by_grain(values: Vector, listed: MeshList, count: int) -> Vector:
    """Values (C, M) of the contacts of each row as those of N grains, (C, N): zero of those without a row."""
    return tuple(jnp.zeros((x.shape[0], count), x.dtype).at[:, listed.row].set(x, mode="drop") for x in values)


def of_grain(values: Vector, listed: MeshList) -> Vector:
    """The inverse: (C, M) of (C, N), zero in rows without a grain."""
    return tuple(x.at[:, listed.row].get(mode="fill", fill_value=0) for x in values)


def carried(values: Vector, old: MeshList, new: MeshList, count: int) -> Vector:
    """Values (C, M) of the contacts of each row, moved to the rows of another list by the identity of the grains.

    Args:
        values: of the old list.
        old: list that they belong to.
        new: list with C' contacts and M' rows.
        count: N, number of grains.
    """
    if not values:
        return ()
    rows = old.row.shape[0]
    place = jnp.full(count + 1, rows, jnp.int32).at[old.row].set(jnp.arange(rows, dtype=jnp.int32))
    place = place.at[count].set(rows)
    wanted = place[new.row]

    def moved(x: Array) -> Array:
        wider = jnp.pad(x, ((0, max(new.contacts - x.shape[0], 0)), (0, 1)))
        return wider[:, wanted]

    return tuple(map(moved, values))
