"""Faces of `insert/stream`: an STL file that is a rectangle across an axis, or a regular polygon for a disc."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jaxdem.files.reading import TABLE_BYTES, read_bytes
from jaxdem.foreign.notes import Unknown
from jaxdem.foreign.region import Region, block, cylinder

VERTEX = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)")
HEAD, RECORD = 84, 50
"""Bytes of a binary file before the triangles, and of each of them."""

ALIKE = 1e-5
"""Part of the extent by which places may differ and are one."""


@dataclass
class Face:
    """A plane face across an axis.

    Attributes:
        line: number of the note of its mesh.
        axis: that it is across.
        coordinate: along it [m].
        lower, upper: corners of the rectangle round it [m].
        radius: of a disc [m]; 0 for a rectangle.
        normal: 1 or -1, the way the triangles look along the axis.
    """

    line: int
    axis: int
    coordinate: float
    lower: list[float]
    upper: list[float]
    radius: float
    normal: int

    def layer(self, thickness: float, ahead: int) -> Region:
        """The region of that thickness [m] that begins at the face and goes on in the direction `ahead`, 1 or -1."""
        low, high = list(self.lower), list(self.upper)
        ends = sorted((self.coordinate, self.coordinate + ahead * thickness))
        if self.radius:
            middle = [0.5 * (a + b) for k, (a, b) in enumerate(zip(low, high, strict=True)) if k != self.axis]
            return cylinder(self.axis, middle, self.radius, ends)
        low[self.axis], high[self.axis] = ends
        return block(low, high)


def read_face(path: Path, words: list[str], unit: float, line: int) -> Face:
    """The face of `file NAME type T [scale S] [move x y z]`.

    Raises:
        Unknown: the file cannot be read, or is no plane rectangle or disc across an axis.
    """
    if "rotate" in words:
        raise Unknown("a mesh that is turned is not read; turn the STL file")
    triangles = _triangles(path) * unit
    scale = float(words[words.index("scale") + 1]) if "scale" in words else 1.0
    moved = [float(w) * unit for w in words[words.index("move") + 1 :][:3]] if "move" in words else [0.0] * 3
    points = triangles * scale + np.asarray(moved)
    low, high = points.reshape(-1, 3).min(axis=0), points.reshape(-1, 3).max(axis=0)
    extent = float((high - low).max())
    flat = np.flatnonzero(high - low <= ALIKE * extent)
    if len(flat) != 1:
        raise Unknown("its face is not plane across an axis; write [[particles.inlet]] by hand")
    axis = int(flat[0])
    across = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    area = 0.5 * float(np.linalg.norm(across, axis=1).sum())
    sides = [float(high[k] - low[k]) for k in range(3) if k != axis]
    normal = 1 if across[:, axis].sum() > 0.0 else -1
    found = Face(line, axis, float(low[axis]), low.tolist(), high.tolist(), 0.0, normal)
    if abs(area / (sides[0] * sides[1]) - 1.0) <= ALIKE:
        return found
    found.radius = _radius(points, axis, area)
    return found


def _radius(points: np.ndarray, axis: int, area: float) -> float:
    """Radius of the circle round a regular polygon [m].

    Raises:
        Unknown: the face is another shape.
    """
    flat = np.delete(points.reshape(-1, 3), axis, axis=1)
    middle = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
    distance = np.linalg.norm(flat - middle, axis=1)
    radius = float(distance.max())
    ring = np.unique(np.round(flat[distance > (1.0 - 1e-3) * radius] / radius, 4), axis=0)
    corners = len(ring)
    expected = 0.5 * corners * radius**2 * math.sin(2.0 * math.pi / max(corners, 3))
    if corners < 8 or abs(area / expected - 1.0) > 0.01:
        raise Unknown("its face is neither a rectangle nor a disc; write [[particles.inlet]] by hand")
    return radius


def _triangles(path: Path) -> np.ndarray:
    """(T, 3, 3) corners of the triangles of an STL file, text or binary.

    Raises:
        Unknown: it cannot be read, or holds none.
    """
    try:
        content = read_bytes(path, TABLE_BYTES)
    except (OSError, ValueError) as error:
        raise Unknown(f"its file {path.name} cannot be read ({getattr(error, 'strerror', None) or error})") from None
    count = int.from_bytes(content[HEAD - 4 : HEAD], "little")
    if len(content) >= HEAD and len(content) == HEAD + RECORD * count and count:
        records = np.frombuffer(content[HEAD:], np.uint8).reshape(count, RECORD)
        return records[:, 12:48].copy().view("<f4").reshape(count, 3, 3).astype(np.float64)
    try:
        corners = np.asarray([[float(word) for word in found] for found in VERTEX.findall(content)])
    except ValueError:
        corners = np.zeros(0)
    if not len(corners) or len(corners) % 3:
        raise Unknown(f"its file {path.name} is no STL file")
    return corners.reshape(-1, 3, 3)
