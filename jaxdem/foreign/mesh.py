"""Meshes of blockMesh that are a box of equal cells: one block, or several that make one."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxdem.foreign.foam import Sheet
from jaxdem.foreign.model import SIDES
from jaxdem.foreign.notes import LEFT, TAKEN, Notes, unreadable

ALIKE = 1e-6
"""Part of a cell by which the places of two blocks may differ."""

REMEDY = "write a box round the geometry, and its walls as [[walls]], by hand"


class PatchFace(NamedTuple):
    """A rectangle of a side.

    Attributes:
        name: of its patch.
        lower, upper: corners in the other axes [m].
    """

    name: str
    lower: tuple[float, ...]
    upper: tuple[float, ...]

    @property
    def area(self) -> float:
        """[m2]."""
        return math.prod(b - a for a, b in zip(self.lower, self.upper, strict=True))


class Mesh(NamedTuple):
    """A box of equal cells.

    Attributes:
        lower, upper: corners [m].
        cells: along each axis.
        types: type of each patch.
        sides: rectangles of the patches on each side.
        default: type of the patch of what no other has.
    """

    lower: list[float]
    upper: list[float]
    cells: list[int]
    types: dict[str, str]
    sides: dict[str, list[PatchFace]]
    default: str

    def area(self, side: str) -> float:
        """Of a side [m2]."""
        axis = next(k for k, names in enumerate(SIDES[3]) if side in names)
        return math.prod(b - a for k, (a, b) in enumerate(zip(self.lower, self.upper, strict=True)) if k != axis)


class _Block(NamedTuple):
    """Corners and cells of a block along the axes."""

    lower: np.ndarray
    upper: np.ndarray
    cells: np.ndarray


def read_mesh(root: Path, notes: Notes) -> Mesh:
    """The mesh of a case, with a note on each entry.

    Raises:
        InputError: it is no box of equal cells.
    """
    places = (root / "system" / "blockMeshDict", root / "constant" / "polyMesh" / "blockMeshDict")
    sheet = Sheet(next((place for place in places if place.is_file()), places[0]), notes)
    scale = float(sheet.get("scale", sheet.get("convertToMeters", 1.0)))
    vertices = scale * np.asarray([[float(value) for value in vertex] for vertex in sheet.entries["vertices"]])
    if sheet.get("edges") or sheet.get("mergePatchPairs"):
        limit = "the mesh has curved edges or merged patches; the mesh of a scene is a box of equal cells"
        raise unreadable(str(sheet.path), limit, REMEDY)
    blocks = _blocks(sheet, vertices)
    lower, upper = np.min([b.lower for b in blocks], axis=0), np.max([b.upper for b in blocks], axis=0)
    cells = _cells(sheet, blocks, lower, upper)
    types, sides = _patches(sheet, vertices, lower, upper)
    default = sheet.get("defaultPatch")
    for key in ("vertices", "blocks", "scale", "convertToMeters", "edges", "mergePatchPairs"):
        sheet.say(key, TAKEN, "domain.size and fluid.cells")
    for key in ("boundary", "patches", "defaultPatch"):
        sheet.say(key, TAKEN, "the sides of [boundary]; see 0/U for what each is")
    sheet.finish(("geometry", "faces", "prefix", "namedVertices", "namedBlocks", "fastMerge"))
    kind = str(default.get("type", "wall")) if isinstance(default, dict) else "wall"
    return Mesh(lower.tolist(), upper.tolist(), cells, types, sides, kind)


def _blocks(sheet: Sheet, vertices: np.ndarray) -> list[_Block]:
    """The blocks, each along the axes.

    Raises:
        InputError: one is not, or its cells are not equal.
    """
    words, found = sheet.entries["blocks"], []
    starts = [k for k, word in enumerate(words) if word == "hex"]
    for number, (at, end) in enumerate(zip(starts, [*starts[1:], len(words)], strict=True)):
        corners = vertices[[int(word) for word in words[at + 1]]]
        rest = [word for word in words[at + 2 : end] if isinstance(word, list)]
        low, high = corners.min(axis=0), corners.max(axis=0)
        edges = corners[[1, 3, 4]] - corners[0]
        axes = np.abs(edges).argmax(axis=1)
        near = ALIKE * float((high - low).max())
        straight = sorted(axes.tolist()) == [0, 1, 2] and all(
            np.abs(np.delete(edge, axis)).max() <= near for edge, axis in zip(edges, axes, strict=True)
        )
        ends = (np.abs(corners - low) <= near) | (np.abs(corners - high) <= near)
        if not straight or not ends.all():
            limit = f"block {number} is no box along the axes; the mesh of a scene is a box of equal cells"
            raise unreadable(str(sheet.path), limit, REMEDY)
        if any(value != 1.0 for value in _flat(rest[1:])):
            limit = f"the cells of block {number} are graded; those of a scene are equal"
            raise unreadable(
                str(sheet.path), limit, "give simpleGrading (1 1 1), with more cells where they are needed"
            )
        cells = np.zeros(3, int)
        cells[axes] = [int(word) for word in rest[0]]
        found.append(_Block(low, high, cells))
    if not found:
        raise unreadable(str(sheet.path), "has no block (hex)", REMEDY)
    return found


def _flat(value: Any) -> list[float]:
    """All numbers of nested lists."""
    return [one for part in value for one in _flat(part)] if isinstance(value, list) else [float(value)]


def _cells(sheet: Sheet, blocks: list[_Block], lower: np.ndarray, upper: np.ndarray) -> list[int]:
    """Cells of the box along each axis.

    Raises:
        InputError: the blocks do not make a box, or their cells are not equal.
    """
    sizes = np.asarray([(block.upper - block.lower) / block.cells for block in blocks])
    size, near = sizes[0], ALIKE * sizes[0]
    if (np.abs(sizes - size) > near).any():
        widest = np.abs(sizes / size - 1.0).max(axis=1).argmax()
        limit = f"the cells of block 0 are {_row(size)} m, those of block {widest} {_row(sizes[widest])} m"
        raise unreadable(str(sheet.path), f"{limit}; those of a scene are equal", "change the numbers of cells")
    for first, second in itertools.combinations(blocks, 2):
        if (np.minimum(first.upper, second.upper) - np.maximum(first.lower, second.lower) > near).all():
            raise unreadable(str(sheet.path), "two of its blocks overlap", REMEDY)
    whole = math.prod((upper - lower).tolist())
    filled = sum(math.prod((block.upper - block.lower).tolist()) for block in blocks)
    if abs(filled / whole - 1.0) > ALIKE:
        limit = (
            f"its {len(blocks)} blocks fill {100 * filled / whole:.4g} % of the box round them; they must make a box"
        )
        raise unreadable(str(sheet.path), limit, REMEDY)
    return [int(round(value)) for value in ((upper - lower) / size).tolist()]


def _row(values: np.ndarray) -> str:
    return " x ".join(f"{value:.4g}" for value in values)


def _patches(
    sheet: Sheet, vertices: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> tuple[dict[str, str], dict[str, list[PatchFace]]]:
    """Type of each patch, and the rectangles on each side."""
    words = sheet.get("boundary")
    if words is not None:
        entries = iter(words)
        given = [
            (name, str(table.get("type", "patch")), table["faces"])
            for name, table in zip(entries, entries, strict=True)
        ]
    else:
        entries = iter(sheet.get("patches", []))
        given = [(name, kind, faces) for kind, name, faces in zip(entries, entries, entries, strict=True)]
    sides: dict[str, list[PatchFace]] = {}
    near = ALIKE * (upper - lower)
    for name, _, faces in given:
        for face in faces:
            corners = vertices[[int(number) for number in face]]
            low, high = corners.min(axis=0), corners.max(axis=0)
            for axis, end in itertools.product(range(3), (0, 1)):
                if (np.abs(corners[:, axis] - (lower, upper)[end][axis]) <= near[axis]).all():
                    part = PatchFace(name, tuple(np.delete(low, axis).tolist()), tuple(np.delete(high, axis).tolist()))
                    sides.setdefault(SIDES[3][axis][end], []).append(part)
                    break
            else:
                sheet.note(sheet.entries.lines.get("boundary", 1), f"{name}: a face within the mesh", LEFT,
                           "a wall within the box has no counterpart in the fluid")  # fmt: skip
    return {name: kind for name, kind, _ in given}, sides
