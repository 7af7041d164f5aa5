"""Slope of a heap against the elongation of its grains: clumps of spheres in a row, in 2-D.

    python benchmarks/clump_heap.py [--count 80] [--seeds 3]

Rods of the same volume settle behind a gate, the gate vanishes, and they slump. The slope is that of a wedge with the
same centre of mass, as in `cohesive_heap`. Writes results/clump_heap.{json,md} and docs/results/clump_heap.png.
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
from benchmarks.cohesive_heap import slope

RADIUS, DENSITY, GATE, OPENED, END = 1e-3, 2500.0, 0.025, 0.15, 0.5
SHAPES = {1.0: (1, 0.0), 1.5: (2, 1.0), 2.0: (3, 1.0), 3.0: (5, 1.0)}
"""By length over width: number of spheres in a row, and how far apart they are, in radii."""
SHOWN = (1.0, 1.5, 3.0)
FIGURE = Path(__file__).parents[1] / "docs" / "results" / "clump_heap.png"


def scene_of(elongation: float, seed: int, count: int) -> jaxdem.Scene:
    """Rods behind a gate that vanishes at `OPENED`."""
    number, apart = SHAPES[elongation]
    height = 4.0 * count * math.pi * RADIUS**2 / GATE
    particles: dict[str, Any] = {
        "count": count,
        "density": DENSITY,
        "distribution": {"kind": "normal", "mean": RADIUS, "standard_deviation": 0.1 * RADIUS,
                         "lower": 0.8 * RADIUS, "upper": 1.2 * RADIUS},
        "pack": {"kind": "random", "start": [0.0, 0.0], "stop": [GATE, height * elongation], "spacing": 1.001},
    }  # fmt: skip
    if number > 1:
        centres = [[apart * k, 0.0] for k in range(number)]
        particles |= {"shape": "rod", "shapes": [{"name": "rod", "centres": centres, "radii": [1.0] * number}]}
    return jaxdem.load_scene(
        {
            "seed": seed,
            "domain": {"size": [0.2, height * elongation], "gravity": [0.0, -9.81]},
            "particles": particles,
            "contact": {"young_modulus": 5e5, "restitution": 0.5, "friction": 0.5, "speed": 0.5},
            "walls": [{"kind": "plane", "point": [GATE, 0.0], "normal": [-1.0, 0.0], "end": OPENED}],
            "time": {"end": END, "output_interval": 0.05},
        }
    )


def draw(found: dict[float, list[float]], heaps: dict[float, tuple[np.ndarray, np.ndarray]]) -> None:
    """The angles of all seeds, their mean, and three heaps."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.collections import EllipseCollection

    figure, axes = plt.subplots(1, 1 + len(heaps), figsize=(13, 3.4), width_ratios=[1.3] + [1.0] * len(heaps))
    for elongation, angles in found.items():
        axes[0].plot([elongation] * len(angles), angles, "o", color="tab:blue", markersize=4, alpha=0.6)
    axes[0].plot(list(found), [float(np.mean(angles)) for angles in found.values()], "-", color="tab:blue")
    axes[0].set_xlabel("length of a grain over its width")
    axes[0].set_ylabel("slope [degrees]")
    axes[0].set_ylim(0.0, 45.0)
    axes[0].grid(alpha=0.3)
    for axis, (elongation, (position, radius)) in zip(axes[1:], heaps.items(), strict=True):
        size = 2e3 * radius
        axis.add_collection(
            EllipseCollection(size, size, np.zeros(len(size)), units="x", offsets=1e3 * position,
                              offset_transform=axis.transData, facecolor="tab:orange")
        )  # fmt: skip
        axis.set_xlim(0.0, 80.0)
        axis.set_ylim(0.0, 30.0)
        axis.set_aspect("equal")
        axis.set_title(f"length over width {elongation:g}", fontsize=10)
        axis.set_xlabel("x [mm]")
    axes[1].set_ylabel("z [mm]")
    figure.tight_layout()
    figure.savefig(FIGURE, dpi=110)


def main() -> None:
    """Runs all heaps."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--count", type=int, default=80)
    parser.add_argument("--seeds", type=int, default=3)
    arguments = parser.parse_args()
    found: dict[float, list[float]] = {}
    moving: dict[float, list[float]] = {}
    heaps: dict[float, tuple[np.ndarray, np.ndarray]] = {}
    begin = time.process_time()
    for elongation in SHAPES:
        found[elongation], moving[elongation] = [], []
        for seed in range(arguments.seeds):
            with tempfile.TemporaryDirectory() as folder:
                run = jaxdem.simulate(scene_of(elongation, seed, arguments.count), Path(folder) / "run")
                last, spheres = run.particles(-1), run.spheres(-1)
                speed = float(run.history["particle_velocity_mean"][-1])
            found[elongation].append(slope(np.asarray(last["position"])[:, :2]))
            moving[elongation].append(speed)
            if seed == 0 and elongation in SHOWN:
                heaps[elongation] = np.asarray(spheres["position"])[:, :2], np.asarray(spheres["radius"])
        angles = ", ".join(f"{angle:.1f}" for angle in found[elongation])
        print(f"{elongation:g}: {angles} degrees, at {max(moving[elongation]):.2g} m/s", flush=True)
    draw(found, heaps)
    lines = ["| length over width | spheres | slope [degrees], mean | seeds |", "| --- | --- | --- | --- |"]
    for elongation, angles in found.items():
        each = ", ".join(f"{angle:.1f}" for angle in angles)
        lines.append(f"| {elongation:g} | {SHAPES[elongation][0]} | {np.mean(angles):.1f} | {each} |")
    result = {"arguments": vars(arguments), "slopes": {str(k): v for k, v in found.items()},
              "speed_at_the_end": {str(k): v for k, v in moving.items()},
              "processor_seconds": time.process_time() - begin}  # fmt: skip
    harness.write("clump_heap", result, "\n".join(lines))


if __name__ == "__main__":
    main()
