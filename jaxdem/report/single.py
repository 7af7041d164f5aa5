"""Pictures of one run: its metrics over time, and particles and fluid at one time.

Example:
    >>> plot_run(load_run("runs/settling"), Path("runs/settling/plots"), time=0.2)  # doctest: +SKIP
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

from matplotlib.figure import Figure, SubFigure

from jaxdem.errors import InputError
from jaxdem.io import Run
from jaxdem.report import chart, drawing, pictures, style
from jaxdem.report import runs as read
from jaxdem.report.comparison import folder_name, row_of_one
from jaxdem.report.figures import left_out, metrics_panels
from jaxdem.report.force_lines import force_lines
from jaxdem.report.pictures import Picture, Tops
from jaxdem.report.probes import probe_panels

FORMATS = (".png", ".pdf", ".svg")
"""Endings of a single file with both pictures."""

LONG_SIDE, SHORTEST = 8.0, 5.2
"""Longer side of the picture of a frame and least width of its figure [inch]."""


def plot_run(
    run: Run, out: Path, *, time: float | None = None, color: str = "velocity", forces: bool = False
) -> list[Path]:
    """Draw the metrics of a run over time, its particles over the fluid's speed at one time, and its probes if any.

    Args:
        run: as `jaxdem.load_run` gives it, finished or not.
        out: a file (.png, .pdf, .svg) for both in one picture, else a folder for metrics.png,
            snapshot.png and, of a run with probes, probes.png.
        time: of the snapshot [s], the nearest output is taken; the last one if None.
        color: of the particles, "velocity" or "drag".
        forces: in contacts, as lines in the snapshot; of a run with a probe of kind "contacts".

    Returns:
        The files written.

    Raises:
        InputError: no output yet, a time outside the run, a colour or ending that is not known, or no list of contacts
            to draw.
    """
    pictures.require(run, color)
    single, index = is_file(out), frame_at(run, time)
    picture = pictures.take(run, index)
    if forces:
        picture = dataclasses.replace(picture, forces=force_lines(run, index))
    panels, probes = metrics_panels([row_of_one(run)]), probe_panels([row_of_one(run)])
    (out.parent if single else out).mkdir(parents=True, exist_ok=True)
    with style.look():
        width, tall = frame_size(run)
        if single:
            panels = [*panels, *probes]
            height = _size(panels)[1]
            figure = style.new_figure(max(width, 12.5), tall + height)
            upper, lower = figure.subfigures(2, 1, squeeze=False, height_ratios=[tall, height]).flat
            _snapshot(upper, run, picture, color)
            _metrics(lower, run, panels, picture.time, left_out([row_of_one(run)]))
            return [style.save(figure, out)]
        still, lines = style.new_figure(width, tall), style.new_figure(*_size(panels))
        _snapshot(still, run, picture, color)
        _metrics(lines, run, panels, picture.time, left_out([row_of_one(run)]))
        files = [style.save(lines, out / "metrics.png"), style.save(still, out / "snapshot.png")]
        if probes:
            measured = style.new_figure(*_size(probes))
            _metrics(measured, run, probes, picture.time)
            files.append(style.save(measured, out / "probes.png"))
        return files


def _size(panels: list[chart.Panel]) -> tuple[float, float]:
    """Width and height of a figure of panels [inch]."""
    return min(4.2 * len(panels), 12.5), 2.9 * math.ceil(len(panels) / chart.COLUMNS) + 0.3


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


def frame_at(run: Run, time: float | None) -> int:
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


def _metrics(figure: Figure | SubFigure, run: Run, panels: list[chart.Panel], time: float, note: str = "") -> None:
    """The panels, with the time of the snapshot marked, and a note above."""
    for axis, panel in zip(chart.draw_panels(figure, panels), panels, strict=True):
        if panel.x_label == "time [s]":
            axis.axvline(time, color=style.NOISE, linewidth=1.0, linestyle=":", zorder=1)
    row = row_of_one(run)
    figure.suptitle(note, fontsize=9, color="#666666", wrap=True)
    if row.status != "valid":
        status = style.escaped(f"{row.name}: {row.status}", math.inf)
        figure.suptitle(status, color=style.INVALID, fontsize=10, wrap=True)


def _snapshot(figure: Figure | SubFigure, run: Run, picture: Picture, color: str) -> None:
    Frame(figure, run, pictures.scale_tops([picture]), color, picture).draw(picture)


def _box(run: Run) -> tuple[float, float]:
    """Length and height of the domain [m]."""
    box = read.domain_size(run)
    if box is None:
        raise InputError("RUN", str(run.path), "its scene has no domain.size", "Give a run directory.")
    return box[0], box[-1]


def frame_size(run: Run) -> tuple[float, float]:
    """Width and height of the figure of one frame [inch]: the box, and room for title, axes and keys."""
    length, height = _box(run)
    scale = LONG_SIDE / max(length, height)
    bars = sum(bool(run.scene.get(table)) for table in ("fluid", "particles"))
    return max(scale * length + 1.2, SHORTEST), scale * height + (2.7 if bars == 2 else 2.1)


class Frame:
    """Axes in the box's own shape with the colour bars below, for one frame after another."""

    def __init__(self, figure: Figure | SubFigure, run: Run, tops: Tops, color: str, first: Picture) -> None:
        self.run, self.tops, self.color, self.box = run, tops, color, _box(run)
        self.axis = figure.subplots()
        self.axis.set(xlabel="x [m]", ylabel="height [m]")
        inches = LONG_SIDE * self.box[0] / max(self.box)
        self.axis.locator_params(axis="x", nbins=max(2, int(1.3 * inches)))
        drawing.add_legends(figure, [self.axis], [first], tops, color, inches)

    def draw(self, picture: Picture) -> None:
        """A frame, with run, time and view above."""
        drawing.draw(self.axis, picture, self.box, self.box, self.tops, self.color)
        view, when = pictures.view(self.run, picture), f",  t = {picture.time:.4g} s"
        name = style.escaped(folder_name(self.run), frame_size(self.run)[0] - style.text_width(when) - 1.0)
        self.axis.set_title(name + when + (f"\n{view}" if view else ""), fontsize=10)
