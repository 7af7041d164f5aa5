"""Cost of a fluid step between walls that the fluid sees, over one on the same mesh without them.

    taskset -c 0 python benchmarks/cut_cells.py [--cases cylinder pipe] [--rounds 15] [--precision float32]

Both are programs of one process and take turns, a window each, from a state that is kept: so windows of one case do the
same work. A window is a number of coupling intervals of one fluid step, in one compiled loop as in a run, with the load
on the walls. Figures are processor times. "start" is from rest, "developed" after the flow has formed.

The case "cylinder" is a jet in 2-D that meets a cylinder of 20 cells at a Reynolds number of 500; "pipe" a jet in 3-D
into a round pipe, 22 cells across; "sphere" the same jet onto a sphere of 10 cells. Without walls the jet is the same.
"swinging cylinder" is the cylinder that swings by two cells, over the same at rest.
No flow becomes steady, so that every step has a pressure to find.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jax
import jax.numpy as jnp
import trimesh

import jaxdem
from benchmarks import harness
from jaxdem.state import Parameters, State


class Setting(NamedTuple):
    """A case: the tables of its scene, the wall that one of its two programs has, and steps of a window and before it.

    Attributes:
        scene: tables without walls.
        wall: that the fluid sees.
        steps: fluid steps of a window.
        before: fluid steps until the flow has formed.
        other: walls of the other program.
    """

    scene: dict[str, Any]
    wall: dict[str, Any]
    steps: int
    before: int
    other: tuple[dict[str, Any], ...] = ()


def jet(cells: tuple[int, ...], spacing: float, viscosity: float, step: float) -> dict[str, Any]:
    """A box that a stream of 1 m/s enters through the middle half of its left side, and leaves on the right."""
    size = [count * spacing for count in cells]
    patch = {"from": [0.25 * length for length in size[1:]], "to": [0.75 * length for length in size[1:]]}
    return {
        "domain": {"size": size, "gravity": [0.0] * len(cells)},
        "fluid": {"cells": list(cells), "density": 1.0, "viscosity": viscosity, "time_step": step},
        "boundary": {
            "left": {"kind": "inlet", "velocity": [1.0] + [0.0] * (len(cells) - 1), "ramp_time": 0.0, **patch},
            "right": {"kind": "outlet"},
        },
        "time": {"end": 1000.0 * step, "output_interval": 1000.0 * step},
    }


CASES = ("cylinder", "pipe", "sphere", "swinging cylinder")
ACROSS = {"kind": "cylinder", "center": [2.02, 1.61], "radius": 0.5, "inside": False, "fluid": "no_slip"}
SWINGING = {"motion": [{"kind": "oscillation", "direction": [0.0, 1.0], "amplitude": 0.1, "frequency": 0.1}]}
TUBE = {"kind": "cylinder", "center": [0.0, 0.6, 0.61], "axis": [1.0, 0.0, 0.0], "radius": 0.55, "fluid": "no_slip"}


def settings(folder: Path) -> dict[str, Setting]:
    """Cases by name; the folder is for the file of a mesh."""
    flat, solid = jet((128, 64), 0.05, 2e-3, 0.01), jet((48, 24, 24), 0.05, 1e-3, 0.01)
    return {
        "cylinder": Setting(flat, ACROSS, 60, 3000),
        "pipe": Setting(solid, TUBE, 15, 800),
        "sphere": Setting(solid, ball((0.81, 0.61, 0.59), 0.25, folder), 15, 800),
        "swinging cylinder": Setting(flat, ACROSS | SWINGING, 20, 60, (ACROSS,)),
    }


def ball(center: tuple[float, ...], radius: float, folder: Path) -> dict[str, Any]:
    """A wall from a closed mesh of 1,280 triangles."""
    made = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    made.apply_translation(center)
    path = folder / "ball.stl"
    made.export(path)
    return {"kind": "mesh", "file": str(path), "fluid": "no_slip"}


class Program:
    """A scene as a compiled loop of intervals, and its states at rest and after the flow has formed."""

    def __init__(self, tables: dict[str, Any], setting: Setting) -> None:
        scene = jaxdem.load_scene(tables)
        self.simulation, self.parameters = jaxdem.build(scene)
        self.steps = setting.steps
        rest, _ = jaxdem.initial_state(scene, self.simulation, self.parameters)
        self.advance = jax.jit(self._advance).lower(self.parameters, rest, 1).compile()
        self.starts = {"start": rest, "developed": self.advance(self.parameters, rest, setting.before)[0]}

    def _advance(self, parameters: Parameters, state: State, steps: jax.Array) -> tuple[State, dict[str, jax.Array]]:
        def body(_: int, carry: tuple[State, dict[str, jax.Array]]) -> tuple[State, dict[str, jax.Array]]:
            state, told = carry
            state, _, report = self.simulation.step(parameters, state, None)
            fluid = report.fluid
            load = 0.0 if fluid.surface_load is None else jnp.sum(fluid.surface_load[:, 0, 0])
            return state, {
                "steps": told["steps"] + fluid.substeps.astype(jnp.int32),
                "iterations": told["iterations"] + fluid.iterations.astype(jnp.int32),
                "divergence": jnp.maximum(told["divergence"], fluid.divergence),
                "converged": told["converged"] & fluid.converged,
                "load": told["load"] + load,
            }

        zero = jnp.zeros((), state.fluid.pressure.dtype)
        none, yes = jnp.zeros((), jnp.int32), jnp.asarray(True)
        told = {"steps": none, "iterations": none, "divergence": zero, "converged": yes, "load": zero}
        return jax.lax.fori_loop(0, steps, body, (state, told))

    def window(self, stage: str) -> dict[str, float]:
        """Processor time of a step [s], iterations of its projection, largest divergence in units of U/h."""
        begun = time.process_time()
        state, told = self.advance(self.parameters, self.starts[stage], self.steps)
        jax.block_until_ready(state)
        seconds = time.process_time() - begun
        assert bool(told["converged"]), "a pressure did not converge"
        assert int(told["steps"]) == self.steps, "an interval is more than one fluid step"
        return {
            "seconds": seconds / self.steps,
            "iterations": float(told["iterations"]) / self.steps,
            "divergence": float(told["divergence"]),
        }


def measured(setting: Setting, rounds: int, precision: str) -> dict[str, Any]:
    """Windows of both programs in turns, by stage."""
    scene = setting.scene | {"precision": precision}
    pair: dict[str, Callable[[str], dict[str, float]]] = {
        "without": Program(scene | {"walls": list(setting.other)}, setting).window,
        "with": Program(scene | {"walls": [setting.wall]}, setting).window,
    }
    found = {}
    for stage in ("start", "developed"):
        rows = [{name: window(stage) for name, window in pair.items()} for _ in range(rounds + 1)][1:]
        seconds = {name: [row[name]["seconds"] for row in rows] for name in pair}
        found[stage] = {
            "ratio": harness.spread([row["with"]["seconds"] / row["without"]["seconds"] for row in rows]),
            **{name: harness.spread(values) for name, values in seconds.items()},
            "iterations": {name: rows[-1][name]["iterations"] for name in pair},
            "divergence": {name: rows[-1][name]["divergence"] for name in pair},
        }
    return found


def table_of(result: dict[str, Any]) -> str:
    """The figures as a table of Markdown."""
    lines = [
        "| case | flow | ms a step, without walls | with | ratio, median (range) "
        "| iterations, without and with | divergence, without and with |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for case, stages in result.items():
        for stage, row in stages.items():
            times = [f"{1e3 * row[name]['median']:.3g}" for name in ("without", "with")]
            ratio = f"{row['ratio']['median']:.2f} ({row['ratio']['lowest']:.2f}-{row['ratio']['highest']:.2f})"
            counts = " and ".join(f"{row['iterations'][name]:.1f}" for name in ("without", "with"))
            left = " and ".join(f"{row['divergence'][name]:.1e}" for name in ("without", "with"))
            lines.append(f"| {case} | {stage} | {times[0]} | {times[1]} | {ratio} | {counts} | {left} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--cases", nargs="+", default=list(CASES), choices=CASES)
    parser.add_argument("--rounds", type=int, default=15, help="windows of each program")
    parser.add_argument("--precision", default="float32", choices=["float32", "float64"])
    parser.add_argument("--dry", action="store_true", help="print the table, write nothing")
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", given.precision == "float64")
    with tempfile.TemporaryDirectory() as folder:
        cases = settings(Path(folder))
        result = {case: measured(cases[case], given.rounds, given.precision) for case in given.cases}
    if given.dry:
        print(table_of(result))
    else:
        harness.write("cut_cells", {"precision": given.precision, "cases": result}, table_of(result))


if __name__ == "__main__":
    main()
