"""Columns of grains that collapse in a viscous liquid: run-off and pressure in the pores of dense and loose packs.

    python benchmarks/viscous_collapses.py [--packs 0,1] [--only dense] [--end 4] [--shear] [--coarse] [--runs FOLDER]

After L. Rondon, O. Pouliquen, P. Aussillous, Phys. Fluids 23 (2011) 073301, with fewer and larger grains at a Stokes
number that is small as theirs. A column comes to rest with contacts of other frictions, so that it is dense or loose,
under the weight that it has in the liquid; then its gate is gone and all have the same contacts. With --shear no column
collapses: each is sheared dry at a constant pressure, which tells whether it dilates or contracts. Rows are kept beside
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

import jaxdem  # noqa: E402
from benchmarks import harness  # noqa: E402
from benchmarks.collapses import (  # noqa: E402
    FLOWING,
    GRAVITY,
    SOLID,
    Setup,
    area_fraction,
    collapsed,
    complete,
    fronts,
    inner_fraction,
    poured,
    width_of,
)
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

BOND = 5.0
"""Pull-off force of two mean grains over the weight of one in the liquid, of the sticky column [-]."""

WEIGHT = np.pi / 6.0 * TANK.diameter**3 * (SOLID - LIQUID) * GRAVITY

POURED: dict[str, dict[str, Any]] = {
    "dense": {"friction": 0.0},
    "loose": {"friction": 1.0, "rolling_friction": 0.1},
    "rough": {"friction": 1.0, "rolling_friction": 1.0},
    "sticky": {
        "friction": 1.0, "rolling_friction": 1.0,
        "cohesion": {"kind": "dmt", "work_of_adhesion": BOND * WEIGHT / (0.5 * np.pi * TANK.diameter)},
    },
}  # fmt: skip
"""Contacts with which the columns come to rest. The pull-off force is 2 pi w R*, R* a quarter of the diameter."""

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
    early = pressure[1:][times[1:] < 1.0]
    moving = front - front[0]
    last = np.asarray(run.particles(-1)["velocity"])
    return {
        "kind": kind, "seed": seed, "diameter_mm": 1e3 * setup.diameter, "grains": setup.grains, "aspect": aspect,
        "area_fraction": area, "end": setup.end, "runoff": float(front[-1] / width - 1.0),
        "time_to_90_percent": float(times[np.argmax(moving >= 0.9 * moving[-1])]),
        "pressure": float(early[np.argmax(np.abs(early))]), "mean_pressure": float(early.mean()),
        "last_speed": float(np.linalg.norm(last, axis=1).max()),
        "still_running": float((front[-1] - front[3 * len(front) // 4]) / width),
        "front": [float(f / width) for f in front[:: max(1, len(front) // 20)]],
        "pressures": [round(float(p), 4) for p in pressure[:: max(1, len(front) // 20)]],
        "run": str(run.path.relative_to(folder)),
    }  # fmt: skip


PRESSURE = 0.5 * TANK.grains * WEIGHT / (0.06 * TANK.diameter)
"""On the sheared columns: half of the weight of the grains on the floor of a column, which is some 6 cm wide [Pa]."""

STRAIN, RATE, REST = 0.2, 0.4, 0.2
"""Shear of a column: by how much of its height it is pressed flat, the rate, and the time before [-], [1/s], [s]."""


def sheared(setup: Setup, kind: str, seed: int, folder: Path) -> dict[str, Any]:
    """A row: a column between smooth walls, without gravity and liquid, is pressed flat at a constant rate while a
    constant force holds its side; contacts as of a collapse.

    The inertial number is below 0.004, so this is the slow flow.
    """
    own = folder / f"viscous_{kind}_{seed}_{1e3 * setup.diameter:g}mm"
    column, width = poured(setup, ASPECT, seed, own, POURED[kind]), width_of(setup, ASPECT, seed)
    before, path = jaxdem.load_run(column), own / "sheared"
    begin, last = before.scene["time"]["end"], before.particles(-1)
    top = float((np.asarray(last["position"])[:, 1] + np.asarray(last["radius"])).max())
    falls = {"kind": "translation", "velocity": [0.0, -RATE * top], "begin": begin + REST}
    push = {"direction": [-1.0, 0.0], "force": PRESSURE * top * setup.diameter, "mass": 0.02, "damping": 0.3}
    tables = {
        "domain": {"size": [setup.box[0], 2.0 * setup.box[1]], "depth": setup.diameter, "gravity": [0.0, 0.0]},
        "particles": {"radius": before.scene["particles"]["radius"], "density": SOLID},
        "contact": {"young_modulus": setup.modulus, "poisson_ratio": 0.3, "restitution": 0.3, **FLOWING,
                    "wall_friction": 0.0, "speed": setup.speed},
        "walls": [
            {"kind": "plane", "point": [0.0, top], "normal": [0.0, -1.0], "motion": [falls]},
            {"kind": "plane", "point": [width, 0.0], "normal": [-1.0, 0.0], "piston": push},
        ],
        "start": {"from": str(column), "fluid": "new"},
        "time": {"end": begin + REST + STRAIN / RATE, "output_interval": setup.output},
    }  # fmt: skip
    if not complete(path):
        jaxdem.simulate(jaxdem.load_scene(tables), path)
    run = jaxdem.load_run(path)
    found = np.asarray([inner_fraction(setup, run, index) for index in range(run.number_of_frames)])
    times = np.asarray(run.times) - run.times[0]
    pressed, flowing = int(np.argmin(np.abs(times - REST))), times > REST + 0.5 * STRAIN / RATE
    return {
        "kind": kind, "seed": seed, "poured": found[0], "pressed": found[pressed], "flowing": found[flowing].mean(),
        "scatter": found[flowing].std(), "run": str(run.path.relative_to(folder)),
    }  # fmt: skip


def table(rows: list[dict[str, Any]], sheared: list[dict[str, Any]]) -> str:
    """The tables as Markdown."""
    lines = [
        "| pack | seed | d [mm] | H0/L0 | area fraction | (L - L0)/L0 at 1 s | at 2 s | at the end | the end [s] | "
        "90 % of it after [s] | pressure in the pores, largest | mean |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for r in rows:
        front = np.asarray(r["front"])
        times = np.linspace(0.0, r["end"], len(front))
        first, second = (f"{np.interp(t, times, front) - 1.0:.2f}" if t <= r["end"] else "-" for t in (1.0, 2.0))
        mean = f"{r['mean_pressure']:+.2f}" if "mean_pressure" in r else "-"
        lines.append(
            f"| {r['kind']} | {r['seed']} | {r['diameter_mm']:.3g} | {r['aspect']:.2f} | {r['area_fraction']:.3f} | "
            f"{first} | {second} | {r['runoff']:.2f} | {r['end']:g} | {r['time_to_90_percent']:.2f} | "
            f"{r['pressure']:+.2f} | {mean} |"
        )
    lines += [
        "",
        "| sheared dry | seed | area fraction as poured | at rest under the pressure | in steady flow |",
        "| --- | --- | --- | --- | --- |",
    ]
    lines += [
        f"| {r['kind']} | {r['seed']} | {r['poured']:.3f} | {r['pressed']:.3f} | {r['flowing']:.3f} |" for r in sheared
    ]
    return "\n".join(lines)


def _key(row: dict[str, Any]) -> tuple[str, float]:
    """Of the rows that one run makes."""
    return row["run"], row.get("end", 0.0)


def main() -> None:
    """The columns asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--packs", default="0,1", help="seeds of the packs")
    parser.add_argument("--only", default=",".join(POURED), help="kinds of columns")
    parser.add_argument("--end", type=float, default=TANK.end, help="time of a collapse [s]")
    parser.add_argument("--shear", action="store_true", help="the columns are sheared at constant pressure")
    parser.add_argument("--coarse", action="store_true", help="grains of 1.41 times the diameter, half as many")
    parser.add_argument("--runs", type=Path, help="folder in which the runs are kept")
    given = parser.parse_args()
    setup = dataclasses.replace(TANK, end=given.end)
    if given.coarse:
        setup = dataclasses.replace(setup, grains=TANK.grains // 2, diameter=TANK.diameter * np.sqrt(2.0))
    stored = harness.RESULTS / "viscous_collapses.json"
    kept = json.loads(stored.read_text()) if stored.exists() else {}
    found: dict[str, Any] = {"rows": kept.get("rows", []), "sheared": kept.get("sheared", [])}
    name, measure = ("sheared", sheared) if given.shear else ("rows", measured)
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.runs or Path(temporary)
        for kind in given.only.split(","):
            for seed in map(int, given.packs.split(",")):
                row = measure(setup, kind, seed, folder)
                rows = [*(r for r in found[name] if _key(r) != _key(row)), row]
                found[name] = sorted(rows, key=_key)
                print({key: value for key, value in row.items() if key not in ("front", "pressures")}, flush=True)
                result = found | {"stokes_number": stokes_number(setup.diameter)}
                harness.save("viscous_collapses", result, table(**found))
    print(table(**found))


if __name__ == "__main__":
    main()
