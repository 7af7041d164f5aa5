"""Draws docs/pictures/pipe_bend.png, spouted_bed.png and pier_scour.png from runs of the scenes of these names.

jaxdem run scenes/pipe_bend.toml --out runs/pipe_bend
python docs/tools/fluid_walls.py runs/pipe_bend
"""

from __future__ import annotations

import sys
from pathlib import Path

import h5py
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import PatchCollection
from matplotlib.patches import Circle

import jaxdem
from jaxdem.io.load import Run

sys.path.insert(0, str(Path(__file__).parent))  # for the script beside this one

from moving_walls import frames, save

BEND, OUTER = np.array([0.09, 0.11]), 0.09
"""Middle of the bend and radius of its outer wall [m]."""

SETTLED = 0.2
"""Time at which the bed of the pier has settled and the stream begins [s]."""


def pipe_bend(run: Run) -> None:
    """The slurry at the end, and where the grains have worn the outer wall."""
    figure, panels = plt.subplots(
        1, 2, figsize=(12.0, 8.0), layout="constrained", gridspec_kw={"width_ratios": (1.6, 1.0)}
    )
    frames(figure, panels[:1], run, (float(run.times[-1]),))
    with h5py.File(run.path / "walls.vtkhdf") as file:
        points, volume = file["points"][:], file["VTKHDF/CellData/wear_volume"][:]
        pairs = file["VTKHDF/Lines/Connectivity"][:].reshape(-1, 2)
    middle = points[pairs].mean(axis=1) - BEND
    outside = (np.hypot(*middle.T) > 0.95 * OUTER) & (middle[:, 0] > 0.0) & (middle[:, 1] < 0.0)
    angle = np.degrees(np.arctan2(middle[:, 0], -middle[:, 1]))[outside]
    order = np.argsort(angle)
    panels[1].bar(angle[order], 1e18 * volume[outside][order], width=4.0)
    panels[1].set_box_aspect(1.0)
    panels[1].set(xlabel="angle along the outer wall of the bend [degrees]", ylabel="volume worn off [µm³]")
    save(figure, "pipe_bend")
    print(f"worn off in all {volume.sum():.3g} m3, on the outer wall {volume[outside].sum():.3g} m3")


def spouted_bed(run: Run) -> None:
    """The bed at rest, with the first spout, and later."""
    figure, panels = plt.subplots(1, 4, figsize=(11.0, 7.0), layout="constrained")
    frames(figure, panels, run, (0.0, 0.5, 2.0, float(run.times[-1])))
    for axes in panels[1:]:
        axes.set_yticklabels([])
    save(figure, "spouted_bed")


def pier_scour(run: Run) -> None:
    """The bed from above, settled and at the end, by the height of its grains, and how its surface has changed."""
    figure, panels = plt.subplots(1, 3, figsize=(13.0, 3.6), layout="constrained")
    pier, size = run.scene["walls"][0], run.scene["domain"]["size"]
    settled, heights = int(np.argmin(np.abs(run.times - SETTLED))), []
    for axes, index in zip(panels[:2], (settled, len(run.times) - 1), strict=True):
        grains = run.particles(index)
        place, radius = np.asarray(grains["position"], float), np.asarray(grains["radius"], float)
        order = np.argsort(place[:, 2])
        discs = PatchCollection([Circle(place[k, :2], radius[k]) for k in order], cmap="viridis", linewidths=0.2)
        discs.set_array(1e3 * place[order, 2])
        discs.set(clim=(0.0, 10.0), edgecolor="black")
        axes.add_collection(discs)
        axes.add_patch(Circle(pier["center"][:2], pier["radius"], facecolor="#A9AFB7", edgecolor="black", zorder=3.0))
        axes.set(xlim=(0.0, size[0]), ylim=(0.0, size[1]), aspect="equal", xlabel="x, along the stream [m]")
        axes.set_title(f"{run.times[index]:.1f} s")
        heights.append(surface(place, radius, size))
    panels[0].set_ylabel("y [m]")
    figure.colorbar(discs, ax=panels[:2], label="height of a grain [mm]", location="right", shrink=0.8)
    change = 1e3 * (heights[1] - heights[0])
    extent = (0.0, size[0], 0.0, size[1])
    shown = panels[2].imshow(change.T, origin="lower", extent=extent, cmap="RdBu", vmin=-8.0, vmax=8.0)
    panels[2].add_patch(Circle(pier["center"][:2], pier["radius"], facecolor="#A9AFB7", edgecolor="black", zorder=3.0))
    panels[2].set(xlabel="x, along the stream [m]", title="change of the bed's surface")
    figure.colorbar(shown, ax=panels[2], label="change [mm]", shrink=0.8)
    save(figure, "pier_scour")
    x, y = np.stack(np.meshgrid(*[(np.arange(n) + 0.5) * 2e-3 for n in change.shape], indexing="ij"))
    apart = np.hypot(x - pier["center"][0], y - pier["center"][1]) / pier["radius"]
    beside = (apart > 1.2) & (apart < 2.0)
    for words, place in (
        ("before and beside the pier", beside & (x < pier["center"][0] + 0.5 * pier["radius"])),
        ("behind it", beside & (x > pier["center"][0] + 0.5 * pier["radius"])),
        ("at the same x, more than two radii away", (apart > 2.0) & (np.abs(x - pier["center"][0]) < pier["radius"])),
    ):
        print(f"surface {words}: {1e3 * heights[0][place].mean():.1f} to {1e3 * heights[1][place].mean():.1f} mm")


def surface(place: np.ndarray, radius: np.ndarray, size: list[float], width: float = 2e-3) -> np.ndarray:
    """Height of the highest grain over each square of a width; 0 where there is none [m]."""
    shape = tuple(round(length / width) for length in size[:2])
    found = np.zeros(shape)
    column = np.clip((place[:, :2] / width).astype(int), 0, np.asarray(shape) - 1)
    np.maximum.at(found, tuple(column.T), place[:, 2] + radius)
    return found


if __name__ == "__main__":
    for path in sys.argv[1:]:
        given = jaxdem.load_run(path)
        {"pipe_bend": pipe_bend, "spouted_bed": spouted_bed, "pier_scour": pier_scour}[Path(path).name](given)
