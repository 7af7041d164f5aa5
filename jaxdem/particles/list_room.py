"""What a neighbour list needs room for; on the host, by SciPy's tree."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import jax
import numpy as np
from jax import Array
from scipy.spatial import KDTree

from jaxdem.errors import required
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.level_room import level_room, pairs_in_reach
from jaxdem.particles.mesh_room import with_margin
from jaxdem.particles.mesh_search import needed
from jaxdem.particles.mesh_surface import MeshSurface, on_host
from jaxdem.particles.neighbor_search import NeighborSearch
from jaxdem.particles.neighbors import Room
from jaxdem.particles.regions import into_period
from jaxdem.particles.usual_room import DENSE, EXTRA_CAPACITY, EXTRA_PAIRS, USUAL_PAIRS, USUAL_SLOTS


def list_room(
    search: NeighborSearch, position: Vector, active: Array | None = None, radius: Array | None = None
) -> Room:
    """Room for these positions and for a dense pack, with a margin; on the host.

    `radius` () or (N,) says how far each reaches [m]; without it all reach as far as the largest.
    """
    count, dimension = position[0].shape[0], len(position)
    if count < 2:
        return Room(0, 0, 1)
    if search.levels is not None:
        there = None if active is None else np.asarray(active)
        places = tuple(np.asarray(x, float) for x in position)
        return level_room(search.levels, search.geometry, places, np.asarray(required(radius, "radii"), float), there)
    present = jax.tree.map(np.asarray, position)
    own, reaches = own_in_reach(search, present, active), None
    if radius is not None:
        sizes: Any = np.asarray(radius, float)
        reaches = search.reaches(sizes)
    if active is not None:
        present = tuple(x[np.asarray(active)] for x in present)
        reaches = None if reaches is None else reaches[np.asarray(active)]
    cells = search.cells_for(position)
    crowd = max(cells.largest_occupancy(present), cells.dense_occupancy(search.geometry.cutoff))
    usual, each = USUAL_SLOTS[dimension], USUAL_PAIRS[dimension]
    if active is not None:  # what stands there at the start tells nothing of those who come
        usual = math.ceil(EXTRA_CAPACITY * _crowd(search, search.reach))
        each = max(each, 0.5 * _crowd(search, search.reach))
        widths = (length / n for length, n in zip(search.geometry.box, cells.shape, strict=True))
        crowd = max(crowd, _crowd(search, 0.6 * max(widths)))
    found, most = _found(search, present, own, reaches)
    everyone = count * (count - 1) // 2
    pairs = min(max(math.ceil(EXTRA_PAIRS * found), math.ceil(each * count)), everyone)
    # The wide cells of a vast box have room for more than there are.
    held = min(math.ceil(EXTRA_CAPACITY * crowd), count)
    return Room(min(max(int(EXTRA_CAPACITY * most), usual), count - 1), pairs + 1, held)


def _crowd(search: NeighborSearch, reach: float) -> int:
    """How many particles of the mean volume a dense pack has within `reach` [m], `USUAL_SLOTS` at least.

    Where particles come in while the scene runs, what stands at the start tells nothing.
    """
    dimension = len(search.geometry.box)
    return max(USUAL_SLOTS[dimension], math.ceil(DENSE[dimension] * (reach / search.typical_radius) ** dimension))


def _found(search: NeighborSearch, position: Vector, own: np.ndarray | int, reaches: Array | None) -> tuple[int, int]:
    """Number of pairs in reach at these positions, and the most neighbours that a particle has; not jittable.

    `own` (N,) of those that it has in reach are of its own body, itself too; `reaches` are as of the method.
    """
    if reaches is not None:
        places = tuple(np.asarray(x, float) for x in position)
        ends = np.concatenate(pairs_in_reach(search.geometry, places, np.asarray(reaches)))
        return len(ends) // 2, int(np.bincount(ends, minlength=1).max())
    tree = tree_of(search, position)
    others = tree.query_ball_point(tree.data, search.reach, return_length=True, workers=-1) - own
    return int(others.sum()) // 2, int(others.max(initial=0))


def own_in_reach(search: NeighborSearch, position: Vector, active: Array | None) -> np.ndarray | int:
    """(N,) of those present: how many spheres of its body a sphere has in reach, itself too; not jittable."""
    if search.members == 1:
        return 1
    there = np.full(len(position[0]), True) if active is None else np.asarray(active)
    own = np.stack([np.where(there, np.asarray(x, float), np.nan).reshape(search.members, -1) for x in position])
    apart = np.linalg.norm(own[:, :, None] - own[:, None], axis=0)
    return np.sum(apart <= search.reach, axis=1).ravel()[there]


def tree_of(search: NeighborSearch, position: Vector) -> KDTree:
    """SciPy's tree of these positions, in the box; on the host."""
    geometry = search.geometry
    stacked = np.stack([np.asarray(x, float) for x in position], axis=1)
    inside = np.where(geometry.periodic, into_period(stacked, np.asarray(geometry.box)), stacked)
    # A period of zero is none.
    return KDTree(inside, boxsize=np.where(geometry.periodic, geometry.box, 0.0))


def with_room_for_meshes(
    search: NeighborSearch,
    room: Room,
    surfaces: tuple[MeshSurface, ...],
    usual: tuple[tuple[int, ...], ...],
    position: Vector,
    radius: Array,
    active: Array | None,
) -> Room:
    """Room for the lists of the meshes too; on the host.

    Args:
        search: of the particles.
        room: for that of the particles.
        surfaces: the meshes.
        usual: room of each mesh that is needed in any case, `MeshRoom.numbers`.
        position, radius, active: see `allocate`.
    """
    count = position[0].shape[0]
    there = np.full(count, True) if active is None else np.asarray(active)
    place = tuple(np.asarray(x, float)[there] for x in position)
    size = np.asarray(radius, float)
    size = size if size.ndim == 0 else size[there]
    numbers: list[int] = []
    for surface, least in zip(surfaces, usual, strict=True):
        wanted = needed(search.mesh_search, on_host(surface), place, size)
        rows, contacts, *rest = least
        wanted[1:] *= np.array(rest) > 0
        numbers += [min(with_margin(wanted[0], rows), max(count, 1)), contacts]
        share = min(1.0, count / rows)  # of the grains that the mesh has room for
        rest = [math.ceil(share * looks) for looks in rest[:3]] + rest[3:]
        numbers += [with_margin(number, own) for number, own in zip(wanted[1:], rest, strict=True)]
    return dataclasses.replace(room, mesh=tuple(numbers))
