"""A gas-fluidised bed of fine powder with and without cohesion: does it bubble (Geldart A), or channel (Geldart C)?

    python benchmarks/cohesive_bed.py [--bonds 0,100] [--seeds 0,1]

A strong stream breaks the bed up, then a weaker one goes through it. Measures are over the second half of the weaker
one: the pressure drop over the weight of the bed; the standard deviation in time of the void fraction of the cells
below the mean surface; that of their mean void fraction between the cells; the speed of the grains; and the share of
the gas that goes through the quarter of the columns of cells where most of it goes, mean over the heights. The figure
has the first seed.

Writes results/cohesive_bed.{json,md} and docs/results/cohesive_bed.png. Runs are kept in `--runs`, and are not repeated
if they are there.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks import harness
from jaxdem.io.load import Run

RADIUS, DENSITY, GAS, VISCOSITY = 5e-5, 1500.0, 1.2, 1.5e-5
COUNT, WIDTH, HEIGHT, FILLED, CELLS = 1200, 4e-3, 12e-3, 3.9e-3, (13, 39)
BREAKS, THEN = (0.06, 0.25), (0.03, 0.33)
"""Superficial velocity and end of the strong stream, and of the weak one [m/s, s]."""

WEIGHT = DENSITY * 4.0 / 3.0 * math.pi * RADIUS**3 * 9.81
FIGURE = Path(__file__).parents[1] / "docs" / "results" / "cohesive_bed.png"


def scene_of(bond: float, seed: int, before: Path | None) -> jaxdem.Scene:
    """A bed of a Bond number in air that comes from below: in the strong stream, or after that run in the weak one."""
    contact: dict[str, Any] = {
        "young_modulus": 1e6, "restitution": 0.8, "friction": 0.3, "speed": 0.1, "maximum_overlap": 0.3,
    }  # fmt: skip
    if bond:
        contact["cohesion"] = {"kind": "jkr", "work_of_adhesion": bond * WEIGHT / (1.5 * math.pi * 0.5 * RADIUS)}
    particles: dict[str, Any] = {"radius": RADIUS, "density": DENSITY}
    start: dict[str, Any] = {}
    if before is None:
        pack = {"kind": "random", "start": [0.0, 0.0], "stop": [WIDTH, FILLED], "spacing": 1.001}
        particles |= {"count": COUNT, "pack": pack}
    else:
        start = {"start": {"from": str(before)}}
    speed, end = BREAKS if before is None else THEN
    ramp = 0.02 if before is None else 0.0
    return jaxdem.load_scene(
        {
            "seed": seed,
            "domain": {"size": [WIDTH, HEIGHT], "depth": 2.0 * RADIUS, "gravity": [0.0, -9.81]},
            "particles": particles,
            "contact": contact,
            "fluid": {"cells": list(CELLS), "density": GAS, "viscosity": VISCOSITY},
            "boundary": {"bottom": {"kind": "inlet", "velocity": speed, "ramp_time": ramp}, "top": {"kind": "outlet"}},
            "coupling": {"drag": "koch_hill", "kernel_width": {"diameters": 1.5, "cells": 1.0}},
            "time": {"end": end, "output_interval": 2e-3},
        }
        | start
    )


def run_of(scene: jaxdem.Scene, folder: Path) -> Run:
    """The run in a folder, or a new one."""
    if (folder / "summary.json").exists():
        return jaxdem.load_run(folder)
    return jaxdem.simulate(scene, folder, resume=folder.exists())


def measured(run: Run) -> dict[str, Any]:
    """Figures of the second half of a run, and the mean void fraction and upward flux of its cells."""
    frames = [run.fluid(k) for k in range(run.number_of_frames)]
    fluid = [frame for frame in frames if frame is not None]
    late, count = slice(len(fluid) // 2, None), len(run.particles(0)["id"])
    void = np.stack([np.asarray(frame["void_fraction"]) for frame in fluid])[late]
    flux = void * np.stack([np.asarray(frame["velocity"])[..., 1] for frame in fluid])[late]
    pressure = np.asarray([np.asarray(frame["pressure"])[:, 0].mean() for frame in fluid])[late]
    pressure *= WIDTH * 2.0 * RADIUS / (count * WEIGHT)
    grains = [run.particles(k) for k in range(run.number_of_frames)][late]
    surface = np.median([np.percentile(each["position"][:, 1], 95) for each in grains])
    rows = max(int(surface / HEIGHT * CELLS[1]), 1)
    bed, through = void[:, :, :rows], np.sort(flux.mean(axis=0)[:, 1 : rows - 1], axis=0)
    quarter = CELLS[0] // 4
    return {
        "particles": count,
        "pressure_mean": float(pressure.mean()),
        "pressure_deviation": float(pressure.std()),
        "void_mean": float(bed.mean()),
        "void_deviation": float(bed.std(axis=0).mean()),
        "contrast": float(bed.mean(axis=0).std()),
        "speed": float(np.mean([np.linalg.norm(each["velocity"], axis=1).mean() for each in grains])),
        "gas_in_a_quarter": float((through[-quarter:].sum(axis=0) / through.sum(axis=0)).mean()),
        "even_share": quarter / CELLS[0],
        "surface": float(surface),
        "flux": flux.mean(axis=0).tolist(),
    }


COLUMNS = {
    "pressure_mean": "pressure drop over weight",
    "pressure_deviation": "its deviation",
    "void_mean": "void fraction",
    "void_deviation": "its deviation in time",
    "contrast": "deviation of its mean between cells",
    "speed": "speed of grains [m/s]",
    "gas_in_a_quarter": "gas through the fullest quarter",
}


def main() -> int:
    """Runs, table and figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bonds", default="0,100", help="Bond numbers, separated by commas")
    parser.add_argument("--seeds", default="0,1", help="of the packs, separated by commas")
    parser.add_argument("--runs", type=Path, default=Path("runs/cohesive_bed"))
    arguments = parser.parse_args()
    results, shown = {}, {}
    for bond in (float(text) for text in arguments.bonds.split(",")):
        for seed in (int(text) for text in arguments.seeds.split(",")):
            broken, after = (arguments.runs / f"{bond:g}_{seed}_{name}" for name in ("breaks", "then"))
            run_of(scene_of(bond, seed, None), broken)
            run = run_of(scene_of(bond, seed, broken), after)
            results[f"{bond:g}, {seed}"] = measured(run)
            if f"{bond:g}" not in shown:
                places = [run.particles(k)["position"][:, :2] for k in (run.number_of_frames // 2, -1)]
                shown[f"{bond:g}"] = places, results[f"{bond:g}, {seed}"]["flux"]
    draw(shown)
    lines = [f"| Bond number, seed | {' | '.join(COLUMNS.values())} |", "| --- " * (len(COLUMNS) + 1) + "|"]
    lines += [f"| {name} | " + " | ".join(f"{one[key]:.3f}" for key in COLUMNS) + " |" for name, one in results.items()]
    harness.write("cohesive_bed", results, "\n".join(lines))
    return 0


def draw(shown: dict[str, tuple[list[np.ndarray], Any]]) -> None:
    """Beds in the middle and at the end of the weak stream, and where the gas goes, by Bond number."""
    figure, axes = plt.subplots(1, 3 * len(shown), figsize=(8.0 * len(shown), 4.6), layout="constrained")
    begin, end = 1e3 * BREAKS[1], 1e3 * THEN[1]
    for number, (bond, (places, upwards)) in enumerate(shown.items()):
        own = axes[3 * number : 3 * number + 3]
        for ax, position, time in zip(own, places, (0.5 * (begin + end), end), strict=False):
            ax.scatter(1e3 * position[:, 0], 1e3 * position[:, 1], s=3.0, color="0.3")
            ax.set(title=f"Bond no. {bond}, {time:.0f} ms")
        extent = (0.0, 1e3 * WIDTH, 0.0, 1e3 * HEIGHT)
        flux = np.asarray(upwards).T
        image = own[2].imshow(flux, origin="lower", extent=extent, vmin=0.0, vmax=4.0 * THEN[0])
        own[2].set(title="gas upwards, mean")
        figure.colorbar(image, ax=own[2], label="superficial velocity [m/s]")
        for ax in own:
            ax.set(xlim=(0, 1e3 * WIDTH), ylim=(0, 0.55e3 * HEIGHT), aspect="equal", xlabel="x [mm]")
    axes[0].set(ylabel="z [mm]")
    figure.savefig(FIGURE, dpi=110)


if __name__ == "__main__":
    sys.exit(main())
