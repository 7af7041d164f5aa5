"""Initial positions from a scene: packs, lists and files. Host, numpy."""

from __future__ import annotations

import math

import numpy as np

from jaxdem.errors import InputError
from jaxdem.particles import packing
from jaxdem.scene import Pack, Particles, Scene
from jaxdem.scene.particles import radius_range
from jaxdem.scene.rows import rows_of

MOST_PLACES = 20_000_000
"""Places that a pack may have; more would fill the memory before the first particle stands."""

LATTICE = 'use a lattice (particles.pack.kind = "lattice")'
"""Remedy for a random pack without room."""


def positions_of(scene: Scene, particles: Particles) -> np.ndarray:
    """(N, D) centres [m] of a lattice, a polygon, rows or a file; not yet checked against each other.

    Args:
        scene: that the particles belong to.
        particles: its table `[particles]`, without a random pack.

    Raises:
        InputError: the pack cannot hold the particles, or the rows are wrong in shape or number.
    """
    count, pack = particles.count, particles.pack
    if pack is None:
        position = rows_of("particles.position", particles.position, scene.dimension, of_frame=True)
        if position is None:
            return np.zeros((0, scene.dimension))  # all come through inlets
        if count is not None and len(position) != count:
            limit = f"there are {len(position)} positions"
            raise InputError("particles.count", count, limit, "give as many positions as particles")
        return position
    if count == 0 and particles.position is None:
        return np.zeros((0, scene.dimension))
    packed = _packed(scene, particles, pack)
    if count is not None and len(packed) < count:
        raise InputError(
            "particles.count",
            count,
            f"the pack holds {len(packed)} particles",
            "enlarge the pack, lower particles.pack.spacing, or lower the count",
        )
    if len(packed) == 0:
        raise InputError(
            "particles.pack",
            pack.kind,
            "holds no particle",
            "enlarge the pack (all lengths are in m), or set particles.count = 0 for a scene that starts empty",
        )
    # Rows are filled from below, so a pack that is not full has a level top.
    return packed[:count]


def check_random_pack(scene: Scene, pack: Pack, radius: np.ndarray) -> None:
    """Refuses a random pack that certainly cannot hold particles of these radii, (N,) [m]."""
    start, stop = (_corner(name, getattr(pack, name), scene.dimension) for name in ("start", "stop"))
    box = scene.domain.size
    if (stop <= start).any():
        raise InputError(
            "particles.pack.stop", pack.stop, f"must be above start = {pack.start}", "exchange start and stop"
        )
    if (start < 0.0).any() or (stop > np.asarray(box)).any():
        limit = f"start and stop must lie in the box, 0 ... {box} m"
        raise InputError("particles.pack.stop", pack.stop, limit, "move them into the box")
    fraction, largest = _random_fraction(pack, radius), packing.REACHABLE[scene.dimension]
    if fraction > largest:
        raise InputError(
            "particles.count",
            len(radius),
            f"the particles, with their spacing, fill {100 * fraction:.3g} % of the box of the random pack; the limit "
            f"is {100 * largest:g} %",
            f"{LATTICE}, enlarge the box, or lower particles.pack.spacing",
        )


def random_positions(scene: Scene, pack: Pack, radius: np.ndarray) -> np.ndarray:
    """(N, D) centres [m] of a random pack of particles of these radii, (N,) [m]; not checked against each other.

    Raises:
        InputError: there is no room for them.
    """
    start, stop = np.asarray(pack.start), np.asarray(pack.stop)
    position, placed = packing.random_pack(start, stop, radius, pack.spacing, scene.seed)
    if not placed.all():
        raise InputError(
            "particles.count",
            len(radius),
            f"only {int(placed.sum())} of them have room in the box of the random pack, which they would fill to "
            f"{100 * _random_fraction(pack, radius):.3g} % with their spacing; a narrow box holds less",
            f"{LATTICE}, or enlarge the box",
        )
    return position


def _random_fraction(pack: Pack, radius: np.ndarray) -> float:
    """Part of the box of a random pack that its particles fill, with their spacing [-]."""
    return packing.random_solid_fraction(np.asarray(pack.start), np.asarray(pack.stop), radius, pack.spacing)


def _packed(scene: Scene, particles: Particles, pack: Pack) -> np.ndarray:
    """All centres of a lattice or a polygon."""
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
        start, stop = (_corner(name, getattr(pack, name), scene.dimension) for name in ("start", "stop"))
        _check_places("stop", tuple(stop - start), spacing)
        points = packing.lattice_pack(start, stop, largest, spacing, jitter)
    return packing.jittered(points, jitter, scene.seed)


def _corner(name: str, corner: tuple[float, ...] | None, dimension: int) -> np.ndarray:
    if corner is None or len(corner) != dimension:
        raise InputError(f"particles.pack.{name}", corner, f"needs {dimension} numbers", f"give {dimension} numbers")
    return np.asarray(corner)


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
