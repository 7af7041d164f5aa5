"""What all benchmarks share: repetitions, machine and versions, results as files, studies over several packs."""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import os
import platform
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

RESULTS = Path(__file__).parent / "results"
PACKAGES = ("jax", "jaxlib", "numpy")


def machine() -> dict[str, Any]:
    """Processor, cores and versions that a figure belongs to."""
    model = "unknown"
    if Path("/proc/cpuinfo").exists():
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), model)
    return {
        "processor": model,
        "cores": len(os.sched_getaffinity(0)),
        "load_before": os.getloadavg()[0],
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in PACKAGES},
    }


def pinned(cores: int, command: list[str]) -> list[str]:
    """The command kept on so many cores, where taskset is installed."""
    if shutil.which("taskset") is None:
        return command
    chosen = sorted(os.sched_getaffinity(0))[:cores]
    return ["taskset", "-c", ",".join(map(str, chosen)), *command]


def peak_memory() -> dict[str, int | None]:
    """Largest memory of this process so far, and of its device where that reports it [bytes]."""
    import jax

    unit = 1 if sys.platform == "darwin" else 1024
    of_device = jax.local_devices()[0].memory_stats() or {}
    return {
        "peak_bytes": unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
        "device_peak_bytes": of_device.get("peak_bytes_in_use"),
    }


def spread(values: list[float]) -> dict[str, float]:
    """Median, smallest and largest of the repetitions."""
    return {
        "median": statistics.median(values),
        "lowest": min(values),
        "highest": max(values),
        "repetitions": len(values),
    }


def write(name: str, result: dict[str, Any], table: str) -> None:
    """Writes results/NAME.json and results/NAME.md, and prints the table."""
    save(name, result, table)
    print(table)


def save(name: str, result: dict[str, Any], table: str) -> None:
    """Writes results/NAME.json and results/NAME.md: also what there is so far, so that a failure loses nothing."""
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / f"{name}.json").write_text(json.dumps({"machine": machine(), **result}, indent=1) + "\n")
    described = ", ".join(f"{key} {value}" for key, value in machine().items())
    (RESULTS / f"{name}.md").write_text(f"{table}\n\n{described}\n")


class Study(NamedTuple):
    """A scene run at several values of a parameter, each with several packs of particles.

    Attributes:
        name: of the files of its results.
        parameter: name of the option of the values, also in the rows.
        values: of the parameter, unless the command line gives others.
        run_of: a run with this value and pack in this folder, measured; used again if it is complete.
        columns: of the table, by heading: how a row is written, as a format string with the names of the row.
        about: settings and what follows from all rows together, kept beside them.
    """

    name: str
    parameter: str
    values: Sequence[float]
    run_of: Callable[[float, int, Path], dict[str, Any]]
    columns: Mapping[str, str]
    about: Callable[[list[dict[str, Any]]], dict[str, Any]]

    def arguments(self, description: str) -> argparse.ArgumentParser:
        """Options of a script: values of the parameter, packs, a folder in which the runs are kept, a picture."""
        how = argparse.RawTextHelpFormatter
        parser = argparse.ArgumentParser(description=description, formatter_class=how)
        parser.add_argument(f"--{self.parameter}s", dest="values", default=",".join(map(str, self.values)))
        parser.add_argument("--packs", default="0,1", help="seeds of the packs")
        parser.add_argument("--runs", type=Path, help="folder in which the runs are kept")
        parser.add_argument("--picture", type=Path, help="PNG of the result")
        return parser

    def run(self, given: argparse.Namespace) -> list[dict[str, Any]]:
        """All runs, one row each; prints and saves every row when it is there, so that a failure loses nothing."""
        rows: list[dict[str, Any]] = []
        with tempfile.TemporaryDirectory() as temporary:
            folder = given.runs or Path(temporary)
            for value in map(float, given.values.split(",")):
                for seed in map(int, given.packs.split(",")):
                    found = self.run_of(value, seed, folder / f"{value:g}_{seed}")
                    rows.append({self.parameter: value, "seed": seed} | found)
                    print(self.table(rows).splitlines()[-1], flush=True)
                    save(self.name, self.about(rows) | {"rows": rows}, self.table(rows))
        print(self.table(rows))
        return rows

    def table(self, rows: list[dict[str, Any]]) -> str:
        """One line a run."""
        lines = [list(self.columns), ["---"] * len(self.columns)]
        lines += [[form.format(**row) for form in self.columns.values()] for row in rows]
        return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def standard_error(values: np.ndarray, blocks: int = 5) -> float:
    """Of the mean of a series, from the means of so many equal parts, which are taken as independent."""
    means = [float(part.mean()) for part in np.array_split(values, blocks)]
    return float(np.std(means, ddof=1) / np.sqrt(blocks))


def time_of(run: Any) -> float:
    """Wall time of a run without that of compiling [s]."""
    return run.summary["wall_time_s"] - (run.summary["stages_s"]["compile"] or 0.0)


def reason_of(error: Exception) -> str:
    """Why a program failed, in a line: its last line with the word error, else its last line, else the exception."""
    said = ""
    if isinstance(error, subprocess.CalledProcessError):
        said = "\n".join(text for text in (error.stdout, error.stderr) if isinstance(text, str))
    lines = [line.strip() for line in said.splitlines() if line.strip()] or [f"{type(error).__name__}: {error}"]
    told = [line for line in lines if "error" in line.lower()] or lines
    return told[-1].replace("|", "/")[:200]
