"""Surfaces from files: triangle meshes, height maps of terrain, and paths of 2-D drawings. Host.

What is wrong is raised as OSError (the file cannot be opened or is too large) or ValueError (what it holds); who reads
it knows the key and the remedy.
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jaxdem.files.reading import TABLE_BYTES, read_bytes
from jaxdem.solids.surface_mesh import SurfaceMesh
from jaxdem.solids.svg_path import points_of_svg

MESHES = (".stl", ".obj", ".ply")
"""Files of triangles, read by trimesh."""

HEIGHTS = (".npy", ".txt", ".csv", ".asc")
"""Height maps: arrays, rows of numbers, and ESRI's text grids."""

DRAWINGS = (".svg",)
"""Files of 2-D paths."""


def triangles_of(path: str) -> SurfaceMesh:
    """The triangles of an STL (binary or text), OBJ or PLY file, in its own unit.

    Raises:
        OSError: it cannot be opened.
        ValueError: it holds no triangles, or something else than it should.
    """
    import trimesh  # only scenes with such files wait for it

    kind = Path(path).suffix.lower()[1:]
    data = read_bytes(path, TABLE_BYTES)
    more = {"skip_materials": True} if kind == "obj" else {}
    try:
        found = trimesh.load_mesh(io.BytesIO(data), file_type=kind, process=False, **more)
        points, cells = np.asarray(found.vertices, float), np.asarray(found.faces, np.int64)
    except Exception as error:  # whatever the reader stumbles over
        raise ValueError(f"is no {kind.upper()} file that can be read ({type(error).__name__}: {error})") from error
    if cells.ndim != 2 or not len(cells):
        raise ValueError("holds no triangles")
    if not np.isfinite(points[cells]).all():
        raise ValueError("holds coordinates that are not finite")
    return SurfaceMesh(points, cells)


def surface_of_heights(path: str, spacing: Sequence[float] | None) -> SurfaceMesh:
    """The surface over a grid of heights, with the front above: two triangles a square, in 2-D a line.

    Heights [i, j] stand at x = i dx, y = j dy. Where one is not a number, or has the NODATA value of a text grid, the
    surface has a hole.

    Args:
        path: .npy with a 2-D array, for a 2-D scene a 1-D array; text with a row of heights j = 0, 1, ... for each i;
            or ESRI's text grid (.asc), whose first row is that of the highest y, with its own corner and spacing.
        spacing: dx and dy [unit of the file]; None for a text grid that has its own.

    Raises:
        OSError: it cannot be opened.
        ValueError: it is no grid of numbers, or the spacing is missing or given twice.
    """
    heights, own_corner, own_spacing = _heights(path)
    if (spacing is None) == (own_spacing is None):
        raise ValueError("needs the key spacing" if spacing is None else "has a cellsize, so the key spacing must go")
    steps = own_spacing or tuple(spacing or ())
    if heights.ndim != len(steps) or min(heights.shape) < 2:
        shape = f"an array of shape {heights.shape}"
        raise ValueError(f"holds {shape}, expected at least two heights along each of {len(steps)} axes")
    triples = zip(own_corner, steps, heights.shape, strict=False)
    axes = [corner + step * np.arange(n) for corner, step, n in triples]
    points = np.stack([*np.meshgrid(*axes, indexing="ij"), heights], axis=-1).reshape(-1, heights.ndim + 1)
    number = np.arange(heights.size).reshape(heights.shape)
    if heights.ndim == 1:
        cells = np.stack([number[1:], number[:-1]], axis=1)  # the front is to the right, above
    else:
        a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
        cells = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    cells = cells[np.isfinite(points[cells]).all(axis=(1, 2))]
    if not len(cells):
        raise ValueError("holds no two neighbouring heights that are finite")
    return SurfaceMesh(np.nan_to_num(points), cells)


def _heights(path: str) -> tuple[np.ndarray, tuple[float, float], tuple[float, ...] | None]:
    """Heights [i, j], corner, and spacing if the file has one."""
    data = read_bytes(path, TABLE_BYTES)
    if path.lower().endswith(".npy"):
        found = np.load(io.BytesIO(data), allow_pickle=False)
        if found.dtype.kind not in "iuf":
            raise ValueError(f"holds {found.dtype}, expected numbers")
        return np.asarray(found, float), (0.0, 0.0), None
    lines = data.decode("utf-8-sig").splitlines()
    head: dict[str, float] = {}
    while lines and lines[0].split() and lines[0].split()[0][0].isalpha() and lines[0].split()[0].lower() != "nan":
        name, value = lines.pop(0).split()[:2]
        head[name.lower()] = float(value)
    rows = np.loadtxt([line.replace(",", " ") for line in lines], ndmin=2)
    if not head:
        return (rows[:, 0] if rows.shape[1] == 1 else rows), (0.0, 0.0), None
    size = head.get("cellsize", 0.0)
    if not size > 0.0:
        raise ValueError("has a head without a cellsize above 0")
    if rows.shape != (head.get("nrows", len(rows)), head.get("ncols", rows.shape[1])):
        raise ValueError(f"has {rows.shape[0]} rows of {rows.shape[1]} heights, its head says otherwise")
    rows = np.where(rows == head.get("nodata_value", math.nan), math.nan, rows)
    shift = 0.5 * size if "xllcorner" in head else 0.0
    corner = head.get("xllcorner", head.get("xllcenter", 0.0)), head.get("yllcorner", head.get("yllcenter", 0.0))
    return rows[::-1].T, (corner[0] + shift, corner[1] + shift), (size, size)


def polyline(points: Sequence[Sequence[float]] | np.ndarray, closed: bool) -> SurfaceMesh:
    """Segments between points of a plane in their order, and from the last to the first where closed."""
    number = np.arange(len(points))
    cells = np.stack([number, np.roll(number, -1)], axis=1)
    return SurfaceMesh(np.asarray(points, float), cells if closed else cells[:-1])


def drawing(path: str) -> SurfaceMesh:
    """The paths of an SVG file as segments, in its own unit, with y upwards.

    Raises:
        OSError: it cannot be opened.
        ValueError: it is no SVG file, or has no path that can be read.
    """
    parts = [polyline(points, closed) for points, closed in points_of_svg(read_bytes(path).decode("utf-8-sig"))]
    if not parts:
        raise ValueError("holds no path, polyline, polygon, rect, circle or line")
    first = np.cumsum([0, *(len(part.points) for part in parts)])
    cells = [part.cells + start for part, start in zip(parts, first, strict=False)]
    return SurfaceMesh(np.concatenate([part.points for part in parts]), np.concatenate(cells))
