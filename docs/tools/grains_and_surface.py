"""Draws docs/pictures/grains_and_surface.png from runs of two scenes, and prints how fast the wave runs.

jaxdem run scenes/collapse_into_water.toml --out runs/collapse
jaxdem run scenes/dam_break_over_grains.toml --out runs/dam
python docs/tools/grains_and_surface.py runs/collapse runs/dam
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import EllipseCollection
from matplotlib.colors import ListedColormap

import jaxdem
from jaxdem.io.load import Run

sys.path.insert(0, str(Path(__file__).parent))  # for the script beside this one

from moving_walls import save

SHOWN = ((0.1, 0.3, 0.6), (0.12, 0.2, 0.4))
"""Frames of the two runs [s]."""

WAVE = (0.45, 0.7)
"""Frames between which the crest is free of the grains and of the far wall [s]."""

FASTEST = (0.4, 1.5)
"""Speed at the dark end of the colours of the two runs [m/s]."""

WATER = ListedColormap(plt.get_cmap("Blues")(np.linspace(0.15, 1.0, 128)))

TITLES = ("a column collapses in a lake", "a dam breaks over grains")


def main() -> None:
    """Three frames of each run, under each other."""
    runs = [jaxdem.load_run(path) for path in sys.argv[1:3]]
    figure, panels = plt.subplots(3, 2, figsize=(10.0, 6.2), layout="constrained", width_ratios=(1.5, 1.0))
    for column, (run, times, title) in enumerate(zip(runs, SHOWN, TITLES, strict=True)):
        for row, time in enumerate(times):
            shown = draw(panels[row, column], run, nearest(run, time), title, FASTEST[column])
        panels[-1, column].set(xlabel="x [m]")
        label = "speed of the water [m/s]"
        figure.colorbar(shown, ax=panels[-1, column], label=label, location="bottom", shrink=0.7, extend="max")
    for axes in panels[:, 0]:
        axes.set(ylabel="z [m]")
    save(figure, "grains_and_surface")
    print(wave_speed(runs[0]))


def nearest(run: Run, time: float) -> int:
    """Number of the frame nearest to a time [s]."""
    return int(np.argmin(np.abs(np.asarray(run.times) - time)))


def draw(axes: plt.Axes, run: Run, index: int, title: str, fastest: float):  # type: ignore[no-untyped-def]
    """Water by its speed, its surface, and the grains."""
    fluid, grains, size = run.fluid(index), run.particles(index), run.scene["domain"]["size"]
    assert fluid is not None and grains is not None
    speed, liquid = np.linalg.norm(fluid["velocity"], axis=-1), fluid["liquid_fraction"]
    shown = axes.imshow(
        np.where(liquid >= 0.5, speed, np.nan).T, origin="lower", extent=(0.0, size[0], 0.0, size[1]), cmap=WATER,
        vmin=0.0, vmax=fastest,
    )  # fmt: skip
    x, z = ((np.arange(n) + 0.5) * side / n for n, side in zip(liquid.shape, size, strict=True))
    axes.contour(x, z, liquid.T, levels=[0.5], colors="#223366", linewidths=0.9)
    diameter = 2.0 * np.broadcast_to(grains["radius"], len(grains["position"]))
    axes.add_collection(
        EllipseCollection(
            diameter,
            diameter,
            np.zeros(len(diameter)),
            units="xy",
            offsets=grains["position"][:, :2],
            transOffset=axes.transData,
            facecolors="#aa7744",
            edgecolors="white",
            linewidths=0.15,
        )  # fmt: skip
    )
    axes.set(xlim=(0.0, size[0]), ylim=(0.0, size[1]), aspect="equal", title=f"{title}, {run.times[index]:.2f} s")
    return shown


def wave_speed(run: Run) -> str:
    """Speed of the crest, beside that of a solitary wave of its height, sqrt(g (h + a))."""
    first, last = (nearest(run, time) for time in WAVE)
    found = [crest(run, index) for index in (first, last)]
    speed = (found[1][0] - found[0][0]) / (run.times[last] - run.times[first])
    depth, height = run.scene["surface"]["level"], np.mean([height for _, height in found])
    return (
        f"crest {1e3 * (height - depth):.0f} mm high, {speed:.2f} m/s; "
        f"solitary wave {np.sqrt(9.81 * height):.2f} m/s, long wave {np.sqrt(9.81 * depth):.2f} m/s"
    )


def crest(run: Run, index: int) -> tuple[float, float]:
    """Place and height of the highest water, by a parabola through three columns of cells [m]."""
    fluid, size = run.fluid(index), run.scene["domain"]["size"]
    assert fluid is not None
    width, cell = size[0] / fluid["liquid_fraction"].shape[0], size[1] / fluid["liquid_fraction"].shape[1]
    level = cell * fluid["liquid_fraction"].sum(axis=1)
    k = int(np.argmax(level[:-2]))
    low, top, high = level[k - 1 : k + 2]
    shift = 0.5 * (low - high) / (low - 2.0 * top + high)
    return width * (k + 0.5 + shift), top - 0.25 * (low - high) * shift


if __name__ == "__main__":
    main()
