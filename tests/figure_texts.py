"""Reads every text of a figure as drawn: no raw markup, inside the canvas, none over another or over other axes."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from unittest import mock

from matplotlib import cbook
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

MARKUP = re.compile(r"\\mathdefault|\\times|\^\{|\$")
USUAL_DPI = 100.0
SLACK, MARGIN = 2.0, 1.0
"""Boxes of texts are a little higher than their ink; a text counts as inside the canvas to a pixel [px at 100 dpi]."""


@dataclass
class Drawing:
    """What the last drawing of a figure draws of texts, without tick labels that are not drawn.

    Attributes:
        texts: by identity.
        dpi: of the drawing: where some of the texts are is kept in its pixels.
    """

    texts: dict[int, Text] = field(default_factory=dict)
    dpi: float = USUAL_DPI


@contextmanager
def recorded() -> Iterator[Drawing]:
    """Records the figure that is drawn meanwhile."""
    drawing = Drawing()
    draw, draw_all = Text.draw, Figure.draw

    def record(text: Text, renderer: object) -> None:
        if text.get_visible() and text.get_text().strip():
            drawing.texts[id(text)] = text
        draw(text, renderer)

    def anew(figure: Figure, renderer: object) -> None:
        # A figure is drawn several times: the first time a layout still moves what it draws.
        drawing.texts.clear()
        drawing.dpi = figure.dpi
        draw_all(figure, renderer)

    with mock.patch.object(Text, "draw", record), mock.patch.object(Figure, "draw", anew):
        yield drawing


def drawn(figure: Figure) -> Drawing:
    """A drawing of the figure, which is not saved."""
    with recorded() as drawing:
        figure.draw_without_rendering()
        figure.draw_without_rendering()
    return drawing


def as_shown(text: Text) -> str:
    """What a reader sees; math text has no markup then and counts as empty here."""
    string = text.get_text()
    if not text.get_parse_math():
        return string
    return "" if cbook.is_math_text(string) else string.replace(r"\$", "$")


def faults(figure: Figure, drawing: Drawing | None = None, names: Sequence[str] = ()) -> list[str]:
    """What is wrong with the texts of a figure, in words; empty where nothing is.

    Args:
        figure: with a canvas.
        drawing: of this figure; it is drawn if not given.
        names: of runs and files, which may look like markup.
    """
    drawing = drawn(figure) if drawing is None else drawing
    before, figure.dpi = figure.dpi, drawing.dpi
    try:
        return _faults(figure, list(drawing.texts.values()), names, drawing.dpi / USUAL_DPI)
    finally:
        figure.dpi = before


def _faults(figure: Figure, drawn: Sequence[Text], names: Sequence[str], scale: float) -> list[str]:
    """Of these texts, whose pixels are so many times as small as usual."""
    texts, found, margin = [(text, text.get_window_extent()) for text in drawn], [], scale * MARGIN
    for text, box in texts:
        shown = as_shown(text)
        for name in names:
            shown = shown.replace(name, "")
        if MARKUP.search(shown):
            found.append(f"raw markup: {shown!r}")
        canvas = figure.bbox
        if min(box.x0, box.y0) < -margin or box.x1 > canvas.width + margin or box.y1 > canvas.height + margin:
            found.append(f"outside the canvas: {text.get_text()!r}")
    for (one, first), (other, second) in itertools.combinations(texts, 2):
        if _overlap(first, second, scale * SLACK):
            found.append(f"{one.get_text()!r} over {other.get_text()!r}")
    axes = [axis for axis in figure.findobj(Axes) if axis.axison and axis.get_visible()]
    for text, box in texts:
        if any(text.axes is not axis and _overlap(box, axis.bbox, scale * SLACK) for axis in axes):
            found.append(f"{text.get_text()!r} over other axes")
    return found


@contextmanager
def watched(names: Sequence[str]) -> Iterator[list[str]]:
    """Reads every figure that is saved meanwhile, films' frames too; the list that it gives has all that is wrong."""
    found: list[str] = []
    save = Figure.savefig

    def read_and_save(figure: Figure, *given: object, **options: object) -> None:
        with recorded() as drawing:
            save(figure, *given, **options)
        found.extend(faults(figure, drawing, names))

    with mock.patch.object(Figure, "savefig", read_and_save):
        yield found


def _overlap(one: Bbox, other: Bbox, slack: float) -> bool:
    width = min(one.x1, other.x1) - max(one.x0, other.x0)
    height = min(one.y1, other.y1) - max(one.y0, other.y0)
    return bool(width > 0.0 and height > slack)
