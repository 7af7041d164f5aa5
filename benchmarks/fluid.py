"""Cost of a fluid step without particles, from 15,000 to a million cells, on one core and on two.

    python benchmarks/fluid.py [--meshes 300x50 1200x200 ...] [--cores 1 2] [--windows 5] [--cell-steps 2e6]
    python benchmarks/fluid.py --against DIR [--pairs 9] [--meshes ...] [--cores 1 2] [--cell-steps 2e6]

A channel, water at 3 m/s through the left side and out on the right, no slip below, free slip above, in float32.
"uniform" enters over the whole side into an existing stream, where the pressure converges at once: a lower bound. "jet"
enters through the lowest third into a fluid at rest and rolls up. An interval is 0.01 s on 300 x 50 cells and shorter
in proportion on finer meshes, the Courant number of 3 m/s being 0.75 on all; where the jet is faster an interval is cut
into several steps, and the figures are per step. After a warm-up of one window, windows of `cell-steps` cells times
intervals are timed, every mesh in a process of its own. `--against` compares with another checkout of jaxdem.

The same two flows are given to pisoFoam (`apt-get install openfoam`) on the smallest 2-D mesh, one process, where it is
installed: Euler, linear-upwind advection, GAMG to 1e-6, two correctors, the interval in one step.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

from benchmarks import against, harness, openfoam

# jax is imported by the processes that measure, not here: a process inherits the peak memory of the one it came from.

MESHES = ("300x50", "1200x200", "2000x500", "30x25x20", "100x100x100")
FLOWS = ("uniform", "jet")
BOX = {2: (12.0, 2.0), 3: (1.2, 1.0, 0.8)}
SPEED, VISCOSITY, COURANT = 3.0, 1e-6, 0.75
JET = 0.32  # part of the height that the jet enters through; in 3-D of the width as well, in its middle


def mesh_of(text: str) -> tuple[int, ...]:
    """Cells per axis, of the text 300x50 or 100x100x100."""
    cells = tuple(int(part) for part in text.split("x"))
    if len(cells) not in BOX:
        raise argparse.ArgumentTypeError(f"{text}: two or three numbers joined by x")
    return cells


def interval_of(cells: tuple[int, ...]) -> float:
    """Time in which 3 m/s crosses 0.75 of the smallest side of a cell [s]."""
    spacing = (length / n for length, n in zip(BOX[len(cells)], cells, strict=True))
    return COURANT * min(spacing) / SPEED


# --- jaxdem -----------------------------------------------------------------------------------------------


def scene_text(cells: tuple[int, ...], flow: str) -> str:
    """The channel as a scene file."""
    size, interval = BOX[len(cells)], interval_of(cells)
    start = [SPEED if flow == "uniform" else 0.0] + [0.0] * (len(cells) - 1)
    patch = ""
    if flow == "jet":
        sideways = [(0.5 * (1.0 - JET) * w, 0.5 * (1.0 + JET) * w) for w in size[1:-1]]
        lower, upper = zip(*sideways, (0.0, JET * size[-1]), strict=True)
        patch = f"from = {list(lower)}\nto = {list(upper)}"
    return f"""
