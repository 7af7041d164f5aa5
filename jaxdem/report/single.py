"""Pictures of one run: its metrics over time, and particles and fluid at one time.

Example:
    >>> plot_run(load_run("runs/settling"), Path("runs/settling/plots"), time=0.2)  # doctest: +SKIP
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure, SubFigure

from jaxdem.errors import InputError
from jaxdem.metrics import METRICS, Metric
from jaxdem.report import figures, pictures, style
from jaxdem.report import runs as read
from jaxdem.report.comparison import NAN, Entry, make_row
from jaxdem.report.pictures import Picture, Scales
from jaxdem.report.runs import RunLike

FORMATS = (".png", ".pdf", ".svg")
"""Endings of a single file with both pictures."""

LONG_SIDE, SHORTEST = 8.0, 5.2
"""Longer side of the picture of a frame and least width of its figure [inch]."""
LEFT, RIGHT, TOP, BOTTOM = 1.0, 0.4, 0.65, 1.15
"""Room around it [inch]: axes with numbers of up to seven characters, title, colour bars."""


def plot_run(run: RunLike, out: Path, *, time: float | None = None, color: str = "velocity") -> list[Path]:
    """Draw the metrics of a run over time, and its particles over the fluid's speed at one time.

    Args:
        run: as `jaxdem.load_run` gives it, finished or not.
        out: a file (.png, .pdf, .svg) for both in one picture, else a folder for metrics.png and snapshot.png.
        time: of the snapshot [s], the nearest output is taken; the last one if None.
        color: of the particles, "velocity" or "drag".

    Returns:
        The files written.

    Raises:
        InputError: no output yet, a time outside the run, a colour or ending that is not known.
    """
    pictures.require(run, color)
    single = is_file(out)
    picture = pictures.take(run, frame_at(run, time))
    with style.look():
        size = frame_size(run)
        metrics = _recorded(run)
        height = 2.9 * math.ceil(len(metrics) / 3) + 0.3
        if single:
            out.parent.mkdir(parents=True, exist_ok=True)
            figure = style.new_figure(max(size[0], 12.5), size[1] + height)
            upper, lower = figure.subfigures(2, 1, squeeze=False, height_ratios=[size[1], height]).flat
            _snapshot(upper, (figure.get_figwidth(), size[1]), run, picture, color)
            _metrics(lower, run, metrics, picture.time)
            return [style.save(figure, out)]
        out.mkdir(parents=True, exist_ok=True)
        still = style.new_figure(*size, layout=None)
        _snapshot(still, size, run, picture, color)
        lines = style.new_figure(min(4.2 * len(metrics), 12.5), height)
        _metrics(lines, run, metrics, picture.time)
        return [style.save(lines, out / "metrics.png"), style.save(still, out / "snapshot.png")]


def is_file(out: Path) -> bool:
    """Whether `out` names one picture, not a folder.

    Raises:
        InputError: it has another ending than `FORMATS`.
    """
    if out.is_dir() or not out.suffix:
        return False
    if out.suffix.lower() not in FORMATS:
        limit = f"a file must end in {', '.join(FORMATS)}"
        raise InputError("--out", str(out), limit, "Name such a file, or a folder.")
    return True


def frame_at(run: RunLike, time: float | None) -> int:
    """Number of the output nearest to a time [s], the last one for None.

    Raises:
        InputError: the time is not within the run, to half an output interval.
    """
    if time is None:
        return run.number_of_frames - 1
    index = pictures.nearest(run, time, float(run.times[-1])) if math.isfinite(time) else None
    if index is None:
        limit = f"outputs of {run.path} are from {run.times[0]:.6g} to {run.times[-1]:.6g} s"
        raise InputError("--time", time, limit, "Give a time between these.")
    return index


def _recorded(run: RunLike) -> list[Metric]:
    """The metrics that the run has: those of the fluid or of the particles may be missing, the pressure of a closed box is."""
    history = read.history_until(run, None)
    return [metric for metric in METRICS if metric.name in history and np.isfinite(history[metric.name]).any()]


def _metrics(figure: Figure | SubFigure, run: RunLike, metrics: Sequence[Metric], time: float) -> None:
    """The panels, with the time of the snapshot marked."""
    entry = Entry(name_of(run), "reference", run, read.history_until(run, None))
    row = make_row(entry, entry, NAN, None)
    axes = figures.metrics_panels(
        figure, metrics, [entry], {entry.name: row}, {entry.name: style.styles(["", entry.name])[entry.name]}
    )
    for axis in axes:
        axis.axvline(time, color=style.NOISE, linewidth=1.0, linestyle=":", zorder=1)
    if row.status != "valid":
        status = style.escaped(f"{entry.name}: {row.status}", math.inf)
        figure.suptitle(status, color=style.INVALID, fontsize=10, wrap=True)


def _snapshot(
    figure: Figure | SubFigure, size: tuple[float, float], run: RunLike, picture: Picture, color: str
) -> None:
    scales = Scales.of([picture], color)
    axis = frame_axes(figure, size, run, scales, color)
    draw_frame(axis, run, picture, scales, color)
    name_openings(figure, size, picture)


def name_openings(figure: Figure | SubFigure, size: tuple[float, float], picture: Picture) -> None:
    """What the coloured edges are, on the line of the label of the x axis; `size` of the figure [inch]."""
    if handles := pictures.opening_handles([picture]):
        right = 0.5 * (size[0] + min(size[0], LONG_SIDE + LEFT + RIGHT)) - 0.1
        place = (right / size[0], (BOTTOM - 0.35) / size[1])
        figure.legend(handles=handles, loc="center right", bbox_to_anchor=place, ncols=2, borderpad=0.0)


def name_of(run: RunLike) -> str:
    """Name of the run's folder."""
    return Path(run.path).resolve().name or "run"


