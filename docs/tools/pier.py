"""Draws docs/pictures/pier.png from a run of the scene of this name, and prints drag coefficient and Strouhal number.

jaxdem run scenes/pier.toml --out runs/pier
python docs/tools/pier.py runs/pier
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
from jaxdem.report import pictures

sys.path.insert(0, str(Path(__file__).parent))  # for the script beside this one

from moving_walls import save

SHOWN = 8.0
"""Time of the frame [s]."""

STEADY = 4.0
"""From this time on [s] the vortices leave at a steady rate."""

STRONGEST = 10.0
"""End of the colour scale of the vorticity [1/s]."""


def main() -> None:
    """A frame of the stream, and the force on the pier."""
    run = jaxdem.load_run(sys.argv[1])
    figure, (stream, force) = plt.subplots(
        1, 2, figsize=(12.0, 4.2), layout="constrained", gridspec_kw={"width_ratios": (1.9, 1.0)}
    )
    draw_stream(figure, stream, run)
    measured = np.genfromtxt(run.path / "probes" / "pier.csv", delimiter=",", names=True)
    time, drag, lift = measured["time"], *(coefficient(run, measured[f"fluid_force_{axis}"]) for axis in "xz")
    force.plot(time, drag, label="drag coefficient")
    force.plot(time, lift, label="lift coefficient")
    force.set(xlabel="time [s]", ylabel="force of the fluid on the pier [-]", ylim=(-1.3, 2.6))
    force.legend(loc="center right", bbox_to_anchor=(1.0, 0.58))
    save(figure, "pier")
    late = time > STEADY
    print(f"drag coefficient {drag[late].mean():.2f}, lift {lift[late].min():.2f} to {lift[late].max():.2f}")
    print(f"Strouhal number {strouhal(run, time[late], lift[late]):.3f}, from {STEADY:g} s on")


def draw_stream(figure: plt.Figure, axes: plt.Axes, run: Run) -> None:
    """The vorticity of the fluid, grains in their true size, and the pier."""
    picture = pictures.take_nearest(run, SHOWN, SHOWN)
    index = pictures.nearest(run, SHOWN, SHOWN)
    assert picture is not None and index is not None
    fluid = run.fluid(index)
    assert fluid is not None
    velocity, size = np.asarray(fluid["velocity"], np.float64), run.scene["domain"]["size"]
    spacing = [length / cells for length, cells in zip(size, velocity.shape[:2], strict=True)]
    across, along = velocity[..., -1], velocity[..., 0]
    vorticity = np.gradient(across, spacing[0], axis=0) - np.gradient(along, spacing[1], axis=1)
    shown = axes.imshow(
        vorticity.T, origin="lower", extent=(0.0, size[0], 0.0, size[1]), cmap="RdBu_r", vmin=-STRONGEST, vmax=STRONGEST
    )
    grains = [Circle(place, radius) for place, radius in zip(picture.centres, picture.radius, strict=True)]
    axes.add_collection(PatchCollection(grains, facecolor="black", linewidths=0.0))
    pier = run.scene["walls"][0]
    axes.add_patch(Circle(pier["center"], pier["radius"], facecolor="#A9AFB7", edgecolor="black", zorder=3.0))
    axes.set(title=f"{picture.time:.2f} s, {len(grains)} grains", xlabel="x [m]", ylabel="z, across the stream [m]")
    figure.colorbar(
        shown, ax=axes, label="vorticity of the fluid [1/s]", location="bottom", extend="both", shrink=0.7, aspect=40.0
    )


def speed(run: Run) -> float:
    """Of the undisturbed stream [m/s]."""
    return float(run.scene["fluid"]["velocity"][0])


def coefficient(run: Run, force: np.ndarray) -> np.ndarray:
    """Forces [N] over rho U^2 D b / 2, with the diameter D of the pier and the thickness b of the slab [-]."""
    area = 2.0 * run.scene["walls"][0]["radius"] * run.scene["domain"]["depth"]
    return force / (0.5 * run.scene["fluid"]["density"] * speed(run) ** 2 * area)


def strouhal(run: Run, time: np.ndarray, lift: np.ndarray) -> float:
    """D / (T U) with the mean time T between two rises of the lift through its mean [-]."""
    swing = lift - lift.mean()
    rises = np.flatnonzero((swing[:-1] < 0.0) & (swing[1:] >= 0.0))
    share = swing[rises] / (swing[rises] - swing[rises + 1])
    crossed = time[rises] + share * (time[rises + 1] - time[rises])
    period = float(np.diff(crossed).mean())
    return 2.0 * run.scene["walls"][0]["radius"] / (period * speed(run))


if __name__ == "__main__":
    main()
