"""Millions of grains in several processes of one machine: time, memory, and the run as one file.

    python benchmarks/millions.py [--count 4000000] [--processes 4] [--intervals 3] [--steps 100]

The sliding column of contact.py, run by `jaxdem run --processes P` for so many intervals of so many contact steps, with
an output at the end of each. Memory is looked at while it runs: the largest sum over all processes of what each has for
itself and its share of what they have together (proportional set size). Then VTK's reader opens the master as one file:
all grains must be there, each once, and inside of the box. Needs Linux and the package vtk.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

from benchmarks import contact, harness

LOOK = 0.5  # time between two looks at the memory [s]


def memory(parent: int) -> dict[int, int]:
    """Bytes of all processes below one; those that end meanwhile count for nothing."""
    parents, found = {}, {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            stat = (folder / "stat").read_text()
            parents[int(folder.name)] = int(stat[stat.rindex(")") + 2 :].split()[1])
        except OSError:
            continue
    below = {parent}
    for _ in range(4):
        below |= {process for process, above in parents.items() if above in below}
    for process in below:
        try:
            lines = Path(f"/proc/{process}/smaps_rollup").read_text().splitlines()
            found[process] = sum(1024 * int(line.split()[1]) for line in lines if line.startswith("Pss:"))
        except OSError:
            continue
    return found


def run(scene: Path, out: Path, processes: int) -> dict[str, Any]:
    """The command, its time and the largest memory that was seen."""
    command = [sys.executable, "-m", "jaxdem", "run", scene, "--out", out, "--processes", str(processes), "--quiet"]
    begin = time.perf_counter()
    child = subprocess.Popen(command)
    most, each = 0, 0
    while child.poll() is None:
        now = memory(child.pid)
        most, each = max(most, sum(now.values())), max(each, *now.values(), 0)
        time.sleep(LOOK)
    if child.returncode:
        raise SystemExit(f"jaxdem run ended with code {child.returncode}")
    return {"seconds": time.perf_counter() - begin, "memory": most, "memory_of_a_process": each}


def opened(out: Path, count: int, box: tuple[float, float]) -> dict[str, Any]:
    """What VTK's reader finds in the master."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOHDF import vtkHDFReader

    reader = vtkHDFReader()
    reader.SetFileName(str(out / "particles.vtkhdf"))
    reader.UpdateInformation()
    frames = reader.GetNumberOfSteps()
    reader.SetStep(frames - 1)
    reader.Update()
    data = reader.GetOutput()
    points, identity = vtk_to_numpy(data.GetPoints().GetData()), vtk_to_numpy(data.GetPointData().GetArray("id"))
    assert len(points) == count and np.array_equal(np.sort(identity), np.arange(count))
    assert np.all(points[:, :2] > 0.0) and np.all(points[:, :2] < np.asarray(box))
    return {"frames": frames, "points": len(points), "bytes": sum(file.stat().st_size for file in out.glob("*.vtkhdf"))}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--count", type=int, default=4_000_000)
    parser.add_argument("--processes", type=int, default=4)
    parser.add_argument("--intervals", type=int, default=3)
    parser.add_argument("--steps", type=int, default=100)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        scene, out = contact.write_sliding_column(Path(folder), arguments.count, arguments.steps), Path(folder) / "run"
        interval = tomllib.loads(scene.read_text())["time"]["output_interval"]
        text = scene.read_text().replace("end = 1.0", f"end = {arguments.intervals * interval}")
        scene.write_text(text)
        told = run(scene, out, arguments.processes)
        seen = opened(out, arguments.count, contact.column(arguments.count)[1])
        summary = json.loads((out / "summary.json").read_text())
    shares = summary["devices"]["particles"]
    result = vars(arguments) | told | {"opened": seen, "devices": summary["devices"]}
    rows = [
        ("grains", f"{arguments.count:,}"),
        ("processes", str(arguments.processes)),
        ("contact steps", str(arguments.intervals * arguments.steps)),
        ("time with start, compiling and files", f"{told['seconds']:.0f} s"),
        ("largest memory of all processes", f"{told['memory'] / 2**30:.1f} GiB"),
        ("largest memory of a process", f"{told['memory_of_a_process'] / 2**30:.1f} GiB"),
        ("grains of each", f"{min(shares):,} to {max(shares):,}"),
        (
            "opened by VTK as one file",
            f"{seen['points']:,} points, {seen['frames']} frames, {seen['bytes'] / 2**20:.0f} MiB",
        ),
    ]
    lines = ["| what | value |", "| --- | --- |", *(f"| {name} | {value} |" for name, value in rows)]
    harness.write("millions", result, "\n".join(lines))


if __name__ == "__main__":
    main()
