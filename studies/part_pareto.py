"""Error against run time: what mesh, closure, precision, stiffness and time steps buy."""

from __future__ import annotations

import math
import string
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter
from matplotlib.transforms import Bbox

from jaxdem import metrics
from jaxdem.io import Run
from jaxdem.report import style
from studies.evidence import Evidence
from studies.measure import NAMES, PERCENT, labelled, mean, mean_over, noise_floor, over
from studies.specs import RunSpec
from studies.tables import Cell, Section, Table

LETTERS = string.ascii_letters
"""Of the runs on a front; what is beyond has a point alone."""
OFFSET = (-4.0, -4.0)
"""Of a letter from its point [pt]."""

SCENES = {"the injection scene": "", "the dilute jet": "dilute_"}
"""By what stands before the names of their runs."""


def pareto_part(evidence: Evidence) -> Section:
    """A table and a figure of all runs of each scene."""
    section = Section("pareto", "Error against run time")
    section.text.append(
        f"Run times are those of the runs themselves, without compiling. {evidence.sharing} Training is not in them "
        "and stands beside. In the figures orange points are runs with a closure, hollow ones have its training added "
        "as if for one run as long as the fine one, the grey line is the noise and the black one the fine run's time."
    )
    for words, prefix in SCENES.items():
        table, points = _table(evidence, words, prefix)
        section.tables.append(table)
        if points:
            picture = evidence.out / f"pareto_{prefix or 'injection_'}"
            reference = _time_per_second(evidence, evidence.runs([f"{prefix}fine"])[0], f"{prefix}fine")
            draw(points, reference, picture.with_name(picture.name.rstrip("_") + ".png"), words)
    section.missing = dict(evidence.missing)
    return section


Point = tuple[str, float, dict[str, float], float]
"""Name, run time over simulated time [-], error over noise by metric, training over the simulated time of a run [-]."""


def _time_per_second(evidence: Evidence, run: Run, reference: str) -> float:
    """Run time over simulated time [-], for not all runs have the same end; NaN with another device."""
    seconds = evidence.run_time(run, reference)
    return math.nan if seconds is None else seconds / float(run.history["time"][-1])


def runs_of(evidence: Evidence, prefix: str) -> list[str]:
    """Names of the plan's runs that are compared with the fine run of a scene."""
    plan = evidence.plan
    scene = plan.run(f"{prefix}fine").scene
    runs = [plan.run(name) for name in plan.names("pareto", RunSpec)]
    # Another pack is in the error of the first.
    same = [run.name for run in runs if run.scene == scene and "seed" not in run.overrides]
    return [name for name in same if name != f"{prefix}fine"]


def _table(evidence: Evidence, words: str, prefix: str) -> tuple[Table, list[Point]]:
    title, fine = f"Error over noise and run time, {words}", evidence.run(f"{prefix}fine")
    if fine is None:
        return Table.of(title, []), []
    floor = noise_floor(fine, evidence.jittered(f"{prefix}fine"))
    points: list[Point] = []
    rows: list[dict[str, Cell]] = []
    for name in runs_of(evidence, prefix):
        run, error = evidence.run(name), evidence.errors(name, f"{prefix}fine")
        if run is None or error is None:
            continue
        seconds, ratio = _time_per_second(evidence, run, f"{prefix}fine"), over(error, floor)
        if math.isnan(seconds):
            evidence.missing[name] = "was run on another device than its fine run, or with another JAX"
            continue
        training = evidence.training_of(name)
        row = _row(name, run, seconds, training) | labelled(ratio)
        rows.append({**row, "mean": mean_over(error, floor), "mean error [%]": mean(error) / PERCENT})
        points.append((name, seconds, ratio, (training or 0.0) / float(fine.history["time"][-1])))
    noise = mean(floor) / PERCENT
    front = metrics.pareto_front(
        [point[1] for point in points],
        [float(row["mean error [%]"] or math.nan) for row in rows],
        error_noise=noise if math.isfinite(noise) else 0.0,
    )
    rows = [{**row, "on the front": "yes" if on else ""} for row, on in zip(rows, front, strict=True)]
    own = _row(f"{prefix}fine, noise [%]", fine, _time_per_second(evidence, fine, f"{prefix}fine"), None)
    rows.append({**own, **labelled(floor, PERCENT), "mean": None, "mean error [%]": noise, "on the front": ""})
    note = (
        "The last row is the reference: its run time, and the errors that are the unit of the others. Errors are means "
        "over packs. Points on the front differ by more than the noise"
    )
    return Table.of(title, rows, note + ("." if math.isfinite(noise) else ", which is not known here.")), points


def _row(name: str, run: Run, seconds: float, training: float | None) -> dict[str, Cell]:
    cells = " x ".join(str(n) for n in run.cells or ())
    return {"run": name, "cells": cells, "time a simulated second [s]": seconds, "training [s]": training}


