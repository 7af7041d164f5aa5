"""Still figure of the runs at the same few times: particles as discs of their true radius over the fluid's speed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import ScaledTranslation

from jaxdem.report import pictures, style
from jaxdem.report import runs as read
from jaxdem.report.comparison import Comparison, Entry, Row
from jaxdem.report.figures import label
from jaxdem.report.pictures import Picture
from jaxdem.report.runs import Array
from jaxdem.report.style import RunStyle

FRACTIONS = (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0)
"""Times of the snapshots, as fractions of the span that is compared."""

MIN_PANEL, TITLE, GAP, LEFT = 2.2, 0.32, 0.6, 1.0
"""Least width of a panel, height of the line above it, room between panels, and left of them for the axis [inch]."""
LONG_BOX = 2.0
"""From this ratio of length to height on, runs stand above one another and the times in two columns."""


def snapshot_times(times: Array) -> list[float]:
    """The few times at which the runs are shown [s]: the reference's outputs nearest to fractions of its span.

    Args:
        times: of the reference's outputs that are compared (T,) [s].
    """
    if not len(times):
        return []
    wanted = [times[0] + fraction * (times[-1] - times[0]) for fraction in FRACTIONS]
    return sorted({float(times[int(np.argmin(np.abs(times - time)))]) for time in wanted})


def snapshots_figure(
    entries: Sequence[Entry], comparison: Comparison, styles: Mapping[str, RunStyle], path: Path
) -> Path | None:
    """snapshots.png: every run at the same times, one colour scale; None where no run has a frame to show.

    The scale's top is the largest speed of the reference at these times, so that a run that blew up does not
    whiten all others; larger speeds have the last colour. A run that ended before a time has an empty panel there.
    """
    times = snapshot_times(entries[0].history["time"])
    boxes = [box for entry in entries if (box := read.domain_size(entry.run))]
    if not times or not boxes:
        return None
    shots = [[_shot(entry, time, times[-1]) for time in times] for entry in entries]
    if not any(shot for line in shots for shot in line):
        return None
    size = (max(box[0] for box in boxes), max(box[-1] for box in boxes))
    scale = Normalize(0.0, _top(shots))
    rows = {row.name: row for row in comparison.rows}
    with style.look():
        figure, axes = _grid(size, len(entries), len(times))
        for line, entry, run_shots in zip(axes, entries, shots, strict=True):
            for axis, time, shot in zip(line, times, run_shots, strict=True):
                box = read.domain_size(entry.run) or size
                pictures.draw(axis, shot, (box[0], box[-1]), size, scale)
                _title(
                    axis,
                    rows[entry.name],
                    shot.time if shot else time,
                    styles[entry.name].color,
                    shot is None,
                )
        if any(shot and shot.speed is not None for line in shots for shot in line):
            text = "fluid speed [m/s]" + (", mean over the depth" if any(len(box) == 3 for box in boxes) else "")
            bar = figure.add_axes((0.25, 0.5 / figure.get_figheight(), 0.5, 0.14 / figure.get_figheight()))
            figure.colorbar(
                ScalarMappable(scale, pictures.WATER),
                cax=bar,
                label=text,
                extend="max",
                orientation="horizontal",
            )
        elif three := [entry.run for entry in entries if entry.run.dimension == 3]:
            seen = next(pictures.view(three[0], shot) for line in shots for shot in line if shot)
            figure.text(0.5, 0.3 / figure.get_figheight(), seen, ha="center")
        if handles := pictures.opening_handles([shot for line in shots for shot in line]):
            figure.legend(handles=handles, loc="lower right", bbox_to_anchor=(1.0, 0.0))
        return style.save(figure, path, dpi=160)


def _shot(entry: Entry, time: float, until: float) -> Picture | None:
    index = pictures.nearest(entry.run, time, until)
    return None if index is None else pictures.take(entry.run, index)


def _title(axis: Axes, row: Row, time: float, colour: str, missing: bool) -> None:
    """Run and time above a panel, with the run's colour as a square: some of the colours are too light for text."""
    figure = axis.get_figure(root=True)
    assert figure is not None
    above = axis.transAxes + ScaledTranslation(5.0 / 72.0, 10.5 / 72.0, figure.dpi_scale_trans)
    axis.add_artist(Line2D([0.0], [1.0], color=colour, marker="s", markersize=7, transform=above, clip_on=False))
    inches = axis.get_position().width * figure.get_figwidth()
    before, after = "    ", f",  t = {time:.3g} s"
    name = style.escaped(label(row), inches - style.text_width(f".{before}{after}", 9.0), 9.0)
    colour = "black" if row.ranked else style.INVALID
    axis.set_title(before + name + after, loc="left", fontsize=9, color=colour)
    if missing:
        why = f"ended at t = {row.end_time:.3g} s" if time > row.end_time else "no frame at this time"
        axis.text(0.5, 0.5, why, transform=axis.transAxes, ha="center", va="center", color=style.INVALID)


def _top(shots: Sequence[Sequence[Picture | None]]) -> float:
    """Top of the colour scale [m/s]: the reference's largest speed at the shown times, else the largest of all."""
    for lines in (shots[:1], shots):
        speeds = [shot.speed for line in lines for shot in line if shot and shot.speed is not None]
        tops = [float(np.nanmax(speed)) for speed in speeds if np.isfinite(speed).any()]
        finite = [top for top in tops if 0.0 < top < math.inf]
        if finite:
            return max(finite)
    return 1.0


def _grid(size: tuple[float, float], runs: int, times: int) -> tuple[Figure, list[list[Axes]]]:
    """(figure, axes[run][time]), placed by hand: every panel has the box's own shape, whatever the number of runs.

    Long boxes: the runs stand above one another under each time, the times in two columns of such blocks. Other
    boxes: a row for each time, the runs side by side.
    """
    ratio = size[0] / size[1]
    stacked = ratio >= LONG_BOX
    lines, columns, blocks = (runs, 2, math.ceil(times / 2)) if stacked else (1, runs, times)
    wide = 6.9 if stacked else max(MIN_PANEL, min(5.0 / columns**0.5, 4.5 * ratio))
    # At least as high as the label of its axis.
    line = max(wide / ratio + TITLE, 0.85)
    block = lines * line + 0.5
    width, height = LEFT + columns * (wide + GAP), blocks * block + 0.8
    figure = style.new_figure(width, height, layout=None)

    def place(run: int, time: int) -> Axes:
        row, column, group = (run, time % 2, time // 2) if stacked else (0, run, time)
        bottom = height - group * block - row * line - TITLE - wide / ratio
        left = LEFT + column * (wide + GAP)
        rectangle = (left / width, bottom / height, wide / width, wide / ratio / height)
        axis: Axes = figure.add_axes(rectangle)
        lowest = row == lines - 1
        axis.locator_params(axis="x", nbins=max(2, int(1.3 * wide)))
        axis.tick_params(labelleft=column == 0, labelbottom=lowest)
        axis.set_ylabel("height [m]" if column == 0 else "")
        axis.set_xlabel("x [m]" if lowest else "")
        return axis

    return figure, [[place(run, time) for time in range(times)] for run in range(runs)]
