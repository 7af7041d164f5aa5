"""Time of a fluid step with two fluids against that of one fluid on the same mesh, and iterations of the pressure.

A column of water that collapses, in a box of 128 x 96 cells, float32, also with surface tension, with a scalar in the
water that diffuses, and with temperatures; the one fluid is stirred by a lid. Steps of all are timed in turns in one
process, in processor time, and the least of each counts. Iterations are those of the same flow in float64 to a
tolerance of 2e-12, with the multigrid cycle and with the fast inverse of a constant coefficient as the preconditioner.
Writes results/surface.{json,md}. With --stretched it writes results/surface_stretched.{json,md}: the iterations with
the multigrid cycle in boxes that are longer, so that cells are.

    python benchmarks/surface.py [--repeats 5] [--stretched]
"""

from __future__ import annotations

import argparse
import math
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
from jaxdem.fluid import projection
from jaxdem.fluid.multigrid import multigrid
from jaxdem.fluid.pressure import fast_inverse

STEPS, BEFORE = 10, 40
"""Steps that are timed together, and steps before them, in which the column begins to move."""


SALT = {"name": "salt", "diffusivity": 1e-5, "value": 1.0}
"""Dissolved in the water."""

WARM = {
    "surface": {"heat_capacity": 1007.0, "conductivity": 0.026, "temperature": 290.0},
    "heat": {"fluid_heat_capacity": 4180.0, "fluid_conductivity": 0.6, "fluid_temperature": 350.0},
}
"""Warm water under cooler air."""

ASPECTS = (1.0, 2.0, 4.0, 8.0)
"""Length of a cell over its height."""


def tables(
    cells: list[int], ratio: float | None, precision: str = "float32", aspect: float = 1.0, **more: Any
) -> dict[str, Any]:
    """A column of water in the corner of a box; without a ratio of densities one fluid under a lid; `more` tables."""
    found: dict[str, Any] = {
        "precision": precision,
        "domain": {"size": [0.64 * aspect, 0.48], "gravity": [0.0, -9.81]},
        "fluid": {"cells": cells, "density": 1000.0, "viscosity": 1e-6, "time_step": 0.064 / cells[0]},
        "boundary": {"top": {"kind": "moving_wall", "velocity": [0.5, 0.0]}},
        "time": {"end": 6.4, "output_interval": 0.64},
    }
    if ratio is not None:
        found["surface"] = {"density": 1000.0 / ratio, "viscosity": 1e-5}
        found["surface"] |= more.pop("surface", {})
        found["surface"]["regions"] = [{"shape": "box", "start": [-1.0, -1.0], "stop": [0.16 * aspect, 0.32]}]
    return found | more


class Flow:
    """A scene under way; see `tables`."""

    def __init__(self, scene_tables: dict[str, Any]):
        scene = jaxdem.load_scene(scene_tables)
        simulation, parameters = jaxdem.build(scene)
        self.state, _ = jaxdem.initial_state(scene, simulation, parameters)
        self.iterations: list[int] = []
        self._step = jax.jit(lambda state: simulation.step(parameters, state, None))
        for _ in range(BEFORE):
            self.advance()

    def advance(self) -> None:
        """One step."""
        self.state, _, report = self._step(self.state)
        self.iterations.append(int(report.fluid.iterations))

    def seconds(self) -> float:
        """Processor time of a step [s]."""
        before = time.process_time()
        for _ in range(STEPS):
            self.state = self._step(self.state)[0]
        jax.block_until_ready(self.state)
        return (time.process_time() - before) / STEPS


def iterations(ratio: float, inverse: Callable[..., Any], aspect: float = 1.0) -> float:
    """Mean iterations of the pressure in a step, with a preconditioner."""
    projection.multigrid = inverse
    flow = Flow(tables([64, 48], ratio, "float64", aspect))
    projection.multigrid = multigrid
    return float(np.mean(flow.iterations[BEFORE // 2 :]))


def stretched() -> None:
    """Iterations by the aspect of the cells, and their table."""
    jax.config.update("jax_enable_x64", True)
    counts = {aspect: iterations(1000.0, multigrid, aspect) for aspect in ASPECTS}
    lines = [
        "| aspect of the cells | " + " | ".join(f"{aspect:g}" for aspect in counts) + " |",
        "| --- " * (len(counts) + 1) + "|",
        "| iterations, 64 x 48 cells, float64, density ratio 1,000 | "
        + " | ".join(f"{n:.1f}" for n in counts.values())
        + " |",
    ]
    harness.write("surface_stretched", {"iterations": counts}, "\n".join(lines))


def main() -> None:
    """Times, iterations, and the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--stretched", action="store_true")
    given = parser.parse_args()
    if given.stretched:
        return stretched()
    repeats = given.repeats
    flows = {
        "one fluid": Flow(tables([128, 96], None)),
        "two fluids": Flow(tables([128, 96], 833.0)),
        "two fluids, surface tension": Flow(tables([128, 96], 833.0, surface={"tension": 0.07})),
        "two fluids, a scalar in the water": Flow(tables([128, 96], 833.0, scalars=[SALT])),
        "two fluids, temperatures": Flow(tables([128, 96], 833.0, **WARM)),
    }
    best = dict.fromkeys(flows, math.inf)
    for _ in range(repeats):
        for name, flow in flows.items():
            best[name] = min(best[name], flow.seconds())
    ratio = best["two fluids"] / best["one fluid"]
    over = {name: seconds / best["two fluids"] for name, seconds in best.items() if name.startswith("two fluids, ")}
    told = {name: {"ms": 1e3 * best[name], "iterations": float(np.mean(flows[name].iterations[-20:]))} for name in best}
    jax.config.update("jax_enable_x64", True)
    cycles = {
        "multigrid cycle": multigrid,
        "fast inverse": lambda grid, boundary, coefficient: fast_inverse(grid, boundary),
    }
    counts = {name: {r: iterations(r, inverse) for r in (1.5, 10.0, 100.0, 1000.0)} for name, inverse in cycles.items()}
    lines = ["| 128 x 96 cells, float32 | step [ms] | iterations |", "| --- | --- | --- |"]
    lines += [f"| {name} | {row['ms']:.2f} | {row['iterations']:.1f} |" for name, row in told.items()]
    lines += [
        "",
        f"Ratio of two fluids to one {ratio:.2f}.",
        "Over two fluids alone: " + ", ".join(f"{name[12:]} {factor:.2f}" for name, factor in over.items()) + ".",
        "",
        "| iterations by density ratio, 64 x 48 cells, float64 | 1.5 | 10 | 100 | 1,000 |",
    ]
    lines += ["| --- | --- | --- | --- | --- |"]
    lines += [f"| {name} | " + " | ".join(f"{n:.1f}" for n in row.values()) + " |" for name, row in counts.items()]
    harness.write(
        "surface",
        {"steps": told, "ratio": ratio, "over": over, "iterations": counts, "repeats": repeats},
        "\n".join(lines),
    )


if __name__ == "__main__":
    main()
