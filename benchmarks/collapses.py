"""Columns of grains that collapse at a wall into a shallow lake: run-off and height of the wave.

    python benchmarks/collapses.py [--heights 1,2] [--packs 0,1] [--fine] [--runs FOLDER] [--picture PNG]

A column that stands at a wall in the water is let go, after M. Robbe-Saule et al., J. Fluid Mech. (2021),
arXiv:2010.12308: height of the wave over the depth by the Froude number of the front of the grains. Every column is run
with each pack, and with --fine the first one on finer cells. Rows are kept beside those of earlier calls as soon as
they are there; runs that are complete in `--runs` are used again. Writes results/collapses.{json,md}.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import EllipseCollection

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # run as a script from anywhere

import jaxdem  # noqa: E402
from benchmarks import harness  # noqa: E402
from jaxdem.io.load import Run  # noqa: E402
from tests.cases.granular import hanging_together, lube_runoff  # noqa: E402

GRAVITY, SOLID = 9.81, 2500.0
SPREAD = 0.2
"""Radii are even between 1 - SPREAD and 1 + SPREAD of the mean: equal discs on a flat floor are a crystal."""

POURED = {"friction": 0.0}
"""Contacts while a column comes to rest: densely."""

FLOWING = {"friction": 0.5, "rolling_friction": 0.1}
"""Contacts while it collapses."""


@dataclasses.dataclass(frozen=True)
class Setup:
    """What the columns of one kind have in common.

    Attributes:
        grains: number of them, the same in all columns, so that all share a program.
        diameter: mean one [m].
        modulus: Young's modulus, softer than that of glass [Pa].
        box: (length, height) [m].
        liquid: tables [fluid] without cells, [surface], [coupling] and [boundary] of a collapse.
        speed: largest expected one of a grain [m/s].
        pouring: gravity while a column comes to rest [m/s2].
        end, output: of a collapse [s].
    """

    grains: int
    diameter: float
    modulus: float
    box: tuple[float, float]
    liquid: dict[str, Any]
    speed: float
    pouring: float
    end: float
    output: float


LAKE_DEPTH = 0.06

LAKE = Setup(
    grains=900, diameter=4e-3, modulus=5e6, box=(1.6, 0.4),
    liquid={
        "fluid": {"density": 1000.0, "viscosity": 1e-6},
        "surface": {"density": 1.2, "viscosity": 1.5e-5, "level": LAKE_DEPTH},
        "coupling": {"drag": "koch_hill", "interval": 2e-3},
        "boundary": {name: {"kind": "free_slip"} for name in ("bottom", "right")} | {"top": {"kind": "outlet"}},
    },
    speed=2.5, pouring=GRAVITY, end=1.4, output=0.02,
)  # fmt: skip

PACKED = 0.82
"""Area fraction of a column at rest, about: it makes the width of a column of a given height over it."""


def radii(setup: Setup, seed: int) -> np.ndarray:
    """(N,) of the grains of a column [m]."""
    return 0.5 * setup.diameter * np.random.default_rng(seed).uniform(1.0 - SPREAD, 1.0 + SPREAD, setup.grains)


def width_of(setup: Setup, aspect: float, seed: int) -> float:
    """Width of a column whose height is about this many times as large [m]."""
    return float(np.sqrt(np.pi * np.sum(radii(setup, seed) ** 2) / (PACKED * aspect)))


def poured(setup: Setup, aspect: float, seed: int, folder: Path, contacts: Mapping[str, float] = POURED) -> Path:
    """A column at rest between the wall and a gate, without a fluid; `contacts` are what it comes to rest with."""
    path, width = folder / "poured", width_of(setup, aspect, seed)
    tall = 2.0 * aspect * width
    tables = {
        "seed": seed,
        "domain": {"size": [setup.box[0], 2.0 * setup.box[1]], "depth": setup.diameter,
                   "gravity": [0.0, -setup.pouring]},
        "particles": {
            "radius": radii(setup, seed).tolist(), "density": SOLID,
            "pack": {"kind": "settled", "count": setup.grains, "start": [0.0, 0.0], "stop": [width, tall]},
        },
        "contact": {"young_modulus": setup.modulus, "poisson_ratio": 0.3, "restitution": 0.3, **contacts,
                    "speed": float(np.sqrt(4.0 * setup.pouring * setup.box[1]))},
        "walls": [{"kind": "plane", "point": [width, 0.0], "normal": [-1.0, 0.0]}],
        "time": {"end": setup.output, "output_interval": setup.output},
    }  # fmt: skip
    if not complete(path):
        jaxdem.simulate(jaxdem.load_scene(tables), path)
    return path


def complete(path: Path) -> bool:
    """Whether a run has been written to its end."""
    return (path / "summary.json").exists()


def collapsed(setup: Setup, column: Path, cell: float, folder: Path) -> Run:
    """The run from the moment at which the gate is gone.

    Args:
        setup: of the case.
        column: run of the column at rest.
        cell: side of a cell [m].
        folder: for the run.
    """
    path = folder / f"cells_{1e3 * cell:g}mm"
    before = jaxdem.load_run(column).scene
    begin = before["time"]["end"]
    fluid = setup.liquid["fluid"] | {"cells": [round(length / cell) for length in setup.box]}
    contact = {"young_modulus": setup.modulus, "poisson_ratio": 0.3, "restitution": 0.3, **FLOWING}
    tables = {
        "domain": {"size": list(setup.box), "depth": setup.diameter, "gravity": [0.0, -GRAVITY]},
        "particles": {"radius": before["particles"]["radius"], "density": SOLID},
        "contact": contact | {"speed": setup.speed},
        **setup.liquid,
        "fluid": fluid,
        "start": {"from": str(column), "fluid": "new"},
        "time": {"end": begin + setup.end, "output_interval": setup.output},
    }
    if not complete(path):
        jaxdem.simulate(jaxdem.load_scene(tables), path)
    return jaxdem.load_run(path)


def grains(run: Run, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Places (N, 2) and radii (N,) of the grains of the largest cluster in contact [m]."""
    frame = run.particles(index)
    position = np.asarray(frame["position"], float)[:, :2]
    radius = np.broadcast_to(np.asarray(frame["radius"], float), len(position))
    kept = hanging_together(position, radius)
    return position[kept], radius[kept]