[domain]
size = {list(size)}
[fluid]
cells = {list(cells)}
density = 1000.0
viscosity = {VISCOSITY}
time_step = {interval}
courant_limit = 1.0
velocity = {start}
[boundary.left]
kind = "inlet"
velocity = {SPEED}
ramp_time = 0.0
{patch}
[boundary.right]
kind = "outlet"
[boundary.top]
kind = "free_slip"
[time]
end = {100 * interval}
output_interval = {100 * interval}
"""


def jaxdem_windows(cells: tuple[int, ...], flow: str, windows: int, cell_steps: float) -> dict[str, Any]:
    """Seconds, fluid steps, solver iterations and remaining divergence of every window."""
    import jax

    import jaxdem
    from jaxdem.step import step

    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "channel.toml").write_text(scene_text(cells, flow))
        scene = jaxdem.load_scene(Path(folder, "channel.toml"))
    simulation, parameters = jaxdem.build(scene)
    state, _ = jaxdem.initial_state(scene, simulation, parameters)
    advance = jax.jit(lambda s: step(simulation, parameters, s, None)[::2]).lower(state).compile()
    intervals = intervals_of(cells, cell_steps)

    def window() -> dict[str, Any]:
        nonlocal state
        reports, start = [], time.perf_counter()
        for _ in range(intervals):
            state, diagnostics = advance(state)
            reports.append(diagnostics.fluid)
        jax.block_until_ready((state, reports))
        seconds = time.perf_counter() - start
        series = {
            name: np.asarray([getattr(report, name) for report in reports])
            for name in ("substeps", "iterations", "divergence", "converged", "finite")
        }
        assert series["finite"].all(), f"the {flow} on {cells} cells is not finite"
        return {
            "seconds": seconds,
            "steps": int(series["substeps"].sum()),
            "iterations": series["iterations"].tolist(),
            "divergence": float(series["divergence"].max()),
            "not_converged": int((~series["converged"]).sum()),
        }

    window()
    return {
        "device": jax.devices()[0].device_kind,
        "intervals": intervals,
        "windows": [window() for _ in range(windows)],
    }


def intervals_of(cells: tuple[int, ...], cell_steps: float) -> int:
    """Intervals in a window, four at least."""
    return max(4, round(cell_steps / math.prod(cells)))


def ours(cores: int, cells: tuple[int, ...], flow: str, arguments: argparse.Namespace) -> dict[str, Any]:
    """`jaxdem_windows` in a process of its own, kept on so many cores."""
    command = [sys.executable, __file__, "--inside", flow, "--meshes", "x".join(map(str, cells))]
    command += ["--windows", str(arguments.windows), "--cell-steps", str(arguments.cell_steps)]
    text = subprocess.run(harness.pinned(cores, command), check=True, stdout=subprocess.PIPE, text=True).stdout
    return json.loads(text.splitlines()[-1])


# --- OpenFOAM ---------------------------------------------------------------------------------------------

FOAM_CASE = {
    "constant/transportProperties": "transportModel Newtonian;\nnu {viscosity};\n",
    "constant/turbulenceProperties": "simulationType laminar;\n",
    "0/U": """dimensions [0 1 -1 0 0 0 0];
internalField uniform ({start} 0 0);
boundaryField
{{
    inlet  {{ type fixedValue; value uniform ({speed} 0 0); }}
    outlet {{ type pressureInletOutletVelocity; value uniform (0 0 0); }}
    "(beside|bottom)" {{ type noSlip; }}
    top    {{ type slip; }}
    frontAndBack {{ type empty; }}
}}
""",
    "0/p": """dimensions [0 2 -2 0 0 0 0];
internalField uniform 0;
boundaryField
{{
    "(inlet|beside|bottom|top)" {{ type zeroGradient; }}
    outlet {{ type fixedValue; value $internalField; }}
    frontAndBack {{ type empty; }}
}}
""",
    "system/fvSolution": """solvers
{{
    p {{ solver GAMG; tolerance 1e-06; relTol 0.01; smoother GaussSeidel; }}
    pFinal {{ $p; relTol 0; }}
    U {{ solver smoothSolver; smoother symGaussSeidel; tolerance 1e-05; relTol 0; }}
    UFinal {{ $U; }}
}}
PISO {{ nCorrectors 2; nNonOrthogonalCorrectors 0; pRefCell 0; pRefValue 0; }}
""",
    "system/fvSchemes": """ddtSchemes {{ default Euler; }}
gradSchemes {{ default Gauss linear; }}
divSchemes
{{
    default none; div(phi,U) Gauss linearUpwindV grad(U); div((nuEff*dev2(T(grad(U))))) Gauss linear;
}}
laplacianSchemes {{ default Gauss linear corrected; }}
interpolationSchemes {{ default linear; }}
snGradSchemes {{ default corrected; }}
""",
    "system/controlDict": """application pisoFoam;
startFrom startTime; startTime 0; stopAt endTime; endTime {end};
deltaT {interval};
writeControl runTime; writeInterval 1e9; purgeWrite 0; writeFormat binary; writePrecision 6;
writeCompression off; timeFormat general; timePrecision 10; runTimeModifiable no;
""",
    # Two blocks, one above the other: the jet enters through the left side of the lower one.
    "system/blockMeshDict": """scale 1;
