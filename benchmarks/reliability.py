"""Which faults the program survives: kills at any moment, bad scenes, damaged files. Prints counts, not times.

    python benchmarks/reliability.py [--only kills chain scenes runs files] [--kills 20] [--runs 40] [--files 24]
        [--bits 400] [--seed 0]

Prints a table and writes results/reliability.json and .md; sections that are not run keep their rows.
"""

from __future__ import annotations

import argparse
import collections
import itertools
import json
import os
import random
import resource
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # run as a script from anywhere

from benchmarks import harness  # noqa: E402
from jaxdem.io import load_run, run_folder  # noqa: E402
from jaxdem.io.chain import CHAIN as CHAIN_FILE  # noqa: E402
from tests.cases import damage, hostile  # noqa: E402

PATIENCE = 3600
"""For all damaged files of a kind [s]; a hang of the HDF5 library would be one of the whole process."""

SCENE = """
[domain]
size = [0.2, 0.2]
depth = 0.04
[particles]
radius = 0.01
density = 2650.0
[particles.pack]
kind = "lattice"
start = [0.01, 0.02]
stop = [0.15, 0.15]
spacing = 1.05
[contact]
young_modulus = 5e5
speed = 1.0
[fluid]
cells = [5, 5]
time_step = 0.01
[boundary.left]
kind = "inlet"
velocity = 0.2
[boundary.right]
kind = "outlet"
[time]
end = 2.0
output_interval = 0.04
[output]
samples = 0.04
checkpoint_interval = 0.1
"""

STAGES = ("fill", "flow", "tilt")
CHAIN = (
    SCENE.replace("samples = 0.04\n", "")
    + """
[coupling]
interval = 0.01
[[probes]]
name = "middle"
kind = "plane"
axis = "x"
at = 0.1
interval = 0.07
[[probes]]
name = "layers"
kind = "profile"
axis = "z"
cells = 4
interval = 0.09
average = true
[[probes]]
name = "floor"
kind = "wall"
side = "bottom"
interval = 0.11
[[stages]]
name = "fill"
time.end = 0.6
fluid = false
boundary = false
[[stages]]
name = "flow"
time.end = 1.2
[stages.fluid]
cells = [5, 5]
time_step = 0.01
[stages.boundary]
left = { kind = "inlet", velocity = 0.2 }
right = { kind = "outlet" }
[[stages]]
name = "tilt"
time.end = 1.8
domain.gravity = [1.0, -9.7]
"""
)
"""A bed that settles dry, is flown through, and is tilted, with probes whose sums go over from stage to stage."""

KILLED_IN_WRITE = """
import sys
from pathlib import Path
sys.path[:0] = [sys.argv[1], sys.argv[1] + "/tests/io"]
from deaths import die_in_write
from jaxdem.cli.main import app
die_in_write(int(sys.argv[2]))
app(sys.argv[3:], prog_name="jaxdem")
"""


