"""Time and memory against the number of particles and of cells, and the memory of the injection scene.

    python benchmarks/scaling.py [--particles 1e3 1e4 1e5 1e6] [--cells 1.5e4 6e4 2.4e5 1e6] [--windows 5]
        [--particle-steps 2e7] [--cell-steps 2e6] [--no-injection]

Particles: the hexagonal column of contact.py with N grains, in a box scaled by the square root of N. It slides at
2 m/s, so that the neighbour list is rebuilt about as often as in a flowing heap, from the first step and for every N.
Cells: the jet of fluid.py on a 2-D mesh. Injection: the first coupled steps of `scenes/injection.toml`.

Every size has a process of its own, so the peak memory is that of this size: build, compilation and steps together. On
an accelerator the peak memory of the device is given too. A size is left out if its memory, extrapolated from the size
before, is more than the machine has.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

from benchmarks import contact, fluid, harness

# jax is imported by the processes that measure, not here: a process inherits the peak memory of the one it came from.

INJECTION = Path(__file__).parents[1] / "scenes" / "injection.toml"
INJECTION_LIMIT = 1.2e9  # what its memory should stay under [bytes]


def steps_of(count: int, particle_steps: float) -> int:
    """Contact steps in a window: few for many particles, but enough for some list builds."""
    return min(1000, max(50, round(particle_steps / count)))


# --- inside a process of its own --------------------------------------------------------------------------


def particle_windows(count: int, arguments: argparse.Namespace) -> dict[str, Any]:
    """Seconds of windows of contact steps of a sliding column, list builds in them, and seconds of a build."""
    import jax

    import jaxdem
    from jaxdem.step import step

    steps = steps_of(count, arguments.particle_steps)
    with tempfile.TemporaryDirectory() as folder:
        scene = jaxdem.load_scene(contact.write_sliding_column(Path(folder), count, steps))
        simulation, parameters = jaxdem.build(scene)
        state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    advance = jax.jit(lambda s, n: step(simulation, parameters, s, n)[:2]).lower(state, neighbors).compile()
    seconds, builds = [], []
    for _ in range(arguments.windows + 1):
        before, start = int(neighbors.builds), time.perf_counter()
        state, neighbors = jax.block_until_ready(advance(state, neighbors))
        seconds.append(time.perf_counter() - start)
        builds.append(int(neighbors.builds) - before)
        assert not bool(neighbors.overflow)
    memory = harness.peak_memory()  # before the builds alone are compiled: they are no part of a run
    return {
        "steps": simulation.steps.contacts_per_interval,
        "seconds": seconds[1:],
        "builds": builds[1:],
        "build_seconds": build_seconds(simulation, state.particles, neighbors, arguments.windows),
        "pairs_per_particle": float(np.sum(neighbors.pairs.first != neighbors.pairs.second)) / count,
    } | memory


def build_seconds(simulation: Any, particles: Any, neighbors: Any, repetitions: int) -> list[float]:
    """Seconds of one rebuild of the list and its history, as the contact loop does it when the list is stale."""
    import jax

    from jaxdem.numerics import vectors
    from jaxdem.particles.integrate import split_low
    from jaxdem.particles.neighbors import carry_history

    @jax.jit
    def rebuild(position: Any, low: Any, springs: Any, old: Any) -> Any:
        new = simulation.search.update(position, low, old, particles.active)
        return carry_history(springs, old, new), new

    position = vectors.components(particles.position)
    low = split_low(particles.position_low, len(position))
    seconds = []
    for _ in range(repetitions + 1):
        start = time.perf_counter()
        jax.block_until_ready(rebuild(position, low, particles.contact_spring, neighbors))
        seconds.append(time.perf_counter() - start)
    return seconds[1:]  # the first one compiles


def cell_windows(count: int, arguments: argparse.Namespace) -> dict[str, Any]:
    """Windows of the jet on a mesh of about so many cells, in the shape of 300 x 50."""
    up = round(math.sqrt(count / 6))
    cells = (6 * up, up)
    measured = fluid.jaxdem_windows(cells, "jet", arguments.windows, arguments.cell_steps)
    return {"mesh": cells, **measured} | harness.peak_memory()


def injection(count: int, arguments: argparse.Namespace) -> dict[str, Any]:
    """Seconds of the first coupled steps of the injection scene, with so many particles."""
    import jax

    import jaxdem
    from jaxdem.step import step

    scene = jaxdem.load_scene(INJECTION, {"particles.count": count})
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    advance = jax.jit(lambda s, n: step(simulation, parameters, s, n)[:2]).lower(state, neighbors).compile()
    seconds = []
    for _ in range(arguments.windows):
        start = time.perf_counter()
        state, neighbors = jax.block_until_ready(advance(state, neighbors))
        seconds.append(time.perf_counter() - start)
    return {
        "seconds": seconds,
        "contact_steps": simulation.steps.contacts_per_interval,
    } | harness.peak_memory()


def empty_process() -> int:
    """Peak memory with the package imported and the device opened, before there is a scene [bytes]."""
    import jaxdem  # noqa: F401

    return int(harness.peak_memory()["peak_bytes"] or 0)


KINDS = {"particles": particle_windows, "cells": cell_windows, "injection": injection}


# --- the sizes, one process each --------------------------------------------------------------------------


def measured(kind: str, count: int, arguments: argparse.Namespace) -> dict[str, Any]:
    """What a process of its own measures; {"failed": why} where it does not come to its end."""
    command = [sys.executable, __file__, "--inside", kind, str(count)]
    for name in ("windows", "particle_steps", "cell_steps"):
        command += [f"--{name.replace('_', '-')}", str(getattr(arguments, name))]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode < 0:  # by a signal: what the system does when memory runs out
        return {"failed": f"killed by signal {-done.returncode}"}
    if done.returncode > 0:
        print(done.stderr, file=sys.stderr)
        return {"failed": done.stderr.strip().splitlines()[-1][:80]}
    return json.loads(done.stdout.splitlines()[-1])


def sizes(kind: str, counts: list[int], arguments: argparse.Namespace) -> dict[int, dict[str, Any]]:
    """Every size in increasing order, those that the machine's memory does not hold left out."""
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    results: dict[int, dict[str, Any]] = {}
    start, each = 0, 0.0
    for count in sorted(counts):
        expected = start + each * count
        if expected > memory:
            found = {"failed": f"skipped: up to {expected / 1e9:.0f} GB, the machine has {memory / 1e9:.0f}"}
        else:
            found = measured(kind, count, arguments)
            if "failed" not in found:
                start = found["start_bytes"]
                each = found["bytes_each"] = (found["peak_bytes"] - start) / count
        results[count] = found
        print(kind, count, found.get("failed", "done"), flush=True)
    return results


