"""Draws docs/pictures/heat.png from runs of scenes/heated_bed.toml and scenes/cavity.toml.

jaxdem run scenes/heated_bed.toml --out runs/heated_bed
jaxdem run scenes/cavity.toml --out runs/cavity
python docs/tools/heat.py runs/heated_bed runs/cavity
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import PatchCollection
from matplotlib.patches import Circle

import jaxdem
from jaxdem.io.load import Run

sys.path.insert(0, str(Path(__file__).parent))  # for the script beside this one

from moving_walls import save

STREAM = {"density": 0.8, "color": "white", "linewidth": 0.6, "arrowsize": 0.7}

SHOWN = (0.5, 3.0)
"""Frames of the bed [s]."""


def main() -> None:
    """Two frames of the bed, its mean temperatures, and the cavity at its end."""
    bed, cavity = (jaxdem.load_run(path) for path in sys.argv[1:3])
    figure, panels = plt.subplots(
        1, 4, figsize=(12.0, 4.0), layout="constrained", gridspec_kw={"width_ratios": (0.6, 0.6, 1.1, 1.25)}
    )
    for axes, time in zip(panels, SHOWN, strict=False):
        shown = draw_bed(axes, bed, time)
    figure.colorbar(shown, ax=panels[:2], label="temperature of grains and air [K]", location="left", shrink=0.9)
    history = bed.history
    panels[2].plot(history["time"], history["fluid_temperature_mean"], label="air in the box")
    panels[2].plot(history["time"], history["particle_temperature_mean"], label="grains")
    panels[2].set(xlabel="time [s]", ylabel="mean temperature [K]")
    panels[2].legend()
    draw_cavity(figure, panels[3], cavity)
    save(figure, "heat")


def draw_bed(axes: plt.Axes, run: Run, time: float) -> plt.cm.ScalarMappable:
    """Air in colour, grains in their true size on it."""
    index = int(np.argmin(np.abs(np.asarray(run.times) - time)))
    fluid, grains, size = run.fluid(index), run.particles(index), run.scene["domain"]["size"]
    assert fluid is not None
    limits = {"cmap": "inferno", "vmin": 300.0, "vmax": 400.0}
    shown = axes.imshow(fluid["temperature"].T, origin="lower", extent=(0.0, size[0], 0.0, size[1]), **limits)
    places = zip(grains["position"][:, :2], grains["radius"], strict=True)
    circles = PatchCollection([Circle(place, radius) for place, radius in places], edgecolor="white", linewidths=0.3)
    circles.set(array=grains["temperature"], cmap="inferno", clim=(300.0, 400.0))
    axes.add_collection(circles)
    axes.set(title=f"{run.times[index]:.1f} s", xlabel="x [m]", ylabel="z [m]")
    axes.label_outer()
    return shown


def draw_cavity(figure: plt.Figure, axes: plt.Axes, run: Run) -> None:
    """Lines of equal temperature and the stream."""
    fluid, size = run.fluid(-1), run.scene["domain"]["size"]
    assert fluid is not None
    temperature, velocity = fluid["temperature"], fluid["velocity"]
    x, z = ((np.arange(n) + 0.5) * length / n for n, length in zip(temperature.shape, size, strict=True))
    shown = axes.contourf(x, z, temperature.T, levels=16, cmap="inferno")
    axes.streamplot(
        x, z, velocity[..., 0].T, velocity[..., 1].T, density=0.8, color="white", linewidth=0.6, arrowsize=0.7
    )
    axes.set(title="air in a cavity, Ra = 100,000", xlabel="x [m]", ylabel="z [m]", aspect="equal")
    figure.colorbar(shown, ax=axes, label="temperature [K]", shrink=0.9)


if __name__ == "__main__":
    main()
