"""Draws the impact of Dosta et al. at full size: slices of the layer, and the ball's depth and speed over time.

python benchmarks/dosta_full.py
python docs/tools/dosta_full.py runs/dosta_full/impact
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import EllipseCollection

import jaxdem

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]  # for the benchmark, and the script beside this one

from moving_walls import save  # noqa: E402

from benchmarks.dosta_full import RADIUS, SIDE, measured  # noqa: E402

FASTEST = 1.0
"""Speed at the end of the colours [m/s]."""


def slice_of(axis: plt.Axes, frame: dict[str, np.ndarray]) -> EllipseCollection:
    """The spheres whose centres are within a radius from the middle plane, in millimetres."""
    position, radius = (np.asarray(frame[name], float) for name in ("position", "radius"))
    near = np.abs(position[:, 1] - 0.5 * SIDE) < RADIUS
    speed = np.linalg.norm(np.asarray(frame["velocity"], float)[near], axis=1)
    wide = 2e3 * radius[near]
    drawn = EllipseCollection(
        wide, wide, np.zeros_like(wide), units="xy", offsets=1e3 * position[near][:, [0, 2]], array=speed,
        cmap="viridis", edgecolors="black", linewidths=0.15, clim=(0.0, FASTEST), offset_transform=axis.transData,
    )  # fmt: skip
    axis.add_collection(drawn)
    axis.set(xlim=(0.0, 1e3 * SIDE), ylim=(40.0, 130.0), aspect="equal", xlabel="x [mm]")
    return drawn


def main() -> None:
    """The figure."""
    run = jaxdem.load_run(sys.argv[1])
    found = measured(run)
    time = 1e3 * np.asarray(found["time_s"])
    figure, axes = plt.subplots(1, 4, figsize=(13.0, 3.6), layout="constrained")
    for axis, wanted in zip(axes[:-1], (0.0, 5.0, time[-1]), strict=True):
        index = int(np.argmin(np.abs(time - wanted)))
        drawn = slice_of(axis, run.particles(index))
        axis.set_title(f"{abs(time[index]):.0f} ms")
    axes[0].set_ylabel("z [mm]")
    figure.colorbar(drawn, ax=axes[:-1], label="speed [m/s]", extend="max", shrink=0.8)
    depth = axes[-1]
    depth.plot(time, 1e3 * np.asarray(found["depth_m"]), color="tab:blue")
    depth.set(xlabel="time since the ball met the layer [ms]", xlim=(0.0, None), ylim=(0.0, None))
    depth.set_ylabel("depth of its lowest point [mm]", color="tab:blue")
    depth.invert_yaxis()
    other = depth.twinx()
    other.plot(time, found["speed_m_s"], color="tab:orange")
    other.set_ylabel("its speed downwards [m/s]", color="tab:orange")
    save(figure, "dosta_full")


if __name__ == "__main__":
    main()
