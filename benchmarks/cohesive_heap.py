"""Slope of a cohesive heap against the Bond number: pull-off force of two grains over the weight of one.

    python benchmarks/cohesive_heap.py [--count 500] [--seeds 3]

Discs of JKR settle behind a gate, the gate vanishes, and they slump. The slope is that of a wedge with the same centre
of mass. Writes results/cohesive_heap.{json,md} and docs/results/cohesive_heap.png.
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

RADIUS, DENSITY, GATE, OPENED, END = 1e-3, 2500.0, 0.05, 0.2, 0.6
WEIGHT = DENSITY * 4.0 / 3.0 * math.pi * RADIUS**3 * 9.81
BONDS = (0.0, 1.0, 4.0, 16.0)
SHOWN = (0.0, 4.0, 16.0)
FIGURE = Path(__file__).parents[1] / "docs" / "results" / "cohesive_heap.png"


def scene_of(bond: float, seed: int, count: int) -> jaxdem.Scene:
    """Grains behind a gate that vanishes at `OPENED`."""
    height = 1.6 * count * math.pi * RADIUS**2 / (0.8 * GATE)
    return jaxdem.load_scene(
        {
            "seed": seed,
            "domain": {"size": [0.2, 1.2 * height], "gravity": [0.0, -9.81]},
            "particles": {
                "count": count,
                "density": DENSITY,
                "distribution": {"kind": "normal", "mean": RADIUS, "standard_deviation": 0.1 * RADIUS,
                                 "lower": 0.8 * RADIUS, "upper": 1.2 * RADIUS},
                "pack": {"kind": "random", "start": [0.0, 0.0], "stop": [GATE, height], "spacing": 1.001},
            },
            "contact": {
                "young_modulus": 1e6, "restitution": 0.3, "friction": 0.5, "rolling_friction": 0.2, "speed": 0.8,
                "cohesion": {"kind": "jkr", "work_of_adhesion": bond * WEIGHT / (1.5 * math.pi * 0.5 * RADIUS)},
            },
            "walls": [{"kind": "plane", "point": [GATE, 0.0], "normal": [-1.0, 0.0], "end": OPENED}],
            "time": {"end": END, "output_interval": 0.2},
        }
    )  # fmt: skip


def draw(found: dict[float, list[float]], heaps: dict[float, tuple[np.ndarray, np.ndarray]]) -> None:
    """The angles with their range, and three heaps."""
    figure, axes = heaps_figure(found, heaps, (100.0, 50.0), "Bond number", edge="k")
    axes[0].set_xscale("symlog", linthresh=0.5)
    axes[0].set_xticks(list(found), [f"{bond:g}" for bond in found], minor=False)
    axes[0].minorticks_off()
    axes[0].set_xlabel("Bond number, pull-off force over weight")
    figure.tight_layout()
    figure.savefig(FIGURE, dpi=110)


def main() -> None:
    """Runs all heaps."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--count", type=int, default=400)
    parser.add_argument("--seeds", type=int, default=3)
    arguments = parser.parse_args()
    found: dict[float, list[float]] = {}
    heaps: dict[float, tuple[np.ndarray, np.ndarray]] = {}
    begin = time.process_time()
    for bond in BONDS:
        found[bond] = []
        for seed in range(arguments.seeds):
            with tempfile.TemporaryDirectory() as folder:
                run = jaxdem.simulate(scene_of(bond, seed, arguments.count), Path(folder) / "run")
                last: Any = run.particles(-1)
                position, radius = np.asarray(last["position"])[:, :2], np.asarray(last["radius"])
            found[bond].append(slope(position))
            if seed == 0 and bond in SHOWN:
                heaps[bond] = position, radius
        print(f"Bond {bond:g}: {', '.join(f'{angle:.1f}' for angle in found[bond])} degrees", flush=True)
    draw(found, heaps)
    lines = ["| Bond number | slope [degrees], mean | seeds |", "| --- | --- | --- |"]
    for bond, angles in found.items():
        lines.append(f"| {bond:g} | {np.mean(angles):.1f} | {', '.join(f'{angle:.1f}' for angle in angles)} |")
    result = {"arguments": vars(arguments), "slopes": {str(k): v for k, v in found.items()},
              "processor_seconds": time.process_time() - begin}  # fmt: skip
    harness.write("cohesive_heap", result, "\n".join(lines))


if __name__ == "__main__":
    main()
