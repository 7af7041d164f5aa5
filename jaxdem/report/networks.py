"""Figure of many networks: R2 on held-out rows by what was varied."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxdem.report import style

LOWEST = -0.1
"""R2 below is drawn at this value, so that one bad network does not squeeze all others."""


class Scores(NamedTuple):
    """A line of the figure.

    Attributes:
        label: what was varied.
        r2: by coarsening, a value for every seed.
        published: of the literature; NaN where there is none.
    """

    label: str
    r2: Mapping[str, Sequence[float]]
    published: float


def networks_figure(scores: Sequence[Scores], path: Path) -> Path:
    """A line for every architecture: R2 of each seed by coarsening, and the published figure where there is one."""
    coarsenings = list(dict.fromkeys(name for one in scores for name in one.r2))
    with style.look():
        figure = style.new_figure(8.0, 1.2 + 0.3 * len(scores))
        axis = figure.add_subplot()
        places = np.arange(len(scores))
        for number, coarsening in enumerate(coarsenings):
            pairs = [
                (max(value, LOWEST), place)
                for place, one in zip(places, scores, strict=True)
                for value in one.r2.get(coarsening, ())
                if math.isfinite(value)
            ]
            axis.plot(
                [value for value, _ in pairs],
                [place for _, place in pairs],
                color=style.COLOURS[number % len(style.COLOURS)],
                marker=style.MARKERS[number % len(style.MARKERS)][0],
                linestyle="none",
                alpha=0.8,
                label=f"inputs averaged {coarsening}x" if coarsening != "1" else "fine inputs",
            )
        given = [(one.published, place) for place, one in zip(places, scores, strict=True)]
        given = [pair for pair in given if math.isfinite(pair[0])]
        if given:
            axis.plot(*zip(*given, strict=True), "|k", markersize=14, label="published, fine inputs")
        axis.set_yticks(places, [style.escaped(one.label) for one in scores])
        axis.invert_yaxis()
        axis.set_xlim(LOWEST - 0.03, 1.03)
        axis.set_xlabel(f"R² on held-out rows [-] (below {LOWEST:g}: drawn there)")
        figure.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=3)
        return style.save(figure, path)
