"""Windows of work of the jaxdem in the working directory, timed at the word of `against.py`.

Only public names of jaxdem are used, so that checkouts may differ inside: `load_scene`, `build`, `initial_state` and
`Simulation.step`, or `simulate` for whole runs.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax

import jaxdem


def serve(work: dict[str, Any]) -> None:
    """A window for every line of standard input; its wall and processor time as a line of JSON."""
    scene, changes = work["scene"], work["changes"]
    window = steps(scene, changes, work["intervals"], work["warm_up"]) if work["intervals"] else runs(scene, changes)
    print(json.dumps("ready"), flush=True)
    for _ in sys.stdin:
        print(json.dumps(window()), flush=True)


def steps(path: str, changes: dict[str, Any], intervals: int, warm_up: int) -> Callable[[], dict[str, float]]:
    """Windows of coupling intervals, one after the other along one motion."""
    scene = jaxdem.load_scene(path, changes)
    simulation, parameters = jaxdem.build(scene)
    now = jaxdem.initial_state(scene, simulation, parameters)
    advance = jax.jit(lambda state, neighbors: simulation.step(parameters, state, neighbors)[:2]).lower(*now).compile()

    def window(count: int = intervals) -> dict[str, float]:
        nonlocal now
        wall, processor = time.perf_counter(), time.process_time()
        for _ in range(count):
            now = advance(*now)
        jax.block_until_ready(now)
        assert now[1] is None or not now[1].overflow, "the neighbour list ran out of room"
        return {"seconds": time.perf_counter() - wall, "processor": time.process_time() - processor}

    window(max(warm_up, 1))
    return window


def runs(path: str, changes: dict[str, Any]) -> Callable[[], dict[str, float]]:
    """Whole runs, without what they compile."""

    def window() -> dict[str, float]:
        with tempfile.TemporaryDirectory() as folder:
            summary = jaxdem.simulate(jaxdem.load_scene(path, changes), Path(folder) / "run").summary
        assert summary["valid"], summary["reason"]
        return {"seconds": summary["wall_time_s"] - summary["stages_s"]["compile"]}

    return window


if __name__ == "__main__":
    found = Path(jaxdem.__file__).resolve().parents[1]
    assert found == Path.cwd().resolve(), f"imports jaxdem of {found}"
    serve(json.loads(sys.argv[1]))
