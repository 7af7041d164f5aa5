"""Initial positions and velocities from a scene: packs, lists and files, checked before work starts."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np

from jaxdem.errors import InputError
from jaxdem.particles import packing
from jaxdem.scene import Pack, Particles, Scene

INSERTION_OVERLAP = 0.01
"""Two particles may overlap by this part of the smaller diameter at the start; more would throw them apart."""


def initial_positions(scene: Scene) -> np.ndarray:
    """(N, D) centres [m] from a pack, rows or a file; not yet checked against each other.

    Raises:
        InputError: the pack cannot hold the particles, or the rows are wrong in shape or number.
    """
    particles = scene.particles
    assert particles is not None
    if particles.count == 0:
        return np.zeros((0, scene.dimension))
    if particles.pack is not None and particles.pack.kind == "random":
        for name in ("start", "stop"):
            _check_corner(name, getattr(particles.pack, name), scene.dimension)
        return _random(particles, scene.seed).copy()
    if particles.pack is not None:
        packed = _packed(scene, particles.pack)
        if particles.count is not None and len(packed) < particles.count:
            raise InputError(
                "particles.count",
                particles.count,
                f"the pack holds {len(packed)} particles",
                "enlarge the pack, lower particles.pack.spacing, or lower the count",
            )
        # Rows are filled from below, so a pack that is not full has a level top.
        return packed[: particles.count]
    position = rows_of("particles.position", particles.position, scene.dimension)
    assert position is not None
    if particles.count is not None and len(position) != particles.count:
        raise InputError(
            "particles.count", particles.count, f"there are {len(position)} positions", "make them agree"
        )
    return position


def initial_count(scene: Scene) -> int:
    """Number of particles that a scene starts with, without laying out a pack whose number is given."""
    assert scene.particles is not None
    count = scene.particles.count
    return len(initial_positions(scene)) if count is None else count


def check_initial_positions(scene: Scene, position: np.ndarray) -> None:
    """Refuses particles that overlap each other or a wall, or lie outside the box."""
    particles = scene.particles
    assert particles is not None
    radius = np.broadcast_to(
        particle_column("particles.radius", particles.radius, len(position)), len(position)
    )
    box = np.asarray(scene.domain.size)
    walls = ~np.asarray(scene.periodic)
    depth = np.maximum(radius[:, None] - position, position + radius[:, None] - box)
    depth = np.where(walls, depth, -np.inf) / (2.0 * radius[:, None])
    if len(position) and depth.max() > INSERTION_OVERLAP:
        index, axis = np.unravel_index(np.argmax(depth), depth.shape)
        raise InputError(
            "particles.position",
            f"particle {index} at {_point(position[index])} m",
            f"it reaches {100 * depth[index, axis]:.2g} % of its diameter into the "
            f"{scene.sides[2 * axis]} or {scene.sides[2 * axis + 1]} wall, the limit is "
            f"{100 * INSERTION_OVERLAP:g} %",
            "move it into the box",
        )
    worst, first, second = packing.deepest_overlap(position, radius, scene.domain.size, scene.periodic)
    if worst > INSERTION_OVERLAP:
        raise InputError(
            "particles.position",
            f"particles {first} and {second} at {_point(position[first])} and {_point(position[second])} m",
            f"they overlap by {100 * worst:.3g} % of a diameter, the limit is {100 * INSERTION_OVERLAP:g} %",
            "move them apart, or raise particles.pack.spacing",
        )


def check_walls(
    position: np.ndarray, radius: np.ndarray, surfaces: tuple[Any, ...], overlap: np.ndarray
) -> None:
    """Refuses particles that overlap a wall beside the sides of the box, or lie behind it.

    Args:
        position: (N, D) [m].
        radius: () or (N,) [m].
        surfaces: S walls, for the message.
        overlap: (S, N) depth in them [m].
    """
    depth = overlap / (2.0 * radius)
    inside = ~(depth <= INSERTION_OVERLAP)  # an overlap that is not a number too
    if inside.any():
        wall, index = np.unravel_index(np.argmax(np.where(inside, depth, -np.inf)), depth.shape)
        raise InputError(
            "particles.position",
            f"particle {index} at {_point(position[index])} m",
            f"it reaches {100 * depth[wall, index]:.3g} % of its diameter into the wall {surfaces[wall]}, "
            f"the limit is {100 * INSERTION_OVERLAP:g} %",
            "move it off the wall, or the wall off it",
        )


def rows_of(key: str, source: Any, width: int, count: int | None = None) -> np.ndarray | None:
    """Rows of `width` numbers from rows, from a flat list where the width is 1, or from a file; None stays None.

    Args:
        key: scene key, for the messages.
        source: rows, list, or name of a .npy file or of a text file of comma or blank separated rows.
        width: numbers per row.
        count: rows expected, if known.
    """
    if source is None:
        return None
    rows = _read_rows(key, source) if isinstance(source, str) else _as_array(key, source)
    if rows.ndim == 1 and (width == 1 or rows.size == 0):
        rows = rows.reshape(-1, width)
    if rows.ndim != 2 or rows.shape[1] != width:
        raise InputError(
            key, f"an array of shape {rows.shape}", f"needs rows of {width} number(s)", "correct it"
        )
    if not np.isfinite(rows).all():
        raise InputError(
            key, f"row {int(np.argmin(np.isfinite(rows).all(axis=1)))}", "must be finite", "correct it"
        )
    if count is not None and len(rows) != count:
        raise InputError(
            key, f"{len(rows)} rows", f"there are {count} particles", "give one row per particle"
        )
    return rows


def particle_column(key: str, value: float | tuple[float, ...], count: int) -> np.ndarray:
    """() for one number, else (count,)."""
    if isinstance(value, tuple) and len(value) != count:
        raise InputError(
            key, f"{len(value)} numbers", f"there are {count} particles", f"give one number or {count}"
        )
    return np.asarray(value, float)


@functools.lru_cache(maxsize=1)  # asked for its length and for its particles, and it takes seconds
def _random(particles: Particles, seed: int) -> np.ndarray:
    """Centres (N, D) of a random pack."""
    pack, count = particles.pack, particles.count
    assert pack is not None and count is not None
    start, stop = np.asarray(pack.start), np.asarray(pack.stop)
    dimension = len(start)
    if (stop <= start).any():
        raise InputError("particles.pack.stop", pack.stop, f"must be above start = {pack.start}", "swap them")
    radius = np.broadcast_to(particle_column("particles.radius", particles.radius, count), count)
    fraction = packing.random_solid_fraction(start, stop, radius, pack.spacing)
    limit, remedy = packing.REACHABLE[dimension], 'use a lattice (particles.pack.kind = "lattice")'
    if fraction > limit:
        raise InputError(
            "particles.count",
            count,
            f"with their spacing they fill {100 * fraction:.3g} % of the random pack's box; the limit is "
            f"{100 * limit:g} %, for random addition finds no more room at "
            f"{100 * packing.SATURATION[dimension]:g} %",
            f"{remedy}, enlarge the box, or lower particles.pack.spacing",
        )
    position, placed = packing.random_pack(start, stop, radius, pack.spacing, seed)
    if not placed.all():
        raise InputError(
            "particles.count",
            count,
            f"only {int(placed.sum())} of them found room in {packing.TRIES_PER_PARTICLE} tries each",
            f"{remedy}, or enlarge the box",
        )
    return position


def _check_corner(name: str, corner: tuple[float, ...] | None, dimension: int) -> None:
    if corner is None or len(corner) != dimension:
        raise InputError(f"particles.pack.{name}", corner, f"needs {dimension} numbers", "correct it")


def _packed(scene: Scene, pack: Pack) -> np.ndarray:
    particles = scene.particles
    assert particles is not None
    largest, smallest = float(np.max(particles.radius)), float(np.min(particles.radius))
    spacing, jitter = 2.0 * largest * pack.spacing, (pack.jitter or 0.0) * smallest
    if pack.kind == "polygon":
        vertices = np.asarray(pack.vertices, float)
        if vertices.ndim != 2 or vertices.shape[0] < 3 or vertices.shape[1] != 2:
            raise InputError(
                "particles.pack.vertices",
                pack.vertices,
                "needs at least three corners (x, vertical)",
                "add corners",
            )
        points = packing.polygon_pack(vertices, scene.domain.size, largest, spacing, jitter)
    else:
        for name in ("start", "stop"):
            _check_corner(name, getattr(pack, name), scene.dimension)
        points = packing.lattice_pack(np.asarray(pack.start), np.asarray(pack.stop), largest, spacing, jitter)
    return packing.jittered(points, jitter, scene.seed)


def _read_rows(key: str, name: str) -> np.ndarray:
    path = Path(name)
    try:
        if path.suffix == ".npy":
            return np.asarray(np.load(path, allow_pickle=False), float)
        text = path.read_text(encoding="utf-8").replace(",", " ")
        lines = [
            line.split() for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")
        ]
        if lines and not _is_number(lines[0][0]):
            lines = lines[1:]  # a line of column names
        return np.asarray(lines, float)
    except FileNotFoundError:
        raise InputError(key, name, "no such file", "names are relative to the scene file") from None
    except (OSError, ValueError, UnicodeDecodeError) as error:
        raise InputError(
            key, name, f"cannot be read as rows of numbers ({error})", "correct the file"
        ) from None


def _as_array(key: str, rows: Any) -> np.ndarray:
    try:
        return np.asarray(rows, float)
    except ValueError:
        raise InputError(
            key, "rows of unequal length", "all rows need as many numbers", "correct it"
        ) from None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _point(row: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.5g}" for value in row) + ")"