def _box(run: RunLike) -> tuple[float, float]:
    """Length and height of the domain [m]."""
    box = read.domain_size(run)
    if box is None:
        raise InputError("RUN", str(run.path), "its scene has no domain.size", "Give a run directory.")
    return box[0], box[-1]


def frame_size(run: RunLike) -> tuple[float, float]:
    """Width and height of the figure of one frame [inch]."""
    length, height = _box(run)
    scale = LONG_SIDE / max(length, height)
    width = max(scale * length + LEFT + RIGHT, SHORTEST)
    return width, scale * height + TOP + BOTTOM


def frame_axes(figure: Figure | SubFigure, size: tuple[float, float], run: RunLike, scales: Scales, color: str) -> Axes:
    """Axes in the box's own shape with the colour bars below; `size` of the figure [inch]."""
    length, height = _box(run)
    width, tall = size
    scale = LONG_SIDE / max(length, height)
    left = LEFT + 0.5 * (width - LEFT - RIGHT - scale * length)
    axis = figure.add_axes((left / width, BOTTOM / tall, scale * length / width, scale * height / tall))
    axis.set(xlabel="x [m]", ylabel="height [m]")
    axis.locator_params(axis="x", nbins=max(2, int(1.3 * scale * length)))
    quantity = pictures.QUANTITIES[color]
    bars = [
        (norm, colours, text)
        for norm, colours, text in (
            (scales.water, pictures.WATER, "fluid speed [m/s]"),
            (scales.grains, pictures.GRAINS, f"{quantity.label} [{quantity.unit}]"),
        )
        if norm is not None
    ]
    room = (min(width, LONG_SIDE + LEFT + RIGHT) - LEFT - RIGHT) / max(len(bars), 1)
    start = 0.5 * (width - room * len(bars))
    for number, (norm, colours, text) in enumerate(bars):
        place = ((start + (number + 0.1) * room) / width, 0.47 / tall, 0.8 * room / width, 0.12 / tall)
        mappable = ScalarMappable(norm, colours)
        bar = figure.colorbar(mappable, cax=figure.add_axes(place), orientation="horizontal", extend="max")
        bar.set_label(text, labelpad=1)
    return axis


def draw_frame(axis: Axes, run: RunLike, picture: Picture, scales: Scales, color: str) -> None:
    """A frame onto its axes, with run, time and view above."""
    box = _box(run)
    grains = None if scales.grains is None else (color, scales.grains)
    pictures.draw(axis, picture, box, box, scales.water, grains)
    seen = pictures.view(run, picture)
    when = f",  t = {picture.time:.4g} s"
    name = style.escaped(name_of(run), frame_size(run)[0] - (LEFT - RIGHT) - style.text_width(when) - 0.4)
    axis.set_title(name + when + (f"\n{seen}" if seen else ""), fontsize=10)
