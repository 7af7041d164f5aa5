"""Draws docs/pictures/slide_into_lake.png from a run of a scene.

jaxdem run scenes/slide_into_lake.toml --out runs/slide_into_lake
python docs/tools/slide_into_lake.py runs/slide_into_lake
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import jaxdem
from jaxdem.io.load import Run

sys.path.insert(0, str(Path(__file__).parent))  # for the scripts beside this one

from grains_and_surface import draw, nearest
from moving_walls import save

SHOWN = (0.3, 0.6, 1.0)
"""Frames [s]."""

FASTEST = 0.8
"""Speed at the dark end of the colours [m/s]."""


def main() -> None:
    """Three frames under each other."""
    run = jaxdem.load_run(sys.argv[1])
    figure, panels = plt.subplots(3, 1, figsize=(7.0, 8.0), layout="constrained")
    for axes, time in zip(panels, SHOWN, strict=True):
        shown = draw(axes, run, nearest(run, time), "grains slide into a lake", FASTEST)
        for x, z in shores(run):
            axes.fill(x, z, facecolor="#bbbbbb", edgecolor="#666666", linewidth=0.6, zorder=2.0)
        axes.set(ylabel="z [m]")
    panels[-1].set(xlabel="x [m]")
    label = "speed of the water [m/s]"
    figure.colorbar(shown, ax=panels, label=label, location="right", shrink=0.5, extend="max")
    save(figure, "slide_into_lake")


def shores(run: Run) -> list[tuple[np.ndarray, np.ndarray]]:
    """Corners of what the planes of the scene are in the box [m]."""
    (width, height), found = run.scene["domain"]["size"], []
    for wall in run.scene["walls"]:
        (px, pz), (nx, nz) = wall["point"], wall["normal"]
        x = np.linspace(0.0, width, 400)
        z = np.clip(pz - nx / nz * (x - px), 0.0, height)
        found.append((np.concatenate([x, x[::-1]]), np.concatenate([z, 0.0 * z])))
    return found


if __name__ == "__main__":
    main()