def fronts(run: Run) -> np.ndarray:
    """How far the grains reach along the floor, in every frame [m]."""
    found = []
    for index in range(run.number_of_frames):
        position, radius = grains(run, index)
        found.append(float((position[:, 0] + radius).max()))
    return np.asarray(found)


def area_fraction(setup: Setup, column: Path, width: float) -> tuple[float, float]:
    """Area fraction of the column at rest away from its edges, and its height over its width [-]."""
    run = jaxdem.load_run(column)
    return inner_fraction(setup, run, -1, width), middle(run, -1)[1] * 2.0 / width


def middle(run: Run, index: int) -> np.ndarray:
    """(2,) centre of area of the grains [m]."""
    frame = run.particles(index)
    radius = np.asarray(frame["radius"], float)
    return np.asarray(radius**2 @ np.asarray(frame["position"], float)[:, :2] / np.sum(radius**2))


def inner_fraction(setup: Setup, run: Run, index: int, width: float | None = None) -> float:
    """Area fraction of an upright block of grains in the corner of the box, away from its edges [-]; its width is twice
    the height of its centre from the wall unless given [m]."""
    size, frame = 2.0 * middle(run, index), run.particles(index)
    size[0] = size[0] if width is None else width
    position = np.asarray(frame["position"], float)[:, :2]
    radius = np.broadcast_to(np.asarray(frame["radius"], float), len(position))
    low, high = 3.0 * setup.diameter, size - 3.0 * setup.diameter
    # The part of every disc within the box, by the points of a lattice.
    side = np.linspace(0.0, 1.0, 201)
    x, z = np.meshgrid(low + side * (high[0] - low), low + side * (high[1] - low), indexing="ij")
    covered = np.zeros(x.shape, bool)
    for (cx, cz), r in zip(position, radius, strict=True):
        near = np.ix_(np.abs(x[:, 0] - cx) < r, np.abs(z[0] - cz) < r)
        covered[near] |= np.hypot(x[near] - cx, z[near] - cz) < r
    return float(covered.mean())


def wave_heights(setup: Setup, run: Run, front: np.ndarray) -> np.ndarray:
    """Highest water beyond the grains over the depth of the lake, less one, in every frame [-].

    The height of a column of cells is the volume of its water over its area: a splash counts by its water.
    """
    found = []
    for index in range(run.number_of_frames):
        fluid = run.fluid(index)
        assert fluid is not None
        liquid = np.asarray(fluid["liquid_fraction"], float)
        level = liquid.sum(axis=1) * setup.box[1] / liquid.shape[1]
        first = int(front[index] / setup.box[0] * liquid.shape[0]) + 2
        found.append(level[first:].max() / LAKE_DEPTH - 1.0)
    return np.asarray(found)


def front_speed(times: np.ndarray, front: np.ndarray) -> float:
    """Slope of the front while it covers the middle half of its way [m/s]."""
    part = (front - front[0]) / (front.max() - front[0])
    last = int(np.argmax(part >= 0.8))
    first = int(np.argmax(part >= 0.2))
    chosen = slice(first, max(last + 1, first + 2))
    return float(np.polyfit(times[chosen], front[chosen], 1)[0])


