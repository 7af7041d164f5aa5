"""Regions of a scene that are the inside of a mesh: read, placed, checked. Host, numpy."""

from __future__ import annotations

import numpy as np

from jaxdem.errors import InputError
from jaxdem.particles import regions
from jaxdem.scene.domain import Box
from jaxdem.scene.regions import Region
from jaxdem.solids.defects import defects_of, mended
from jaxdem.solids.interior import Interior
from jaxdem.solids.mesh_files import MESHES, triangles_of
from jaxdem.solids.surface_mesh import WELD, SurfaceMesh, rotation_of

LARGEST, SMALLEST = 1e3, 1e-6
"""Extents over that of the box at which a mesh is taken to have another unit [-]."""

FLAT = 1e-9
"""Volume over that of the box around it, below which a mesh encloses nothing [-]."""


def inside_of_mesh(key: str, region: Region, file: str, box: Box, depth: float) -> regions.Region:
    """The part of space inside of a closed mesh.

    Args:
        key: of the region in the scene, for the messages.
        region: of the scene.
        file: its triangles.
        box: of the scene.
        depth: up to which distances inside must be exact [m].

    Raises:
        InputError: the file cannot be read, or the mesh is open or encloses nothing.
    """
    mesh = _read(key, file).placed(region.scale or 1.0, rotation_of(region.rotate, 3), region.translate or (0.0,) * 3)
    ratio = mesh.extent / max(box.size)
    if not SMALLEST <= ratio <= LARGEST:
        limit = f"is {mesh.extent:.4g} m large, and the box {max(box.size):.4g} m"
        raise InputError(f"{key}.file", file, limit, "correct scale: 0.001 for a file in millimetres")
    mesh = _closed(key, file, mesh)
    low, high = (np.asarray(region.start or [-np.inf] * 3), np.asarray(region.stop or [np.inf] * 3))
    # A file rounds what is flush with the sides of the box to beyond them.
    rounded = WELD * mesh.extent
    lowest, highest = mesh.bounds
    side = np.asarray(box.size)
    low = np.maximum(low, np.where(lowest >= -rounded, 0.0, -np.inf))
    high = np.minimum(high, np.where(highest <= side + rounded, side, np.inf))
    if (np.maximum(low, lowest) >= np.minimum(high, highest)).any():
        limit = f"lies outside of start ... stop or of the box: it reaches from {_point(lowest)} to {_point(highest)} m"
        raise InputError(f"{key}.file", file, limit, "correct scale, translate, start or stop; all lengths are in m")
    space = Interior.of(mesh, low, high, 1.01 * depth)
    if space.size <= FLAT * float(np.prod(space.high - space.low)) or not space.is_sound:
        limit = "encloses no volume that is known: surfaces of it cross each other or lie in each other"
        raise InputError(f"{key}.file", file, limit, "unite its parts in the program that made it")
    return regions.Region((((0, 1, 2), space),), (tuple(space.low.tolist()), tuple(space.high.tolist())))


def _read(key: str, file: str) -> SurfaceMesh:
    if not file.lower().endswith(MESHES):
        limit = f"the inside of a mesh is that of a file that ends in {', '.join(MESHES)}"
        raise InputError(f"{key}.file", file, limit, "give a file of one of these kinds")
    try:
        return triangles_of(file)
    except OSError as error:
        limit = f"cannot be read ({error.strerror or error})"
        raise InputError(f"{key}.file", file, limit, "correct the name; it is relative to the scene") from None
    except ValueError as error:
        raise InputError(f"{key}.file", file, str(error), "give a sound file") from None


def _closed(key: str, file: str, mesh: SurfaceMesh) -> SurfaceMesh:
    """The mesh without triangles that have no size or are there twice, with its front outside.

    Raises:
        InputError: it is open.
    """
    found = mended(mesh.welded())
    open_edges = defects_of(found).open_edges if len(found.cells) else len(mesh.cells)
    if open_edges:
        limit = f"is open: {open_edges} edges belong to one triangle alone, so it has no inside"
        remedy = "give a closed mesh (close it in the program that made it), or a region of another shape"
        raise InputError(f"{key}.file", file, limit, remedy)
    return found


def _point(row: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.5g}" for value in row) + ")"