# --- table ------------------------------------------------------------------------------------------------


def memory_text(found: dict[str, Any]) -> str:
    """Peak memory, with the device's where there is one."""
    own = f"{found['peak_bytes'] / 1e9:.2f}"
    device = found["device_peak_bytes"]
    return own if device is None else f"{own}, device {device / 1e9:.2f}"


def spread_text(values: dict[str, float]) -> str:
    """Median and range."""
    return f"{values['median']:.3g} ({values['lowest']:.3g}-{values['highest']:.3g})"


def particle_table(results: dict[int, dict[str, Any]]) -> list[str]:
    """Lines of the table over the number of particles; adds its figures to the results."""
    rows = [
        "| particles | ns a particle and contact step, median (range) | pairs a particle | "
        "contact steps a list build | ms a build | "
        "share of list builds | peak memory [GB] | of it above the empty process, kB a particle |",
        "| --- " * 8 + "|",
    ]
    for count, found in results.items():
        if "failed" in found:
            rows.append(f"| {count} | {found['failed']} | | | | | | |")
            continue
        found["nanoseconds"] = harness.spread([1e9 * s / found["steps"] / count for s in found["seconds"]])
        build, builds = harness.spread(found["build_seconds"]), sum(found["builds"])
        found["build_share"] = build["median"] * builds / sum(found["seconds"])
        between = f"{found['steps'] * len(found['seconds']) / builds:.0f}" if builds else "none built"
        rows.append(
            f"| {count} | {spread_text(found['nanoseconds'])} | {found['pairs_per_particle']:.2f} | {between} | "
            f"{1e3 * build['median']:.3g} | {100 * found['build_share']:.0f} % | {memory_text(found)} | "
            f"{1e-3 * found['bytes_each']:.3g} |"
        )
    return rows


