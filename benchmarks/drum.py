"""Speed of a rotating drum of 4 mm spheres on this machine: million particle-steps per second.

A drum of 0.2 m radius turns at 0.3 rev/s; spheres fill a third of its volume, the bed of them half. They start from the
lower half of a dense disordered pack of a slice of the drum, which is repeated: so the bed lies at the wall, has its
contacts at once, and need not fall for thousands of steps first. Steps are timed after a short settling; the time to
lay out, build, compile and settle is told apart. 0.8 m of length hold 1,000,000 spheres; a shorter drum of the same
radius holds fewer.

    python benchmarks/drum.py [--grains 100000] [--settle 0.006] [--intervals 2] [--repeats 3] [--mesh]
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np
from scipy.spatial import KDTree

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # run as a script from anywhere

import jaxdem  # noqa: E402
from benchmarks import harness  # noqa: E402
from jaxdem.particles.growth import grown_pack  # noqa: E402
from jaxdem.particles.regions import cylinder  # noqa: E402
from jaxdem.setup.builder import build_case  # noqa: E402
from tests.cases.surfaces import pipe_mesh, saved  # noqa: E402

RADIUS, DRUM, DENSITY = 0.002, 0.2, 2500.0
FULL_GRAINS, FULL_LENGTH = 1_000_000, 0.8
SLICE, FRACTION = 0.01, 0.6
"""Length of the part of the drum that is packed and repeated [m], and its solid fraction."""

INTERVAL = 1e-3
"""Of a step of the simulation [s]: 49 contact steps, a few seconds of work for 100,000 spheres on one core."""


def bed(grains: int) -> tuple[np.ndarray, float]:
    """(N, 3) centres in the lower part of a drum about y, middle at (0.21, 0.21); and its length [m]."""
    length = FULL_LENGTH * grains / FULL_GRAINS
    slices = max(1, round(length / SLICE))
    part = length / slices
    number = int(FRACTION * math.pi * DRUM**2 * part / (4.0 / 3.0 * math.pi * RADIUS**3))
    region = cylinder((0.21, 0.0, 0.21), (0.0, 1.0, 0.0), DRUM, part, wraps=True)
    pack, reached = grown_pack(region, np.full(number, RADIUS), 1.0, 1)
    if reached < 1.0:
        raise RuntimeError(f"the slice was packed to {reached:.3f} of the radii only")
    pack[:, 1] = np.mod(pack[:, 1], part)
    points = np.concatenate([pack + [0.0, k * part, 0.0] for k in range(slices)])
    points = points[(points[:, 1] >= RADIUS) & (points[:, 1] <= length - RADIUS)]
    return points[np.argsort(points[:, 2], kind="stable")][:grains], length


def tables(position: str, length: float, mesh: str | None) -> dict[str, Any]:
    """The scene."""
    turn = {"kind": "rotation", "rate": 0.6 * math.pi}
    middle = [0.21, 0.0, 0.21]
    drum: dict[str, Any] = {"kind": "cylinder", "center": middle, "axis": [0, 1, 0], "radius": DRUM, "motion": [turn]}
    if mesh is not None:
        turn = turn | {"center": middle, "axis": [0, 1, 0]}
        drum = {"kind": "mesh", "file": mesh, "translate": [0.21, -0.01, 0.21], "touch": "front", "smooth_angle": 6.0,
                "motion": [turn]}  # fmt: skip
    return {
        "seed": 1,
        "domain": {"size": [0.42, length, 0.42]},
        "particles": {"radius": RADIUS, "density": DENSITY, "position": position},
        "contact": {"young_modulus": 1e7, "poisson_ratio": 0.25, "restitution": 0.7, "friction": 0.3, "speed": 1.0},
        "walls": [drum],
        "coupling": {"interval": INTERVAL},
        "time": {"end": 1.0, "output_interval": 0.01},
    }


def coordination(state: Any) -> float:
    """Mean number of spheres that touch a sphere."""
    particles = state.particles
    low = 0.0 if particles.position_low is None else np.asarray(particles.position_low, float)
    position = np.asarray(particles.position, float) + low
    return 2.0 * len(KDTree(position).query_pairs(2.0 * RADIUS, output_type="ndarray")) / len(position)


def main() -> None:
    """Builds the drum, steps it, and prints the speed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--grains", type=int, default=100_000)
    parser.add_argument("--settle", type=float, default=0.006, help="time before steps are timed [s]")
    parser.add_argument("--intervals", type=int, default=2, help="coupling intervals in a repetition")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--mesh", action="store_true", help="the drum as 144 triangles in place of a cylinder")
    given = parser.parse_args()
    clock = time.perf_counter()

    def passed() -> float:
        nonlocal clock
        before, clock = clock, time.perf_counter()
        return clock - before

    position, length = bed(given.grains)
    seconds = {"pack": passed()}
    with tempfile.TemporaryDirectory() as folder:
        np.save(Path(folder) / "bed.npy", position)
        mesh = saved(pipe_mesh(72, DRUM, length + 0.02), Path(folder) / "drum.ply") if given.mesh else None
        case = build_case(jaxdem.load_scene(tables(str(Path(folder) / "bed.npy"), length, mesh)))
        seconds["build"] = passed()
        state, neighbors = case.initial_state()
    seconds["first_state"] = passed()
    step = jax.jit(case.simulation.step)
    contact_steps = case.simulation.contact.steps

    enlarged = 0

    def advance(state: Any, neighbors: Any) -> tuple[Any, Any]:
        nonlocal enlarged
        while True:
            after, listed, report = jax.block_until_ready(step(case.parameters, state, neighbors))
            if not bool(report.particles.overflow):
                return after, listed
            enlarged += 1
            state, neighbors = case.simulation.with_room(state, neighbors, neighbors.room.enlarged())

    state, neighbors = advance(state, neighbors)
    seconds["compile_and_first_interval"] = passed()
    for _ in range(round(given.settle / INTERVAL)):
        state, neighbors = advance(state, neighbors)
    seconds["settle"] = passed()
    rates, processor = [], []
    for _ in range(given.repeats):
        begin, wall, builds = time.process_time(), time.perf_counter(), int(neighbors.builds)
        for _ in range(given.intervals):
            state, neighbors = advance(state, neighbors)
        work = given.grains * given.intervals * contact_steps
        rates.append(1e-6 * work / (time.perf_counter() - wall))
        processor.append(1e-6 * work / (time.process_time() - begin))
    particles = state.particles
    result = {
        "grains": given.grains, "length_m": length, "drum": "mesh" if given.mesh else "cylinder",
        "contact_step_s": case.simulation.interval / contact_steps,
        "steps_in_a_repetition": given.intervals * contact_steps,
        "builds_in_the_last": int(neighbors.builds) - builds, "times_enlarged": enlarged, "seconds": seconds,
        "million_particle_steps_per_s": harness.spread(rates), "per_processor_s": harness.spread(processor),
        "coordination": coordination(state),
        "touching": float(np.mean(np.any(np.asarray(particles.contact_force) != 0.0, axis=1))),
        "memory": harness.peak_memory(),
    }  # fmt: skip
    speed = result["million_particle_steps_per_s"]["median"]
    full = FULL_GRAINS / (1e6 * speed) / result["contact_step_s"]
    result["full_drum_hours_for_a_second"] = full / 3600.0
    harness.write(f"drum{'_mesh' if given.mesh else ''}", result, table(result))


def table(result: dict[str, Any]) -> str:
    """The figures, one a line."""
    lines = ["| figure | value |", "| --- | --- |"]
    lines += [f"| {key} | {value:.4g} |" for key, value in result.items() if isinstance(value, int | float)]
    lines += [f"| {key} [s] | {value:.3g} |" for key, value in result["seconds"].items()]
    lines += [f"| {key} | {result[key]['median']:.3g} ({result[key]['lowest']:.3g} to {result[key]['highest']:.3g}) |"
              for key in ("million_particle_steps_per_s", "per_processor_s")]  # fmt: skip
    lines.append(f"| peak memory [GB] | {1e-9 * (result['memory']['peak_bytes'] or 0):.2f} |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
