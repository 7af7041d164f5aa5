"""What a probe costs that measures in every coupling interval.

    taskset -c 0 python benchmarks/probes.py [--pairs 60] [--only PATTERN ...]

A scene without probes, and the same scene with one probe, as runs in one process, in turns: an output of the one, an
output of the other. The cost is the processor time of the one over that of the other, less 1, per pair. Both have what
runs write: frames, history, and the lines of the probe, one an output, that is every 5 intervals, or one an interval
where the name says so.
"""

from __future__ import annotations

import argparse
import re
import statistics
import sys
import tempfile
import time
import tomllib
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks import harness
from jaxdem.io import RunDirectory
from jaxdem.run.observer import columns_of
from jaxdem.run.time_loop import TimeLoop
from jaxdem.setup.builder import build_case

SCENE = Path(__file__).parents[1] / "scenes" / "injection_demo.toml"
"""1,500 grains in 2-D, in a fluid of 40 x 20 cells."""

END = 1000.0
"""Of the runs, which do not get there [s]."""

BEGIN = 20
"""Outputs before the first that is timed, so that there are contacts and a flow."""

OUTPUTS = 10
"""Outputs after which both go back to that time: so all probes are measured on the same stretch."""


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
    """A run, with what it writes."""

    def __init__(self, scene: jaxdem.Scene, folder: Path) -> None:
        case = build_case(scene)
        state, neighbors = case.initial_state()
        directory = RunDirectory.create(folder, scene.to_toml(), None, columns_of(case.probes))
        self._loop = TimeLoop(case, directory, state, neighbors, sample_every=0)
        self._loop.begin()
        for _ in range(BEGIN):
            self.seconds()
        self._from = self._loop.state, self._loop.neighbors

    def seconds(self) -> float:
        """Processor time from one output to the next, with all that is written."""
        begin = time.process_time()
        while not self._loop.advance():
            pass
        return time.process_time() - begin

    def go_back(self) -> None:
        """To the state after `BEGIN` outputs."""
        self._loop.state, self._loop.neighbors = self._from


def main() -> None:
    """Runs the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=60)
    parser.add_argument("--only", nargs="*", default=[])
    given = parser.parse_args()
    plain = _scene({})
    interval = build_case(plain).simulation.interval
    result = {}
    lines = ["| probe | cost, median (middle half) | pairs |", "| --- | --- | --- |"]
    with tempfile.TemporaryDirectory() as folder:
        without = Contender(plain, Path(folder) / "without")
        for name, keys in probes(plain.domain.size).items():
            if given.only and not any(re.search(words, name) for words in given.only):
                continue
            keys |= {key: keys[key] * interval for key in ("sample_interval", "interval") if key in keys}
            one = Contender(_scene({"probes": [{"name": "probe", **keys}]}), Path(folder) / name)
            ratios = []
            for k in range(given.pairs):
                if k % OUTPUTS == 0:
                    without.go_back()
                    one.go_back()
                ratios.append(_ratio(without, one, begins=bool(k % 2)) - 1.0)
            low, _, high = statistics.quantiles(ratios, n=4)
            result[name] = harness.spread(ratios) | {"lower_quartile": low, "upper_quartile": high}
            cost = f"{100.0 * statistics.median(ratios):.1f} % ({100.0 * low:.1f} to {100.0 * high:.1f})"
            lines.append(f"| {name} | {cost} | {given.pairs} |")
            harness.save("probes", {"scene": SCENE.name, "cost": result}, "\n".join(lines))
    print("\n".join(lines))


def _scene(tables: dict[str, Any]) -> jaxdem.Scene:
    """The scene with these tables, of runs that do not get to their end."""
    times = tomllib.loads(SCENE.read_text())["time"]
    return jaxdem.load_scene(SCENE, {"time": times | {"end": END}, **tables})


def _ratio(without: Contender, one: Contender, begins: bool) -> float:
    """Time of the one over that of the other; who begins."""
    if begins:
        with_probe, alone = one.seconds(), without.seconds()
    else:
        alone, with_probe = without.seconds(), one.seconds()
    return with_probe / alone


if __name__ == "__main__":
    main()
