"""How dense a grown pack of equal particles becomes, and how long that takes.

    python benchmarks/grown_packs.py [--spheres 5000] [--discs 1000]

Spheres and discs in periodic boxes that they fill to a given solid fraction: processor time of laying them out.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks import harness
from jaxdem.setup.particles import particle_setup

RADIUS = 1e-3
FRACTIONS = {2: (0.80, 0.82, 0.83, 0.839), 3: (0.58, 0.60, 0.62, 0.63)}
"""By dimension, the solid fractions (of areas in 2-D) [-]."""


def scene_of(dimension: int, count: int, fraction: float) -> jaxdem.Scene:
    """So many particles in a periodic cube or square that they fill to this part."""
    size = [
        (count * (math.pi * RADIUS**2, 4.0 / 3.0 * math.pi * RADIUS**3)[dimension - 2] / fraction) ** (1 / dimension)
    ]
    pack = {"kind": "grown", "start": [0.0] * dimension, "stop": size * dimension}
    sides = ("left", "bottom") if dimension == 2 else ("left", "front", "bottom")
    return jaxdem.load_scene(
        {
            "domain": {"size": size * dimension, "gravity": [0.0] * dimension},
            "particles": {"count": count, "radius": RADIUS, "density": 2500.0, "pack": pack},
            "boundary": {side: {"kind": "periodic"} for side in sides},
            "contact": {"young_modulus": 1e7, "speed": 1.0},
            "time": {"end": 0.1, "output_interval": 0.1},
        }
    )


def main() -> None:
    """Runs the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--spheres", type=int, default=5000)
    parser.add_argument("--discs", type=int, default=1000)
    given = parser.parse_args()
    rows: list[dict[str, Any]] = []
    lines = ["| particles | solid fraction | processor time [s] |", "| --- | --- | --- |"]
    for dimension, count, kind in ((2, given.discs, "discs"), (3, given.spheres, "spheres")):
        for fraction in FRACTIONS[dimension]:
            particles, begin = particle_setup(scene_of(dimension, count, fraction)), time.process_time()
            assert particles is not None and len(particles.position) == count
            seconds = time.process_time() - begin
            rows.append({"kind": kind, "count": count, "solid_fraction": fraction, "seconds": seconds})
            lines.append(f"| {count} {kind} | {fraction:g} | {seconds:.1f} |")
            harness.save("grown_packs", {"packs": rows}, "\n".join(lines))
    print("\n".join(lines))


if __name__ == "__main__":
    main()
