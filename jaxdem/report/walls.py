"""Walls of `[[walls]]` and openings of the box for pictures, from the scene as run.

A wall is solid where its signed distance is negative. In 3-D the view is from the front: solid is averaged over the
depth, as the fluid's speed is, and the outline is that of the section at half depth. A mesh is a line, the section of
its surface; filled where it is closed and touched from its front alone.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from contourpy import contour_generator
from scipy.spatial import KDTree

from jaxdem.io.wall_file import read_walls
from jaxdem.report.runs import Array, lookup
from jaxdem.solids.defects import defects_of
from jaxdem.solids.inside import inside
from jaxdem.solids.mesh_files import triangles_of
from jaxdem.solids.surface_mesh import SurfaceMesh, rotation_of

RESOLUTION = {2: 400, 3: 200}
"""Points along the longer side of a picture, by dimension."""
SLICES = 17
"""Points over the depth; the middle one is at half of it."""

LINE = 0.75
"""Half of the width of the line that a mesh is drawn by, over the distance of points."""

INLET, OUTLET = "inlet", "outlet"


@dataclass(frozen=True)
class Solid:
    """The walls of a picture at points (nx, nz) of its plane, cell centres of a mesh over the box.

    Attributes:
        share: of the point's surroundings and of the depth that is solid, 0 to 1.
        distance: signed distance at half depth, negative in the wall [m].
        is_section: whether it is that of a 3-D scene, in which there are grains before it.
        openings: kind and lines (P, 2) of points (x, height) of every `[[walls.opening]]` at half depth [m].
    """

    share: Array
    distance: Array
    is_section: bool = False
    openings: tuple[tuple[str, Array], ...] = ()

    @property
    def shown_share(self) -> Array:
        """Share as pictures have it (nx, nz): a section by its square root, so that what is a small part of the depth,
        such as a pillar or a blade before or behind the section, is seen."""
        return np.sqrt(self.share) if self.is_section else self.share

    def outlines(self, box: Sequence[float]) -> list[Array]:
        """Lines (P, 2) of points (x, height) along the surface at half depth [m].

        Args:
            box: length and height of the picture [m].
        """
        return _contours(self.distance, box)


def _contours(distance: Array, box: Sequence[float]) -> list[Array]:
    """Lines (P, 2) of points (x, height) along which a distance (nx, nz) in a picture of this size is zero [m]."""
    x, z = ((np.arange(n) + 0.5) * side / n for n, side in zip(distance.shape, box, strict=True))
    lines = contour_generator(x, z, distance.T, line_type="Separate").lines(0.0)
    return [np.asarray(line) for line in lines]


class Opening(NamedTuple):
    """Where fluid or grains come in or leave: a patch of a side, or the box that grains appear in.

    Attributes:
        kind: `INLET` or `OUTLET`.
        start, stop: opposite corners (x, height) in the picture's plane [m].
    """

    kind: str
    start: tuple[float, float]
    stop: tuple[float, float]


def solid(
    scene: Mapping[str, Any],
    box: Sequence[float],
    time: float = 0.0,
    history: Mapping[str, Array] | None = None,
    folder: Path | None = None,
) -> Solid | None:
    """The walls of a scene that are there at a time; None where there are none.

    Args:
        scene: tables of scene.toml.
        box: side lengths (D,) [m].
        time: of the frame [s].
        history: of the run, with the displacement of each piston.
        folder: of the run, which has the meshes; without it they are not drawn.
    """
    # A wall that vanishes at the time of a frame has gone in it, whatever rounding the frame's time has.
    now = time * (1.0 + 1e-9)
    walls = [
        dict(wall) | _place(wall, time, _displacement(history, k, time)) | {"number": k, "folder": str(folder)}
        for k, wall in enumerate(scene.get("walls", ()))
        if wall.get("begin", 0.0) <= now < wall.get("end", math.inf)
        and (wall.get("kind") != "mesh" or _mesh_of(str(folder), k) is not None)
    ]
    return _solid(json.dumps(walls), tuple(box)) if walls else None


def _place(wall: Mapping[str, Any], time: float, displacement: float) -> dict[str, Any]:
    """Where a wall has moved, {} for one at rest."""
    if not (wall.get("motion") or wall.get("piston")):
        return {}
    from jaxdem.solids.motion_tables import placement_of  # loads JAX

    placed = placement_of(wall, time, displacement)
    if placed is None:
        return {}
    turn = np.eye(placed.dimension) if placed.rotation is None else np.asarray(placed.rotation)
    if wall["kind"] == "cylinder" and not wall.get("opening") and _same_tube(wall, turn, np.asarray(placed.shift)):
        return {}  # one picture for all angles of a drum
    return {"rotation": turn.tolist(), "shift": np.asarray(placed.shift).tolist(), "motion": None}


def _same_tube(wall: Mapping[str, Any], turn: Array, shift: Array) -> bool:
    """Whether a cylinder covers itself after it has moved."""
    center, size = np.asarray(wall["center"]), 1e-9 * float(wall["radius"])
    axis = np.zeros(len(center)) if wall.get("axis") is None else _unit(wall["axis"])
    moved = turn @ center + shift - center
    return bool(np.abs(moved - (moved @ axis) * axis).max() < size and np.allclose(turn @ axis, axis, atol=1e-12))


def _displacement(history: Mapping[str, Array] | None, number: int, time: float) -> float:
    """How far a piston has moved at a time [m]."""
    column = None if history is None else history.get(f"wall_{number}_displacement")
    return 0.0 if history is None or column is None else float(np.interp(time, history["time"], column))


@lru_cache(maxsize=8)
def _solid(tables: str, box: tuple[float, ...]) -> Solid:
    """See `solid`; kept, for walls that stand still are the same in many frames of a run."""
    walls = json.loads(tables)
    spacing = max(box[0], box[-1]) / RESOLUTION[len(box)]
    counts = [max(2, round(box[0] / spacing)), *([SLICES] * (len(box) - 2)), max(2, round(box[-1] / spacing))]
    centres = [(np.arange(n) + 0.5) * side / n for n, side in zip(counts, box, strict=True)]
    points = np.stack(np.meshgrid(*centres, indexing="ij"), axis=-1)
    distance = _distance(walls, points)
    openings = _openings_of(walls, points if len(box) == 2 else points[:, SLICES // 2 : SLICES // 2 + 1], box)
    # Half of a point's surroundings is solid where the surface goes through it.
    share = np.clip(0.5 - distance / spacing, 0.0, 1.0)
    if len(box) == 2:
        return Solid(share, distance, openings=openings)
    return Solid(share.mean(axis=1), distance[:, SLICES // 2], True, openings)


def _openings_of(
    walls: Sequence[Mapping[str, Any]], points: Array, box: Sequence[float]
) -> tuple[tuple[str, Array], ...]:
    """See `Solid.openings`; the points (nx, [1,] nz, D) are those of a picture."""
    found = []
    for wall in walls:
        if not wall.get("opening"):
            continue
        distance = _distance([wall], points).reshape(len(points), -1)
        lines = [line for line in _contours(distance, (box[0], box[-1])) if len(line) > 1]
        for opening in wall["opening"]:
            for line in lines:
                places = np.insert(line, 1, 0.5 * box[1], axis=1) if len(box) == 3 else line
                if "shift" in wall:
                    places = (places - np.asarray(wall["shift"])) @ np.asarray(wall["rotation"])
                within = np.flatnonzero(_is_in(opening.get("region"), places))
                parts = np.split(within, np.flatnonzero(np.diff(within) > 1) + 1)
                found += [(opening["kind"], line[part]) for part in parts if len(part) > 1]
    return tuple(found)


def _is_in(region: Mapping[str, Any] | None, points: Array) -> Array:
    """(P,) whether points (P, D) are in the region of an opening; all without one."""
    if region is None:
        return np.ones(len(points), bool)
    if region["shape"] == "box":
        return np.all((points >= region["start"]) & (points <= region["stop"]), axis=1)
    if region["shape"] == "sphere":
        return np.linalg.norm(points - np.asarray(region["center"]), axis=1) <= region["radius"]
    axis, away = _unit(region["axis"]), points - np.asarray(region["base"])
    along = away @ axis
    across = np.linalg.norm(away - along[:, None] * axis, axis=1)
    return (along >= 0.0) & (along <= region["length"]) & (across <= region["radius"])


def _distance(walls: Sequence[Mapping[str, Any]], points: Array) -> Array:
    """Distance from the nearest wall, negative inside one; the signed distances of `jaxdem.particles.surfaces`."""
    return np.min([distance for wall in walls for distance in _distances(wall, points)], axis=0)


def _distances(wall: Mapping[str, Any], points: Array) -> list[Array]:
    """Of the surfaces that a wall consists of, at points (..., D); of one that has moved at X = R^T (x - s)."""
    if wall["kind"] == "mesh":
        return [_distance_from_mesh(wall, points)]
    if "shift" in wall:
        points = (points - np.asarray(wall["shift"])) @ np.asarray(wall["rotation"])
    if wall["kind"] == "plane":
        return [(points - np.asarray(wall["point"])) @ _unit(wall["normal"])]
    if wall["kind"] == "cylinder":
        across = points - np.asarray(wall["center"])
        if wall.get("axis") is not None:
            axis = _unit(wall["axis"])
            across = across - (across @ axis)[..., None] * axis
        gap = float(wall["radius"]) - np.linalg.norm(across, axis=-1)
        return [gap if wall.get("inside", True) else -gap]
    a, b = (_unit(direction) for direction in wall["directions"])
    return [(points - np.asarray(wall["apex"])) @ _unit(n) for n in (b - (a @ b) * a, a - (a @ b) * b)]


@lru_cache(maxsize=16)
def _mesh_of(folder: str, number: int) -> SurfaceMesh | None:
    """The mesh that a wall of a run is, where the scene puts it; None where the run has none."""
    found = None if folder == "None" else read_walls(folder)
    if found is None or not np.any(found.wall == number):
        return None
    return SurfaceMesh(found.points, found.cells[found.wall == number]).welded()


def _distance_from_mesh(wall: Mapping[str, Any], points: Array) -> Array:
    """Distance at points (nx, [ny,] nz, D) from the section of a mesh with the plane of each slice, less the width of a
    line; of a closed one that is touched from its front negative inside."""
    mesh = _mesh_of(wall["folder"], wall["number"])
    assert mesh is not None
    if "shift" in wall:
        mesh = mesh.placed(1.0, np.asarray(wall["rotation"]), wall["shift"])
    spacing = float(points[(1,) + (0,) * (points.ndim - 2)][0] - points[(0,) * (points.ndim - 1)][0])
    flat = points if points.ndim == 4 else points[:, None]
    found = np.full(flat.shape[:-1], 4.0 * spacing + np.ptp(points))
    for k in range(flat.shape[1]):
        ends = mesh.corners if mesh.dimension == 2 else _section(mesh, float(flat[0, k, 0, 1]))
        if len(ends):
            plane = flat[:, k][..., [0, -1]]
            found[:, k] = KDTree(_along(ends, 0.5 * spacing)).query(plane)[0]
    found -= LINE * spacing
    if wall.get("touch") == "front" and defects_of(mesh).is_closed:
        within = inside(mesh, flat.reshape(-1, mesh.dimension)).reshape(found.shape)
        found = np.where(within, np.minimum(found, -spacing), found)
    return found if points.ndim == 4 else found[:, 0]


def _section(mesh: SurfaceMesh, y: float) -> Array:
    """(L, 2, 2) ends (x, z) of the lines in which triangles meet a plane across the second axis."""
    above = mesh.points[mesh.cells][..., 1] > y
    cells = np.flatnonzero(above.any(axis=1) & ~above.all(axis=1))
    corners, above = mesh.corners[cells], above[cells]
    ends = []
    for k in range(3):
        a, b = corners[:, k], corners[:, (k + 1) % 3]
        crosses = above[:, k] != above[:, (k + 1) % 3]
        part = np.where(crosses, (y - a[:, 1]) / np.where(crosses, b[:, 1] - a[:, 1], 1.0), np.nan)
        ends.append((a + part[:, None] * (b - a))[:, [0, 2]])
    three = np.stack(ends, axis=1)
    order = np.argsort(np.isnan(three[..., 0]), axis=1, kind="stable")[:, :2]
    return np.take_along_axis(three, order[..., None], axis=1)


def _along(ends: Array, step: float) -> Array:
    """(P, 2) points along lines, no farther apart than a step."""
    many = np.ceil(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / step).astype(int) + 1
    line = np.repeat(np.arange(len(ends)), many)
    part = (np.arange(len(line)) - np.repeat(np.cumsum(many) - many, many)) / np.repeat(np.maximum(many - 1, 1), many)
    return ends[line, 0] + part[:, None] * (ends[line, 1] - ends[line, 0])


def _unit(vector: Sequence[float] | Array) -> Array:
    array = np.asarray(vector, dtype=np.float64)
    return array / math.hypot(*array)


def openings(scene: Mapping[str, Any], box: Sequence[float]) -> list[Opening]:
    """Where something comes in or leaves, but for front and back, which the view looks through.

    Args:
        scene: tables of scene.toml.
        box: side lengths (D,) [m].
    """
    found = []
    for name in ("left", "right", "bottom", "top"):
        side = lookup(scene, f"boundary.{name}", {})
        kind = side.get("kind")
        if kind in (INLET, OUTLET) or side.get("particles") == "remove":
            found.append(_patch(INLET if kind == INLET else OUTLET, name, side, (box[0], box[-1])))
    for inlet in lookup(scene, "particles.inlet", ()):
        ends = _ends(inlet)
        if ends is not None:
            found.append(Opening(INLET, *((corner[0], corner[-1]) for corner in ends)))
    return found


def _ends(inlet: Mapping[str, Any]) -> tuple[Sequence[float], Sequence[float]] | None:
    """Lower and upper corner of the box round an inlet of particles [m]; None where the file of its mesh has gone."""
    region = inlet.get("region")
    if region is None:
        return inlet["start"], inlet["stop"]
    if region["shape"] == "mesh":
        try:
            mesh = triangles_of(region["file"])
        except (OSError, ValueError):
            return None
        turn, shift = rotation_of(region.get("rotate"), 3), region.get("translate", (0.0, 0.0, 0.0))
        low, high = mesh.placed(region.get("scale", 1.0), turn, shift).bounds
        cut = np.maximum(low, region.get("start", low)), np.minimum(high, region.get("stop", high))
        return cut[0].tolist(), cut[1].tolist()
    if region["shape"] == "polygon":
        corners = np.asarray(region["vertices"])
        return corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    if region["shape"] == "sphere":
        center, reach = np.asarray(region["center"]), np.full(len(region["center"]), region["radius"])
        return (center - reach).tolist(), (center + reach).tolist()
    along = _unit(region["axis"])
    ends = np.asarray(region["base"]) + np.outer([0.0, region["length"]], along)
    reach = region["radius"] * np.sqrt(np.maximum(1.0 - along**2, 0.0))
    return (ends.min(axis=0) - reach).tolist(), (ends.max(axis=0) + reach).tolist()


def _patch(kind: str, name: str, side: Mapping[str, Any], size: tuple[float, float]) -> Opening:
    across = 0 if name in ("left", "right") else 1  # the axis of the picture that the side is normal to
    along = 1 - across
    ends = [0.0, size[along]]
    if side.get("from") is not None and side.get("to") is not None:
        # The corners have the side's own axes in order: the vertical one is the last, x the first.
        ends = [float(side[key][-1 if along else 0]) for key in ("from", "to")]
    place = size[across] if name in ("right", "top") else 0.0
    start, stop = ((place, end) if along else (end, place) for end in ends)
    return Opening(kind, start, stop)
