"""What cohesion costs: a contact step of a pile with each kind over that of the same pile without.

    python benchmarks/cohesion.py [--count 20000] [--steps 300] [--rounds 7] [--warm-up 3000] [--ratio 3] [--kinds ...]

The pile of `benchmarks/contact.py` collapses for `warm-up` steps without cohesion. From that state all kinds take the
same number of steps in turns, forwards and backwards; the figure is the ratio of the least processor times. Bond number
10: the pull-off force is ten times the weight. Lists are kept in date as in a run. With `--ratio` half of the grains,
at random places, are so many times smaller, and steps as much shorter.
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
import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks import harness
from benchmarks.contact import DENSITY, RADIUS, STEP, column
from jaxdem.step import step

CHUNK, BOND = 50, 10.0
WEIGHT = DENSITY * 4.0 / 3.0 * np.pi * RADIUS**3 * 9.81
PULL, HALF = BOND * WEIGHT, 0.5 * RADIUS

KINDS: dict[str, dict[str, Any] | None] = {
    "none": None,
    "jkr": {"kind": "jkr", "work_of_adhesion": PULL / (1.5 * np.pi * HALF)},
    "dmt": {"kind": "dmt", "work_of_adhesion": PULL / (2.0 * np.pi * HALF)},
    "van_der_waals": {
        "kind": "van_der_waals",
        "hamaker_constant": 6.0 * (0.02 * RADIUS) ** 2 * PULL / HALF,
        "minimum_gap": 0.02 * RADIUS,
        "cutoff": 0.2 * RADIUS,
    },
    "capillary": {"kind": "capillary", "surface_tension": PULL / (4.0 * np.pi * HALF), "liquid_content": 0.01},
    "sjkr": {"kind": "sjkr", "energy_density": 1e6},
}


def of_sizes(cohesion: dict[str, Any] | None, ratio: float) -> dict[str, Any] | None:
    """The same for a smallest radius that is `ratio` times smaller: its pull-off force is ten times its weight, and no
    attraction is longer than half of that radius."""
    if cohesion is None or ratio == 1.0:
        return cohesion
    shorter = {
        "minimum_gap": 1.0 / ratio,
        "cutoff": 1.0 / ratio,
        "hamaker_constant": ratio**-4,
        "energy_density": 1.0 / ratio,
    }
    weaker = dict.fromkeys(("work_of_adhesion", "surface_tension"), ratio**-2.0)
    return {key: x if key == "kind" else x * (shorter | weaker).get(key, 1.0) for key, x in cohesion.items()}


def scene_of(cohesion: dict[str, Any] | None, file: Path, box: tuple[float, float], ratio: float = 1.0) -> jaxdem.Scene:
    """The pile, with or without cohesion."""
    radius: Any = RADIUS
    if ratio != 1.0:
        small = np.random.default_rng(0).uniform(size=len(np.loadtxt(file))) < 0.5
        radius = np.where(small, RADIUS / ratio, RADIUS).tolist()
    step, cohesion = STEP / ratio, of_sizes(cohesion, ratio)
    contact: dict[str, Any] = {
        "young_modulus": 7e7, "restitution": 0.7, "friction": 0.1, "rolling_friction": 0.1, "time_step": step,
        "maximum_overlap": 0.5,
    }  # fmt: skip
    if cohesion is not None:
        cohesion = {key: float(value) if isinstance(value, np.floating) else value for key, value in cohesion.items()}
        contact["cohesion"] = cohesion
    return jaxdem.load_scene(
        {
            "domain": {"size": list(box), "depth": 0.04},
            "particles": {"position": str(file), "radius": radius, "density": DENSITY},
            "contact": contact,
            "time": {"end": 1.0, "output_interval": CHUNK * step},
        }
    )


def contender(scene: jaxdem.Scene, settled: Any) -> tuple[Callable[[int, tuple], tuple], tuple]:
    """A function that takes so many chunks of steps, and the state that it starts from: the settled one."""
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    if settled is not None:
        names = ("position", "position_low", "velocity", "angular_velocity", "contact_force")
        kept = {name: getattr(settled, name) for name in names}
        particles = state.particles._replace(**kept)
        room = neighbors.room
        neighbors = simulation.allocate(parameters, particles, room)
        blank = (jnp.zeros(room.pairs, jnp.float32),) * len(particles.contact_spring)
        state = state._replace(particles=particles._replace(contact_spring=blank))
    advance = jax.jit(lambda s, n: step(simulation, parameters, s, n)[:2]).lower(state, neighbors).compile()

    def run(chunks: int, now: tuple) -> tuple:
        for _ in range(chunks):
            now = advance(*now)
        return jax.block_until_ready(now)

    return run, (state, neighbors)


def pairs_of(state: Any, neighbors: Any) -> tuple[int, int]:
    """Number of pairs that are listed, and of those that touch or hold each other."""
    there = np.asarray(neighbors.pairs.first != neighbors.pairs.second)
    springs = [np.asarray(spring) != 0 for spring in state.particles.contact_spring]
    return int(there.sum()), int((there & np.any(springs, axis=0)).sum())


def main() -> None:
    """Measures and writes results/cohesion.{json,md}, or cohesion_of_sizes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    for name, value in (("--count", 20_000), ("--steps", 300), ("--rounds", 7), ("--warm-up", 3000)):
        parser.add_argument(name, type=int, default=value)
    parser.add_argument("--ratio", type=float, default=1.0)
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=list(KINDS), help="`none` first")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "column.txt"
        position, box = column(arguments.count)
        np.savetxt(file, position)
        run, start = contender(scene_of(None, file, box, arguments.ratio), None)
        settled = run(arguments.warm_up // CHUNK, start)[0].particles
        chosen = {name: KINDS[name] for name in dict.fromkeys(["none", *arguments.kinds])}
        scenes = {name: scene_of(cohesion, file, box, arguments.ratio) for name, cohesion in chosen.items()}
        runs = {name: contender(scene, settled) for name, scene in scenes.items()}
    chunks = max(arguments.steps // CHUNK, 1)
    warm = {name: run(1, start) for name, (run, start) in runs.items()}  # contacts remember, bridges are made
    listed = {name: pairs_of(*state) for name, state in warm.items()}
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    for number in range(arguments.rounds):
        for name in list(runs) if number % 2 == 0 else list(runs)[::-1]:
            begin = time.process_time()
            runs[name][0](chunks, warm[name])
            seconds[name].append((time.process_time() - begin) / (chunks * CHUNK))
    least = {name: min(values) for name, values in seconds.items()}
    lines = [
        "| cohesion | contact step [ms] | over none | range over rounds | pairs listed | contacts |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for name, values in seconds.items():
        pairs = [a / b for a, b in zip(values, seconds["none"], strict=True)]
        lines.append(
            f"| {name} | {1e3 * least[name]:.2f} | {least[name] / least['none']:.2f} | {min(pairs):.2f} to "
            f"{max(pairs):.2f} | {listed[name][0]} | {listed[name][1]} |"
        )
    name = "cohesion" if arguments.ratio == 1.0 else "cohesion_of_sizes"
    harness.write(name, {"arguments": vars(arguments), "seconds_per_step": seconds}, "\n".join(lines))


if __name__ == "__main__":
    main()
