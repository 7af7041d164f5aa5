"""Drag of a pier with few cells across: whether the layer before it, or the vortices behind it, need more cells.

    python benchmarks/pier.py [--cells 4 8 16 24] [--flows steady mirrored shedding]

A cylinder of diameter 1 in a stream of speed 1 through 8 x 4 diameters, free slip beside it, in float32. "steady" is at
Re = 25. "mirrored" is half of the cylinder and of the box at Re = 100, in which no vortices are shed; "shedding" the
whole one, which a stream that comes in aslant at first makes shed. Figures are means over the last third of the time.
The drag in rho U^2 D / 2 is the sum of friction and pressure. The layer before the stagnation point is D/(2 sqrt(Re))
thick.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jax
import jax.numpy as jnp
import numpy as np

import jaxdem
from benchmarks import harness
from jaxdem.fluid.surface_loads import stress_on_cuts

VISCOUS, COURANT = 0.28, 0.3


class Flow(NamedTuple):
    """A stream round the pier.

    Attributes:
        reynolds: of the diameter [-].
        end: of the run, in D/U.
        mirrored: half of the cylinder, whose middle is on the lower side of half of the box.
        aslant: whether the stream comes in aslant for the first 2.5 D/U.
    """

    reynolds: float
    end: float
    mirrored: bool = False
    aslant: bool = False


FLOWS = {
    "steady": Flow(25.0, 20.0),
    "mirrored": Flow(100.0, 60.0, mirrored=True),
    "shedding": Flow(100.0, 60.0, aslant=True),
}


def tables(flow: Flow, cells: int) -> dict[str, Any]:
    """The scene with so many cells a diameter."""
    viscosity, spacing = 1.0 / flow.reynolds, 1.0 / cells
    size = [8.0, 2.0 if flow.mirrored else 4.0]
    inlet: dict[str, Any] = {"kind": "inlet", "velocity": [1.0, 0.0], "ramp_time": 0.0}
    if flow.aslant:
        inlet = {"kind": "inlet", "times": [0.0, 2.5, 3.0], "velocities": [[1.0, 0.5], [1.0, 0.5], [1.0, 0.0]]}
    center = [2.51, 0.0 if flow.mirrored else 1.98]
    return {
        "domain": {"size": size, "depth": 1.0, "gravity": [0.0, 0.0]},
        "fluid": {
            "cells": [round(length * cells) for length in size],
            "density": 1.0,
            "viscosity": viscosity,
            "time_step": min(VISCOUS * spacing**2 / (2.0 * viscosity), COURANT * spacing),
            "velocity": [1.0, 0.0],
        },
        "walls": [{"kind": "cylinder", "center": center, "radius": 0.5, "inside": False, "fluid": "no_slip"}],
        "boundary": {
            "left": inlet,
            "right": {"kind": "outlet"},
            "bottom": {"kind": "free_slip"},
            "top": {"kind": "free_slip"},
        },
        "time": {"end": flow.end, "output_interval": flow.end},
    }


def drag(name: str, cells: int) -> dict[str, Any]:
    """Drag coefficient, its parts, and half of the range of the lift coefficient."""
    flow = FLOWS[name]
    scene = jaxdem.load_scene(tables(flow, cells))
    simulation, parameters = jaxdem.build(scene)
    state, _ = jaxdem.initial_state(scene, simulation, parameters)
    count, grid = math.ceil(flow.end / simulation.interval), simulation.fluid.solver.grid

    @jax.jit
    def march(state):
        def body(state, _):
            state, _, told = simulation.step(parameters, state, None)
            pressure = stress_on_cuts(grid, parameters.fluid.cut, state.fluid.pressure, jnp.zeros(()))[0].sum()
            return state, jnp.stack([*told.fluid.surface_load[0, :, 0], pressure])

        return jax.lax.scan(body, state, None, length=count)[1]

    series = np.asarray(march(state), float) * (4.0 if flow.mirrored else 2.0)
    whole, lift, pressure = series[-count // 3 :].T
    return {
        "flow": name, "cells": cells, "layer": cells / (2.0 * math.sqrt(flow.reynolds)), "drag": whole.mean(),
        "friction": (whole - pressure).mean(), "pressure": pressure.mean(),
        "lift": 0.0 if flow.mirrored else float(np.ptp(lift)) / 2.0,
    }  # fmt: skip


def table_of(rows: list[dict[str, Any]]) -> str:
    """The figures, with what the drag is off from that of the finest mesh."""
    lines = [
        "| flow | cells a diameter | cells in the layer | drag coefficient | off | friction | pressure | lift, +- |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for row in rows:
        finest = max((r for r in rows if r["flow"] == row["flow"]), key=lambda r: r["cells"])
        off = 100.0 * (row["drag"] / finest["drag"] - 1.0)
        parts = " | ".join(f"{row[k]:.4g}" for k in ("friction", "pressure", "lift"))
        lines.append(
            f"| {row['flow']} | {row['cells']} | {row['layer']:.2g} | {row['drag']:.4g} | {off:+.1f} % | {parts} |"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--cells", nargs="+", type=int, default=[4, 8, 16, 24])
    parser.add_argument("--flows", nargs="+", default=list(FLOWS), choices=list(FLOWS))
    given = parser.parse_args()
    rows = []
    for name in given.flows:
        for cells in given.cells:
            rows.append(drag(name, cells))
            harness.save("pier", {"rows": rows}, table_of(rows))
    print(table_of(rows))


if __name__ == "__main__":
    main()
