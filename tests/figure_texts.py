"""Reads every text of a figure as drawn: no raw markup, inside the canvas, none over another or over other axes."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from unittest import mock

from matplotlib import cbook
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

MARKUP = re.compile(r"\\mathdefault|\\times|\^\{|\$")
SLACK = 2.0
"""Boxes of texts are a little higher than their ink [px at 100 dpi]; a text counts as inside the canvas to 1 px."""


def drawn_texts(figure: Figure) -> list[tuple[Text, Bbox]]:
    """The texts that drawing the figure draws, with their boxes in pixels; without tick labels that are not drawn."""
    drawn: dict[int, Text] = {}
    draw = Text.draw

    def record(text: Text, renderer: object) -> None:
        if text.get_visible() and text.get_text().strip():
            drawn[id(text)] = text
        draw(text, renderer)

    # Twice: the first time a layout still moves what it draws.
    figure.draw_without_rendering()
    with mock.patch.object(Text, "draw", record):
        figure.draw_without_rendering()
    return [(text, text.get_window_extent()) for text in drawn.values()]


def as_shown(text: Text) -> str:
    """What a reader sees; math text has no markup then and counts as empty here."""
    string = text.get_text()
    if not text.get_parse_math():
        return string
    return "" if cbook.is_math_text(string) else string.replace(r"\$", "$")


def faults(figure: Figure, names: Sequence[str] = ()) -> list[str]:
    """What is wrong with the texts of a figure, in words; empty where nothing is.

    Args:
        figure: with a canvas.
        names: of runs and files, which may look like markup.
    """
    texts, found = drawn_texts(figure), []
    for text, box in texts:
        shown = as_shown(text)
        for name in names:
            shown = shown.replace(name, "")
        if MARKUP.search(shown):
            found.append(f"raw markup: {shown!r}")
        canvas = figure.bbox
        if min(box.x0, box.y0) < -1.0 or box.x1 > canvas.width + 1.0 or box.y1 > canvas.height + 1.0:
            found.append(f"outside the canvas: {text.get_text()!r}")
    for (one, first), (other, second) in itertools.combinations(texts, 2):
        if _overlap(first, second):
            found.append(f"{one.get_text()!r} over {other.get_text()!r}")
    axes = [axis for axis in figure.findobj(Axes) if axis.axison and axis.get_visible()]
    for text, box in texts:
        if any(text.axes is not axis and _overlap(box, axis.bbox) for axis in axes):
            found.append(f"{text.get_text()!r} over other axes")
    return found


@contextmanager
def watched(names: Sequence[str]) -> Iterator[list[str]]:
    """Reads every figure that is saved meanwhile, films' frames too; the list that it gives has all that is wrong."""
    found: list[str] = []
    save = Figure.savefig

    def read_and_save(figure: Figure, *given: object, **options: object) -> None:
        found.extend(faults(figure, names))
        save(figure, *given, **options)

    with mock.patch.object(Figure, "savefig", read_and_save):
        yield found


def _overlap(one: Bbox, other: Bbox) -> bool:
    width = min(one.x1, other.x1) - max(one.x0, other.x0)
    height = min(one.y1, other.y1) - max(one.y0, other.y0)
    return bool(width > 0.0 and height > SLACK)
