"""Draws docs/pictures/rotating_drum.png and compression.png from runs of the scenes of these names.

jaxdem run scenes/rotating_drum.toml --out runs/drum
jaxdem run scenes/compression.toml --out runs/compression
python docs/tools/moving_walls.py runs/drum runs/compression
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

import jaxdem
from jaxdem.io.load import Run
from jaxdem.report import drawing, pictures

ROOT = Path(__file__).parents[2]
DRUM_TIMES, LID_TIMES = (0.0, 0.25, 3.0), (0.3, 0.8)
"""Of the frames [s]."""


def drum(run: Run) -> None:
    """Frames of the drum, and what its motor gives."""
    figure, panels = plt.subplots(1, len(DRUM_TIMES) + 1, figsize=(12.0, 3.4), layout="constrained")
    frames(figure, panels[:-1], run, DRUM_TIMES)
    measured = np.genfromtxt(run.path / "probes" / "drum.csv", delimiter=",", names=True)
    panels[-1].plot(measured["time"], -1e3 * measured["power"])
    panels[-1].set(xlabel="time [s]", ylabel="power of the drum [mW]", ylim=(0.0, None))
    save(figure, "rotating_drum")


def lid(run: Run) -> None:
    """Frames of the lid, and its displacement against the load that the grains carry."""
    figure, panels = plt.subplots(1, len(LID_TIMES) + 1, figsize=(9.6, 3.4), layout="constrained")
    frames(figure, panels[:-1], run, LID_TIMES)
    history = run.history
    measured = np.genfromtxt(run.path / "probes" / "lid.csv", delimiter=",", names=True)
    late = history["time"] > 0.3
    displacement = np.interp(history["time"][late], history["time"], history["wall_0_displacement"])
    load = np.interp(history["time"][late], measured["time"], measured["force_z"])
    rising = history["time"][late] <= 0.8
    start = displacement[0]
    panels[-1].plot(load[rising], 1e3 * (displacement[rising] - start), label="loading")
    panels[-1].plot(load[~rising], 1e3 * (displacement[~rising] - start), "--", label="unloading")
    panels[-1].set(xlabel="force on the lid [N]", ylabel="displacement of the lid [mm]")
    panels[-1].invert_yaxis()
    panels[-1].legend()
    save(figure, "compression")


def frames(figure: plt.Figure, panels: np.ndarray, run: Run, times: tuple[float, ...]) -> None:
    """Pictures of a run side by side."""
    size = run.scene["domain"]["size"]
    box = size[0], size[-1]
    shown = [pictures.take_nearest(run, time, times[-1]) for time in times]
    tops = pictures.scale_tops([picture for picture in shown if picture])
    for axes, picture in zip(panels, shown, strict=True):
        assert picture is not None
        drawing.draw(axes, picture, box, box, tops, "velocity")
        axes.set(xlabel="x [m]", title=f"{picture.time:.2f} s")
    panels[0].set_ylabel("z [m]")
    drawing.add_legends(figure, panels, shown, tops, "velocity", 9.0)
    for legend in figure.legends:  # of sides of the box: beside the frames, and not below the graph at the right
        legend.remove()
        panels[0].legend(handles=legend.legend_handles, loc="best", fontsize="small")


def save(figure: plt.Figure, name: str) -> None:
    """The figure as a small PNG."""
    target = ROOT / "docs" / "pictures" / f"{name}.png"
    figure.savefig(target, dpi=90)
    with Image.open(target) as drawn:
        drawn.convert("RGB").quantize(200).save(target, optimize=True)


if __name__ == "__main__":
    drum(jaxdem.load_run(sys.argv[1]))
    lid(jaxdem.load_run(sys.argv[2]))
