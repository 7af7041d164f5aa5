"""Still figure of the runs at the same few times: particles as discs of their true radius over the fluid's speed."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import ScaledTranslation

from jaxdem.report import drawing, pictures, style
from jaxdem.report import runs as read
from jaxdem.report.comparison import Comparison, Row
from jaxdem.report.runs import Array

FRACTIONS = (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0)
"""Times of the snapshots, as fractions of the span that is compared."""

COLOR = "velocity"

TALLEST = 6.0
"""Greatest height of a panel [inch]."""


def snapshot_times(times: Array) -> list[float]:
    """The few times at which the runs are shown [s]: the reference's outputs nearest to fractions of its span.

    Args:
        times: of the reference's outputs that are compared (T,) [s].
    """
    wanted = [times[0] + fraction * (times[-1] - times[0]) for fraction in FRACTIONS if len(times)]
    return sorted({float(times[int(np.argmin(np.abs(times - time)))]) for time in wanted})


def snapshots_figure(comparison: Comparison, path: Path) -> Path | None:
    """snapshots.png: every run at the same times, one scale of each colour; None where no run has a frame to show.

    A run that ended before a time has an empty panel there.
    """
    rows, times = comparison.rows, snapshot_times(comparison.reference.history["time"])
    boxes = [box for row in rows if (box := read.domain_size(row.run))]
    shots = [[pictures.take_nearest(row.run, time, times[-1]) for time in times] for row in rows]
    shown = [shot for line in shots for shot in line if shot]
    if not shown or not boxes:
        return None
    size = (max(box[0] for box in boxes), max(box[-1] for box in boxes))
    tops = pictures.common_tops(shots)
    with style.look():
        figure, panels, width = _panels(size, len(rows), len(times))
        for line, row, run_shots in zip(panels, rows, shots, strict=True):
            for axis, time, shot in zip(line, times, run_shots, strict=True):
                box = read.domain_size(row.run) or size
                drawing.draw(axis, shot, (box[0], box[-1]), size, tops, COLOR)
                _title(axis, row, shot.time if shot else time, width)
                if shot is None:
                    why = f"ended at t = {row.end_time:.3g} s" if time > row.end_time else "no frame at this time"
                    axis.text(0.5, 0.5, why, transform=axis.transAxes, ha="center", va="center", color=style.INVALID)
        drawing.add_legends(figure, figure.axes, shown, tops, COLOR, figure.get_figwidth() - 0.9)
        for axis in (axis for line in panels for axis in line):
            axis.set_anchor("NW")  # of a panel that is narrower than its title, which begins where it does
        views = {pictures.view(row.run, shot) for row, line in zip(rows, shots, strict=True) for shot in line if shot}
        if view := max(views, key=len):
            figure.supxlabel(view, fontsize=10)
        return style.save(figure, path, dpi=160)


def _panels(size: tuple[float, float], runs: int, times: int) -> tuple[Figure, list[list[Axes]], float]:
    """Figure, axes[run][time], and the width of one [inch].

    Long boxes: the runs stand above one another under each time, the times in two columns of such blocks. Tall boxes:
    a row for each run, the times side by side, no higher than `TALLEST`. Other boxes: a row for each time, the runs
    side by side.
    """
    ratio = size[0] / size[1]
    stacked, tall = ratio >= pictures.LONG_BOX, ratio <= pictures.TALL_BOX
    lines, columns = (runs * math.ceil(times / 2), 2) if stacked else (runs, times) if tall else (times, runs)
    width = 6.9 if stacked else 2.2 if tall else max(2.2, min(5.0 / columns**0.5, 4.5 * ratio))
    # A panel is at least as high as the label of its axis, and has its title above.
    height = min(max(width / ratio + 0.35, 0.85), TALLEST) + 0.1
    # Without the space beside narrow panels their titles would lie on each other.
    layout: Literal["constrained", "compressed"] = "constrained" if tall else "compressed"
    figure = style.new_figure(columns * (width + 0.2) + 0.9, lines * height + 2.3, layout=layout)
    axes = figure.subplots(lines, columns, squeeze=False, sharex=True, sharey=True)
    for axis in axes.flat:
        if tall:  # no room for more
            axis.set_xticks([size[0]])
        else:
            axis.locator_params(axis="x", nbins=max(2, int(1.3 * width)))
        axis.set_visible(False)
    for axis in axes[:, 0]:
        axis.set_ylabel("height [m]")
    for axis in axes[-1]:
        axis.set_xlabel("x [m]")

    def of(run: int, time: int) -> Axes:
        place = (time // 2 * runs + run, time % 2) if stacked else (run, time) if tall else (time, run)
        axis: Axes = axes[place]
        axis.set_visible(True)
        return axis

    return figure, [[of(run, time) for time in range(times)] for run in range(runs)], width


def _title(axis: Axes, row: Row, time: float, inches: float) -> None:
    """Run and time above a panel, with the run's colour as a square: some of the colours are too light for text."""
    above = axis.transAxes + ScaledTranslation(5.0 / 72.0, 10.5 / 72.0, axis.figure.dpi_scale_trans)
    square = Line2D([0.0], [1.0], color=row.look.color, marker="s", markersize=7, transform=above, clip_on=False)
    axis.add_artist(square).set_in_layout(False)
    before, after = "    ", f",  t = {time:.3g} s"
    name = style.escaped(row.label, inches - style.text_width(f".{before}{after}", 9.0), 9.0)
    axis.set_title(before + name + after, loc="left", fontsize=9, color="black" if row.ranked else style.INVALID)
