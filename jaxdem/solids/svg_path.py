"""Outlines in SVG files: the subset of SVG 1.1 that drawings of walls are made of. Host.

Paths with the commands M L H V C S Q T Z, absolute and relative; polylines, polygons, lines, rectangles and circles.
Curves become segments. What moves a whole group (`transform`) is refused: a drawing without it says where things are.

Source: W3C, Scalable Vector Graphics (SVG) 1.1, section 8.3 (https://www.w3.org/TR/SVG11/paths.html).
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree

import numpy as np

PIECES = 16
"""Segments of a curve."""

CIRCLE = 72
"""Segments of a circle."""

TOKEN = re.compile(r"[A-Za-z]|[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")

Outline = tuple[np.ndarray, bool]
"""Points (P, 2), and whether the last is joined to the first."""


def points_of_svg(text: str) -> list[Outline]:
    """The outlines of a drawing, y upwards.

    Raises:
        ValueError: it is no SVG, or has something that is not understood.
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        text = re.sub(r"<!DOCTYPE[^>\[]*>", "", text)
        if "<!" in text.replace("<!--", ""):
            raise ValueError("defines entities of its own")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ValueError(f"is no XML: {error}") from None
    if root.tag.rpartition("}")[2] != "svg":
        raise ValueError("is no SVG file")
    found: list[Outline] = []
    for node in root.iter():
        if node.get("transform"):
            raise ValueError("moves a part by transform; save it as plain SVG with transforms applied")
        found += _outlines(node)
    return [(points * (1.0, -1.0), closed) for points, closed in found]


def _outlines(node: ElementTree.Element) -> list[Outline]:
    kind = node.tag.rpartition("}")[2] if isinstance(node.tag, str) else ""

    def number(name: str) -> float:
        return float(re.sub(r"[a-z]+$", "", node.get(name, "0")))

    if kind == "path":
        return path_outlines(node.get("d", ""))
    if kind in ("polyline", "polygon"):
        values = [float(x) for x in re.split(r"[\s,]+", node.get("points", "").strip()) if x]
        return [(np.reshape(values, (-1, 2)), kind == "polygon")]
    if kind == "line":
        return [(np.array([[number("x1"), number("y1")], [number("x2"), number("y2")]]), False)]
    if kind == "rect":
        x, y, width, height = (number(name) for name in ("x", "y", "width", "height"))
        return [(np.array([[x, y], [x, y + height], [x + width, y + height], [x + width, y]]), True)]
    if kind == "circle":
        angle = -2.0 * np.pi * np.arange(CIRCLE) / CIRCLE
        ring = number("r") * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return [(ring + (number("cx"), number("cy")), True)]
    return []


def path_outlines(text: str) -> list[Outline]:
    """The outlines of the attribute `d` of a path, y downwards.

    Raises:
        ValueError: a command that is not understood, such as an arc.
    """
    tokens = TOKEN.findall(text)
    pen = _Pen()
    while tokens:
        command = tokens.pop(0)
        if command.upper() not in SIZES:
            raise ValueError(f"has the path command {command!r}; those that are read are {', '.join(SIZES)}")
        size, first = SIZES[command.upper()], True
        while first or (size and tokens and not tokens[0].isalpha()):
            given, tokens = tokens[:size], tokens[size:]
            if len(given) < size or any(token.isalpha() for token in given):
                raise ValueError(f"has too few numbers after the path command {command!r}")
            again = {"M": "L", "m": "l"}.get(command, command)
            pen.draw(command if first else again, np.array(list(map(float, given))))
            first = False
    return pen.finished()


SIZES = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "Z": 0}
"""Numbers that each command takes."""


class _Pen:
    """Where a path is drawn."""

    def __init__(self) -> None:
        self.at, self.handle = np.zeros(2), np.zeros(2)
        self.points: list[np.ndarray] = []
        self.done: list[Outline] = []

    def draw(self, command: str, given: np.ndarray) -> None:
        """One command with its numbers."""
        kind, origin = command.upper(), self.at if command.islower() else np.zeros(2)
        if kind == "Z":
            self._lift(closed=True)
            return
        if kind in "HV":
            target = self.at.copy()
            axis = 0 if kind == "H" else 1
            target[axis] = given[0] + origin[axis]
            places = target[None]
        else:
            places = given.reshape(-1, 2) + origin
        if kind == "M":
            self._lift(closed=False)
            self.points = [places[0]]
        elif kind in "LHV":
            self._start()
            self.points.append(places[0])
        else:
            self._curve(kind, places)
        if kind not in "CSQT":
            self.handle = places[-1]
        self.at = places[-1]

    def _start(self) -> None:
        if not self.points:
            self.points = [self.at]

    def _curve(self, kind: str, places: np.ndarray) -> None:
        self._start()
        if kind in "ST":  # the handle of the curve before, mirrored
            places = np.concatenate([[2.0 * self.at - self.handle], places])
        nodes = np.concatenate([[self.at], places])
        self.handle = nodes[-2]
        t = np.linspace(0.0, 1.0, PIECES + 1)[1:, None]
        while len(nodes) > 1:  # de Casteljau
            nodes = np.asarray([(1.0 - t) * a + t * b for a, b in zip(nodes, nodes[1:], strict=False)])
        self.points += list(nodes[0])

    def _lift(self, closed: bool) -> None:
        if len(self.points) > 1:
            points = np.array(self.points)
            if closed and np.array_equal(points[0], points[-1]):
                points = points[:-1]
            self.done.append((points, closed))
            self.at = self.points[0] if closed else self.at
        self.points = []

    def finished(self) -> list[Outline]:
        """All that was drawn."""
        self._lift(closed=False)
        return self.done
