"""The injection scene by mesh and drag, split by stage: seconds per simulated second, beside the paper and DPMFoam.

    python benchmarks/coupled.py [--end 0.5] [--repetitions 1]

`scenes/injection.toml` at 4 and 16 cm, with its correlation and with learned closures in its place, from the start to
`--end`. The closures are evaluated at every particle and then found out of range, so that the base law acts: all runs
of a mesh see the same flow, and differ by the cost of the drag alone. Stages are those of `summary.json`; compilation
and output are left out of the time per simulated second.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import tempfile
from pathlib import Path
from typing import Any

import jax.numpy as jnp

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks import harness
from jaxdem.closures.base import DragClosure
from jaxdem.closures.invariant import InvariantClosure
from jaxdem.closures.network import PaperNetwork

SCENE = Path(__file__).parents[1] / "scenes" / "injection.toml"
MESHES = {"4 cm": [300, 50], "16 cm": [75, 12]}

ELSEWHERE = """Elsewhere, on other machines: Davydzenka & Tahmasebi (2022), CFDEM, four cores, seconds per simulated second: 310 fine,
127-160 coarse, 139-173 coarse with their network (5 s runs of 1550, 627-800, 695-865 s). DPMFoam 1912, the fine mesh
with this pack, one process of a two-core machine: 11.0 s per fluid step of 0.01 s, 1,100 s per simulated second."""


def closures() -> dict[str, DragClosure | None]:
    """Learned closures that are out of range everywhere, by name; None for the scene's own correlation."""
    network = PaperNetwork.initial(2)
    nowhere = jnp.full_like(network.input_low, jnp.inf)
    invariant = InvariantClosure.initial()
    return {
        "Koch-Hill": None,
        "paper's network": dataclasses.replace(network, input_low=nowhere),
        "invariant": dataclasses.replace(
            invariant, feature_low=jnp.full_like(invariant.feature_low, jnp.inf)
        ),
    }


def run(cells: list[int], closure: DragClosure | None, end: float) -> dict[str, Any]:
    """Stages [s], steps and wall time of one run."""
    overrides = {"fluid.cells": cells, "time.end": end, "time.output_interval": min(0.1, end)}
    scene = jaxdem.load_scene(SCENE, overrides)
    with tempfile.TemporaryDirectory() as folder:
        summary = jaxdem.simulate(scene, Path(folder) / "run", closure=closure).summary
    assert summary["valid"]
    stages = {name: value for name, value in summary["stages_s"].items() if value is not None}
    solving = sum(value for name, value in stages.items() if name not in ("compile", "output"))
    return {
        "stages_s": stages,
        "counts": summary["counts"],
        "per_simulated_second": solving / end,
    }


def row(mesh: str, name: str, results: list[dict[str, Any]]) -> str:
    """A line of the table: the median run's stages as parts of its time."""
    speed = harness.spread([result["per_simulated_second"] for result in results])
    middle = min(results, key=lambda result: abs(result["per_simulated_second"] - speed["median"]))
    stages = middle["stages_s"]
    solving = sum(value for key, value in stages.items() if key not in ("compile", "output"))
    parts = [
        f"{100 * stages[key] / solving:.1f} %" if key in stages else "-"
        for key in ("contact", "neighbors", "coupling", "drag", "fluid")
    ]
    return (
        f"| {mesh} | {name} | {speed['median']:.1f} ({speed['lowest']:.1f}-{speed['highest']:.1f}) | "
        f"{' | '.join(parts)} | {stages['compile']:.1f} |"
    )


def main() -> None:
    """All meshes and closures, then the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--end", type=float, default=0.5)
    parser.add_argument("--repetitions", type=int, default=1)
    arguments = parser.parse_args()
    lines = [
        "| mesh | drag | s per simulated s, median (range) | contact | neighbours | exchange | drag | fluid | compile [s] |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    result: dict[str, Any] = {"end": arguments.end}
    for mesh, cells in MESHES.items():
        for name, closure in closures().items():
            runs = [run(cells, closure, arguments.end) for _ in range(arguments.repetitions)]
            result[f"{mesh}, {name}"] = runs
            lines.append(row(mesh, name, runs))
            print(lines[-1], flush=True)
    harness.write("coupled", result, "\n".join(lines) + "\n\n" + ELSEWHERE)


if __name__ == "__main__":
    main()
