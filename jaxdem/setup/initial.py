"""Initial positions and velocities from a scene: packs, lists and files, checked before work starts."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

from jaxdem.errors import InputError
from jaxdem.particles import packing
from jaxdem.scene import Pack, Particles, Scene
from jaxdem.scene.particles import radius_range
from jaxdem.scene.rows import rows_of
from jaxdem.setup.arrivals import arrivals
from jaxdem.setup.bodies import Bodies, collapsed, particle_bodies

INSERTION_OVERLAP = 0.01
"""Two particles may overlap by this part of the smaller diameter at the start, whatever the contact; see `Overlap`."""

DEEPER = "or raise contact.speed: overlaps as deep as an impact at that speed are allowed"
"""Remedy for overlaps that are meant."""

MOST_PLACES = 20_000_000
"""Places that a pack may have; more would fill the memory before the first particle stands."""


class Overlap(NamedTuple):
    """How deep particles may overlap at the start.

    As deep as an impact at the largest speed expected, for a bed that runs has such overlaps too, the contact step is made
    for them, and two particles that are let go from one part no faster than that speed.

    Attributes:
        part: of the smaller diameter [-].
        reason: that says where it is from, for messages.
        key: of the scene that places the particles, for messages.
    """

    part: float = INSERTION_OVERLAP
    reason: str = ""
    key: str = "particles.position"

    def remedy(self, move: str) -> str:
        """What to do about a deeper one: a pack is laid out, not a state that a run was in, so no speed allows more in it."""
        return f"{move}, {DEEPER}" if self.key == "particles.position" else "change the pack"

    def __str__(self) -> str:
        return f"the limit is {100 * self.part:.3g} %{self.reason}"


LEAST_OVERLAP = Overlap()
"""What any scene allows."""

PACK_OVERLAP = Overlap(key="particles.pack")
"""What a pack may have."""


def allowed_overlap(speed: float | None, overlap: float | None) -> Overlap:
    """The overlap that is accepted at the start.

    Args:
        speed: largest expected of the particles [m/s].
        overlap: of an impact at that speed, over the diameter [-].
    """
    if speed is None or overlap is None or overlap <= INSERTION_OVERLAP:
        return LEAST_OVERLAP
    return Overlap(overlap, f", the overlap expected at contact.speed = {speed:.3g} m/s")


def initial_positions(scene: Scene) -> np.ndarray:
    """(N, D) centres [m] from a pack, rows or a file; not yet checked against each other.

    Raises:
        InputError: the pack cannot hold the particles, or the rows are wrong in shape or number.
    """
    particles = scene.particles
    assert particles is not None
    if particles.position is None and (particles.count == 0 or particles.pack is None):
        return np.zeros((0, scene.dimension))  # none at the start, by their number or for those of an inlet
    if particles.pack is not None and particles.pack.kind == "random":
        for name in ("start", "stop"):
            _check_corner(name, getattr(particles.pack, name), scene.dimension)
        if particles.count is None:  # refused by the scene
            return np.zeros((0, scene.dimension))
        radius = np.broadcast_to(particle_bodies(scene, particles.count).radius, particles.count)
        return _random(particles, scene.seed, tuple(radius.tolist()), scene.domain.size).copy()
    if particles.pack is not None:
        packed = _packed(scene, particles.pack)
        if particles.count is not None and len(packed) < particles.count:
            raise InputError(
                "particles.count",
                particles.count,
                f"the pack holds {len(packed)} particles",
                "enlarge the pack, lower particles.pack.spacing, or lower the count",
            )
        if len(packed) == 0:
            raise InputError(
                "particles.pack",
                particles.pack.kind,
                "holds no particle",
                "enlarge the pack (all lengths are in m), or set particles.count = 0 for a scene that starts empty",
            )
        # Rows are filled from below, so a pack that is not full has a level top.
        return packed[: particles.count]
    position = rows_of("particles.position", particles.position, scene.dimension, of_frame=True)
    assert position is not None
    if particles.count is not None and len(position) != particles.count:
        raise InputError(
            "particles.count",
            particles.count,
            f"there are {len(position)} positions",
            "give as many positions as particles",
        )
    return position


def scene_bodies(scene: Scene) -> Bodies:
    """Size, density and material of all particles that a scene ever has; no entries in a scene without."""
    if scene.particles is None:
        return Bodies(np.zeros(0), np.zeros(0), np.zeros(0, np.int32))
    bodies = particle_bodies(scene, len(initial_positions(scene)))
    coming = arrivals(scene)
    if not coming:
        return bodies
    count = len(initial_positions(scene))
    parts = [Bodies(*(np.broadcast_to(a, count) for a in bodies)), *(one.bodies for one in coming)]
    return collapsed(Bodies(*(np.concatenate(columns) for columns in zip(*parts, strict=True))))


def initial_count(scene: Scene) -> int:
    """Number of particles that a scene starts with, without laying out a pack whose number is given."""
    assert scene.particles is not None
    count = scene.particles.count
    return len(initial_positions(scene)) if count is None else count


def check_initial_positions(scene: Scene, position: np.ndarray, allowed: Overlap = LEAST_OVERLAP) -> None:
    """Refuses particles that overlap each other or a wall by more than is allowed, or lie outside the box."""
    particles = scene.particles
    assert particles is not None
    radius = np.broadcast_to(particle_bodies(scene, len(position)).radius, len(position))
    box = np.asarray(scene.domain.size)
    walls = ~np.asarray(scene.periodic)
    depth = np.maximum(radius[:, None] - position, position + radius[:, None] - box)
    depth = np.where(walls, depth, -np.inf) / (2.0 * radius[:, None])
    if len(position) and depth.max() > allowed.part:
        index, axis = np.unravel_index(np.argmax(depth), depth.shape)
        raise InputError(
            allowed.key,
            f"particle {index} at {_point(position[index])} m",
            f"it reaches {_percent(depth[index, axis])} of its diameter into the "
            f"{scene.sides[2 * axis]} or {scene.sides[2 * axis + 1]} wall, {allowed}",
            allowed.remedy("move the particle into the box"),
        )
    worst, first, second = packing.deepest_overlap(position, radius, scene.domain.size, scene.periodic)
    if worst > allowed.part:
        raise InputError(
            allowed.key,
            f"particles {first} and {second} at {_point(position[first])} and {_point(position[second])} m",
            f"they overlap by {100 * worst:.3g} % of a diameter, {allowed}",
            allowed.remedy("move the particles apart")
            if particles.pack is None
            else "raise particles.pack.spacing, or lower particles.pack.jitter",
        )


def check_walls(
    position: np.ndarray,
    radius: np.ndarray,
    names: tuple[str, ...],
    overlap: np.ndarray,
    allowed: Overlap,
) -> None:
    """Refuses particles that overlap a wall beside the sides of the box, or lie behind it.

    Args:
        position: (N, D) [m].
        radius: () or (N,) [m].
        names: of the S walls, for the message.
        overlap: (S, N) depth in them [m].
        allowed: overlap at the start.
    """
    depth = overlap / (2.0 * radius)
    inside = ~(depth <= allowed.part)  # an overlap that is not a number too
    if inside.any():
        wall, index = np.unravel_index(np.argmax(np.where(inside, depth, -np.inf)), depth.shape)
        raise InputError(
            allowed.key,
            f"particle {index} at {_point(position[index])} m",
            f"it reaches {_percent(depth[wall, index])} of its diameter into {names[wall]}, {allowed}",
            allowed.remedy("move the particle or the wall")
            + ("; the normal of a wall points to the particles" if depth[wall, index] > 1.0 else ""),
        )


@functools.lru_cache(maxsize=1)  # asked for its length and for its particles, and it takes seconds
def _random(particles: Particles, seed: int, sizes: tuple[float, ...], box: tuple[float, ...]) -> np.ndarray:
    """Centres (N, D) of a random pack of particles of these radii in a box of these sides."""
    pack, count = particles.pack, particles.count
    assert pack is not None and count is not None
    start, stop = np.asarray(pack.start), np.asarray(pack.stop)
    dimension = len(start)
    if (stop <= start).any():
        raise InputError(
            "particles.pack.stop", pack.stop, f"must be above start = {pack.start}", "exchange start and stop"
        )
    if (start < 0.0).any() or (stop > np.asarray(box)).any():
        raise InputError(
            "particles.pack.stop",
            pack.stop,
            f"start and stop must lie in the box, 0 ... {box} m",
            "move them into the box",
        )
    radius = np.asarray(sizes)
    fraction = packing.random_solid_fraction(start, stop, radius, pack.spacing)
    limit, remedy = packing.REACHABLE[dimension], 'use a lattice (particles.pack.kind = "lattice")'
    if fraction > limit:
        raise InputError(
            "particles.count",
            count,
            f"the particles, with their spacing, fill {100 * fraction:.3g} % of the box of the random pack; the limit is "
            f"{100 * limit:g} %",
            f"{remedy}, enlarge the box, or lower particles.pack.spacing",
        )
    position, placed = packing.random_pack(start, stop, radius, pack.spacing, seed)
    if not placed.all():
        raise InputError(
            "particles.count",
            count,
            f"only {int(placed.sum())} of them have room in the box of the random pack, which they would fill to {100 * fraction:.3g} % with their "
            "spacing; a narrow box holds less",
            f"{remedy}, or enlarge the box",
        )
    return position


def _check_corner(name: str, corner: tuple[float, ...] | None, dimension: int) -> None:
    if corner is None or len(corner) != dimension:
        raise InputError(f"particles.pack.{name}", corner, f"needs {dimension} numbers", f"give {dimension} numbers")


def _check_places(name: str, sides: tuple[float, ...], spacing: float) -> None:
    """Refuses a pack between whose sides [m] lie too many places."""
    places = math.prod(max(side, 0.0) / spacing + 1.0 for side in sides)
    if places > MOST_PLACES:
        raise InputError(
            f"particles.pack.{name}",
            f"sides of {', '.join(f'{side:.4g}' for side in sides)} m",
            f"the pack has about {places:.3g} places {spacing:.3g} m apart, the limit is {MOST_PLACES}",
            "make the pack smaller, or raise particles.radius or particles.pack.spacing",
        )


def _packed(scene: Scene, pack: Pack) -> np.ndarray:
    particles = scene.particles
    assert particles is not None
    smallest, largest = radius_range(particles)
    spacing, jitter = 2.0 * largest * pack.spacing, (pack.jitter or 0.0) * smallest
    if pack.kind == "polygon":
        corners = pack.vertices or ()
        if len(corners) < 3 or any(len(corner) != 2 for corner in corners):
            raise InputError(
                "particles.pack.vertices",
                pack.vertices,
                "needs at least three corners (x, vertical)",
                "add corners to the polygon",
            )
        vertices = np.asarray(corners, float)
        across = scene.domain.size[1:-1]
        _check_places("vertices", (*np.ptp(vertices, axis=0), *across), spacing)
        points = packing.polygon_pack(vertices, scene.domain.size, largest, spacing, jitter)
    else:
        for name in ("start", "stop"):
            _check_corner(name, getattr(pack, name), scene.dimension)
        start, stop = np.asarray(pack.start), np.asarray(pack.stop)
        _check_places("stop", tuple(stop - start), spacing)
        points = packing.lattice_pack(start, stop, largest, spacing, jitter)
    return packing.jittered(points, jitter, scene.seed)


def _point(row: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.5g}" for value in row) + ")"


def _percent(part: float) -> str:
    return f"{100 * part:.3g} %" if part < 10.0 else f"{100 * part:,.0f} %"
