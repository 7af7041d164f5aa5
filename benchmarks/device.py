"""The same work on several of JAX's platforms: contacts, fluid, coupled scenes and training, on a graphics card and on
a core.

    python benchmarks/device.py [--platforms cpu cuda] [--cores 1] [--cases "fluid, 300 x 50 cells" ...]

Contacts and cells are those of scaling.py and fluid.py, the injection that of coupled.py, the training that of
training.py; the dilute jet is `scenes/dilute_jet.toml` for a twentieth of a second. Every case is a process of its own.
The platforms work at the same time, one case each; on the CPU a process keeps to `--cores` cores.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

from benchmarks import harness

# jax is imported by the processes that measure: they say which platform it takes.

DILUTE = Path(__file__).parents[1] / "scenes" / "dilute_jet.toml"
WINDOWS = argparse.Namespace(windows=3, particle_steps=1e7, cell_steps=2e6)


def contacts(count: int) -> tuple[list[float], str]:
    """Microseconds of a contact step of a sliding column of so many grains."""
    from benchmarks import scaling

    found = scaling.particle_windows(count, WINDOWS)
    return [1e6 * s / found["steps"] for s in found["seconds"]], "us a contact step"


def fluid(cells: tuple[int, ...]) -> tuple[list[float], str]:
    """Milliseconds of a fluid step of the jet."""
    from benchmarks import fluid

    windows = fluid.jaxdem_windows(cells, "jet", WINDOWS.windows, WINDOWS.cell_steps)["windows"]
    return [1e3 * w["seconds"] / w["steps"] for w in windows], "ms a fluid step"


def injection(mesh: str) -> tuple[list[float], str]:
    """Seconds per simulated second of the first 0.2 s of the injection."""
    from benchmarks import coupled

    return [coupled.run(mesh, "Koch-Hill", 0.2)["per_simulated_second"]], "s per simulated s"


def dilute() -> tuple[list[float], str]:
    """The same of the dilute jet."""
    import jaxdem
    from benchmarks import coupled

    end = 0.05
    with tempfile.TemporaryDirectory() as folder:
        done = jaxdem.simulate(jaxdem.load_scene(DILUTE, {"time.end": end}), Path(folder) / "run")
    stages = {key: value for key, value in done.summary["stages_s"].items() if value is not None}
    return [coupled.solving(stages) / end], "s per simulated s"


def training() -> tuple[list[float], str]:
    """Seconds of an epoch of the paper's network."""
    from benchmarks import training
    from jaxdem.train.fit_settings import FitSettings

    settings = FitSettings(epochs=7)
    found = training.single_training(settings, training.synthetic_samples(settings.samples))
    spread = found["seconds_per_epoch"]
    return [spread["median"], spread["lowest"], spread["highest"]], "s an epoch"


CASES: dict[str, Callable[[], tuple[list[float], str]]] = {
    "contacts, 10,000 grains": lambda: contacts(10_000),
    "contacts, 100,000 grains": lambda: contacts(100_000),
    "contacts, 1,000,000 grains": lambda: contacts(1_000_000),
    "fluid, 300 x 50 cells": lambda: fluid((300, 50)),
    "fluid, 1,200 x 200 cells": lambda: fluid((1200, 200)),
    "fluid, 2,400 x 400 cells": lambda: fluid((2400, 400)),
    "fluid, 100 x 100 x 100 cells": lambda: fluid((100, 100, 100)),
    "injection, 16 cm, 20,000 grains": lambda: injection("16 cm"),
    "injection, 4 cm, 20,000 grains": lambda: injection("4 cm"),
    "dilute jet, 10,000 grains, a million cells": dilute,
    "training, 250,000 samples, 170-70-30": training,
}


def inside(case: str) -> dict[str, Any]:
    """What this process measures, and what it measured it on."""
    import jax

    values, unit = CASES[case]()
    return {
        "values": harness.spread(values),
        "unit": unit,
        "device": jax.devices()[0].device_kind,
    } | harness.peak_memory()


def measured(platform: str, case: str, cores: int) -> dict[str, Any]:
    """A case in a process of its own on a platform; {"failed": why} where it does not come to its end."""
    command = [sys.executable, __file__, "--inside", case]
    if platform == "cpu":
        command = harness.pinned(cores, command)
    done = subprocess.run(command, env={**os.environ, "JAX_PLATFORMS": platform}, capture_output=True, text=True)
    if done.returncode:
        return {"failed": (done.stderr.strip().splitlines() or [f"status {done.returncode}"])[-1][:200]}
    return json.loads(done.stdout.splitlines()[-1])


def cell(found: dict[str, Any]) -> str:
    """A figure with its range."""
    if "failed" in found:
        return str(found["failed"])
    values = found["values"]
    ranged = f" ({values['lowest']:.3g}-{values['highest']:.3g})" if values["repetitions"] > 1 else ""
    return f"{values['median']:.3g}{ranged}"


def table(results: dict[str, dict[str, Any]], cases: list[str]) -> str:
    """A line for every case; with two platforms, how often the second goes into the first."""
    platforms = list(results)
    rows = ["| case | unit | " + " | ".join(platforms) + " | ratio |", "|" + " --- |" * (len(platforms) + 3)]
    for case in cases:
        found = [results[platform][case] for platform in platforms]
        unit = next((one["unit"] for one in found if "unit" in one), "")
        good = len(found) == 2 and all("values" in one for one in found)
        ratio = f"{found[0]['values']['median'] / found[1]['values']['median']:.3g}" if good else ""
        rows.append(f"| {case} | {unit} | {' | '.join(map(cell, found))} | {ratio} |")
    return "\n".join(rows)


def main() -> None:
    """All cases on all platforms, then the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--platforms", nargs="+", default=["cpu", "cuda"])
    parser.add_argument("--cores", type=int, default=1)
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES), metavar="CASE")
    parser.add_argument("--inside", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.inside:
        print(json.dumps(inside(arguments.inside)))
        return

    def all_of(platform: str) -> dict[str, Any]:
        found = {}
        for case in arguments.cases:
            found[case] = measured(platform, case, arguments.cores)
            print(platform, case, cell(found[case]), flush=True)
        return found

    with ThreadPoolExecutor(len(arguments.platforms)) as pool:
        results = dict(zip(arguments.platforms, pool.map(all_of, arguments.platforms), strict=True))
    devices = {one["device"] for found in results.values() for one in found.values() if "device" in one}
    about = f"On {', '.join(sorted(devices))}; the CPU with {arguments.cores} core(s); median (range)."
    harness.write("device", {"cores_used": arguments.cores, **results}, f"{about}\n\n{table(results, arguments.cases)}")


if __name__ == "__main__":
    main()
