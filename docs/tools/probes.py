"""Draws docs/pictures/probes.png from a run of scenes/probes.toml.

jaxdem run scenes/probes.toml --out runs/probes && python docs/tools/probes.py runs/probes
"""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import matplotlib.pyplot as plt

import jaxdem
from jaxdem.report import chart, drawing, pictures, style
from jaxdem.report.comparison import row_of_one
from jaxdem.report.force_lines import force_lines
from jaxdem.report.probes import probe_panels

ROOT = Path(__file__).parents[2]
SHOWN = ("falling: number flow [1/s]", "layers: stress zz [Pa]", "axis: fluid pressure [Pa]")


def main() -> None:
    """The grains at the end with the forces between them, and a panel of three of the probes."""
    run = jaxdem.load_run(Path(sys.argv[1]))
    panels = [panel for panel in probe_panels([row_of_one(run)]) if {panel.x_label, panel.y_label} & set(SHOWN)]
    picture = dataclasses.replace(pictures.take(run, -1), forces=force_lines(run, -1))
    size = tuple(float(length) for length in run.scene["domain"]["size"])
    tops = pictures.scale_tops([picture])
    with style.look():
        figure = plt.figure(figsize=(10.5, 8.4), layout="constrained")
        upper, lower = figure.subfigures(2, 1, height_ratios=(2.1, 1.0))
        axes = upper.subplots()
        drawing.draw(axes, picture, size, size, tops, "velocity")
        axes.set(title=f"t = {picture.time:.3g} s", xlabel="x [m]", ylabel="height [m]")
        drawing.add_legends(upper, [axes], [picture], tops, "velocity", 5.5)
        chart.draw_panels(lower, panels)
        figure.savefig(ROOT / "docs" / "pictures" / "probes.png", dpi=80)


if __name__ == "__main__":
    main()
