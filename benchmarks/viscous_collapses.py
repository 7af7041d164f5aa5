"""Columns of grains that collapse in a viscous liquid: run-off and pressure in the pores of dense and loose packs.

    python benchmarks/viscous_collapses.py [--packs 0,1] [--only dense] [--coarse] [--runs FOLDER]

After L. Rondon, O. Pouliquen, P. Aussillous, Phys. Fluids 23 (2011) 073301, with fewer and larger grains at a Stokes
number that is small as theirs. A column comes to rest with contacts of other frictions, so that it is dense or loose,
under the weight that it has in the liquid; then its gate is gone and all have the same contacts. Rows are kept beside
those of earlier calls as soon as they are there. Writes results/viscous_collapses.{json,md}.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # run as a script from anywhere

from benchmarks import harness  # noqa: E402
from benchmarks.collapses import GRAVITY, SOLID, Setup, area_fraction, collapsed, fronts, poured, width_of  # noqa: E402
from jaxdem.io.load import Run  # noqa: E402

LIQUID, VISCOSITY = 1010.0, 0.1
"""Density and viscosity of the liquid [kg/m3], [Pa s]."""

ASPECT = 0.8
"""Height of a column over its width, about, as of the columns whose dynamics the paper shows."""

TANK = Setup(
    grains=900, diameter=2e-3, modulus=1e6, box=(0.3, 0.12),
    liquid={
        "fluid": {"density": LIQUID, "viscosity": VISCOSITY / LIQUID},
        "coupling": {"drag": "koch_hill", "interval": 2e-4},
    },
    speed=0.5, pouring=GRAVITY * (1.0 - LIQUID / SOLID), end=4.0, output=0.02,
)  # fmt: skip

POURED = {
    "dense": {"friction": 0.0},
    "loose": {"friction": 1.0, "rolling_friction": 0.1},
}
"""Contacts with which the columns come to rest."""

CELL = 5e-3
"""Side of a cell [m]."""


def stokes_number(diameter: float) -> float:
    """(rho_s (rho_s - rho_f) g d^3)^(1/2) / (18 sqrt(2) mu), after S. Courrech du Pont et al., PRL 90 (2003) 044301."""
    return float(np.sqrt(SOLID * (SOLID - LIQUID) * GRAVITY * diameter**3) / (18.0 * np.sqrt(2.0) * VISCOSITY))


def pore_pressure(run: Run, width: float, height: float, solids: float) -> np.ndarray:
    """Mean pressure at the floor under the column less that at the other end of the floor, over the weight of the
    grains in the liquid by area, in every frame [-].

    Args:
        run: of the collapse.
        width, height: of the column [m].
        solids: solid fraction of the column [-].
    """
    weight, found = (SOLID - LIQUID) * GRAVITY * solids * height, []
    for index in range(run.number_of_frames):
        fluid = run.fluid(index)
        assert fluid is not None
        floor = np.asarray(fluid["pressure"], float)[:, 0]
        under = round(width / TANK.box[0] * len(floor))
        found.append((floor[:under].mean() - floor[-3:].mean()) / weight)
    return np.asarray(found)


def measured(setup: Setup, kind: str, seed: int, folder: Path) -> dict[str, Any]:
    """A row: one collapse."""
    own = folder / f"viscous_{kind}_{seed}_{1e3 * setup.diameter:g}mm"
    column, width = poured(setup, ASPECT, seed, own, POURED[kind]), width_of(setup, ASPECT, seed)
    run = collapsed(setup, column, CELL, own)
    area, aspect = area_fraction(setup, column, width)
    front, times = fronts(run), np.asarray(run.times) - run.times[0]
    # Spheres in a slab that is a mean diameter deep.
    pressure = pore_pressure(run, width, aspect * width, area * 2.0 / 3.0)
    early = pressure[1 : len(pressure) // 4]
    moving = front - front[0]
    last = np.asarray(run.particles(-1)["velocity"])
    return {
        "kind": kind, "seed": seed, "diameter_mm": 1e3 * setup.diameter, "grains": setup.grains, "aspect": aspect,
        "area_fraction": area, "runoff": float(front[-1] / width - 1.0),
        "time_to_90_percent": float(times[np.argmax(moving >= 0.9 * moving[-1])]),
        "pressure": float(early[np.argmax(np.abs(early))]),
        "last_speed": float(np.linalg.norm(last, axis=1).max()),
        "still_running": float((front[-1] - front[3 * len(front) // 4]) / width),
        "front": [float(f / width) for f in front[:: max(1, len(front) // 20)]],
        "run": str(run.path.relative_to(folder)),
    }  # fmt: skip


def table(rows: list[dict[str, Any]]) -> str:
    """The table as Markdown."""
    lines = [
        "| pack | seed | d [mm] | H0/L0 | area fraction | (L - L0)/L0 | 90 % of it after [s] | pressure in the pores |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    lines += [
        f"| {r['kind']} | {r['seed']} | {r['diameter_mm']:.3g} | {r['aspect']:.2f} | {r['area_fraction']:.3f} | "
        f"{r['runoff']:.2f} | {r['time_to_90_percent']:.2f} | {r['pressure']:+.2f} |"
        for r in rows
    ]
    return "\n".join(lines)


def main() -> None:
    """The columns asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--packs", default="0,1", help="seeds of the packs")
    parser.add_argument("--only", default=",".join(POURED), help="kinds of columns")
    parser.add_argument("--coarse", action="store_true", help="grains of 1.41 times the diameter, half as many")
    parser.add_argument("--runs", type=Path, help="folder in which the runs are kept")
    given = parser.parse_args()
    setup = TANK
    if given.coarse:
        setup = dataclasses.replace(TANK, grains=TANK.grains // 2, diameter=TANK.diameter * np.sqrt(2.0))
    stored = harness.RESULTS / "viscous_collapses.json"
    rows = json.loads(stored.read_text())["rows"] if stored.exists() else []
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.runs or Path(temporary)
        for kind in given.only.split(","):
            for seed in map(int, given.packs.split(",")):
                row = measured(setup, kind, seed, folder)
                rows = sorted([*(r for r in rows if r["run"] != row["run"]), row], key=lambda r: r["run"])
                print({key: value for key, value in row.items() if key != "front"}, flush=True)
                found = {"rows": rows, "stokes_number": stokes_number(setup.diameter)}
                harness.save("viscous_collapses", found, table(rows))
    print(table(rows))


if __name__ == "__main__":
    main()
