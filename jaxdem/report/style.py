"""One look for all figures: a colour per run that a colour-blind reader can tell, the reference black."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, NamedTuple, cast

from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from jaxdem.io.durable import write_bytes

# Okabe and Ito (2008), without black (the reference) and yellow (too light on white).
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
REFERENCE, NOISE, INVALID = "#000000", "#9A9A9A", "#B00020"
# After one round of colours the dash and the marker change, so that no two runs look alike up to 24.
DASHES = (("-", "solid"), ((0, (5, 2)), "dash"), ((0, (5, 1.5, 1, 1.5)), "dashdot"), ((0, (1, 1.2)), "dot"))
MARKERS = (("o", "circle"), ("s", "square"), ("^", "triangle-up"), ("D", "diamond"))

RC: dict[str, Any] = {
    "font.size": 10,
    # Names of runs are text, whatever is in them.
    "text.parse_math": False,
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


class RunStyle(NamedTuple):
    """How one run is drawn, in matplotlib's and in plotly's words."""

    color: str
    dash: Any
    plotly_dash: str
    marker: str
    plotly_marker: str
    width: float


def styles(names: Sequence[str]) -> dict[str, RunStyle]:
    """Style by name; the first name is the reference."""
    result = {names[0]: RunStyle(REFERENCE, "-", "solid", "*", "star", 2.4)}
    for i, name in enumerate(names[1:]):
        turn = i // len(COLOURS) % len(DASHES)
        (dash, plotly_dash), (marker, plotly_marker) = DASHES[turn], MARKERS[turn]
        result[name] = RunStyle(COLOURS[i % len(COLOURS)], dash, plotly_dash, marker, plotly_marker, 1.6)
    return result


def new_figure(width: float, height: float, layout: Literal["constrained"] | None = "constrained") -> Figure:
    """A figure of that many inches that touches no global state of matplotlib's; draw it inside `look()`."""
    figure = Figure(figsize=(width, height), layout=layout)
    FigureCanvasAgg(figure)
    return figure


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
