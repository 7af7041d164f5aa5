"""What a probe costs that measures in every coupling interval.

    python benchmarks/probes.py [--pairs 9] [--only WORD ...]

A scene without probes, and the same scene with one probe, as the programs that runs use, in one process and in turns,
from the same state. The cost is the processor time of the one over that of the other, less 1, per pair.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from pathlib import Path
from typing import Any

import jax

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks import harness
from jaxdem.run.chunk import CHUNK, ChunkProgram
from jaxdem.run.observer import Observer
from jaxdem.setup.builder import build_case

SCENE = Path(__file__).parents[1] / "scenes" / "injection_demo.toml"
"""1,500 grains in 2-D, in a fluid of 40 x 20 cells."""

INTERVALS = 32
"""Of a timed call."""


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
        "a profile of 50 slices every 5 intervals": profile | {"cells": 50, "sample": 5},
    }


class Contender:
    """A program and what it starts from."""

    def __init__(self, scene: jaxdem.Scene) -> None:
        self._case = build_case(scene)
        self._state, self._neighbors = self._case.initial_state()
        self._observer = Observer(self._case.probes)
        self._observer.fit(self._state, self._neighbors, self._case.parameters.gravity.dtype)
        self._program = ChunkProgram(
            self._case.simulation, self._case.parameters, self._state, self._neighbors, self._observer.watch
        )
        for _ in range(2):  # contacts, and a flow, to be timed with
            chunk = self._call(CHUNK)
            self._state, self._neighbors = chunk.state, chunk.neighbors

    def _call(self, count: int) -> Any:
        given = (self._case.parameters, self._state, self._neighbors, count, self._observer.watch)
        return jax.block_until_ready(self._program(*given))

    def seconds(self) -> float:
        """Processor time of a call."""
        begin = time.process_time()
        self._call(INTERVALS)
        return time.process_time() - begin


def main() -> None:
    """Runs the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=9)
    parser.add_argument("--only", nargs="*", default=[])
    given = parser.parse_args()
    plain = jaxdem.load_scene(SCENE)
    interval = build_case(plain).simulation.interval
    without, result = Contender(plain), {}
    lines = ["| probe | cost, median (range) | pairs |", "| --- | --- | --- |"]
    for name, keys in probes(plain.domain.size).items():
        if given.only and not any(word in name for word in given.only):
            continue
        sample = keys.pop("sample", None)
        keys |= {} if sample is None else {"sample_interval": sample * interval}
        scene = jaxdem.load_scene(SCENE, {"probes": [{"name": "probe", **keys}]})
        one = Contender(scene)
        ratios = []
        for k in range(given.pairs):
            if k % 2:
                with_probe, alone = one.seconds(), without.seconds()
            else:
                alone, with_probe = without.seconds(), one.seconds()
            ratios.append(with_probe / alone - 1.0)
        spread = harness.spread(ratios)
        result[name] = spread
        low, high = 100.0 * spread["lowest"], 100.0 * spread["highest"]
        lines.append(
            f"| {name} | {100.0 * statistics.median(ratios):.1f} % ({low:.1f} to {high:.1f}) | {given.pairs} |"
        )
        harness.save("probes", {"scene": SCENE.name, "intervals": INTERVALS, "cost": result}, "\n".join(lines))
    print("\n".join(lines))


if __name__ == "__main__":
    main()
