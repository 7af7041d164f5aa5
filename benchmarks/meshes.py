"""Time of a contact step with a mesh of triangles against the same step with an analytic plane.

A tenth of the grains lie on the wall. Steps of both scenes are timed in turns in one process, in processor time, and
the least of each counts.

    python benchmarks/meshes.py [--grains 20000] [--triangles 10000] [--repeats 7] [--json FILE]
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
from pathlib import Path

import jax
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from jaxdem.setup.builder import build_case
from tests.cases.surfaces import plane_mesh, saved

RADIUS = 0.002
HEIGHT = 0.01


def scene(wall: dict, grains: int) -> jaxdem.Scene:
    """Ten layers of grains, of which the lowest lies on the wall: a tenth of them touch it."""
    side = math.ceil(math.sqrt(grains / 10))
    width = (side + 1) * 2.0 * RADIUS
    layers = math.ceil(grains / side**2)
    axis = 2.0 * RADIUS * (np.arange(side) + 1.0)
    x, y, k = np.meshgrid(axis, axis, np.arange(layers), indexing="ij")
    height = HEIGHT + RADIUS * (0.999 + 1.998 * k)
    position = np.stack([x, y, height], axis=-1).reshape(-1, 3)[np.argsort(k.ravel(), kind="stable")][:grains]
    return jaxdem.load_scene(
        {
            "seed": 1,
            "domain": {"size": [width, width, HEIGHT + 4.0 * RADIUS * (layers + 2)]},
            "particles": {"position": position.tolist(), "radius": RADIUS, "density": 2500.0},
            "contact": {"young_modulus": 1e7, "poisson_ratio": 0.3, "restitution": 0.5, "friction": 0.4, "speed": 0.5},
            "time": {"end": 1.0, "output_interval": 0.01},
            "walls": [wall],
        }
    )


def stepper(wall: dict, grains: int):
    """A function that advances the scene by an interval and gives the processor time of a contact step [s]."""
    case = build_case(scene(wall, grains))
    state, neighbors = case.initial_state()
    step = jax.jit(case.simulation.step)
    going = [state, neighbors]

    def once() -> tuple[float, int]:
        before = time.process_time(), int(going[1].builds)
        while True:
            after, listed, report = jax.block_until_ready(step(case.parameters, *going))
            if not bool(report.particles.overflow):
                break
            going[:] = case.simulation.with_room(*going, going[1].room.enlarged())
            before = time.process_time(), int(going[1].builds)
        spent = time.process_time() - before[0]
        going[:] = after, listed
        return spent / case.simulation.contact.steps, int(listed.builds) - before[1]

    once()
    return once, going


def measured(grains: int, triangles: int, repeats: int) -> dict[str, float]:
    """Processor time of a contact step of both walls [s], builds of lists included."""
    with tempfile.TemporaryDirectory() as folder:
        squares = max(1, round(math.sqrt(triangles / 2)))
        width = (math.ceil(math.sqrt(grains / 10)) + 1) * 2.0 * RADIUS
        mesh = saved(plane_mesh(squares, -0.01, width + 0.01, warp=0.3), Path(folder) / "plane.ply")
        walls = {
            "plane": {"kind": "plane", "point": [0.0, 0.0, HEIGHT], "normal": [0.0, 0.0, 1.0]},
            "mesh": {"kind": "mesh", "file": mesh, "translate": [0.0, 0.0, HEIGHT]},
        }
        steps = {name: stepper(wall, grains) for name, wall in walls.items()}
    best: dict[str, float] = {}
    for _ in range(repeats):
        for name, (once, _) in steps.items():
            best[name] = min(best.get(name, math.inf), once()[0])
    listed = steps["mesh"][1][1].meshes[0]
    found = {
        "grains": grains,
        "triangles": 2 * squares**2,
        "rows": int(np.sum(np.asarray(listed.row) < grains)),
        "plane_ms": 1e3 * best["plane"],
        "mesh_ms": 1e3 * best["mesh"],
        "ratio": best["mesh"] / best["plane"],
    }
    return found


def main() -> None:
    """The table of one case."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--grains", type=int, default=20000)
    parser.add_argument("--triangles", type=int, default=10000)
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    found = measured(given.grains, given.triangles, given.repeats)
    for name, value in found.items():
        print(f"{name:12s} {value:.4g}")
    if given.json:
        given.json.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