vertices
(
    (0 0 -0.02) ({length} 0 -0.02) ({length} {split} -0.02)
    (0 {split} -0.02) ({length} {height} -0.02) (0 {height} -0.02)
    (0 0 0.02) ({length} 0 0.02) ({length} {split} 0.02) (0 {split} 0.02) ({length} {height} 0.02) (0 {height} 0.02)
);
blocks
(
    hex (0 1 2 3 6 7 8 9) ({along} {below} 1) simpleGrading (1 1 1)
    hex (3 2 4 5 9 8 10 11) ({along} {above} 1) simpleGrading (1 1 1)
);
edges ();
boundary
(
    inlet  {{ type patch; faces ({inlet}); }}
    beside {{ type wall; faces ({beside}); }}
    outlet {{ type patch; faces ((1 2 8 7) (2 4 10 8)); }}
    bottom {{ type wall; faces ((0 1 7 6)); }}
    top    {{ type wall; faces ((5 11 10 4)); }}
    frontAndBack {{ type empty; faces ((0 3 2 1) (3 5 4 2) (6 7 8 9) (9 8 10 11)); }}
);
""",
}


def write_foam_case(folder: Path, cells: tuple[int, ...], flow: str, intervals: int) -> None:
    """The OpenFOAM case of a flow on a 2-D mesh, for so many intervals."""
    length, height = BOX[2]
    below = round(JET * cells[1])
    sides = ["(0 6 9 3)", "(3 9 11 5)"]
    entered = 1 if flow == "jet" else 2
    values = {
        "viscosity": VISCOSITY, "speed": SPEED, "start": SPEED if flow == "uniform" else 0.0,
        "interval": interval_of(cells), "end": intervals * interval_of(cells),
        "length": length, "height": height, "split": height * below / cells[1],
        "along": cells[0], "below": below, "above": cells[1] - below,
        "inlet": " ".join(sides[:entered]), "beside": " ".join(sides[entered:]),
    }  # fmt: skip
    kinds = {"0/U": "volVectorField", "0/p": "volScalarField"}
    openfoam.write_case(folder, FOAM_CASE, values, kinds)


def pisofoam(cells: tuple[int, ...], flow: str, arguments: argparse.Namespace) -> dict[str, Any]:
    """Windows of pisoFoam by the clock, as for jaxdem: from the arrival of the line that ends a step."""
    intervals = intervals_of(cells, arguments.cell_steps)
    ends, iterations, count = [], [], 0
    with tempfile.TemporaryDirectory() as folder:
        write_foam_case(Path(folder), cells, flow, (arguments.windows + 1) * intervals)
        for line in openfoam.lines_of("pisoFoam", folder):
            if found := re.search(r"Solving for p,.*No Iterations (\d+)", line):
                count += int(found[1])
            elif line.startswith("ExecutionTime"):
                ends.append(time.perf_counter())
                iterations.append(count)
                count = 0
    return {
        "intervals": intervals,
        "windows": [
            {
                "seconds": ends[k + intervals] - ends[k],
                "steps": intervals,
                "iterations": iterations[k + 1 : k + 1 + intervals],
            }
            for k in range(intervals - 1, len(ends) - intervals, intervals)
        ],
    }


# --- table ------------------------------------------------------------------------------------------------


def summary(cells: tuple[int, ...], measured: dict[str, Any]) -> dict[str, Any]:
    """Figures of a contender's windows."""
    windows = measured["windows"]
    step = harness.spread([w["seconds"] / w["steps"] for w in windows])
    iterations = list(itertools.chain.from_iterable(w["iterations"] for w in windows))
    return {
        "cells": cells,
        "seconds_per_step": step,
        "nanoseconds_per_cell_and_step": 1e9 * step["median"] / math.prod(cells),
        "seconds_per_interval": harness.spread([w["seconds"] / measured["intervals"] for w in windows]),
        "steps_per_interval": sum(w["steps"] for w in windows) / (len(windows) * measured["intervals"]),
        "iterations": {"mean": sum(iterations) / len(iterations), "largest": max(iterations)},
        **measured,
    }


def row(name: str, flow: str, cores: int, figures: dict[str, Any]) -> str:
    """A contender's line of the table."""
    step, iterations = figures["seconds_per_step"], figures["iterations"]
    left = ""
    if "divergence" in figures["windows"][0]:
        left = f"{max(w['divergence'] for w in figures['windows']):.1e}"
        failed = sum(w["not_converged"] for w in figures["windows"])
        left += f", {failed} intervals not converged" if failed else ""
    return (
        f"| {name} | {flow} | {' x '.join(map(str, figures['cells']))} | {cores} | "
        f"{1e3 * step['median']:.3g} ({1e3 * step['lowest']:.3g}-{1e3 * step['highest']:.3g}) | "
        f"{figures['nanoseconds_per_cell_and_step']:.3g} | {figures['steps_per_interval']:.2f} | "
        f"{iterations['mean']:.1f}, {iterations['largest']} | {left} |"
    )


