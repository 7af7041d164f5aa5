"""Draws docs/pictures/brazil_nut.png from a run of scenes/brazil_nut.toml.

jaxdem run scenes/brazil_nut.toml --out runs/nut
python docs/tools/segregation.py runs/nut
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import EllipseCollection

from jaxdem import load_run

ROOT = Path(__file__).parents[2]
MM = 1e3


def main() -> None:
    """Three frames, and the height of the large disc over time."""
    run = load_run(Path(sys.argv[1]))
    times, found = run.times, [run.particles(k) for k in range(len(run.times))]
    frames = [(one["position"], one["radius"]) for one in found]
    heights = [MM * position[0, 1] for position, _ in frames]
    figure, panels = plt.subplots(1, 4, figsize=(10.0, 3.6), layout="constrained", width_ratios=(1, 1, 1, 2))
    for panel, k in zip(panels, (0, len(frames) // 4, len(frames) - 1), strict=False):
        position, radius = frames[k]
        size = 2.0 * MM * np.asarray(radius)
        colors = np.where(np.arange(len(size)) == 0, "#cc6677", "#4477aa")
        panel.add_collection(
            EllipseCollection(
                size,
                size,
                np.zeros(len(size)),
                units="xy",
                offsets=MM * position[:, :2],
                transOffset=panel.transData,
                facecolors=colors,
                edgecolors="white",
                linewidths=0.2,
            )  # fmt: skip
        )
        width, height = run.scene["domain"]["size"]
        panel.set(
            xlim=(0.0, MM * width),
            ylim=(0.0, 0.6 * MM * height),
            aspect="equal",
            title=f"{times[k]:.2f} s",
            xlabel="x [mm]",
        )
    panels[0].set(ylabel="z [mm]")
    panels[-1].plot(times, heights, color="#cc6677")
    panels[-1].set(xlabel="time [s]", ylabel="height of the large disc [mm]")
    figure.savefig(ROOT / "docs" / "pictures" / "brazil_nut.png", dpi=110)


if __name__ == "__main__":
    main()
