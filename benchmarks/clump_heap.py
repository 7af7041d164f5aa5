"""Slope of a heap of clumps against their elongation: length over width of a row of spheres.

    python benchmarks/clump_heap.py [--count 150] [--seeds 3]

Rows of overlapping discs of the same volume settle behind a gate, the gate vanishes, and they slump. No rolling
friction: the shape alone keeps them from rolling. The slope is that of a wedge with the same centre of mass
(`benchmarks/heaps.py`). Writes results/clump_heap.{json,md} and docs/results/clump_heap.png.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks import harness
from benchmarks.heaps import heaps_figure, slope

RADIUS, DENSITY, GATE, OPENED, END = 1e-3, 2500.0, 0.03, 0.2, 0.55
ELONGATIONS = (1.0, 1.5, 2.0, 3.0)
SHOWN = (1.0, 1.5, 3.0)
FIGURE = Path(__file__).parents[1] / "docs" / "results" / "clump_heap.png"


def shape_of(elongation: float) -> dict[str, Any]:
    """A row of discs a radius apart."""
    number = round(2.0 * (elongation - 1.0)) + 1
    places = np.linspace(1.0 - elongation, elongation - 1.0, number)
    return {"name": "row", "centres": [[x, 0.0] for x in places.tolist()], "radii": [1.0] * number}


def scene_of(elongation: float, seed: int, count: int) -> jaxdem.Scene:
    """Rows of discs behind a gate that vanishes at `OPENED`."""
    height = 4.0 * count * math.pi * RADIUS**2 / GATE * elongation**0.7
    particles: dict[str, Any] = {
        "count": count,
        "density": DENSITY,
        "distribution": {"kind": "normal", "mean": RADIUS, "standard_deviation": 0.05 * RADIUS,
                         "lower": 0.9 * RADIUS, "upper": 1.1 * RADIUS},
        "pack": {"kind": "random", "start": [0.0, 0.0], "stop": [GATE, height], "spacing": 1.001},
    }  # fmt: skip
    if elongation > 1.0:
        particles |= {"shape": "row", "shapes": [shape_of(elongation)]}
    return jaxdem.load_scene(
        {
            "seed": seed,
            "domain": {"size": [0.2, 1.1 * height], "gravity": [0.0, -9.81]},
            "particles": particles,
            "contact": {
                "young_modulus": 1e6,
                "restitution": 0.3,
                "friction": 0.5,
                "speed": 1.5,
                "maximum_overlap": 0.4,
            },
            "walls": [{"kind": "plane", "point": [GATE, 0.0], "normal": [-1.0, 0.0], "end": OPENED}],
            "time": {"end": END, "output_interval": 0.05},
        }
    )


def discs_of(run: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres of the bodies, and centres and radii of their discs, at the end."""
    bodies: Any = run.particles(-1)
    centre = np.asarray(bodies["position"])[:, :2]
    if "orientation" not in bodies:
        return centre, centre, np.asarray(bodies["radius"])
    discs: Any = run.spheres(-1)
    return centre, np.asarray(discs["position"])[:, :2], np.asarray(discs["radius"])


def draw(found: dict[float, list[float]], heaps: dict[float, tuple[np.ndarray, np.ndarray]]) -> None:
    """The slopes with their means, and three heaps."""
    figure, axes = heaps_figure(found, heaps, (80.0, 40.0), "elongation")
    axes[0].set_xlabel("elongation, length over width")
    figure.tight_layout()
    figure.savefig(FIGURE, dpi=110)


def main() -> None:
    """Runs all heaps."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--count", type=int, default=150)
    parser.add_argument("--seeds", type=int, default=3)
    arguments = parser.parse_args()
    found: dict[float, list[float]] = {}
    speeds: dict[float, list[float]] = {}
    heaps: dict[float, tuple[np.ndarray, np.ndarray]] = {}
    begin = time.process_time()
    for elongation in ELONGATIONS:
        found[elongation], speeds[elongation] = [], []
        for seed in range(arguments.seeds):
            with tempfile.TemporaryDirectory() as folder:
                run = jaxdem.simulate(scene_of(elongation, seed, arguments.count), Path(folder) / "run")
                centre, discs, radius = discs_of(run)
                speeds[elongation].append(float(np.mean(run.history["particle_velocity_mean"][-1:])))
            found[elongation].append(slope(centre))
            if seed == 0 and elongation in SHOWN:
                heaps[elongation] = discs, radius
        told = ", ".join(f"{angle:.1f}" for angle in found[elongation])
        print(f"elongation {elongation:g}: {told} degrees, at the end {speeds[elongation]} m/s", flush=True)
    draw(found, heaps)
    lines = [
        "| elongation | slope [degrees], mean | seeds | mean speed at the end [mm/s] |",
        "| --- | --- | --- | --- |",
    ]
    for elongation, angles in found.items():
        told = ", ".join(f"{angle:.1f}" for angle in angles)
        lines.append(f"| {elongation:g} | {np.mean(angles):.1f} | {told} | {1e3 * np.mean(speeds[elongation]):.1f} |")
    result = {"arguments": vars(arguments), "slopes": {str(k): v for k, v in found.items()},
              "speeds": {str(k): v for k, v in speeds.items()},
              "processor_seconds": time.process_time() - begin}  # fmt: skip
    harness.write("clump_heap", result, "\n".join(lines))


if __name__ == "__main__":
    main()
