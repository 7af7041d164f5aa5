"""The injection scene by mesh and drag, split by stage: seconds per simulated second, beside DPMFoam and the paper.

    python benchmarks/coupled.py [--end 0.5] [--repetitions 1] [--cores 1]
    python benchmarks/coupled.py --against DIR [--pairs 9] [--end 0.5] [--cores 1]

`scenes/injection.toml` at 4 and 16 cm, with its correlation and with learned closures in its place, from the start to
`--end`, every run in a process of its own. The closures are evaluated at every particle, but all particles are out of
their range, so the base law acts: all runs on one mesh have the same flow, and only the cost of the drag differs.
Stages are those of `summary.json`; compilation and output are left out of the time per simulated second. `--against`
compares whole runs, output included, with those of another checkout of jaxdem.

DPMFoam (`apt-get install openfoam`), if it is installed, starts with the grains where the first of these runs ended.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks import against, dpmfoam, harness, openfoam
from jaxdem.closures.base import DragClosure
from jaxdem.closures.invariant import InvariantClosure
from jaxdem.closures.network import PaperNetwork

SCENE = Path(__file__).parents[1] / "scenes" / "injection.toml"
MESHES = {"4 cm": [300, 50], "16 cm": [75, 12]}

ELSEWHERE = """Elsewhere, on another machine: Davydzenka & Tahmasebi (2022), CFDEM, four cores, seconds per simulated
second: 310 fine, 127-160 coarse, 139-173 coarse with their network (5 s runs of 1550, 627-800, 695-865 s)."""


def closures() -> dict[str, DragClosure | None]:
    """Learned closures that are out of range everywhere, by name; None for the scene's own correlation."""
    network = PaperNetwork.initial(2)
    nowhere = jnp.full_like(network.input_low, jnp.inf)
    invariant = InvariantClosure.initial()
    return {
        "Koch-Hill": None,
        "paper's network": dataclasses.replace(network, input_low=nowhere),
        "invariant": dataclasses.replace(invariant, feature_low=jnp.full_like(invariant.feature_low, jnp.inf)),
    }


def run(mesh: str, name: str, end: float) -> dict[str, Any]:
    """Stages [s], counts, time per simulated second and last positions of one run, in this process."""
    scene = scene_of(mesh, end)
    with tempfile.TemporaryDirectory() as folder:
        done = jaxdem.simulate(scene, Path(folder) / "run", closure=closures()[name])
        position = np.asarray(done.particles(-1)["position"])[:, :2]
    assert done.summary["valid"]
    stages = {key: value for key, value in done.summary["stages_s"].items() if value is not None}
    return {
        "stages_s": stages,
        "counts": done.summary["counts"],
        "per_simulated_second": solving(stages) / end,
        "peak_bytes": harness.peak_memory()["peak_bytes"],
        "position": position.tolist(),
    }


def scene_of(mesh: str, end: float) -> jaxdem.Scene:
    """The scene on a mesh, to a time."""
    return jaxdem.load_scene(SCENE, changes(mesh, end))


def changes(mesh: str, end: float) -> dict[str, Any]:
    """What makes it of the scene file."""
    return {"fluid.cells": MESHES[mesh], "time.end": end, "time.output_interval": min(0.1, end)}


def solving(stages: dict[str, float]) -> float:
    """Time of the steps, which the other stages are parts of; without compilation and output [s]."""
    return stages["step"]


def measured(mesh: str, name: str, options: argparse.Namespace) -> dict[str, Any]:
    """`run` in a process of its own, on the cores asked for."""
    command = [sys.executable, __file__, "--one", mesh, name, "--end", str(options.end)]
    done = subprocess.run(harness.pinned(options.cores, command), stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def row(mesh: str, name: str, results: list[dict[str, Any]]) -> str:
    """A line of the table: the median run's stages as parts of its time."""
    speed = harness.spread([result["per_simulated_second"] for result in results])
    middle = min(results, key=lambda result: abs(result["per_simulated_second"] - speed["median"]))
    stages = middle["stages_s"]
    parts = [
        f"{100 * stages[key] / solving(stages):.1f} %" if key in stages else "-"
        for key in ("contact", "neighbors", "coupling", "drag", "fluid")
    ]
    return (
        f"| {mesh} | {name} | {speed['median']:.1f} ({speed['lowest']:.1f}-{speed['highest']:.1f}) | "
        f"{' | '.join(parts)} | {stages['compile']:.1f} | {middle['peak_bytes'] / 2**20:.0f} |"
    )


def peer_row(position: list[list[float]], ours: float, end: float) -> tuple[list[float], str]:
    """DPMFoam's times, and its line: on the fine mesh, one process, from the positions that our run reached."""
    if not openfoam.installed("DPMFoam"):
        return [], "| 4 cm | DPMFoam | not installed (`apt-get install openfoam`) | | | | | | | |"
    times = dpmfoam.seconds_per_simulated_second(scene_of("4 cm", end), np.asarray(position))
    speed = harness.spread(times)
    described = f"{speed['median']:.0f} ({speed['lowest']:.0f}-{speed['highest']:.0f})"
    return (
        times,
        f"| 4 cm | DPMFoam, one process | {described}, {speed['median'] / ours:.1f} x ours | | | | | | | |",
    )


def main() -> None:
    """All meshes and closures, DPMFoam, then the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--end", type=float, default=0.5)
    parser.add_argument("--repetitions", type=int, default=1)
    parser.add_argument("--cores", type=int, default=1)
    against.add_options(parser)
    parser.add_argument("--one", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(run(*options.one, options.end)))
        return
    if options.against:
        works = [against.Work(mesh, SCENE, changes(mesh, options.end), cores=options.cores) for mesh in MESHES]
        against.compare("coupled", works, options.against, options.pairs)
        return
    lines = [
        "| mesh | drag | s per simulated s, median (range) | contact | neighbours | exchange | drag | fluid | "
        "compile [s] | peak memory [MiB] |",
        "|" + " --- |" * 10,
    ]
    result: dict[str, Any] = {"end": options.end, "cores_used": options.cores}
    position: list[list[float]] = []
    for mesh in MESHES:
        for name in closures():
            runs = [measured(mesh, name, options) for _ in range(options.repetitions)]
            position = position or runs[0]["position"]
            result[f"{mesh}, {name}"] = [{k: v for k, v in r.items() if k != "position"} for r in runs]
            lines.append(row(mesh, name, runs))
            print(lines[-1], flush=True)
    ours = [one["per_simulated_second"] for one in result["4 cm, Koch-Hill"]]
    result["DPMFoam"], line = peer_row(position, statistics.median(ours), options.end)
    lines.append(line)
    about = f"{options.cores} core(s), to {options.end} s, {options.repetitions} repetition(s)."
    harness.write("coupled", result, "\n".join([about, "", *lines]) + "\n\n" + ELSEWHERE)


if __name__ == "__main__":
    main()
