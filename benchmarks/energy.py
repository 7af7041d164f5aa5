"""What the balance of energy and lubrication cost: a contact step of a pile with each over that of the same pile.

    python benchmarks/energy.py [--count 20000] [--steps 300] [--rounds 5] [--warm-up 3000]

The pile and the turns are those of `benchmarks/cohesion.py`.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks import harness
from benchmarks.cohesion import CHUNK, contender, scene_of
from benchmarks.contact import RADIUS, column

LIQUID = {"cutoff": 0.1 * RADIUS, "roughness": 1e-3 * RADIUS, "viscosity": 1e-3}
OPTIONS: dict[str, dict[str, Any]] = {
    "plain": {},
    "output.energy": {"output": {"energy": True}},
    "lubrication": {"contact": {"lubrication": LIQUID}},
    "lubrication, shear = false": {"contact": {"lubrication": LIQUID | {"shear": False}}},
}


def with_option(scene: jaxdem.Scene, tables: dict[str, Any]) -> jaxdem.Scene:
    """The scene with these keys of its tables."""
    own = scene.tables()
    return jaxdem.load_scene(own | {name: own[name] | keys for name, keys in tables.items()})


def main() -> None:
    """Measures and writes results/energy.{json,md}."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    for name, default in (("count", 20000), ("steps", 300), ("rounds", 5), ("warm-up", 3000)):
        parser.add_argument(f"--{name}", type=int, default=default)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "pile.txt"
        position, box = column(arguments.count)
        np.savetxt(file, position)
        plain = scene_of(None, file, box)
        run, start = contender(plain, None)
        settled = run(arguments.warm_up // CHUNK, start)[0].particles
        runs = {name: contender(with_option(plain, tables), settled) for name, tables in OPTIONS.items()}
        seconds: dict[str, list[float]] = {name: [] for name in runs}
        for turn in range(arguments.rounds):
            for name in list(runs)[:: 1 if turn % 2 == 0 else -1]:
                begin = time.process_time()
                runs[name][0](arguments.steps // CHUNK, runs[name][1])
                seconds[name].append((time.process_time() - begin) / arguments.steps)
    lines = ["| option | contact step [ms] | over plain |", "| --- | --- | --- |"]
    least = min(seconds["plain"])
    lines += [f"| {name} | {1e3 * min(each):.3f} | {min(each) / least:.2f} |" for name, each in seconds.items()]
    harness.write("energy", {"arguments": vars(arguments), "seconds_per_step": seconds}, "\n".join(lines))


if __name__ == "__main__":
    main()
