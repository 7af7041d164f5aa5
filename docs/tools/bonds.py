"""Draws docs/pictures/brazilian_test.png from a run of the scene of this name, and prints the strength of the disc.

jaxdem run scenes/brazilian_test.toml --out runs/disc
python docs/tools/bonds.py runs/disc
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import EllipseCollection, LineCollection

import jaxdem
from jaxdem.io.load import Run
from jaxdem.particles.bond_state import INTACT

sys.path.insert(0, str(Path(__file__).parent))  # for the script beside this one

from moving_walls import save

CENTRE, RADIUS = 0.03, 0.02


def main() -> None:
    """Stresses just before the disc splits, the broken disc, and the force of the plates."""
    run = jaxdem.load_run(sys.argv[1])
    measured = np.genfromtxt(run.path / "probes" / "upper.csv", delimiter=",", names=True)
    time, force = measured["time"], measured["force_z"]
    peak = int(np.argmax(force))
    thickness = run.scene["domain"]["depth"]
    strength = 2.0 * force[peak] / (np.pi * 2.0 * RADIUS * thickness)
    print(f"largest force {force[peak]:.3g} N at {1e3 * time[peak]:.2f} ms: 2 F/(pi D t) = {strength:.3g} Pa")
    last = run.bonds(-1)
    broken = last["status"] != INTACT
    middle = run.bonds(0)["position"].reshape(-1, 2, 3).mean(axis=1)[:, 0]
    near = np.abs(middle - CENTRE) < 0.25 * RADIUS
    print(f"{broken.sum()} bonds broken, {near[broken].mean():.0%} of them in the middle quarter of the width,")
    print(f"which has {near.mean():.0%} of all; {run.summary['bonds']['bodies']} bodies")
    before = int(np.searchsorted(run.times, time[peak]) - 1)
    figure, axes = plt.subplots(1, 3, figsize=(13.0, 4.2), layout="constrained")
    lines = draw(axes[0], run, before)
    figure.colorbar(lines, ax=axes[0], label="tensile stress of intact bonds [MPa]", shrink=0.8)
    draw(axes[1], run, run.number_of_frames - 1)
    axes[2].plot(1e3 * time, force)
    axes[2].set(xlabel="time [ms]", ylabel="force of the upper plate [N]")
    counted = axes[2].twinx()
    counted.plot(1e3 * run.times, run.history["bonds_broken"], "o-", color="tab:red", markersize=3)
    counted.set_ylabel("broken bonds", color="tab:red")
    save(figure, "brazilian_test")


def draw(axes: plt.Axes, run: Run, index: int) -> LineCollection:
    """Grains, intact bonds by stress, and broken ones."""
    grains, bonds = run.particles(index), run.bonds(index)
    places, size = 1e3 * grains["position"][:, :2], 2e3 * grains["radius"]
    axes.add_collection(
        EllipseCollection(
            size, size, np.zeros(len(size)), units="x", offsets=places, offset_transform=axes.transData,
            facecolor="0.93", edgecolor="0.8", linewidth=0.4,
        )
    )  # fmt: skip
    ends, holds = 1e3 * bonds["position"].reshape(-1, 2, 3)[:, :, :2], bonds["status"] == INTACT
    near = ~holds & (np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) < 4.0)  # grains that have not gone far apart
    lines = LineCollection(ends[holds], cmap="viridis", linewidth=1.6)
    lines.set_array(1e-6 * np.maximum(bonds["tensile_stress"][holds], 0.0))
    lines.set_clim(0.0, 1.0)
    axes.add_collection(lines)
    axes.add_collection(LineCollection(ends[near], color="tab:red", linewidth=1.0))
    axes.set(xlim=(7.0, 53.0), ylim=(7.0, 53.0), aspect="equal", xlabel="x [mm]", ylabel="z [mm]")
    axes.set_title(f"{1e3 * run.times[index]:.1f} ms, {(~holds).sum()} bonds broken")
    for name, height in (("lower", 10.0), ("upper", 50.0 - 100.0 * run.times[index])):
        axes.axhline(height, color="0.3", linewidth=2.0, label=name)
    return lines


if __name__ == "__main__":
    main()