def cell_table(results: dict[int, dict[str, Any]]) -> list[str]:
    """Lines of the table over the number of cells; adds its figures to the results."""
    rows = [
        "| cells | ns a cell and fluid step, median (range) | pressure iterations a step | peak memory [GB] | "
        "of it above the empty process, kB a cell |",
        "| --- " * 5 + "|",
    ]
    for count, found in results.items():
        if "failed" in found:
            rows.append(f"| {count} | {found['failed']} | | | |")
            continue
        cells = math.prod(found["mesh"])
        windows = found["windows"]
        found["nanoseconds"] = harness.spread([1e9 * w["seconds"] / w["steps"] / cells for w in windows])
        iterations = float(np.mean([w["iterations"] for w in windows]))
        rows.append(
            f"| {' x '.join(map(str, found['mesh']))} | {spread_text(found['nanoseconds'])} | {iterations:.1f} | "
            f"{memory_text(found)} | {1e-3 * found['bytes_each']:.3g} |"
        )
    return rows


def injection_line(found: dict[str, Any]) -> str:
    """What the injection scene took."""
    if "failed" in found:
        return f"scenes/injection.toml: {found['failed']}"
    found["seconds_per_step"] = harness.spread(found["seconds"])
    verdict = "under" if found["peak_bytes"] < INJECTION_LIMIT else "over"
    return (
        f"scenes/injection.toml, build and {len(found['seconds'])} coupled steps of {found['contact_steps']} contact "
        f"steps: peak memory {memory_text(found)} GB ({verdict} {INJECTION_LIMIT / 1e9} GB), "
        f"{spread_text(found['seconds_per_step'])} s a step"
    )


def whole(text: str) -> int:
    """A number of particles or cells, 1e5 being one too."""
    return round(float(text))


def main() -> None:
    """All sizes, the injection scene, then the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--particles", nargs="*", type=whole, default=[1000, 10_000, 100_000, 1_000_000])
    parser.add_argument("--cells", nargs="*", type=whole, default=[15_000, 60_000, 240_000, 1_000_000])
    parser.add_argument("--windows", type=int, default=5)
    parser.add_argument("--particle-steps", type=float, default=2e7)
    parser.add_argument("--cell-steps", type=float, default=2e6)
    parser.add_argument("--no-injection", action="store_true")
    parser.add_argument("--inside", nargs=2, metavar=("KIND", "COUNT"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.inside:
        kind, count = arguments.inside
        start = empty_process()
        print(json.dumps({"start_bytes": start} | KINDS[kind](int(count), arguments)))
        return
    particles = sizes("particles", arguments.particles, arguments)
    cells = sizes("cells", arguments.cells, arguments)
    result: dict[str, Any] = {"particles": particles, "cells": cells}
    lines = [*particle_table(particles), "", *cell_table(cells)]
    if not arguments.no_injection:
        result["injection"] = measured("injection", 20_000, arguments)
        lines += ["", injection_line(result["injection"])]
    harness.write("scaling", result, "\n".join(lines))


if __name__ == "__main__":
    main()
