"""The mesh of a wall of a scene: read, placed, checked and mended. Host, numpy."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np

from jaxdem.errors import InputError
from jaxdem.scene import Scene
from jaxdem.scene.walls import Wall
from jaxdem.setup.mesh_tables import hull_of
from jaxdem.solids.defects import Defects, defects_of, mended
from jaxdem.solids.mesh_files import DRAWINGS, HEIGHTS, MESHES, drawing, polyline, surface_of_heights, triangles_of
from jaxdem.solids.motion_tables import placement_of
from jaxdem.solids.surface_mesh import SurfaceMesh, rotation_of

LARGEST, SMALLEST = 100.0, 0.001
"""Extents over that of the box at which a mesh is taken to have another unit [-]."""


MOMENTS = 65
"""Times of a run at which a mesh that moves is looked for in the box."""


def sound_mesh(key: str, wall: Wall, scene: Scene, smallest: float) -> tuple[SurfaceMesh, Defects]:
    """The mesh of a wall without its motion, and what it is like after repair.

    Args:
        key: of the wall's table.
        wall: the table.
        scene: that it belongs to.
        smallest: radius of the smallest grain [m].

    Raises:
        InputError: its file cannot be read, or the mesh is broken or lies where it cannot be meant to.
    """
    mesh, defects = _checked(key, wall, placed_mesh(key, wall, scene.dimension))
    _check_place(key, wall, mesh, scene, smallest)
    return mesh, defects


def placed_mesh(key: str, wall: Wall, dimension: int) -> SurfaceMesh:
    """The mesh of a wall as its file or its points have it, scaled, turned and shifted, without its motion [m].

    Args:
        key: of the wall's table.
        wall: the table.
        dimension: of the scene.

    Raises:
        InputError: its file cannot be read.
    """
    if wall.points is not None:
        mesh = polyline(wall.points, bool(wall.closed))
    else:
        mesh = _from_file(key, str(wall.file), wall, dimension)
    return mesh.placed(wall.scale or 1.0, rotation_of(wall.rotate, dimension), wall.translate or (0.0,) * dimension)


def _from_file(key: str, file: str, wall: Wall, dimension: int) -> SurfaceMesh:
    kind = Path(file).suffix.lower()
    known = (*(MESHES if dimension == 3 else DRAWINGS), *HEIGHTS)
    if kind not in known:
        limit = f"in {dimension}-D a mesh is read from files that end in {', '.join(known)}"
        raise InputError(f"{key}.file", file, limit, "give a file of one of these kinds")
    if wall.spacing is not None and kind not in HEIGHTS:
        raise InputError(f"{key}.spacing", wall.spacing, "is for maps of heights", "remove this key")
    try:
        stamp = Path(file).stat()
        return _read(file, kind, wall.spacing, (stamp.st_mtime_ns, stamp.st_size))
    except OSError as error:
        limit = f"cannot be read ({error.strerror or error})"
        raise InputError(f"{key}.file", file, limit, "correct the name; it is relative to the scene") from None
    except ValueError as error:
        remedy = "give a sound file, or correct the keys of this wall"
        raise InputError(f"{key}.file", file, str(error), remedy) from None


@functools.lru_cache(maxsize=4)
def _read(file: str, kind: str, spacing: tuple[float, ...] | None, _: tuple[int, int]) -> SurfaceMesh:
    """The mesh of a file, once in a build, where several parts ask for it; the last argument is the file's time and
    size, so that one that has changed is read anew."""
    if kind in MESHES:
        mesh = triangles_of(file)
    else:
        mesh = drawing(file) if kind in DRAWINGS else surface_of_heights(file, spacing)
    for array in (mesh.points, mesh.cells):
        array.flags.writeable = False
    return mesh


def _checked(key: str, wall: Wall, mesh: SurfaceMesh) -> tuple[SurfaceMesh, Defects]:
    """The mesh with its corners welded, mended if the wall asks for it, and what it is like.

    Raises:
        InputError: it is broken.
    """
    mesh = mesh.welded()
    if wall.repair:
        mesh = mended(mesh)
        if not len(mesh.cells):
            raise InputError(f"{key}.file", wall.file, "nothing is left of it after repair", "give another mesh")
    defects = defects_of(mesh)
    one, many = ("triangle", "triangles") if mesh.dimension == 3 else ("line", "lines")
    found = [
        f"{count} {one if count == 1 else many} {words}"
        for count, words in (
            (defects.degenerate, "without size"),
            (defects.duplicate, "that are there already"),
            (defects.flipped if wall.touch == "front" else 0, "turned over against their neighbours"),
        )
        if count
    ]
    if found:
        limit = f"has {', '.join(found)}, of {len(mesh.cells)}"
        raise InputError(f"{key}.file", wall.file, limit, "mend the file, or set repair = true")
    if wall.closed and not defects.is_closed:
        limit = f"has holes: {defects.open_edges} edges that belong to one triangle alone"
        raise InputError(f"{key}.closed", True, limit, "mend the file, or set closed = false")
    if wall.touch == "front" and defects.crowded_edges:
        limit = f"has {defects.crowded_edges} edges of more than two triangles, which have no front"
        raise InputError(f"{key}.touch", "front", limit, 'set touch = "both", or mend the file')
    return mesh, defects


def _check_place(key: str, wall: Wall, mesh: SurfaceMesh, scene: Scene, smallest: float) -> None:
    """Refuses a mesh at rest that is nowhere in the box, and one with a size as if in another unit."""
    lower, upper = mesh.bounds
    size, name = np.asarray(scene.domain.size), "file" if wall.points is None else "points"
    words = " x ".join(f"{length:.4g}" for length in upper - lower)
    box = " x ".join(f"{length:.4g}" for length in size)
    ratio = mesh.extent / float(size.max())
    unit = "are its coordinates in millimetres? Then set scale = 0.001"
    if ratio > LARGEST or ratio < SMALLEST or mesh.extent < smallest:
        limit = f"is {words} m large with scale = {wall.scale:g}, and the box {box} m"
        raise InputError(f"{key}.{name}", wall.file, limit, unit if ratio > 1.0 else "correct scale")
    if not wall.moves and outside(lower, upper, size):
        limit = f"lies outside of the box: {from_to(lower, upper)}, and the box is {box} m"
        raise InputError(
            f"{key}.{name}", wall.file, limit, f"correct translate; or {unit}" if ratio > 5.0 else "correct translate"
        )


def outside(lower: np.ndarray, upper: np.ndarray, size: np.ndarray) -> bool:
    """Whether a box between two corners (D,) lies wholly outside of that of the scene, whose sides are `size` [m]."""
    return bool(np.any(upper < 0.0) or np.any(lower > size))


def from_to(lower: np.ndarray, upper: np.ndarray) -> str:
    """The two corners in words."""
    one, other = ("(" + ", ".join(f"{x:.4g}" for x in corner) + ")" for corner in (lower, upper))
    return f"from {one} to {other} m"


def reached(wall: Wall, mesh: SurfaceMesh, end: float) -> tuple[np.ndarray, np.ndarray]:
    """(D,) corners of the box around all places that a mesh has while it is there, as far as `MOMENTS` tell [m].

    Args:
        wall: with a given motion or none; a piston counts where it begins.
        mesh: without its motion.
        end: of the run [s].
    """
    if not wall.motion:
        return mesh.bounds
    tables, hull = wall.model_dump(exclude_none=True), hull_of(mesh)
    bounds = []
    for time in np.linspace(wall.begin or 0.0, min(wall.end or end, end), MOMENTS):
        placed = placement_of(tables, float(time))
        turned = hull if placed is None or placed.rotation is None else hull @ np.asarray(placed.rotation).T
        points = turned if placed is None else turned + np.asarray(placed.shift)
        bounds.append((points.min(axis=0), points.max(axis=0)))
    lowest, highest = zip(*bounds, strict=True)
    return np.min(lowest, axis=0), np.max(highest, axis=0)
