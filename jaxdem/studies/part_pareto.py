"""Error against run time: what mesh, closure, precision, stiffness and time steps buy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

from jaxdem import metrics
from jaxdem.io import Run
from jaxdem.report import style
from jaxdem.studies.evidence import Evidence
from jaxdem.studies.measure import LABELS, NAMES, mean, mean_over, noise_floor, over
from jaxdem.studies.tables import Cell, Section, Table

SCENES = {"the injection scene": "", "the dilute jet": "dilute_"}
"""By what stands before the names of their runs."""


def pareto_part(evidence: Evidence) -> Section:
    """A table and a figure of all runs of each scene."""
    section = Section("pareto", "Error against run time")
    section.text.append(
        f"Run times are those of the runs themselves, compiling included. {evidence.sharing} Training is not in them "
        "and stands beside. In the figures orange points are runs with a closure, hollow ones have its training added as if for one run "
        "as long as the fine one, the grey line is the noise and the black one the fine run's time."
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
    """Run time over simulated time [-]: runs that only errors are taken of end earlier than others. NaN with another device."""
    seconds = evidence.wall_time(run, reference)
    return math.nan if seconds is None else seconds / float(run.history["time"][-1])


def runs_of(evidence: Evidence, prefix: str) -> list[str]:
    """Names of the plan's runs that are compared with the fine run of a scene."""
    part = evidence.plan.parts["pareto"].runs
    scene = evidence.plan.runs[f"{prefix}fine"].scene
    runs = {name: evidence.plan.runs[name] for name in part}
    # Another pack is in the error of the first.
    return [
        name
        for name, spec in runs.items()
        if spec.scene == scene and name != f"{prefix}fine" and "seed" not in spec.overrides
    ]


def _table(evidence: Evidence, words: str, prefix: str) -> tuple[Table, list[Point]]:
    headings = [
        "run",
        "cells",
        "time a simulated second [s]",
        "training [s]",
        *LABELS,
        "mean",
        "mean error [%]",
        "on the front",
    ]
    table = Table(f"Error over noise and run time, {words}", headings, [])
    fine = evidence.run(f"{prefix}fine")
    if fine is None:
        return table, []
    floor = noise_floor(fine, evidence.jittered(f"{prefix}fine"))
    points: list[Point] = []
    rows: list[list[Cell]] = []
    for name in runs_of(evidence, prefix):
        run, error = evidence.run(name), evidence.errors(name, f"{prefix}fine")
        if run is None or error is None:
            continue
        seconds, ratio = _time_per_second(evidence, run, f"{prefix}fine"), over(error, floor)
        if math.isnan(seconds):
            evidence.missing[name] = "was run on another device than its fine run, or with another JAX"
            continue
        training = evidence.training_of(name)
        cells = " x ".join(str(n) for n in run.cells or ())
        rows.append(
            [
                name,
                cells,
                seconds,
                training,
                *(ratio[n] for n in NAMES),
                mean_over(error, floor),
                100 * mean(error),
            ]
        )
        points.append((name, seconds, ratio, (training or 0.0) / float(fine.history["time"][-1])))
    front = metrics.pareto_front([p[1] for p in points], [float(row[-1] or math.nan) for row in rows])
    table.rows = [[*row, "yes" if on else ""] for row, on in zip(rows, front, strict=True)]
    noise = [100 * floor[n] for n in NAMES]
    size = " x ".join(str(n) for n in fine.cells or ())
    table.rows.append(
        [
            f"{prefix}fine, noise [%]",
            size,
            _time_per_second(evidence, fine, f"{prefix}fine"),
            None,
            *noise,
            None,
            100 * mean(floor),
            "",
        ]
    )
    table.note = "The last row is the reference: its run time, and the errors that are the unit of the others. Errors are means over packs."
    return table, points


def draw(points: Sequence[Point], reference: float, path: Path, words: str) -> Path:
    """Error over noise against run time, a panel a metric, with the front; a hollow point adds the training.

    Args:
        points: the runs.
        reference: run time of the fine run over simulated time, the black line [-].
        path: PNG file.
        words: name of the scene.
    """
    with style.look():
        figure = style.new_figure(12.0, 10.0)
        axes = figure.subplots(3, 3)
        for axis, name, label in zip(axes.flat, NAMES, LABELS, strict=True):
            time = np.array([point[1] for point in points])
            error = np.array([point[2].get(name, math.nan) for point in points])
            front = metrics.pareto_front(time, error)
            for (title, seconds, _, training), value, on in zip(points, error, front, strict=True):
                if not (math.isfinite(value) and value > 0.0):
                    continue
                colour = style.COLOURS[1] if training else style.COLOURS[0]
                axis.plot(seconds, value, "o", color=colour, markersize=7 if on else 4)
                if training:
                    axis.plot(
                        seconds + training, value, "o", markerfacecolor="white", color=colour, markersize=4
                    )
                if on:
                    axis.annotate(
                        title, (seconds, value), fontsize=6, xytext=(3, 3), textcoords="offset points"
                    )
            order = np.argsort(time[front])
            axis.plot(
                time[front][order],
                error[front][order],
                color="#555555",
                drawstyle="steps-post",
                linewidth=0.8,
            )
            axis.axvline(reference, color=style.REFERENCE, linewidth=1.0)
            axis.axhline(1.0, color=style.NOISE, linewidth=1.2)
            axis.set(xscale="log", yscale="log", title=label)
            for scale in (axis.xaxis, axis.yaxis):  # less than a decade as a rule
                scale.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
                scale.set_major_formatter(FormatStrFormatter("%g"))
                scale.set_minor_formatter(NullFormatter())
        figure.supxlabel("run time of a simulated second [s]")
        figure.supylabel(f"error over noise [-], {words}")
        return style.save(figure, path)
