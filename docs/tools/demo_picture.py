"""Draw the picture of the demonstration: its runs at the end, and their errors against run time as in its report.

    python docs/tools/demo_picture.py runs/demo docs/pictures/demo.png

needs the folder of a finished `jaxdem study clusters --scale demo`. It prints the table of docs/learned_closures.md,
from which README.md has its figures: picture and figures are of one study.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from jaxdem.closures import load_closure
from jaxdem.io import Run, load_run
from jaxdem.report import Candidate, drawing, pictures, style
from jaxdem.report.chart import add_legend, draw_panels
from jaxdem.report.comparison import Comparison, build
from jaxdem.report.figures import error_panel
from jaxdem.study import DEMOS

PLAN = DEMOS["clusters"]


def compared(study: Path) -> Comparison:
    """The runs of a finished study, of all packs."""

    def packs(folder: str) -> list[Run]:
        return [load_run(study / folder), *(load_run(study / f"{folder}_seed_{seed}") for seed in PLAN.seeds)]

    def candidate(folder: str, name: str, training: float = float("nan")) -> Candidate:
        first, *others = packs(folder)
        return Candidate(first, name, others, training)

    last = PLAN.coarse[-1]
    training = float(load_closure(study / "filtered.closure.h5")[1]["study_seconds"])
    candidates = [candidate(one.folder, one.label) for one in PLAN.coarse]
    candidates.append(candidate(f"{last.folder}_closure", f"{last.label} + closure", training))
    fine, *noise = packs("fine")
    return build(Candidate(fine, "fine"), candidates, noise)


def table(comparison: Comparison) -> str:
    """Mean errors and run times of all runs, as Markdown."""
    lines = [
        "| run | mean error (range over three packs) | over the noise | run time [s] | over that of the fine run |"
    ]
    lines.append("| --- " * 5 + "|")
    whole = comparison.reference.run_time_s
    for row in comparison.runs:
        percent = [100.0 * error for error in (row.mean_error, min(row.pack_errors), max(row.pack_errors))]
        error = "{:.2g} % ({:.2g}-{:.2g})".format(*percent)
        times = f"{row.run_time_s:.2g} | {row.run_time_s / whole:.2g}"
        lines.append(f"| {row.name} | {error} | {comparison.over_noise(row):.2g} | {times} |")
    errors = [100.0 * row.mean_error for row in comparison.noise_rows]
    noise = f"{100.0 * comparison.noise_mean:.2g} % ({min(errors):.2g}-{max(errors):.2g})"
    lines.append(f"| fine, two other packs (noise) | {noise} | 1 | {whole:.2g} | 1 |")
    return "\n".join(lines)


def collision_errors(comparison: Comparison) -> str:
    """The error of the mean collision force of each run, in a line."""
    found = [f"{row.name} {100.0 * row.errors['collision_force_mean']:.0f} %" for row in comparison.runs]
    return f"Collision force: {', '.join(found)}"


def draw(comparison: Comparison, out: Path) -> None:
    """Write one picture of the runs of a study."""
    rows = [comparison.reference, *comparison.runs]
    shots = [pictures.take(row.run, row.run.number_of_frames - 1) for row in rows]
    tops = pictures.common_tops([[shot] for shot in shots])
    length, height = (float(side) for side in rows[0].run.scene["domain"]["size"])
    with style.look():
        figure = style.new_figure(14.6, 5.6)
        left, right = figure.subfigures(1, 2, width_ratios=[8.0, 6.6])
        axes = left.subplots(1, len(rows), sharey=True)
        for axis, shot, row in zip(axes, shots, rows, strict=True):
            drawing.draw(axis, shot, (length, height), (length, height), tops, "velocity")
            axis.set(title=row.name, xlabel=f"run time {row.run_time_s:.2g} s", xticks=[], yticks=[])
        drawing.add_legends(left, list(axes), shots, tops, "velocity", 7.0)
        add_legend(right, draw_panels(right, [error_panel(comparison)]), 2)
        style.save(figure, out, dpi=80)
    with Image.open(out) as picture:  # colours in steps of 4 of 255, which nobody sees, take a third less
        colours = 4 * ((np.asarray(picture.convert("RGB"), int) + 2) // 4)
    Image.fromarray(np.minimum(colours, 255).astype(np.uint8)).save(out, optimize=True)


if __name__ == "__main__":
    runs = compared(Path(sys.argv[1]))
    draw(runs, Path(sys.argv[2]))
    print(table(runs), collision_errors(runs), sep="\n\n")
