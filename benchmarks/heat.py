"""Time of a coupling interval with temperatures against the same interval without.

Three scenes: grains in a gas (exchange of heat, conduction through contacts), a fluid alone (a cavity), and two fluids
with a surface (a column of warm water that collapses). With heat and
without they begin from one state, grains and stream as they are after a while with heat: without it the fluid of the
cavity would be at rest, and its pressure would take no iteration. Their intervals are timed in turns in one process, in
processor time, and the least of each counts. A further row is the bed with heat of friction over the bed with heat.
Writes results/heat.{json,md}; with --only that row alone, into a file of its own.

    python benchmarks/heat.py [--repeats 7] [--only "two fluids"]
"""

from __future__ import annotations

import argparse
import copy
import math
import sys
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks import harness, surface

SCENES = Path(__file__).parents[1] / "scenes"
INTERVALS = 10
"""Coupling intervals that are timed together."""

BEFORE = 200
"""Coupling intervals with heat before the timing."""


def tables_of(name: str) -> dict[str, Any]:
    """Tables of a shipped scene."""
    return tomllib.loads((SCENES / f"{name}.toml").read_text())


def bed_tables() -> dict[str, Any]:
    """The heated bed, 10,000 grains on 60 x 60 cells."""
    tables = tables_of("heated_bed")
    tables["domain"]["size"] = [0.3, 0.3]
    tables["particles"]["count"] = 10_000
    tables["particles"]["pack"]["stop"] = [0.3, 0.15]
    tables["fluid"]["cells"] = [60, 60]
    return tables


def cavity_tables() -> dict[str, Any]:
    """The cavity on 128 x 128 cells."""
    tables = tables_of("cavity")
    tables["fluid"] |= {"cells": [128, 128], "time_step": 0.002}
    return tables


def surface_tables() -> dict[str, Any]:
    """The column of water of `benchmarks/surface.py` on 128 x 96 cells, warm."""
    return surface.tables([128, 96], 1000.0, **surface.WARM)


def without_heat(tables: dict[str, Any]) -> dict[str, Any]:
    """The same scene without temperatures."""
    found = copy.deepcopy(tables)
    del found["heat"]
    for key in ("heat_capacity", "conductivity", "temperature"):
        found.get("surface", {}).pop(key, None)
    for side in found["boundary"].values():
        side.pop("temperature", None)
    found["boundary"] = {name: side for name, side in found["boundary"].items() if side}
    return found


def built(tables: dict[str, Any]) -> tuple[Callable[..., Any], Any]:
    """The step of a scene, and its first state and neighbour list."""
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    first = jaxdem.initial_state(scene, simulation, parameters)
    return jax.jit(lambda state, neighbors: simulation.step(parameters, state, neighbors)[:2]), first


def timer(step: Callable[..., Any], start: Any) -> Callable[[], float]:
    """A function that advances a scene from a state and list, and gives the processor time of an interval [s]."""

    def once() -> float:
        going, before = start, time.process_time()
        for _ in range(INTERVALS):
            going = step(*going)
        jax.block_until_ready(going[0])
        return (time.process_time() - before) / INTERVALS

    once()
    return once


def with_friction(tables: dict[str, Any]) -> dict[str, Any]:
    """The same scene with heat of friction."""
    return tables | {"heat": tables["heat"] | {"friction": True}}


def without_scalars(state: Any) -> Any:
    """The state of a scene without temperatures."""
    return state._replace(scalars=None)


def without_friction(state: Any) -> Any:
    """The state of a scene without heat of friction."""
    supplied = state.scalars.supplied._replace(friction=None)
    return state._replace(scalars=state.scalars._replace(supplied=supplied))


def both_kinds(
    tables: dict[str, Any], plain: dict[str, Any], reduced: Callable[[Any], Any]
) -> dict[str, Callable[[], float]]:
    """Timers of a scene and of a plainer one, from one state; `reduced` makes it that of the plainer one."""
    full, going = built(tables)
    for _ in range(BEFORE):
        going = full(*going)
    without, _ = built(plain)
    state, neighbors = going
    return {"with": timer(full, going), "without": timer(without, (reduced(state), neighbors))}


def main() -> None:
    """Both scenes, and the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--only", default="", help="name of a row")
    arguments = parser.parse_args()
    rows: dict[str, dict[str, float]] = {}
    bed, cavity, warm = bed_tables(), cavity_tables(), surface_tables()
    scenes = {
        "bed": (bed, without_heat(bed), without_scalars),
        "cavity": (cavity, without_heat(cavity), without_scalars),
        "bed, heat of friction": (with_friction(bed), bed, without_friction),
        "two fluids": (warm, without_heat(warm), without_scalars),
    }
    for name, given in scenes.items():
        if arguments.only not in ("", name):
            continue
        steps = both_kinds(*given)
        best = dict.fromkeys(steps, math.inf)
        for _ in range(arguments.repeats):
            for kind, once in steps.items():
                best[kind] = min(best[kind], once())
        rows[name] = {f"{kind}_ms": 1e3 * value for kind, value in best.items()}
        rows[name]["ratio"] = best["with"] / best["without"]
    lines = ["| scene | without [ms] | with [ms] | ratio |", "| --- | --- | --- | --- |"]
    lines += [f"| {n} | {r['without_ms']:.2f} | {r['with_ms']:.2f} | {r['ratio']:.2f} |" for n, r in rows.items()]
    written = "heat" + (f"_{arguments.only.replace(' ', '_')}" if arguments.only else "")
    harness.write(written, {"intervals": rows, "repeats": arguments.repeats}, "\n".join(lines))


if __name__ == "__main__":
    main()
