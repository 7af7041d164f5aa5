"""How many rows, ghosts, pairs and travellers the arrays of a slab have room for. Host, numpy."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np

from jaxdem.devices.level_rooms import room_by_levels
from jaxdem.errors import required
from jaxdem.numerics.static import static
from jaxdem.particles.ghosts import Division
from jaxdem.particles.integrate import ParticleState
from jaxdem.particles.list_room import list_room, own_in_reach, tree_of
from jaxdem.particles.migration import IMBALANCE, NARROWEST
from jaxdem.particles.neighbor_search import NeighborSearch
from jaxdem.particles.neighbors import Neighbors, Room
from jaxdem.particles.usual_room import EXTRA_CAPACITY, EXTRA_PAIRS, USUAL_PAIRS
from jaxdem.simulation import Simulation, contact_spheres
from jaxdem.state import Parameters

LEAST = 16
"""Rows, ghosts and travellers that there is always room for beside those that are needed."""

UNEVEN = 1.1
"""Of slabs that do not move, beside a fluid, the fullest has rows for so many times its particles."""

TRAVELLERS = 8
"""There is room for one of so many particles of a slab to go to the same neighbour at once."""


@static
class SlabRoom:
    """What the arrays of a slab have room for; the same in all slabs; static.

    Attributes:
        rows: own particles.
        ghosts: of one neighbour.
        migrating: particles that go to one neighbour at once.
        listed: for the neighbour list.
    """

    rows: int
    ghosts: int
    migrating: int
    listed: Room

    @classmethod
    def of(cls, neighbors: Neighbors) -> SlabRoom:
        """Of a distributed list."""
        ghosts = required(neighbors.ghosts, "ghosts of a list")
        sent = ghosts.lower.shape[-1]
        return cls(ghosts.identity.shape[-1] - 2 * sent, sent, ghosts.migrating, neighbors.room)

    def enlarged(self, needed: np.ndarray) -> SlabRoom:
        """With a margin for what was needed, (3,) as in `Ghosts`; all of the list half as much again if that was there.

        A list that lacks room tells not how much; then the other rooms were large enough.
        """
        own = np.array([self.rows, self.ghosts, self.migrating])
        if np.all(needed <= own):
            return dataclasses.replace(self, listed=self.listed.enlarged())
        wider = np.where(needed > own, np.ceil(EXTRA_CAPACITY * needed).astype(int) + LEAST, own)
        rows, ghosts, migrating = map(int, wider)
        pairs = math.ceil(self.listed.pairs * max(1.0, (rows + 2 * ghosts) / (self.rows + 2 * self.ghosts)))
        return SlabRoom(rows, ghosts, migrating, dataclasses.replace(self.listed, pairs=pairs))


def equal_planes(division: Division, search: NeighborSearch, along: np.ndarray) -> np.ndarray:
    """(B - 1,) where to cut for equal numbers, no slab narrower than the limit, from positions (N,) in the box [m]."""
    number, length = division.blocks.number, division.length
    least = NARROWEST * search.body_reach
    if len(along) < number:
        return length * np.arange(1, number) / number
    ordered = np.sort(along)
    place = len(along) * np.arange(1, number) // number
    planes = 0.5 * (ordered[place - 1] + ordered[place])
    for k in range(number - 1):
        planes[k] = max(planes[k], (planes[k - 1] if k else 0.0) + least)
    for k in reversed(range(number - 1)):
        planes[k] = min(planes[k], (planes[k + 1] if k < number - 2 else length) - least)
    return planes


def slab_of(planes: np.ndarray, along: np.ndarray) -> np.ndarray:
    """(N,) slabs of positions (N,) in the box."""
    return np.searchsorted(planes, along, side="right")


class Spheres(NamedTuple):
    """What a list of the whole box is of: the particles, or the members of clumps, m N rows.

    Attributes:
        search: that lists them; static.
        position: D arrays (m N,) [m].
        radius: () or (m N,) [m].
        active: (m N,) bool, which there are; None where all.
    """

    search: NeighborSearch
    position: tuple[Any, ...]
    radius: Any
    active: Any

    def on_host(self) -> tuple[NeighborSearch, tuple[np.ndarray, ...], np.ndarray, np.ndarray | None]:
        """Search, positions, radii and which there are, as arrays of NumPy."""
        active = None if self.active is None else np.asarray(self.active)
        position = tuple(np.asarray(x, float) for x in self.position)
        return self.search, position, np.asarray(self.radius, float), active

    def whole_room(self) -> Room:
        """Room for their list on one device; of a list by levels `room_by_levels` has what slabs need."""
        if self.search.levels is not None:
            return Room(1, 2, 1)
        return list_room(self.search, self.position, self.active)

    def neighbours(self) -> np.ndarray:
        """(N',) how many others the particles that there are have in reach, of clumps all members together."""
        there = np.ones(len(self.position[0]), bool) if self.active is None else np.asarray(self.active)
        found = np.zeros(len(there))
        if there.any():
            tree = tree_of(self.search, tuple(np.asarray(x, float)[there] for x in self.position))
            found[there] = tree.query_ball_point(tree.data, self.search.reach, return_length=True, workers=-1)
            found[there] -= own_in_reach(self.search, self.position, self.active)
        members = self.search.members
        return found.reshape(members, -1).sum(axis=0)[there.reshape(members, -1).any(axis=0)]


def listed_spheres(simulation: Simulation, parameters: Parameters, particles: ParticleState) -> Spheres:
    """Of particles on one device or on the host."""
    bodies = required(parameters.bodies, "parameters.bodies")
    spheres, radius = contact_spheres(particles, bodies)
    position = tuple(np.asarray(spheres.position).T)
    return Spheres(simulation.search, position, np.asarray(radius), spheres.active)


def needed_room(
    division: Division, spheres: Spheres, position: np.ndarray, planes: np.ndarray, room: Room, coming: int = 0
) -> SlabRoom:
    """Room for these particles with a margin.

    Args:
        division: of the simulation.
        spheres: that touch, of all particles.
        position: (N, D) of those present, in the box [m].
        planes: (B - 1,) [m].
        room: for their list on one device, `Spheres.whole_room`, with that of the meshes.
        coming: particles that come in later.
    """
    number, dimension, search = division.blocks.number, position.shape[1], spheres.search
    along = position[:, division.blocks.axis]
    slab = slab_of(planes, along)
    counts = np.bincount(slab, minlength=number)
    fullest = max(counts.max(), (len(position) + coming) / number)
    margin = IMBALANCE**2 if division.balanced else UNEVEN  # contact steps work on all rows, with a particle or without
    rows = math.ceil(margin * fullest) + LEAST if number > 1 else max(math.ceil(fullest), 1)
    near = np.zeros(len(along), bool)
    most, reach = 0, ghost_reach(division, spheres)
    wraps = division.blocks.periodic and number > 1
    for plane in [*planes, *([0.0, division.length] if wraps else [])]:
        apart = along - plane
        if division.blocks.periodic:
            apart = apart - division.length * np.round(apart / division.length)
        close = np.abs(apart) < reach * 1.25
        most = max(most, int(np.sum(close & (apart < 0))), int(np.sum(close & (apart >= 0))))
        near |= close
    ghosts = math.ceil(EXTRA_CAPACITY * most) + LEAST if number > 1 else 1
    migrating = rows // TRAVELLERS + LEAST
    if search.levels is not None:
        least = math.ceil(USUAL_PAIRS[dimension] * (fullest + most))
        listed = room_by_levels(*spheres.on_host(), slab, least, rows + 2 * ghosts)
        return SlabRoom(rows, ghosts, migrating, dataclasses.replace(listed, mesh=room.mesh))
    # A pair across a border is half of the neighbours of either, and a whole one of both slabs.
    each = np.bincount(slab, weights=0.5 * spheres.neighbours() * (1 + near), minlength=number)
    usual = USUAL_PAIRS[dimension] * (fullest + most) * search.members
    pairs = max(math.ceil(EXTRA_PAIRS * each.max()), math.ceil(usual)) + 1
    listed = dataclasses.replace(room, slots=max(room.slots, 1), pairs=pairs)
    return SlabRoom(rows, ghosts, migrating, listed)


def ghosts_of(division: Division, spheres: Spheres, along: np.ndarray, planes: np.ndarray) -> np.ndarray:
    """(B,) ghosts of every slab, as `chosen_ghosts` has them where all particles are in their slabs.

    Args:
        division, spheres: see `needed_room`.
        along: (N,) positions of those present along the cut axis, in the box [m].
        planes: (B - 1,) [m].
    """
    number, wraps = division.blocks.number, division.blocks.periodic
    found, slab = np.zeros(number, int), slab_of(planes, along)
    if number == 1:
        return found
    ends = np.array([0.0, *planes, division.length])
    away, half = along - 0.5 * (ends[slab] + ends[slab + 1]), 0.5 * np.diff(ends)[slab]
    # How far those above and below the middle of their slab are outside of it, with their sizes where these count.
    upwards, downwards, least, reach = away - half, -half - away, 0.0, spheres.search.body_reach
    if division.by_size:
        _, _, radius, active = spheres.on_host()
        size, reach = radius if active is None else radius[active], spheres.search.spare_reach
        upwards, downwards, least = upwards + size, downwards + size, -division.length
    above, below = (
        np.array([np.max(out[slab == k], initial=least) for k in range(number)]) for out in (upwards, downwards)
    )
    up = (-upwards < reach + below[(slab + 1) % number]) & (wraps | (slab < number - 1))
    down = (-downwards < reach + above[slab - 1]) & (wraps | (slab > 0))
    if number == 2 and wraps:  # both neighbours are one
        down &= ~up
    for sent, step in ((up, 1), (down, -1)):
        found += np.bincount((slab[sent] + step) % number, minlength=number)
    return found


def ghost_reach(division: Division, spheres: Spheres) -> Any:
    """() or (N,) how far from a border particles may be ghosts of the slab beyond, of those present [m]."""
    if not division.by_size:
        return spheres.search.body_reach
    radius = np.asarray(spheres.radius, float)
    own = radius if spheres.active is None else radius[np.asarray(spheres.active)]
    return own + (radius.max(initial=0.0) + spheres.search.spare_reach)