def draw(points: Sequence[Point], reference: float, path: Path, words: str) -> Path:
    """Error over noise against run time, a panel a metric, with the front, whose runs have letters.

    Hollow points add the training.

    Args:
        points: the runs.
        reference: run time of the fine run over simulated time, the black line [-].
        path: PNG file.
        words: name of the scene.
    """
    times = [point[1] for point in points]
    fronts = {name: metrics.pareto_front(times, _errors(points, name), error_noise=1.0) for name in NAMES}
    on_one = [point[0] for k, point in enumerate(points) if any(front[k] for front in fronts.values())]
    letters = dict(zip(on_one, LETTERS, strict=False))
    key = [f"{letter}  {style.escaped(title, 3.2)}" for title, letter in letters.items()]
    columns = style.legend_columns(key, 12.0)
    with style.look():
        figure = style.new_figure(12.0, 10.0 + style.LEGEND_LINE * math.ceil(len(key) / columns))
        axes = figure.subplots(3, 3)
        for axis, metric in zip(axes.flat, metrics.METRICS, strict=True):
            _panel(axis, points, _errors(points, metric.name), fronts[metric.name])
            axis.axvline(reference, color=style.REFERENCE, linewidth=1.0)
            axis.set_title(metric.label)
        for axis in axes[-1]:
            axis.set_xlabel("run time of a simulated second [s]")
        figure.supylabel(f"error over noise [-], {words}", fontsize=12)
        handles = [Line2D([], [], linestyle="", label=entry) for entry in key]
        figure.legend(handles=handles, loc="outside lower center", ncols=columns, handlelength=0.0)
        # Where the points are in pixels is known once the layout is.
        figure.draw_without_rendering()
        for axis, name in zip(axes.flat, NAMES, strict=True):
            _name_front(axis, points, _errors(points, name), fronts[name], letters)
        return style.save(figure, path)


def _errors(points: Sequence[Point], name: str) -> np.ndarray:
    return np.array([point[2].get(name, math.nan) for point in points])


def _panel(axis: Axes, points: Sequence[Point], error: np.ndarray, front: np.ndarray) -> None:
    """All points of a metric, with the front."""
    for (_, seconds, _, training), value, on in zip(points, error, front, strict=True):
        if not (math.isfinite(value) and value > 0.0):
            continue
        colour = style.COLOURS[1] if training else style.COLOURS[0]
        axis.plot(seconds, value, "o", color=colour, markersize=7 if on else 4)
        if training:
            axis.plot(seconds + training, value, "o", markerfacecolor="white", color=colour, markersize=4)
    time = np.array([point[1] for point in points])
    order = np.argsort(time[front])
    axis.plot(time[front][order], error[front][order], color="#555555", drawstyle="steps-post", linewidth=0.8)
    axis.axhline(1.0, color=style.NOISE, linewidth=1.2)
    axis.set(xscale="log", yscale="log")
    # Room for the letters, left of the first point and below the last.
    if np.any(np.isfinite(error) & (error > 0.0)):
        axis.set(xlim=(0.8 * axis.get_xlim()[0], None), ylim=(0.85 * axis.get_ylim()[0], None))
    for scale in (axis.xaxis, axis.yaxis):  # less than a decade as a rule
        scale.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        scale.set_major_formatter(FormatStrFormatter("%g"))
        scale.set_minor_formatter(NullFormatter())


def _name_front(
    axis: Axes, points: Sequence[Point], error: np.ndarray, front: np.ndarray, letters: Mapping[str, str]
) -> None:
    """The key's letters to the left below the front, where no point is; points too close for one each share a label."""
    labels: list[tuple[str, tuple[float, float], Bbox]] = []
    for point, value, on in sorted(zip(points, error, front, strict=True), key=lambda one: one[0][1]):
        if not on or point[0] not in letters:
            continue
        labels.append(_label(axis, letters[point[0]], (point[1], value)))
        while len(labels) > 1 and labels[-1][2].overlaps(labels[-2][2]):
            (first, place, _), (second, *_) = labels[-2:]
            labels[-2:] = [_label(axis, first + second, place)]
    for text, place, _ in labels:
        axis.annotate(text, place, OFFSET, textcoords="offset points", ha="right", va="top", fontsize=8)


def _label(axis: Axes, text: str, place: tuple[float, float]) -> tuple[str, tuple[float, float], Bbox]:
    """Text, point and box [pt] of a label."""
    right, top = axis.transData.transform(place) * 72.0 / axis.figure.dpi + np.array(OFFSET)
    return text, place, Bbox([[right - 72.0 * style.text_width(text, 8.0) - 3.0, top - 11.0], [right, top]])
