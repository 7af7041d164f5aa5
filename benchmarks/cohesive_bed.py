"""A gas-fluidised bed of fine powder with and without cohesion: does it bubble (Geldart A), or channel (Geldart C)?

    python benchmarks/cohesive_bed.py [--bonds 0,30] [--end 0.3]

Writes results/cohesive_bed.{json,md} and docs/results/cohesive_bed.png. Measures, over the second half of the time: the
pressure drop over the weight of the bed, mean and standard deviation, and the standard deviation in time of the void
fraction of the cells below the mean surface.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks import harness
from jaxdem.io.load import Run

RADIUS, DENSITY, GAS, VISCOSITY, SPEED = 5e-5, 1500.0, 1.2, 1.5e-5, 0.03
COUNT, WIDTH, HEIGHT, FILLED, CELL = 1200, 4e-3, 12e-3, 3.9e-3, 4e-4
WEIGHT = DENSITY * 4.0 / 3.0 * math.pi * RADIUS**3 * 9.81
FIGURE = Path(__file__).parents[1] / "docs" / "results" / "cohesive_bed.png"


def scene_of(bond: float, end: float) -> jaxdem.Scene:
    """A bed of a Bond number in air that comes from below."""
    contact: dict[str, Any] = {
        "young_modulus": 1e6, "restitution": 0.8, "friction": 0.3, "speed": 0.1, "maximum_overlap": 0.3,
    }  # fmt: skip
    if bond:
        contact["cohesion"] = {"kind": "jkr", "work_of_adhesion": bond * WEIGHT / (1.5 * math.pi * 0.5 * RADIUS)}
    return jaxdem.load_scene(
        {
            "domain": {"size": [WIDTH, HEIGHT], "depth": 2.0 * RADIUS, "gravity": [0.0, -9.81]},
            "particles": {
                "radius": RADIUS,
                "density": DENSITY,
                "count": COUNT,
                "pack": {"kind": "random", "start": [0.0, 0.0], "stop": [WIDTH, FILLED], "spacing": 1.001},
            },
            "contact": contact,
            "fluid": {
                "cells": [round(WIDTH / CELL), round(HEIGHT / CELL)], "density": GAS, "viscosity": VISCOSITY,
            },
            "boundary": {"bottom": {"kind": "inlet", "velocity": SPEED}, "top": {"kind": "outlet"}},
            "coupling": {"drag": "koch_hill", "kernel_width": {"diameters": 1.5, "cells": 1.0}},
            "time": {"end": end, "output_interval": 2e-3},
        }
    )  # fmt: skip


def measured(run: Run) -> dict[str, Any]:
    """Figures of the second half, and the pressure drop over time."""
    frames = [run.fluid(k) for k in range(run.number_of_frames)]
    count = len(run.particles(0)["id"])
    area = WIDTH * 2.0 * RADIUS
    pressure = (
        np.asarray([np.asarray(f["pressure"])[:, 0].mean() for f in frames if f is not None]) * area / (count * WEIGHT)
    )
    late = slice(len(frames) // 2, None)
    void = np.stack([np.asarray(f["void_fraction"]) for f in frames if f is not None])[late]
    surface = np.median(
        [np.percentile(run.particles(k)["position"][:, 1], 95) for k in range(run.number_of_frames)][late]
    )
    bed = void[:, :, : max(int(surface / CELL), 1)]
    return {
        "particles": count,
        "pressure_mean": float(pressure[late].mean()),
        "pressure_deviation": float(pressure[late].std()),
        "void_deviation": float(bed.std(axis=0).mean()),
        "void_mean": float(bed.mean()),
        "surface": float(surface),
        "pressure": pressure.tolist(),
    }


def main() -> int:
    """Runs, table and figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    parser.add_argument("--bonds", default="0,30", help="Bond numbers, separated by commas")
    parser.add_argument("--end", type=float, default=0.25, help="simulated time [s]")
    arguments = parser.parse_args()
    bonds = [float(text) for text in arguments.bonds.split(",")]
    results, shown = {}, {}
    for bond in bonds:
        with tempfile.TemporaryDirectory() as folder:
            begin = time.time()
            run = jaxdem.simulate(scene_of(bond, arguments.end), Path(folder) / "run")
            results[f"{bond:g}"] = measured(run)
            shown[bond] = [run.particles(k)["position"][:, :2] for k in (run.number_of_frames * 2 // 3, -1)]
            print(
                bond,
                {k: v for k, v in results[f"{bond:g}"].items() if k != "pressure"},
                f"{time.time() - begin:.0f} s",
                flush=True,
            )
    draw(results, shown, arguments.end)
    lines = [
        "| Bond number | pressure drop over weight | its deviation | void fraction | its deviation in time |",
        "| --- | --- | --- | --- | --- |",
    ]
    names = ("pressure_mean", "pressure_deviation", "void_mean", "void_deviation")
    for name, one in results.items():
        lines.append(f"| {name} | " + " | ".join(f"{one[key]:.3f}" for key in names) + " |")
    harness.write("cohesive_bed", results, "\n".join(lines))
    return 0


def draw(results: dict[str, Any], shown: dict[float, list[np.ndarray]], end: float) -> None:
    """Pressure drop over time, and the beds."""
    figure, axes = plt.subplots(1, 1 + 2 * len(shown), figsize=(3.4 + 2.2 * 2 * len(shown), 4.2), layout="constrained")
    for name, one in results.items():
        axes[0].plot(np.linspace(0.0, 1e3 * end, len(one["pressure"])), one["pressure"], label=f"Bond number {name}")
    axes[0].set(xlabel="time [ms]", ylabel="pressure drop over weight [-]")
    axes[0].legend()
    places = [(bond, k, p) for bond, both in shown.items() for k, p in enumerate(both)]
    for ax, (bond, k, position) in zip(axes[1:], places, strict=True):
        ax.scatter(1e3 * position[:, 0], 1e3 * position[:, 1], s=3.0, color="0.3")
        ax.set(
            xlim=(0, 1e3 * WIDTH),
            ylim=(0, 1e3 * HEIGHT),
            aspect="equal",
            xlabel="x [mm]",
            title=f"Bond number {bond:g}, {1e3 * end * (2 / 3, 1)[k]:.0f} ms",
        )
    axes[1].set(ylabel="z [mm]")
    figure.savefig(FIGURE, dpi=110)


if __name__ == "__main__":
    sys.exit(main())
