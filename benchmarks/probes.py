"""What a probe costs that measures in every coupling interval.

    taskset -c 0 python benchmarks/probes.py [--pairs 60] [--only WORD ...]

A scene without probes, and the same scene with one probe, as the programs that runs use, in one process and in turns,
from the same state. The cost is the processor time of the one over that of the other, less 1, per pair. It has the
lines of the file too: one an output, that is every 5 intervals, or one an interval where the name says so.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks import harness
from jaxdem.io.probes import ProbeFiles
from jaxdem.particles.neighbors import Neighbors
from jaxdem.run.chunk import CHUNK, Chunk, ChunkProgram
from jaxdem.run.observer import Observer, columns_of
from jaxdem.setup.builder import build_case
from jaxdem.state import State

SCENE = Path(__file__).parents[1] / "scenes" / "injection_demo.toml"
"""1,500 grains in 2-D, in a fluid of 40 x 20 cells."""

INTERVALS = 5
"""Of a timed call: those of an output."""


def probes(size: tuple[float, ...]) -> dict[str, dict[str, Any]]:
    """Probes by their name in the table, every one in every coupling interval."""
    middle = 0.5 * size[0]
    profile = {"kind": "profile", "axis": "z", "average": True}
    return {
        "a plane": {"kind": "plane", "axis": "x", "at": middle},
        "an oblique plane": {"kind": "plane", "normal": [1.0, 1.0], "point": [middle, 0.5 * size[1]]},
        "ten points": {"kind": "point", "average": True, "points": [[middle, 0.1 * k * size[1]] for k in range(10)]},
        "a profile of 10 slices": profile | {"cells": 10},
        "a profile of 50 slices": profile | {"cells": 50},
        "a profile of 50 slices, lines every interval": profile | {"cells": 50, "interval": 1},
        "a profile of 50 slices, measured every 5 intervals": profile | {"cells": 50, "sample_interval": 5},
        "the floor": {"kind": "wall", "side": "bottom"},
        "contacts, one list an output": {"kind": "contacts"},
        "contacts, a list an interval": {"kind": "contacts", "interval": 1},
    }


class Contender:
    """A program, what it starts from, and what the host does with its rows."""

    def __init__(self, scene: jaxdem.Scene, folder: Path) -> None:
        self._case = build_case(scene)
        self._state, self._neighbors = self._case.initial_state()
        self._observer = Observer(self._case.probes)
        self._observer.fit(self._state, self._neighbors, self._case.parameters.gravity.dtype)
        folder.mkdir()
        self._files = ProbeFiles(folder, columns_of(self._case.probes))
        self._program = ChunkProgram(
            self._case.simulation, self._case.parameters, self._state, self._neighbors, self._observer.watch
        )
        for _ in range(2):  # contacts, and a flow, to be timed with
            chunk = self._call(self._state, self._neighbors, CHUNK)
            self._state, self._neighbors = chunk.state, chunk.neighbors
        self._first = int(self._state.step)

    def _call(self, state: State, neighbors: Neighbors | None, count: int) -> Chunk:
        return self._program(self._case.parameters, state, neighbors, count, self._observer.watch)

    def seconds(self) -> float:
        """Processor time of `INTERVALS`, from the program to the lines on the disk."""
        begin = time.process_time()
        state, neighbors, done = self._state, self._neighbors, 0
        while done < INTERVALS:
            stop = self._observer.next_stop(self._first + done)
            count = INTERVALS - done if stop is None else min(INTERVALS - done, stop - self._first - done)
            chunk = self._call(state, neighbors, count)
            state, neighbors, done = chunk.state, chunk.neighbors, done + count
            if chunk.probed is not None:
                self._observer.take(chunk.probed, float)
        self._observer.write(self, 0.0)
        return time.process_time() - begin

    def write_probe(self, name: str, _: float, table: np.ndarray) -> None:
        """As `RunDirectory` has it."""
        self._files.append(name, table)


def main() -> None:
    """Runs the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=60)
    parser.add_argument("--only", nargs="*", default=[])
    given = parser.parse_args()
    plain = jaxdem.load_scene(SCENE)
    interval = build_case(plain).simulation.interval
    result = {}
    lines = ["| probe | cost, median (middle half) | pairs |", "| --- | --- | --- |"]
    with tempfile.TemporaryDirectory() as folder:
        without = Contender(plain, Path(folder) / "without")
        for name, keys in probes(plain.domain.size).items():
            if given.only and not any(word in name for word in given.only):
                continue
            keys |= {key: keys[key] * interval for key in ("sample_interval", "interval") if key in keys}
            one = Contender(jaxdem.load_scene(SCENE, {"probes": [{"name": "probe", **keys}]}), Path(folder) / name)
            ratios = [_ratio(without, one, begins=bool(k % 2)) - 1.0 for k in range(given.pairs)]
            low, _, high = statistics.quantiles(ratios, n=4)
            result[name] = harness.spread(ratios) | {"lower_quartile": low, "upper_quartile": high}
            cost = f"{100.0 * statistics.median(ratios):.1f} % ({100.0 * low:.1f} to {100.0 * high:.1f})"
            lines.append(f"| {name} | {cost} | {given.pairs} |")
            harness.save("probes", {"scene": SCENE.name, "intervals": INTERVALS, "cost": result}, "\n".join(lines))
    print("\n".join(lines))


def _ratio(without: Contender, one: Contender, begins: bool) -> float:
    """Time of the one over that of the other; who begins."""
    if begins:
        with_probe, alone = one.seconds(), without.seconds()
    else:
        alone, with_probe = without.seconds(), one.seconds()
    return with_probe / alone


if __name__ == "__main__":
    main()
