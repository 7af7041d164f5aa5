"""One look for all figures: a colour per run that a colour-blind reader can tell, the reference black."""

from __future__ import annotations

import functools
import io
import itertools
import math
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, NamedTuple, cast

from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath

from jaxdem.files.durable import write_bytes

# Okabe and Ito (2008), without black (the reference) and yellow (too light on white).
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
REFERENCE, NOISE, INVALID = "#000000", "#9A9A9A", "#B00020"
# Names of plotly's -> what matplotlib has for them.
DASHES: dict[str, str | tuple[float, tuple[float, ...]]] = {
    "solid": "-",
    "dash": (0, (5, 2)),
    "dashdot": (0, (5, 1.5, 1, 1.5)),
    "dot": (0, (1, 1.2)),
}
MARKERS = {"circle": "o", "square": "s", "triangle-up": "^", "diamond": "D", "star": "*", "x": "X"}
# After one round of colours the dash and the marker change, so that no two runs look alike up to 24.
RUN_DASHES, RUN_MARKERS = tuple(DASHES), ("circle", "square", "triangle-up", "diamond")

RC: dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 10,
    # Matplotlib writes its own numbers as mathematics; names are made safe by `escaped`.
    "text.parse_math": True,
    "text.usetex": False,
    # Glyphs at whole pixels make a line up to 9% wider than `text_width` says, by the resolution.
    "text.hinting": "none",
    "axes.titlesize": 10,
    "axes.labelsize": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#E3E3E3",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "legend.fontsize": 10,
    "savefig.facecolor": "white",
}

MAX_PIXELS = 8000
"""Longest side of a PNG; the resolution falls where a figure of many runs would be larger."""

SHORTEST_NAME = 4
"""Characters that are kept of a name wherever it stands."""
NAME_ROOM = 3.4
"""Most that a name takes of a legend's width [inch]."""
LEGEND_LINE, LEGEND_HANDLE = 0.22, 0.65
"""Height of a line of a legend, and what an entry has beside its text [inch]."""


class RunStyle(NamedTuple):
    """How one run is drawn: a colour, a key of `DASHES` and one of `MARKERS`, and the width of its line [pt]."""

    color: str
    dash: str
    marker: str
    width: float


def styles(number: int) -> list[RunStyle]:
    """Styles of a reference and its runs, so many in all."""
    looks = itertools.product(zip(RUN_DASHES, RUN_MARKERS, strict=True), COLOURS)
    runs = [RunStyle(color, dash, marker, 1.6) for (dash, marker), color in looks]
    return [RunStyle(REFERENCE, "solid", "star", 2.4), *itertools.islice(itertools.cycle(runs), number - 1)]


def new_figure(width: float, height: float, layout: Literal["constrained", "compressed"] = "constrained") -> Figure:
    """A figure of that many inches that touches no global state of matplotlib's; draw it inside `look()`."""
    figure = Figure(figsize=(width, height), layout=layout)
    FigureCanvasAgg(figure)
    return figure


def escaped(name: str, inches: float = NAME_ROOM, size: float = 10.0) -> str:
    """A name of the user's as text for matplotlib, which would read mathematics between dollars.

    Control characters are spelled out, and the middle of a name that is too long gives way to an ellipsis.

    Args:
        name: of a run or file, or anything that may hold one.
        inches: room for it.
        size: of the font [pt].
    """
    shown = "".join(c if c.isprintable() else c.encode("unicode_escape", "replace").decode() for c in name)
    kept = len(shown)
    while (width := text_width(safe := _shortened(shown, kept), size)) > inches and kept > SHORTEST_NAME:
        kept = max(SHORTEST_NAME, min(kept - 1, int(kept * inches / width)))
    # Labels that begin with an underscore are left out of legends.
    return ("\u200b" if shown.startswith("_") else "") + safe


def _shortened(text: str, kept: int) -> str:
    head, tail = text[: kept - kept // 2], text[len(text) - kept // 2 :]
    return (text if kept >= len(text) else f"{head}\u2026{tail}").replace("$", r"\$")


@functools.lru_cache(maxsize=1024)
def text_width(text: str, size: float = 10.0) -> float:
    """Width of a line of text in the report's font [inch]."""
    if not text.strip():
        return 0.0
    font = FontProperties(family=RC["font.family"], size=size)
    return float(TextPath((0.0, 0.0), text, prop=font).get_extents().x1) / 72.0


def legend_columns(labels: Collection[str], width: float, most: int = 4) -> int:
    """Number of columns in which a legend of these escaped labels fits a width [inch]."""
    widest = max(map(text_width, labels), default=0.0) + LEGEND_HANDLE
    return max(1, min(most, len(labels), math.floor(width / widest)))


@contextmanager
def look() -> Iterator[None]:
    """Context in which figures have the report's fonts and lines, whatever the user's matplotlibrc says."""
    with rc_context(cast(Any, RC)):
        yield


def save(figure: Figure, path: Path, dpi: int = 150) -> Path:
    """Write a picture, of the kind that the ending names, whole or not at all, and return its path."""
    longest, content = max(figure.get_size_inches()), io.BytesIO()
    figure.savefig(content, format=path.suffix[1:], dpi=min(dpi, MAX_PIXELS / longest))
    write_bytes(path, content.getvalue())
    return path
