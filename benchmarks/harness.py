"""What all benchmarks share: repetitions, machine and versions, results as files."""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import resource
import shutil
import statistics
import subprocess
import sys
from pathlib import Path
from typing import Any

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


def reason_of(error: Exception) -> str:
    """Why a program failed, in a line: its last line with the word error, else its last line, else the exception."""
    said = ""
    if isinstance(error, subprocess.CalledProcessError):
        said = "\n".join(text for text in (error.stdout, error.stderr) if isinstance(text, str))
    lines = [line.strip() for line in said.splitlines() if line.strip()] or [f"{type(error).__name__}: {error}"]
    told = [line for line in lines if "error" in line.lower()] or lines
    return told[-1].replace("|", "/")[:200]
