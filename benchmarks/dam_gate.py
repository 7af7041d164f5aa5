"""The dam break of Martin & Moyce behind a gate that takes time to open: front and height against their tables.

The gate is a resistance on the faces of the mesh at the edge of the column, so large that nothing passes, which goes
away as the gate is lifted from the floor or lowered from the top of the column. Also without a gate and with a floor
without slip and a viscosity a thousand times as large, as of a stream that is rough and turbulent. Errors are by the
paper's own clock, and after Z = 1.44 with the clocks equal there. Writes results/dam_gate.{json,md}.

    python benchmarks/dam_gate.py [--cells 16]
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

from benchmarks import harness
from jaxdem.fluid.fluid_state import FaceExchange, FluidState, ParticleFields
from tests.cases.registry import table
from tests.cases.two_fluids import LIQUID, Dam

UNTIL = 3.4
"""End, in units of sqrt(a / 2 g)."""

UNIT = math.sqrt(Dam.width / (2.0 * 9.81))

LIFTED, LOWERED = (4.0, 2.0, 1.0), (10.0, 8.0, 7.0, 6.0, 4.0)
"""Speeds of the gate [m/s]."""


def watched(dam: Dam, cells: int, lowered: bool) -> Callable[[float], tuple[np.ndarray, np.ndarray]]:
    """Times in units of sqrt(a / 2 g), and front and height after each step, by the speed of the gate [m/s]."""
    box, step = dam.box, 0.2 * Dam.width / cells
    grid, steps = box.grid, int(UNTIL * UNIT / step)
    h, middles, ones = grid.spacing[1], jnp.asarray(box.middles(1)[0]), jnp.ones(grid.cells)
    none = tuple(jnp.zeros(grid.face_shape(axis)) for axis in range(2))

    @jax.jit
    def found(speed: jax.Array) -> tuple[jax.Array, jax.Array]:
        def body(state: FluidState, k: jax.Array) -> tuple[FluidState, Any]:
            moved = speed * k * step
            above = 2.0 * Dam.width - moved - middles if lowered else middles - moved
            shut = jnp.clip(above / h + 0.5, 0.0, 1.0)
            resistance = none[0].at[cells].set(1e5 * LIQUID * grid.cell_volume * shut**4)
            gate = ParticleFields(ones, FaceExchange((resistance, none[1]), none))
            result = box.solver.step(dam.properties, state, k * step, jnp.asarray(step), gate)
            return result.state, (dam.seen(result.state), result.solver.converged)

        start = dam.start(2.0 * Dam.width)._replace(void_fraction=ones)
        _, (seen, converged) = lax.scan(body, start, jnp.arange(steps))
        return jnp.where(jnp.all(converged), seen, jnp.nan), (jnp.arange(steps) + 1.0) * step / UNIT

    def of_speed(speed: float) -> tuple[np.ndarray, np.ndarray]:
        seen, times = found(jnp.asarray(speed))
        return np.asarray(times), np.asarray(seen)

    return of_speed


def errors(times: np.ndarray, seen: np.ndarray) -> dict[str, float]:
    """Of front and height against the tables; how late the front is at Z = 1.44, in units of sqrt(a / 2 g)."""
    (front, height), paper, heights = seen.T, table("martin_moyce_front.csv"), table("martin_moyce_height.csv")
    paper, heights = paper[paper["T"] < UNTIL - 0.2], heights[heights["tau"] < times[-1] / math.sqrt(2.0)]
    late = float(np.interp(1.44, front, times) - np.interp(1.44, paper["Z"], paper["T"]))
    own, shifted = (np.abs(np.interp(paper["T"] + by, times, front) / paper["Z"] - 1.0) for by in (0.0, late))
    apart = np.interp(math.sqrt(2.0) * heights["tau"], times, height) - heights["H"]
    return {
        "late": late,
        "own_clock": float(own.max()),
        "after": float(shifted[paper["Z"] >= 1.44].max()),
        "height": float(np.abs(apart).max()),
    }


def main() -> None:
    """All gates, and the table."""
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=16, help="in the width of the column")
    cells = parser.parse_args().cells
    rough = Dam(cells, "no_slip")
    rough.properties = rough.box.properties(LIQUID / 1.2, (1e-3, 1.5e-3))
    lifted, lowered = (watched(Dam(cells), cells, way) for way in (False, True))
    rows = {"no gate": errors(*lifted(1e4)), "no gate, rough floor": errors(*watched(rough, cells, False)(1e4))}
    rows |= {f"lifted at {speed:g} m/s": errors(*lifted(speed)) for speed in LIFTED}
    rows |= {f"lowered at {speed:g} m/s": errors(*lowered(speed)) for speed in LOWERED}
    lines = ["| gate | front at Z = 1.44 [sqrt(a/2g)] | front, own clock | front after Z = 1.44 | height at the wall |"]
    lines.append("| --- | --- | --- | --- | --- |")
    for name, row in rows.items():
        late = f"{abs(row['late']):.2f} {'late' if row['late'] > 0.0 else 'early'}"
        parts = " | ".join(f"{100.0 * row[key]:.1f} %" for key in ("own_clock", "after", "height"))
        lines.append(f"| {name} | {late} | {parts} |")
    harness.write("dam_gate", {"cells": cells, "gates": rows}, "\n".join(lines))


if __name__ == "__main__":
    main()
