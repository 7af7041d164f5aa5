"""The refusal of particles that overlap a wall beside the sides of the box at the start. Host side."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import jax
import numpy as np
from jax import Array

from jaxdem.errors import InputError
from jaxdem.numerics import vectors
from jaxdem.numerics.placement import Placement
from jaxdem.particles.integrate import ParticleState, split_low
from jaxdem.particles.surfaces import Surface, surface_contacts
from jaxdem.scene import Scene
from jaxdem.setup.inlet_regions import inlet_space
from jaxdem.setup.meshes import WallMesh
from jaxdem.setup.overlaps import Overlap, at_text, percent_text
from jaxdem.setup.particles import ParticleSetup
from jaxdem.setup.walls import wall_keys


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
        allowed = allowed.of_row(int(index))
        raise InputError(
            allowed.key,
            f"particle {index} at {at_text(np.asarray(particles.position[index]))} m",
            f"it reaches {percent_text(depth[wall, index])} of its diameter into {name}, {allowed}",
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
            part = percent_text(depth[index])
            deep = "lies inside of" if depth[index] >= 1.0 else f"reaches {part} of its diameter into"
            allowed = allowed.of_row(rows[index])
            raise InputError(
                allowed.key,
                f"particle {rows[index]} at {at_text(position[index])} m",
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
