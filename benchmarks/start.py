"""From the command to its answer: the first step of a run, `--help`, `check`, and a refusal.

    python benchmarks/start.py [--repetitions 5] [--scenes scenes/settling.toml ...]

A process of its own each time. A run is one of a single coupling interval, imports and output included: with an empty
cache of programs, with the cache that it leaves, and with that cache and other numbers in the scene. The cache and the
bytecode of Python are folders of this benchmark: the user's are not touched, and the bytecode is there from the first
measured start on, as in an installed package. Beside the wall time stands the time of the processor, which says more
where other programs run.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks import harness
from jaxdem.setup.builder import build

ROOT = Path(__file__).parents[1]
SCENES = ("settling.toml", "injection.toml", "injection_demo.toml", "chute.toml")
TARGETS = {"cold": 12.0, "warm": 3.0, "other numbers": 3.0, "--help": 0.3, "check": 1.5, "refused --out": 1.0}
"""Wall time on two quiet cores [s]."""

OTHER_NUMBERS = {
    "particles.density": 1.02,
    "contact.friction": 0.9,
    "contact.restitution": 0.95,
    "fluid.viscosity": 1.1,
}
"""Keys of a scene and what their value is multiplied by; those that the scene has not are left as they are."""


def timed(arguments: list[str], folder: Path, code: int = 0) -> dict[str, float]:
    """Wall and processor time of a command that ends with this code [s]."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONPYCACHEPREFIX": str(folder / "bytecode")}
    environment |= {"PYTHONDONTWRITEBYTECODE": "", "JAXDEM_CACHE": str(folder / "cache")}
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run([sys.executable, "-m", "jaxdem", *arguments], capture_output=True, text=True, env=environment)
    seconds, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode != code:
        raise subprocess.CalledProcessError(done.returncode, arguments, done.stdout, done.stderr)
    return {"wall": seconds, "processor": sum(after[:2]) - sum(before[:2])}


def changes(scene: Path) -> tuple[list[str], list[str]]:
    """Options that make a run one interval long, and those that give the scene other numbers."""
    described = jaxdem.load_scene(scene)
    simulation, _ = build(described)
    short = [f"{key}={simulation.interval!r}" for key in ("time.end", "time.output_interval")]
    other = []
    for key, factor in OTHER_NUMBERS.items():
        table, name = key.split(".")
        value = getattr(getattr(described, table), name, None)
        if isinstance(value, float) and value > 0.0:
            other.append(f"{key}={factor * value!r}")
    return [part for text in short for part in ("--set", text)], [part for text in other for part in ("--set", text)]


def once(scene: Path, folder: Path) -> dict[str, dict[str, float]]:
    """Every command once, with an empty cache at the start."""
    short, other = changes(scene)
    cases: dict[str, list[str]] = {"cold": [], "warm": [], "other numbers": other}
    figures = {}
    for number, (name, options) in enumerate(cases.items()):
        out = folder / f"run-{number}"
        figures[name] = timed(["run", str(scene), "--out", str(out), *short, *options], folder)
    figures["--help"] = timed(["--help"], folder)
    figures["check"] = timed(["check", str(scene)], folder)
    figures["refused --out"] = timed(["run", str(scene), "--out", str(folder / "run-0")], folder, code=2)
    return figures


def measured(scene: Path, repetitions: int) -> dict[str, Any]:
    """Spread of the wall and processor times of every command."""
    runs = []
    with tempfile.TemporaryDirectory() as bytecode:
        timed(["check", str(scene)], Path(bytecode))
        timed(["run", str(scene), "--out", f"{bytecode}/first", *changes(scene)[0]], Path(bytecode))
        for _ in range(repetitions):
            with tempfile.TemporaryDirectory() as folder:
                (Path(folder) / "bytecode").symlink_to(Path(bytecode) / "bytecode")
                runs.append(once(scene, Path(folder)))
    return {
        name: {kind: harness.spread([run[name][kind] for run in runs]) for kind in ("wall", "processor")}
        for name in TARGETS
    }


def main() -> None:
    """All scenes, then the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--scenes", nargs="+", type=Path, default=[ROOT / "scenes" / name for name in SCENES])
    arguments = parser.parse_args()
    lines = [
        "| scene | command | wall time [s], median (range) | processor time [s] | target, wall [s] |",
        "| --- | --- | --- | --- | --- |",
    ]
    result: dict[str, Any] = {}
    for scene in arguments.scenes:
        result[scene.name] = measured(scene, arguments.repetitions)
        for name, figures in result[scene.name].items():
            wall, processor = figures["wall"], figures["processor"]
            spread = f"{wall['median']:.2f} ({wall['lowest']:.2f}-{wall['highest']:.2f})"
            lines.append(f"| {scene.name} | {name} | {spread} | {processor['median']:.2f} | {TARGETS[name]:g} |")
            print(lines[-1], flush=True)
        harness.save("start", result, "\n".join(lines))


if __name__ == "__main__":
    main()