def measured(setup: Setup, aspect: float, seed: int, cell: float, folder: Path) -> dict[str, Any]:
    """A row: one collapse."""
    own = folder / f"lake_{aspect:g}_{seed}"
    column, width = poured(setup, aspect, seed, own), width_of(setup, aspect, seed)
    run = collapsed(setup, column, cell, own)
    fraction, height = area_fraction(setup, column, width)
    front, times = fronts(run), np.asarray(run.times) - run.times[0]
    speed = np.linalg.norm(np.asarray(run.particles(-1)["velocity"]), axis=1)
    return {
        "seed": seed, "cell_mm": 1e3 * cell, "grains": len(speed), "aspect": height,
        "area_fraction": fraction, "runoff": float(front[-1] / width),
        "time_to_90_percent": float(times[np.argmax(front - front[0] >= 0.9 * (front[-1] - front[0]))]),
        "at_rest": float(np.mean(speed < 0.05 * np.sqrt(GRAVITY * setup.diameter))),
        "froude": front_speed(times, front) / float(np.sqrt(GRAVITY * LAKE_DEPTH)),
        "wave": float(wave_heights(setup, run, front).max()),
        "run": str(run.path.relative_to(folder)),
    }  # fmt: skip


def piston(froude: float) -> float:
    """Height over the depth of a long wave before a piston of this Froude number, (1 + Fr/2)^2 - 1 [-]."""
    return float((1.0 + 0.5 * froude) ** 2 - 1.0)


def table(rows: list[dict[str, Any]]) -> str:
    """The table as Markdown."""
    lines = [
        "| H0/L0 | seed | cells [mm] | L/L0 | Fr | A/h0 | long wave of a piston | dry, Lube et al. |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    lines += [
        f"| {r['aspect']:.2f} | {r['seed']} | {r['cell_mm']:.3g} | {r['runoff']:.2f} | {r['froude']:.2f} | "
        f"{r['wave']:.2f} | {piston(r['froude']):.2f} | {1.0 + lube_runoff(r['aspect']):.2f} |"
        for r in rows
    ]
    return "\n".join(lines)


HEIGHTS, CELLS = (1.0, 2.0, 3.0), (1e-2, 7e-3)
"""Heights of columns over their widths, and sides of cells, of which the second is for the first column alone [m]."""


def draw(rows: list[dict[str, Any]], folder: Path, target: Path) -> None:
    """The lakes while the wave runs; of the first pack, where the run is kept."""
    kept = [row for row in rows if row["seed"] == 0 and complete(folder / row["run"])]
    figure, panels = plt.subplots(len(kept), 1, figsize=(7.0, 2.1 * len(kept)), layout="constrained", squeeze=False)
    for axes, row in zip(panels[:, 0], kept, strict=True):
        run = jaxdem.load_run(folder / row["run"])
        passed = np.asarray(run.times) - run.times[0]
        index = int(np.argmin(np.abs(passed - 0.5)))
        fluid, size = run.fluid(index), run.scene["domain"]["size"]
        assert fluid is not None
        liquid = np.asarray(fluid["liquid_fraction"])
        x, z = ((np.arange(n) + 0.5) * side / n for n, side in zip(liquid.shape, size, strict=True))
        axes.contourf(x, z, liquid.T, levels=[0.5, 2.0], colors=["#aaccee"])
        _discs(axes, run, index, "#aa7744")
        title = f"a column of H/L = {row['aspect']:.1f} in a lake, {passed[index]:.1f} s after the gate is gone"
        axes.set(xlim=(0.0, 1.2), ylim=(0.0, 0.2), title=title, aspect="equal", ylabel="z [m]")
    panels[-1, 0].set(xlabel="x [m]")
    figure.savefig(target, dpi=90)


def _discs(axes: plt.Axes, run: Run, index: int, colour: str) -> None:
    frame = run.particles(index)
    width = 2.0 * np.broadcast_to(frame["radius"], len(frame["position"]))
    axes.add_collection(
        EllipseCollection(
            width, width, np.zeros(len(width)), units="xy", offsets=frame["position"][:, :2],
            transOffset=axes.transData, facecolors=colour, edgecolors="white", linewidths=0.1,
        )
    )  # fmt: skip


def main() -> None:
    """The columns asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--heights", default=",".join(map(str, HEIGHTS)), help="of the columns over their widths")
    parser.add_argument("--packs", default="0,1", help="seeds of the packs")
    parser.add_argument("--fine", action="store_true", help="the first column on finer cells, with the first pack")
    parser.add_argument("--runs", type=Path, help="folder in which the runs are kept")
    parser.add_argument("--picture", type=Path, help="PNG of the result, of the runs that are kept")
    given = parser.parse_args()
    stored = harness.RESULTS / "collapses.json"
    rows = json.loads(stored.read_text())["rows"] if stored.exists() else []
    seeds = [int(seed) for seed in given.packs.split(",")]
    wanted = [(float(height), seed, CELLS[0]) for height in given.heights.split(",") for seed in seeds]
    if given.fine:
        wanted = [(HEIGHTS[0], seeds[0], CELLS[1])]
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.runs or Path(temporary)
        for aspect, seed, cell in wanted:
            row = measured(LAKE, aspect, seed, cell, folder)
            rows = sorted([*(r for r in rows if r["run"] != row["run"]), row], key=lambda r: r["run"])
            print(row, flush=True)
            harness.save("collapses", {"rows": rows}, table(rows))
        if given.picture:
            draw(rows, folder, given.picture)
    print(table(rows))


if __name__ == "__main__":
    main()
