"""Draw the picture of the demonstration: its runs at the end, and their errors against run time.

    python docs/tools/demo_picture.py runs/demo docs/pictures/demo.png

needs the folder of a finished `jaxdem study clusters --scale demo`.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from PIL import Image

import jaxdem
from jaxdem.report import pictures, style
from jaxdem.report.chart import log_limits, put_plain_numbers

FOLDERS = ("fine", "coarse", "parcels", "parcels_closure")


def draw(study: Path, out: Path) -> None:
    """Read the runs and comparison.csv of a study, write one picture."""
    with (study / "comparison.csv").open() as file:
        rows = list(csv.DictReader(file))
    shown, looks = [row for row in rows if row["role"] != "noise"], style.styles(len(FOLDERS))
    noise = [float(row["mean_error"]) for row in rows if row["role"] == "noise"]
    runs = [jaxdem.load_run(study / folder) for folder in FOLDERS]
    shots = [pictures.take(run, run.number_of_frames - 1) for run in runs]
    tops = pictures.common_tops([[shot] for shot in shots])
    length, height = (float(side) for side in runs[0].scene["domain"]["size"])
    with style.look():
        figure = style.new_figure(13.0, 5.6)
        left, right = figure.subfigures(1, 2, width_ratios=[8.0, 5.0])
        axes = left.subplots(1, len(runs), sharey=True)
        for axis, shot, row in zip(axes, shots, shown, strict=True):
            pictures.draw(axis, shot, (length, height), (length, height), tops, "velocity")
            axis.set(title=row["name"], xlabel=f"run time {float(row['run_time_s']):.2g} s", xticks=[], yticks=[])
        pictures.add_legends(left, list(axes), shots, tops, "velocity", 7.0)
        _errors(right.subplots(), shown, looks, sum(noise) / len(noise))
        style.save(figure, out, dpi=88)
    with Image.open(out) as picture:  # colours in steps of 4 of 255, which nobody sees, take a third less
        colours = 4 * ((np.asarray(picture.convert("RGB"), int) + 2) // 4)
    Image.fromarray(np.minimum(colours, 255).astype(np.uint8)).save(out, optimize=True)


def _errors(axis: Axes, rows: list[dict[str, str]], looks: list[style.RunStyle], noise: float) -> None:
    """Mean errors against run times, with the range over the packs."""
    times, errors = [float(row["run_time_s"]) for row in rows], [noise]
    for row, look, time in zip(rows[1:], looks[1:], times[1:], strict=True):
        mean, low, high = (float(row[f"mean_error{end}"]) for end in ("", "_lowest", "_highest"))
        errors += [low, high]
        axis.errorbar(time, mean, [[mean - low], [high - mean]], fmt="o", color=look.color, markersize=9, capsize=4)
        axis.annotate(row["name"], (time, high), (0, 7), textcoords="offset points", color=look.color, ha="center")
    axis.axvline(times[0], color=looks[0].color, linewidth=1.2)
    axis.axhline(noise, color=style.NOISE, linewidth=1.6)
    axis.annotate("fine", (times[0], noise), (-6, 8), textcoords="offset points", ha="right")
    axis.set(xscale="log", yscale="log", xlabel="run time [s]", ylabel="mean error against the fine run [-]")
    axis.set(xlim=log_limits([0.8 * min(times), *times, 1.3 * times[0]]), ylim=log_limits([*errors, 0.75 * noise]))
    put_plain_numbers(axis.xaxis, axis.get_xlim())
    put_plain_numbers(axis.yaxis, axis.get_ylim())
    axis.annotate("noise: fine runs of other packs", (axis.get_xlim()[0], noise), (6, -14), textcoords="offset points")


if __name__ == "__main__":
    draw(Path(sys.argv[1]), Path(sys.argv[2]))
