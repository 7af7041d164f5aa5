"""Draws docs/pictures/free_surface.png from runs of scenes/dam_break.toml and scenes/sloshing.toml.

jaxdem run scenes/dam_break.toml --out runs/dam_break
jaxdem run scenes/sloshing.toml --out runs/sloshing
python docs/tools/free_surface.py runs/dam_break runs/sloshing
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import jaxdem
from jaxdem.io.load import Run

sys.path.insert(0, str(Path(__file__).parent))  # for the script beside this one

from moving_walls import save

SHOWN = (0.1, 0.2, 0.44)
"""Frames of the dam break [s]."""


def main() -> None:
    """Three frames of the dam break, and the surface at the left wall of the box that sloshes."""
    dam, sloshing = (jaxdem.load_run(path) for path in sys.argv[1:3])
    figure, panels = plt.subplots(2, 2, figsize=(10.0, 6.4), layout="constrained")
    for axes, time in zip(panels.flat, SHOWN, strict=False):
        draw_dam(axes, dam, time)
    draw_level(panels[1, 1], sloshing)
    save(figure, "free_surface")


def draw_dam(axes: plt.Axes, run: Run, time: float) -> None:
    """The liquid by its speed, the surface as a line."""
    index = int(np.argmin(np.abs(np.asarray(run.times) - time)))
    fluid, size = run.fluid(index), run.scene["domain"]["size"]
    assert fluid is not None
    speed, liquid = np.linalg.norm(fluid["velocity"], axis=-1), fluid["liquid_fraction"]
    extent = (0.0, size[0], 0.0, size[1])
    shown = axes.imshow(
        np.where(liquid >= 0.5, speed, np.nan).T, origin="lower", extent=extent, cmap="viridis", vmin=0.0, vmax=2.0
    )
    x, z = ((np.arange(n) + 0.5) * side / n for n, side in zip(liquid.shape, size, strict=True))
    axes.contour(x, z, liquid.T, levels=[0.5], colors="black", linewidths=0.8)
    axes.set(title=f"{run.times[index]:.2f} s", xlabel="x [m]", ylabel="z [m]")
    axes.figure.colorbar(shown, ax=axes, label="speed of the water [m/s]", location="bottom", shrink=0.8, extend="max")


def draw_level(axes: plt.Axes, run: Run) -> None:
    """Height of the surface at the left wall, beside the linear wave."""
    length, height = run.scene["domain"]["size"]
    times = np.asarray(run.times)
    level = [height * float(np.mean(run.fluid(k)["liquid_fraction"][0])) for k in range(len(times))]
    k = math.pi / length
    heavy, light = run.scene["fluid"]["density"], run.scene["surface"]["density"]
    pull = (heavy - light) / (heavy / math.tanh(0.5 * k) + light / math.tanh((height - 0.5) * k))
    linear = 0.5 + 0.02 * np.cos(math.sqrt(9.81 * k * pull) * times)
    axes.plot(times, level, "o", markersize=3.0, label="run, first column of cells")
    axes.plot(times, linear, color="black", linewidth=0.8, label="linear wave")
    axes.set(title="sloshing", xlabel="time [s]", ylabel="level at the left wall [m]", ylim=(0.475, 0.535))
    axes.legend(loc="upper center", ncols=2)


if __name__ == "__main__":
    main()