def kills(
    number: int, seed: int, scene: str = SCENE, stages: Sequence[str] = (), writes: int = 80, waits: bool = True
) -> dict[str, Any]:
    """The command line killed again and again, every other time inside a write, and resumed; against a whole run.

    Args:
        number: of kills.
        seed: of their moments.
        scene: text of the scene.
        stages: names of its stages; none for a single run.
        writes: most of a process before it is killed in one.
        waits: whether every other kill comes at any moment; else all come inside writes.
    """
    generator = random.Random(seed)
    folder = Path(tempfile.mkdtemp())
    (folder / "scene.toml").write_text(scene)
    environment = os.environ | {"PYTHONPATH": str(ROOT)}

    def command(out: Path, write: int = 0) -> list[str]:
        arguments = ["run", str(folder / "scene.toml"), "--out", str(out)]
        if run_folder.is_complete(out) or any((out / name).exists() for name in ("scene.toml", CHAIN_FILE)):
            arguments.append("--resume")
        start = [sys.executable, "-m", "jaxdem"]
        return [
            *([sys.executable, "-c", KILLED_IN_WRITE, str(ROOT), str(write)] if write else start),
            *arguments,
        ]

    def same(out: Path) -> int:
        return sum(_same_runs(folder / "whole" / name, out / name) for name in stages or [""])

    subprocess.run(command(folder / "whole"), env=environment, check=True, capture_output=True)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    length = used.ru_utime + used.ru_stime
    survived, resumed_to, out = 0, [], folder / "killed"
    while survived < number:
        write = generator.randint(1, writes) if survived % 2 or not waits else 0
        process = subprocess.Popen(
            command(out, write), env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        if not write:
            _wait_for_work(process, generator.uniform(0.0, 0.9 * length))
            process.kill()
        _, errors = process.communicate()
        if process.returncode == 0:  # it came to its end before the kill: another run
            same(out)
            out = folder / f"killed_{survived}"
            continue
        if process.returncode != -9:
            raise RuntimeError(f"exit code {process.returncode} instead of a kill: {errors}")
        survived += 1
        runs = [out / name for name in stages or [""]]
        resumed_to.append(sum(load_run(run).number_of_frames for run in runs if (run / "history.csv").exists()))
    subprocess.run(command(out), env=environment, check=True, capture_output=True)
    return {"kills survived": survived, "frames equal bit for bit": same(out), "frames at the kills": resumed_to}


def _wait_for_work(process: subprocess.Popen[str], seconds: float) -> None:
    """Until the process has used so much processor time, which a loaded machine does not change, or has ended."""
    ticks = seconds * os.sysconf("SC_CLK_TCK")
    while process.poll() is None:
        fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
        if int(fields[11]) + int(fields[12]) >= ticks:
            return
        time.sleep(0.002)


def _same_runs(one: Path, other: Path) -> int:
    """Compares two finished runs bit for bit; the number of frames."""
    for name in ("history.csv", *(f"probes/{file.name}" for file in sorted((one / "probes").glob("*.csv")))):
        if (one / name).read_bytes() != (other / name).read_bytes():
            raise RuntimeError(f"{other}: {name} differs")
    first, second = load_run(one), load_run(other)
    for index in range(first.number_of_frames):
        for read in ("particles", "fluid"):
            ours, theirs = getattr(first, read)(index), getattr(second, read)(index)
            if any(ours[name].tobytes() != theirs[name].tobytes() for name in ours or ()):
                raise RuntimeError(f"{other}: frame {index} of the {read} differs")
    for index in range(len(first.samples or ())):
        ours, theirs = first.samples.frame(index), second.samples.frame(index)  # type: ignore[union-attr]
        if any(np.asarray(ours[name]).tobytes() != np.asarray(theirs[name]).tobytes() for name in ours):
            raise RuntimeError(f"{other}: sample {index} differs")
    return first.number_of_frames


def scenes() -> dict[str, Any]:
    """Every bad scene read."""
    found: collections.Counter[str] = collections.Counter()
    slowest = (0.0, "")
    for case in hostile.bad_scenes():
        started = time.process_time()
        outcome = hostile.outcome(case.tables)
        slowest = max(slowest, (time.process_time() - started, f"{case.base}: {case.key}, {case.kind}"))
        found[outcome] += 1
    counts = {
        "bad scenes tried": sum(found.values()),
        **{f"scenes {name}": n for name, n in sorted(found.items())},
    }
    return counts | {f"processor time [s] of the slowest ({slowest[1]})": round(slowest[0], 2)}


def runs(number: int, seed: int) -> dict[str, Any]:
    """Accepted scenes drawn at random, built and run for three intervals: finite, or stopped with a message.

    Compiling is nearly all of it: with few optimisations, and once for scenes that differ in parameters only.
    """
    # What is left out gives its default, which is no strange value.
    cases = [case for case in hostile.bad_scenes() if not case.kind.startswith(("missing", "empty"))]
    random.Random(seed).shuffle(cases)
    accepted = (case for case in cases if hostile.outcome(case.tables) == "accepted")
    chosen = list(itertools.islice(accepted, number))
    found: collections.Counter[str] = collections.Counter()
    with tempfile.TemporaryDirectory() as cache:
        jax.config.update("jax_disable_most_optimizations", True)
        jax.config.update("jax_compilation_cache_dir", cache)
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
        for case in chosen:
            started = time.process_time()
            try:
                found[hostile.few_steps(case.tables)] += 1
            except Exception as error:
                error.add_note(f"{case.base}: {case.key}, {case.kind}")
                traceback.print_exception(error)
                found["that failed otherwise"] += 1
            print(f"{case.base}: {case.key}, {case.kind}: {time.process_time() - started:.1f} s", flush=True)
    return {"strange scenes run": len(chosen), **{f"runs {name}": n for name, n in sorted(found.items())}}


def files(number: int, bits: int, seed: int) -> dict[str, Any]:
    """Damaged copies of every kind of file read by a process of its own, which may be killed by a hang."""
    result: dict[str, Any] = {}
    for kind in damage.KINDS:
        command = [sys.executable, "-m", "tests.cases.damage", kind, str(number), str(bits), str(seed)]
        try:
            done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            result[f"{kind}: did not end"] = 1
            continue
        if done.returncode != 0:
            raise RuntimeError(f"{kind}: exit code {done.returncode}: {done.stderr[-1000:]}")
        result |= {f"{kind}: {name}": n for name, n in json.loads(done.stdout).items()}
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=["kills", "chain", "scenes", "runs", "files"])
    for name, default in (("kills", 20), ("runs", 40), ("files", 24), ("bits", 400), ("seed", 0)):
        parser.add_argument(f"--{name}", type=int, default=default)
    options = parser.parse_args()
    path = harness.RESULTS / "reliability.json"
    results: dict[str, Any] = {}
    work: dict[str, Callable[[], dict[str, Any]]] = {
        "kills": lambda: kills(options.kills, options.seed),
        "chain": lambda: kills(options.kills, options.seed, CHAIN, STAGES),
        "scenes": scenes,
        "runs": lambda: runs(options.runs, options.seed),
        "files": lambda: files(options.files, options.bits, options.seed),
    }
    for name in work:
        if name in options.only:
            results[name] = work[name]()
    before = json.loads(path.read_text())["sections"] if path.exists() else {}
    results = before | results
    lines = ["| section | what | count |", "| --- | --- | --- |"]
    for name, counts in results.items():
        lines += [f"| {name} | {what} | {count} |" for what, count in counts.items()]
    harness.write("reliability", {"sections": results}, "\n".join(lines))


if __name__ == "__main__":
    main()
