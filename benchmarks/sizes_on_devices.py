"""What lists by levels of size bring on two devices: a contact step of the column of `sizes.py`, 1 : 10.

    XLA_FLAGS=--xla_force_host_platform_device_count=2 python benchmarks/sizes_on_devices.py [--count 4000]

The column is cut into two slabs in one process. It takes the same contact steps from the same state on one device, in
slabs with lists by levels, and in slabs with one table for grains of all sizes, in turns. The figure is the least
processor time of a step, of both slabs together.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks import harness
from benchmarks.sizes import scene_of
from jaxdem import devices


class Contender:
    """The column and its program.

    Attributes:
        simulation: of it, on one device or in slabs.
        now: state and list.
    """

    def __init__(self, simulation: Any, parameters: Any, now: tuple[Any, Any]) -> None:
        self.simulation, self.parameters, self.now = simulation, parameters, now
        self.compile()

    def compile(self) -> None:
        """The program for lists of the present room."""

        def advance(state: Any, neighbors: Any) -> Any:
            return self.simulation.step(self.parameters, state, neighbors)[:2]

        self.advance: Callable[..., Any] = jax.jit(advance).lower(*self.now).compile()

    def run(self, intervals: int) -> float:
        """Processor time of a contact step in so many intervals from now [s]; a list without room is enlarged."""
        now, begin = self.now, time.process_time()
        for _ in range(intervals):
            after = jax.block_until_ready(self.advance(*now))
            if np.any(after[1].overflow):
                if isinstance(self.simulation, devices.DividedSimulation):
                    self.now = devices.enlarged(self.simulation, self.parameters, *self.now, after[1])
                else:
                    self.now = self.simulation.with_room(*self.now, self.now[1].room.enlarged())
                self.compile()
                return self.run(intervals)
            now = after
        return (time.process_time() - begin) / (intervals * self.simulation.steps.contacts_per_interval)


def main() -> None:
    """Measures, and writes the result."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, value in (("count", 4000), ("intervals", 2), ("rounds", 3), ("ratio", 10.0)):
        parser.add_argument(f"--{name}", type=type(value), default=value)
    arguments = parser.parse_args()
    scene, _ = scene_of(2, arguments.ratio, arguments.count)
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    contenders = {"one device": Contender(simulation, parameters, (state, neighbors))}
    for name, whole in (("two slabs, levels", simulation), ("two slabs, one table", simulation.without_levels())):
        divided = devices.divided(whole, 2, np.asarray(state.particles.position))
        slabs = devices.distributed(divided, parameters, state, neighbors)
        contenders[name] = Contender(divided, parameters, slabs)
    times: dict[str, list[float]] = {name: [] for name in contenders}
    for one in contenders.values():
        one.run(arguments.intervals)
    for _ in range(arguments.rounds):
        for name, one in contenders.items():
            times[name].append(one.run(arguments.intervals))
    lines = [
        "| column | contact step [ms] | over one device | room for pairs | ghosts |",
        "| --- | --- | --- | --- | --- |",
    ]
    rows: dict[str, Any] = {}
    for name, one in contenders.items():
        listed, least = one.now[1], min(times[name])
        ghosts = 0 if listed.ghosts is None else int(devices.counts(listed).ghosts.sum())
        rows[name] = {"seconds_per_step": times[name], "pairs": int(listed.overlap.size), "ghosts": ghosts}
        over = least / min(times["one device"])
        lines.append(f"| {name} | {1e3 * least:.2f} | {over:.2f} | {rows[name]['pairs']} | {ghosts} |")
    given = {"count": arguments.count, "ratio": arguments.ratio, "intervals": arguments.intervals}
    harness.write("sizes_on_devices", {"arguments": given, "rows": rows}, "\n".join(lines))


if __name__ == "__main__":
    main()
