"""How deep particles may overlap each other and walls at the start, and the refusal of what is deeper. Host side."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np
from jax import Array

from jaxdem.errors import InputError, required
from jaxdem.numerics import vectors
from jaxdem.numerics.placement import Placement
from jaxdem.particles import packing
from jaxdem.particles.integrate import ParticleState, split_low
from jaxdem.particles.surfaces import Surface, surface_contacts
from jaxdem.scene import Scene
from jaxdem.setup.bodies import Bodies
from jaxdem.setup.inlet_regions import inlet_space
from jaxdem.setup.meshes import WallMesh
from jaxdem.setup.particles import ParticleSetup
from jaxdem.setup.walls import wall_keys

INSERTION_OVERLAP = 0.01
"""Two particles of a pack may overlap by this part of the smaller diameter."""


class Overlap(NamedTuple):
    """How deep particles may overlap at the start.

    A pack is laid out: more than a slip of rounding and jitter is a mistake. Positions that are given, and particles of
    another run, may be a state that a run was in: a run goes on until impacts are faster than its limit, at which they
    overlap by `contact.maximum_overlap`. So much is a state, and more is none.

    Attributes:
        part: of the smaller diameter [-].
        reason: that says where it is from, for messages.
        key: of the scene that places the particles, for messages.
        move: what to do about a deeper one.
    """

    part: float
    reason: str = ""
    key: str = "particles.pack"
    move: str = "change the pack"

    def __str__(self) -> str:
        return f"the limit is {100 * self.part:.3g} %{self.reason}"


PACKED = Overlap(INSERTION_OVERLAP)
"""What a pack may have."""


def allowed_overlap(particles: ParticleSetup) -> Overlap:
    """The overlap that is accepted at the start."""
    reason = ", contact.maximum_overlap"
    if particles.is_started:
        remedy = "remove particles there (start.remove), or move them apart (start.relax = true)"
        return Overlap(particles.contact.maximum_overlap, reason, "start.from", remedy)
    if particles.table.position is None and particles.table.file is None:
        return PACKED
    key = "particles.position" if particles.table.file is None else "particles.file"
    return Overlap(particles.contact.maximum_overlap, reason, key, "move the particles apart or into the box")


def check_initial_positions(particles: ParticleSetup) -> None:
    """Refuses particles that overlap each other or a side of the box by more than is allowed, or lie outside the box.

    Raises:
        InputError: naming the particles.
    """
    if particles.shapes is not None:
        return _check_clumps(particles)
    allowed = allowed_overlap(particles)
    rows = np.flatnonzero(np.broadcast_to(particles.active, particles.count))
    scene, position = particles.scene, particles.position[rows]
    radius = np.broadcast_to(particles.present.radius, particles.count)[rows]
    index, part, sides = _deepest_in_sides(scene, position, radius)
    if part > allowed.part:
        raise InputError(
            allowed.key,
            f"particle {rows[index]} at {_point(position[index])} m",
            f"its centre lies outside of the box, beyond the {sides} wall"
            if part > 0.5
            else f"it reaches {_percent(part)} of its diameter into the {sides} wall, {allowed}",
            allowed.move,
        )
    if not particles.is_started:
        return _check_pairs(particles, rows, allowed, None)
    added = rows >= particles.placed
    _check_pairs(particles, rows[~added], allowed, None)
    packed = PACKED._replace(key="start.add", move="add the particles elsewhere, or remove those that are there")
    return _check_pairs(particles, rows, packed, added)


def _deepest_in_sides(scene: Scene, position: np.ndarray, radius: np.ndarray) -> tuple[int, float, str]:
    """Of the sphere that is deepest in a side of the box: its row, the depth over its diameter, and the sides of the
    axis; no depth without spheres. A side that removes particles is no wall to one whose centre is in the box."""
    if not len(position):
        return 0, -np.inf, ""
    beyond = np.stack([-position, position - np.asarray(scene.domain.size)], axis=2)
    removes = [scene.boundary[name].particles == "remove" for name in scene.sides]
    passes = np.reshape(removes, (-1, 2)) & (beyond <= 0.0)
    depth = np.max(np.where(passes, -np.inf, beyond + radius[:, None, None]), axis=2)
    depth = np.where(scene.periodic, -np.inf, depth) / (2.0 * radius[:, None])
    index, axis = np.unravel_index(np.argmax(depth), depth.shape)
    sides = f"{scene.sides[2 * axis]} or {scene.sides[2 * axis + 1]}"
    return int(index), float(depth[index, axis]), sides


def _check_pairs(particles: ParticleSetup, rows: np.ndarray, allowed: Overlap, some: np.ndarray | None) -> None:
    """Refuses pairs of `rows`, at least one of them among `some`, that overlap by more than is allowed."""
    scene, position = particles.scene, particles.position[rows]
    radius = np.broadcast_to(particles.present.radius, particles.count)[rows]
    worst, *pair = packing.deepest_overlap(position, radius, scene.domain.size, scene.periodic, some)
    if worst > allowed.part:
        first, second = pair
        owners = np.repeat(np.arange(len(particles.packs)), [pack.count for pack in particles.packs])
        if len(owners) and owners[first] != owners[second]:
            one, other = sorted((int(owners[first]), int(owners[second])))
            raise InputError(
                particles.packs[other].key,
                f"particles at {_point(position[first])} and {_point(position[second])} m",
                f"one is of {particles.packs[one].key}; they overlap by {100 * worst:.3g} % of a diameter, {allowed}",
                "move the packs apart, or make one smaller",
            )
        spread = "raise particles.pack.spacing, or lower particles.pack.jitter"
        raise InputError(
            allowed.key,
            f"particles {rows[first]} and {rows[second]} at {_point(position[first])} and {_point(position[second])} m",
            f"they overlap by {100 * worst:.3g} % of a diameter, {allowed}",
            spread if allowed.key == "particles.pack" else allowed.move,
        )


def _check_clumps(particles: ParticleSetup) -> None:
    """The same of the members of clumps."""
    allowed, scene, table = allowed_overlap(particles), particles.scene, particles.shapes
    assert table is not None
    count = particles.count
    orientation = required(particles.orientation, "orientation")[:count]
    present = Bodies(*(np.broadcast_to(column, count) for column in particles.present))
    position, radius, body = table.placed(present, particles.position, orientation)
    index, part, sides = _deepest_in_sides(scene, position, radius)
    if part > allowed.part:
        raise InputError(
            allowed.key,
            f"clump {body[index]} at {_point(particles.position[body[index]])} m",
            f"one of its spheres reaches {_percent(part)} of its diameter into the {sides} wall, {allowed}",
            allowed.move,
        )
    worst, *pair = packing.deepest_overlap(position, radius, scene.domain.size, scene.periodic, body=body)
    if worst > allowed.part:
        first, second = body[pair]
        raise InputError(
            allowed.key,
            f"clumps {first} and {second} at {_point(particles.position[first])} and "
            f"{_point(particles.position[second])} m",
            f"two of their spheres overlap by {100 * worst:.3g} % of a diameter, {allowed}",
            allowed.move,
        )


def check_surfaces(
    scene: Scene,
    surfaces: tuple[Surface, ...],
    present: np.ndarray | None,
    particles: ParticleState,
    radius: Array,
    allowed: Overlap,
    placed: tuple[Placement | None, ...] = (),
) -> None:
    """Refuses particles that overlap a wall beside the sides of the box, or lie behind it.

    Args:
        scene: that the walls belong to.
        surfaces: the walls, those given as functions last.
        present: (W,) bool, which of them are there at the start; None for all.
        particles: at the start; those still to come are checked when they come.
        radius: () or (N,) [m].
        allowed: overlap at the start.
        placed: where each of the walls is at the start; empty where all are at rest.

    Raises:
        InputError: naming the particle and the wall.
    """
    if not surfaces:
        return
    at, at_low = jax.device_get((particles.position, particles.position_low))
    position, low = vectors.components(at), split_low(at_low, at.shape[1])
    # As one program: operation by operation it takes seconds to compile.
    overlap, _ = jax.jit(functools.partial(surface_contacts, surfaces))(position, low, radius, placed)
    depth = np.asarray(overlap) / (2.0 * np.asarray(radius))
    present = None if present is None else present[: len(surfaces)]
    inside = ~(depth <= allowed.part)  # an overlap that is not a number too
    if present is not None:
        inside &= present[:, None]
    if particles.active is not None:
        inside &= np.asarray(particles.active)
    if inside.any():
        wall, index = np.unravel_index(np.argmax(np.where(inside, depth, -np.inf)), depth.shape)
        names = [f"{key} ({kind})" for key, kind in wall_keys(scene)]
        name = names[int(wall)] if wall < len(names) else "a wall given as a function"
        raise InputError(
            allowed.key,
            f"particle {index} at {_point(np.asarray(particles.position[index]))} m",
            f"it reaches {_percent(depth[wall, index])} of its diameter into {name}, {allowed}",
            f"{allowed.move}, or move the wall"
            + ("; the normal of a wall points to the particles" if depth[wall, index] > 1.0 else ""),
        )


def check_meshes(
    meshes: Sequence[WallMesh],
    present: np.ndarray | None,
    particles: ParticleState,
    radius: Array,
    allowed: Overlap,
    placed: tuple[Placement | None, ...] = (),
) -> None:
    """Refuses particles that overlap a wall that is a mesh, or lie inside of a closed one that is touched from its
    front alone.

    Args:
        meshes: of the scene.
        present: (W,) bool, which walls beside the sides are there at the start, the meshes last; None for all.
        particles, radius, allowed, placed: see `check_surfaces`; the meshes last.

    Raises:
        InputError: naming the particle and the wall.
    """
    if not meshes:
        return
    there = np.full(len(particles.position), True) if particles.active is None else np.asarray(particles.active)
    rows = np.flatnonzero(there)
    position = np.asarray(particles.position, float)[rows]
    if particles.position_low is not None:
        position = position + np.asarray(particles.position_low, float)[rows]
    size = np.broadcast_to(np.asarray(radius, float), len(there))[rows]
    shown = np.full(len(meshes), True) if present is None else present[-len(meshes) :]
    for (mesh, place), is_there in zip(_placed_meshes(meshes, placed), shown, strict=True):
        depth = mesh.depth(_in_body(place, position), size) / (2.0 * size)
        if is_there and len(rows) and depth.max() > allowed.part:
            index = int(np.argmax(depth))
            deep = "lies inside of" if depth[index] >= 1.0 else f"reaches {_percent(depth[index])} of its diameter into"
            raise InputError(
                allowed.key,
                f"particle {rows[index]} at {_point(position[index])} m",
                f"it {deep} {mesh.key} (mesh), {allowed}",
                f"{allowed.move}, or move the wall",
            )


def _placed_meshes(
    meshes: Sequence[WallMesh], placed: tuple[Placement | None, ...]
) -> list[tuple[WallMesh, Placement | None]]:
    """Each mesh and where it is, the last of `placed`."""
    return list(zip(meshes, placed[-len(meshes) :] or (None,) * len(meshes), strict=True))


def _in_body(placed: Placement | None, position: np.ndarray) -> np.ndarray:
    """Positions (N, D) in the frame of a wall, which may have moved, in float64 [m]."""
    if placed is None:
        return position

    def whole(high: Array, low: Array | None) -> np.ndarray:
        found = np.asarray(high, float)
        return found if low is None else found + np.asarray(low, float)

    apart = position - whole(placed.shift, placed.shift_low)
    return apart if placed.rotation is None else apart @ whole(placed.rotation, placed.rotation_low)


def check_inlets_beside_meshes(particles: ParticleSetup, placed: tuple[Placement | None, ...] = ()) -> None:
    """Refuses a mesh in the region of an inlet: particles that come in do not look for it.

    Args:
        particles: of the scene.
        placed: see `check_meshes`.

    Raises:
        InputError: naming the inlet and the wall.
    """
    if not particles.meshes:
        return
    drawn = np.random.default_rng(0).uniform(size=(4096, particles.scene.dimension))
    for k, inlet in enumerate(particles.table.inlet):
        key, corners = f"particles.inlet.{k}", (inlet.start or (), inlet.stop or ())
        largest = float(np.max(particles.bodies.radius, initial=0.0))
        space = None if inlet.region is None else inlet_space(key, inlet.region, particles.scene.box, largest)
        if space is not None:
            corners = space.bounds
        places = np.asarray(corners[0]) + drawn * np.subtract(corners[1], corners[0])
        for mesh, place in _placed_meshes(particles.meshes, placed):
            if space is not None:  # their centres are so far inside
                places = places[space.inside(places, mesh.largest)]
            radius = np.full(len(places), mesh.largest)
            if mesh.depth(_in_body(place, places), radius).max(initial=-np.inf) > 0.0:
                limit = f"{mesh.key} (mesh) lies in it or touches its particles, and they would come in on it"
                raise InputError(key, "...", limit, "move the inlet or the wall")


def _point(row: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.5g}" for value in row) + ")"


def _percent(part: float) -> str:
    return f"{100 * part:.3g} %" if part < 10.0 else f"{100 * part:,.0f} %"