def growth(runs: dict[tuple[str, tuple[int, ...], int], dict[str, Any]]) -> dict[str, float]:
    """Cost per cell and step on the largest mesh over that on the smallest, by flow, dimension and cores."""
    ratios = {}
    groups = sorted({(flow, len(cells), cores) for flow, cells, cores in runs})
    for flow, dimension, cores in groups:
        meshes = sorted(
            {cells for f, cells, c in runs if (f, len(cells), c) == (flow, dimension, cores)}, key=math.prod
        )
        if len(meshes) > 1:
            small, large = (
                runs[flow, mesh, cores]["nanoseconds_per_cell_and_step"] for mesh in (meshes[0], meshes[-1])
            )
            names = [" x ".join(map(str, mesh)) for mesh in (meshes[-1], meshes[0])]
            label = f"cost per cell, {names[0]} over {names[1]}, {flow}, {cores} core(s)"
            ratios[label] = large / small
    return ratios


def compare(arguments: argparse.Namespace) -> None:
    """Every mesh, flow and number of cores, here and in another checkout."""
    with tempfile.TemporaryDirectory() as folder:
        works = []
        for cores, flow, cells in itertools.product(arguments.cores, FLOWS, arguments.meshes):
            mesh, intervals = "x".join(map(str, cells)), intervals_of(cells, arguments.cell_steps)
            scene = Path(folder, f"{flow}_{mesh}.toml")
            scene.write_text(scene_text(cells, flow))
            works.append(against.Work(f"{flow}, {mesh}", scene, {}, intervals, intervals, cores))
        against.compare("fluid", works, arguments.against, arguments.pairs)


def main() -> None:
    """Every mesh, flow and number of cores, then OpenFOAM, then the table and the ratios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--meshes", nargs="+", type=mesh_of, default=[mesh_of(text) for text in MESHES])
    parser.add_argument("--cores", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--windows", type=int, default=5)
    parser.add_argument("--cell-steps", type=float, default=2e6)
    against.add_options(parser)
    parser.add_argument("--inside", metavar="FLOW", choices=FLOWS, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.inside:
        measured = jaxdem_windows(arguments.meshes[0], arguments.inside, arguments.windows, arguments.cell_steps)
        print(json.dumps(measured))
        return
    if arguments.against:
        compare(arguments)
        return

    rows = [
        "| program | flow | cells | cores | ms a step, median (range) | ns a cell and step | steps an interval | "
        "pressure iterations a step, mean, most | divergence left [U/h] |",
        "| --- " * 9 + "|",
    ]
    runs, result = {}, {}
    available = len(os.sched_getaffinity(0))
    for cores, flow, cells in itertools.product(arguments.cores, FLOWS, arguments.meshes):
        if cores <= available:
            figures = summary(cells, ours(cores, cells, flow, arguments))
            runs[flow, cells, cores] = figures
            result[f"jaxdem, {flow}, {cells}, {cores}"] = figures
            rows.append(row(f"jaxdem, {figures['device']}", flow, cores, figures))
            print(rows[-1], flush=True)
    ratios = growth(runs)
    flat = sorted((cells for cells in arguments.meshes if len(cells) == 2), key=math.prod)
    if not openfoam.installed("pisoFoam"):
        rows.append("| pisoFoam | | | | not installed (`apt-get install openfoam`) | | | | |")
    elif flat:
        for flow in FLOWS:
            theirs = summary(flat[0], pisofoam(flat[0], flow, arguments))
            result[f"pisoFoam, {flow}"] = theirs
            rows.append(row("pisoFoam", flow, 1, theirs))
            for cores in (c for c in arguments.cores if (flow, flat[0], c) in runs):
                label = f"time for an interval, jaxdem on {cores} core(s) over pisoFoam on one, {flow}"
                median = runs[flow, flat[0], cores]["seconds_per_interval"]["median"]
                ratios[label] = median / theirs["seconds_per_interval"]["median"]
    result["ratios"] = ratios
    lines = [*rows, "", *(f"- {label}: {ratio:.2f}" for label, ratio in ratios.items())]
    harness.write("fluid", result, "\n".join(lines))


if __name__ == "__main__":
    main()
