"""From the command to the end of the first coupled step: with an empty compilation cache and with a filled one.

    python benchmarks/compile_time.py [--repetitions 5] [--scenes scenes/injection.toml ...]

`jaxdem run` of one coupling interval, a process of its own each time, imports and output included. The cache is a folder
of this benchmark: the user's is not touched. Targets: 40 s with an empty cache, 8 s with a filled one.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks import harness
from tests.cases.steps import time_steps

ROOT = Path(__file__).parents[1]
SCENES = ("injection.toml", "injection_demo.toml", "chute.toml")


def first_step(scene: Path, cache: Path) -> dict[str, float]:
    """Seconds from the command to the end of one interval, and how much of them was compilation."""
    interval = time_steps(jaxdem.load_scene(scene)).interval
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        command = [sys.executable, "-m", "jaxdem", "run", str(scene), "--out", str(out)]
        for key in ("time.end", "time.output_interval"):
            command += ["--set", f"{key}={interval!r}"]
        environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": str(cache), "PYTHONPATH": str(ROOT)}
        begin = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True, env=environment)
        seconds = time.perf_counter() - begin
        summary = json.loads((out / "summary.json").read_text())
    return {"seconds": seconds, "compile": summary["stages_s"]["compile"]}


def measured(scene: Path, repetitions: int) -> dict[str, Any]:
    """Cold once for each repetition, in a new cache, then warm in the same."""
    cold, warm = [], []
    for _ in range(repetitions):
        with tempfile.TemporaryDirectory() as cache:
            cold.append(first_step(scene, Path(cache)))
            warm.append(first_step(scene, Path(cache)))
    return {
        kind: {name: harness.spread([run[name] for run in runs]) for name in ("seconds", "compile")}
        for kind, runs in (("cold", cold), ("warm", warm))
    }


def main() -> None:
    """All scenes, then the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--scenes", nargs="+", type=Path, default=[ROOT / "scenes" / name for name in SCENES])
    arguments = parser.parse_args()
    lines = [
        "| scene | cold [s], median (range) | of it compiling | warm [s], median (range) | of it compiling |",
        "| --- | --- | --- | --- | --- |",
    ]
    result: dict[str, Any] = {}
    for scene in arguments.scenes:
        figures = result[scene.name] = measured(scene, arguments.repetitions)
        cells = []
        for kind in ("cold", "warm"):
            whole, part = figures[kind]["seconds"], figures[kind]["compile"]
            cells += [
                f"{whole['median']:.1f} ({whole['lowest']:.1f}-{whole['highest']:.1f})",
                f"{part['median']:.1f}",
            ]
        lines.append(f"| {scene.name} | {' | '.join(cells)} |")
        print(lines[-1], flush=True)
    harness.write("compile_time", result, "\n".join(lines))


if __name__ == "__main__":
    main()
