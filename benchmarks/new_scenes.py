"""The scenes that `jaxdem new` writes, run to their end as a user runs them.

    python benchmarks/new_scenes.py [--only settling ...] [--set time.end=0.5 ...]

Each is written by `jaxdem new`, checked by `jaxdem check` and run by `jaxdem run`, processes of their own. A run must
be valid. Prints what came out, and writes results/new_scenes.json and .md.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # run as a script from anywhere

import jaxdem  # noqa: E402
from benchmarks import harness  # noqa: E402
from jaxdem.scene.commented import NAMES  # noqa: E402


def command(*arguments: str | Path) -> float:
    """Processor time of a command of jaxdem that must succeed [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    subprocess.run([sys.executable, "-m", "jaxdem", *map(str, arguments)], env=environment, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def outcome(name: str, changes: list[str], folder: Path) -> dict[str, Any]:
    """What a run to the end came to."""
    scene, out = folder / f"{name}.toml", folder / name
    command("new", name, "--out", scene)
    settings = [word for change in changes for word in ("--set", change)]
    command("check", scene, *settings)
    seconds = command("run", scene, "--out", out, "--quiet", *settings)
    run = jaxdem.load_run(out)
    grains = run.particles(-1)
    there = grains["active"].astype(bool) if "active" in grains else slice(None)
    position = grains["position"][there]
    if not (run.summary["valid"] and np.all(np.isfinite(position))):
        raise RuntimeError(f"{name}: {run.summary['reason']}")
    removed = float(run.history["removed"][-1]) if "removed" in run.history else 0.0
    return {
        "end_s": float(run.times[-1]),
        "frames": run.number_of_frames,
        "grains_at_end": len(position),
        "removed": removed,
        "kinetic_energy_j": float(run.history["kinetic_energy"][-1]),
        "height_m": float(run.history["height"][-1]),
        "processor_s": seconds,
    }


def main() -> None:
    """Runs the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=list(NAMES), choices=NAMES)
    parser.add_argument("--set", nargs="*", default=[], dest="changes", metavar="KEY=VALUE")
    given = parser.parse_args()
    rows: dict[str, Any] = {}
    names = ("end_s", "frames", "grains_at_end", "removed", "kinetic_energy_j", "processor_s")
    lines = [f"| scene | {' | '.join(names)} |", f"| --- |{' --- |' * len(names)}"]
    with tempfile.TemporaryDirectory() as folder:
        for name in given.only:
            rows[name] = outcome(name, given.changes, Path(folder))
            lines.append(f"| {name} | {' | '.join(f'{rows[name][key]:.3g}' for key in names)} |")
            harness.save("new_scenes", {"scenes": rows, "changes": given.changes}, "\n".join(lines))
    print("\n".join(lines))


if __name__ == "__main__":
    main()
