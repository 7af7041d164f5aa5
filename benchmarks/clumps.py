"""What clumps cost: a contact step of rods of three spheres over that of as many free spheres.

    python benchmarks/clumps.py [--count 20000] [--steps 300] [--rounds 7] [--warm-up 2000]

A column of free spheres (`benchmarks/contact.py`) and one of rods, three spheres of the same size in a row that overlap
by half, collapse for `warm-up` steps each. Then both take the same number of steps in turns, forwards and backwards;
the figure is the ratio of the processor times of a pair of turns. Lists are kept in date as in a run. The rods are as
many as have together as many spheres.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks import harness
from benchmarks.contact import DENSITY, RADIUS, column
from jaxdem.particles.union import union_of
from jaxdem.step import step

STEP, CHUNK = 1e-5, 50
ROD = ((-1.0, 0.0), (0.0, 0.0), (1.0, 0.0))


def rods(count: int) -> tuple[np.ndarray, tuple[float, float]]:
    """(N, 2) centres of rods along x in rows, jittered by 0.005 radii, and their box; as long and high as `column`."""
    _, box = column(3 * count)
    long, high = 4.03 * RADIUS, 2.03 * RADIUS
    per_row = int((5.0 / 12.0 * box[0] - long) // long)
    row, place = np.divmod(np.arange(count), per_row)
    x = 0.51 * long + place * long + (row % 2) * 0.5 * long
    y = 0.51 * high + row * high
    jitter = np.random.default_rng(0).uniform(-0.005 * RADIUS, 0.005 * RADIUS, (count, 2))
    return np.stack((x, y), axis=1) + jitter, box


def scene_of(clumps: bool, count: int, folder: Path) -> jaxdem.Scene:
    """The column of either."""
    position, box = rods(count // 3) if clumps else column(count)
    file = folder / f"column-{clumps}.txt"
    np.savetxt(file, position)
    particles: dict[str, Any] = {"position": str(file), "radius": RADIUS, "density": DENSITY}
    if clumps:
        union = union_of(tuple((x, 0.0, z) for x, z in ROD), (1.0,) * 3)
        shape = {"name": "rod", "centres": [list(row) for row in ROD], "radii": [1.0, 1.0, 1.0]}
        particles |= {"radius": union.radius * RADIUS, "shape": "rod", "shapes": [shape], "orientation": "aligned"}
    contact = {"young_modulus": 7e7, "restitution": 0.7, "friction": 0.1, "time_step": STEP, "maximum_overlap": 0.5}
    return jaxdem.load_scene(
        {
            "domain": {"size": list(box), "depth": 0.04},
            "particles": particles,
            "contact": contact,
            "time": {"end": 1.0, "output_interval": CHUNK * STEP},
        }
    )


def contender(scene: jaxdem.Scene) -> tuple[Callable[[int, tuple], tuple], tuple]:
    """A function that takes so many chunks of steps, and the state that it starts from."""
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    advance = jax.jit(lambda s, n: step(simulation, parameters, s, n)[:2]).lower(state, neighbors).compile()

    def run(chunks: int, now: tuple) -> tuple:
        for _ in range(chunks):
            now = advance(*now)
        if bool(now[1].overflow):
            raise RuntimeError("the list ran out of room")
        return jax.block_until_ready(now)

    return run, (state, neighbors)


def main() -> None:
    """Measures and writes results/clumps.{json,md}."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    for name, value in (("--count", 20_000), ("--steps", 300), ("--rounds", 7), ("--warm-up", 2000)):
        parser.add_argument(name, type=int, default=value)
    arguments = parser.parse_args()
    chunks, names = max(arguments.steps // CHUNK, 1), ("spheres", "clumps")
    runs, warm = {}, {}
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            runs[name], start = contender(scene_of(name == "clumps", arguments.count, Path(folder)))
            warm[name] = runs[name](arguments.warm_up // CHUNK, start)
    listed = {name: int(np.sum(np.asarray(now[1].pairs.first != now[1].pairs.second))) for name, now in warm.items()}
    builds = {name: int(now[1].builds) for name, now in warm.items()}
    seconds: dict[str, list[float]] = {name: [] for name in names}
    for number in range(arguments.rounds):
        for name in names if number % 2 == 0 else names[::-1]:
            begin = time.process_time()
            runs[name](chunks, warm[name])
            seconds[name].append((time.process_time() - begin) / (chunks * CHUNK))
    ratios = [b / a for a, b in zip(*seconds.values(), strict=True)]
    lines = ["| pile | contact step [ms] | pairs in reach | lists built in the warm-up |", "| --- | --- | --- | --- |"]
    for name in names:
        lines.append(f"| {name} | {1e3 * min(seconds[name]):.2f} | {listed[name]} | {builds[name]} |")
    lines += ["", f"Clumps over spheres: {np.median(ratios):.2f} (median), {min(ratios):.2f} to {max(ratios):.2f}."]
    found = {"arguments": vars(arguments), "seconds_per_step": seconds, "ratios": ratios, "pairs": listed}
    harness.write("clumps", found | {"builds": builds}, "\n".join(lines))


if __name__ == "__main__":
    main()
