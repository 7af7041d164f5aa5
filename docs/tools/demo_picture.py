"""Draw the picture of the demonstration: its runs at the end, and their errors against run time as in its report.

    python docs/tools/demo_picture.py runs/demo docs/pictures/demo.png

needs the folder of a finished `jaxdem study clusters --scale demo`.
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


def draw(study: Path, out: Path) -> None:
    """Read the runs of a study, write one picture."""
    comparison = compared(study)
    rows = [comparison.reference, *comparison.runs]
    shots = [pictures.take(row.run, row.run.number_of_frames - 1) for row in rows]
    tops = pictures.common_tops([[shot] for shot in shots])
    length, height = (float(side) for side in rows[0].run.scene["domain"]["size"])
    with style.look():
        figure = style.new_figure(13.0, 5.6)
        left, right = figure.subfigures(1, 2, width_ratios=[8.0, 5.0])
        axes = left.subplots(1, len(rows), sharey=True)
        for axis, shot, row in zip(axes, shots, rows, strict=True):
            drawing.draw(axis, shot, (length, height), (length, height), tops, "velocity")
            axis.set(title=row.name, xlabel=f"run time {row.run_time_s:.2g} s", xticks=[], yticks=[])
        drawing.add_legends(left, list(axes), shots, tops, "velocity", 7.0)
        add_legend(right, draw_panels(right, [error_panel(comparison)]), 2)
        style.save(figure, out, dpi=88)
    with Image.open(out) as picture:  # colours in steps of 4 of 255, which nobody sees, take a third less
        colours = 4 * ((np.asarray(picture.convert("RGB"), int) + 2) // 4)
    Image.fromarray(np.minimum(colours, 255).astype(np.uint8)).save(out, optimize=True)


if __name__ == "__main__":
    draw(Path(sys.argv[1]), Path(sys.argv[2]))
