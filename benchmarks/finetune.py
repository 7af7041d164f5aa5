"""Cost of a gradient through the coupled solver by number of steps, and training by gradients compared with a
gradient-free search.

    python benchmarks/finetune.py [--horizons 5 10 20 40 80 100 160 320] [--repetitions 5] [--updates 12]

The small injection scene on coarse cells with an invariant closure. First table: for every horizon, in a process of its
own, time of the loss (forward) and of loss and gradient, their ratio (the project aims at 5 or less at 100 intervals),
peak memory of the process, and the memory that XLA plans for the compiled gradient. Second table: the closure trained
to follow a fine run, by gradients of all weights, by gradients of the few parameters of the search, and by the search
(Nelder-Mead), each with about as many forward runs.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks import harness
from jaxdem.closures import InvariantClosure
from jaxdem.train.closures import Closures
from jaxdem.train.finetune import FinetuneSettings, finetune
from jaxdem.train.observables import BINS, Grains, Observables
from jaxdem.train.reference import CoarseCase
from jaxdem.train.unrolled import Unrolled

SCENE = Path(__file__).parents[1] / "scenes" / "injection_demo.toml"
COARSE = {"fluid.cells": [25, 5]}
HORIZONS = (5, 10, 20, 40, 80, 100, 160, 320)


def scene_of(count: int, **changes: Any) -> jaxdem.Scene:
    """The demo scene with fewer grains; its contact step is set, so that all runs have the same."""
    return jaxdem.load_scene(SCENE, {"particles.count": count, "time.end": 0.6} | changes)


class OwnStart(CoarseCase):
    """A case without a reference: its targets are ones."""

    targets = Observables(*[jnp.ones(1)] * 5, *[jnp.ones((1, BINS))] * 2)


def unrolled(count: int) -> tuple[Unrolled, Any]:
    """Runs of the coarse scene from its own start, with targets of ones; and the arguments of a loss."""
    scene = scene_of(count, **COARSE)
    closure = InvariantClosure.initial()
    simulation, parameters = jaxdem.build(scene, closure)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    bodies = parameters.mixture.bodies
    grains = Grains(bodies.mass, bodies.inertia, bodies.volume, scene.domain.size[0])
    case = OwnStart(simulation, parameters, grains, None, state.particles, 1)  # type: ignore[arg-type]
    closures = Closures(closure)
    return Unrolled(case, closures, 1), (closures.weights, state, neighbors)


def one_horizon(steps: int, count: int, repetitions: int, sloped: bool) -> dict[str, Any]:
    """Times and memory of the loss, or of loss and gradient, over so many coupling intervals; in this process."""
    runs, arguments = unrolled(count)
    ones = Observables(*[jnp.ones(steps)] * 5, *[jnp.ones((steps, BINS))] * 2)

    def loss(weights: Any, state: Any, neighbors: Any) -> Any:
        return runs.loss_of_run(weights, state, neighbors, ones, jnp.asarray(steps))

    begin = time.perf_counter()
    program = jax.jit(jax.value_and_grad(loss, has_aux=True) if sloped else loss).lower(*arguments).compile()
    compiled = time.perf_counter() - begin
    seconds = []
    for _ in range(repetitions + 1):
        begin = time.perf_counter()
        result = jax.block_until_ready(program(*arguments))
        seconds.append(time.perf_counter() - begin)
    value, code = result[0] if sloped else result
    memory = program.memory_analysis()
    return {
        "steps": steps,
        "seconds": harness.spread(seconds[1:]),
        "compile_s": compiled,
        "sound": int(code) == 0 and bool(jnp.isfinite(value)),
        "planned_bytes": None if memory is None else memory.temp_size_in_bytes,
        **harness.peak_memory(),
    }


def measured(steps: int, options: argparse.Namespace, sloped: bool) -> dict[str, Any]:
    """`one_horizon` in a process of its own, on the cores asked for."""
    command = [sys.executable, __file__, "--one", str(steps), "--count", str(options.count)]
    command += ["--repetitions", str(options.repetitions)] + (["--sloped"] if sloped else [])
    done = subprocess.run(harness.pinned(options.cores, command), stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def horizon_table(options: argparse.Namespace) -> tuple[list[dict[str, Any]], str]:
    """Rows and table of cost against horizon."""
    rows, lines = [], []
    for steps in options.horizons:
        forward, slope = measured(steps, options, False), measured(steps, options, True)
        ratio = slope["seconds"]["median"] / forward["seconds"]["median"]
        rows.append({"steps": steps, "forward": forward, "gradient": slope, "ratio": ratio})
        sound = "yes" if forward["sound"] and slope["sound"] else "no"
        lines.append(
            f"| {steps} | {forward['seconds']['median']:.3g} | {slope['seconds']['median']:.3g} | {ratio:.2f} | "
            f"{forward['peak_bytes'] / 2**20:.0f} | {slope['peak_bytes'] / 2**20:.0f} | "
            f"{(slope['planned_bytes'] or 0) / 2**20:.1f} | {slope['compile_s']:.0f} | {sound} |"
        )
        print(lines[-1], flush=True)
    head = (
        "| coupling intervals | loss [s] | loss and gradient [s] | ratio | peak memory, loss [MiB] | "
        "peak memory, gradient [MiB] | of it planned for the gradient [MiB] | compilation [s] | sound |"
    )
    return rows, "\n".join([head, "|" + " --- |" * 9, *lines])


def training_table(options: argparse.Namespace) -> tuple[dict[str, Any], str]:
    """Three ways to train with about the same number of forward runs."""
    lines, results = [], {}
    with tempfile.TemporaryDirectory() as folder:
        jaxdem.simulate(scene_of(options.count), Path(folder) / "fine")
        closure, coarse = InvariantClosure.initial(), scene_of(options.count, **COARSE)
        stages = (1, 2, 4)
        ways = {
            "gradient, all weights": FinetuneSettings(stages, options.updates, learning_rate=1e-2),
            "gradient, few parameters": FinetuneSettings(stages, options.updates, parameters="few", learning_rate=3e-2),
            # Each evaluation of the search runs all its starts.
            "Nelder-Mead, few parameters": FinetuneSettings(
                stages, max(1, options.updates // 3), starts=3, method="gradient-free"
            ),
        }
        for name, settings in ways.items():
            begin = time.perf_counter()
            result = finetune(coarse, Path(folder) / "fine", Closures(closure), {}, settings)
            record = result.metadata["drag"]["finetune"] | {"seconds": time.perf_counter() - begin}
            results[name] = {key: value for key, value in record.items() if key != "scene_toml"}
            lines.append(
                f"| {name} | {record['validation_loss_before']:.4g} | {record['validation_loss']:.4g} | "
                f"{record['forward_runs']} | {record['skipped']} | {record['seconds']:.0f} |"
            )
            print(lines[-1], flush=True)
    head = "| trained by | loss before | loss after | forward runs | skipped | seconds, compilation included |"
    return results, "\n".join([head, "|" + " --- |" * 6, *lines])


def main() -> None:
    """Both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--horizons", type=int, nargs="+", default=HORIZONS)
    parser.add_argument("--count", type=int, default=300, help="number of grains")
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--updates", type=int, default=12, help="updates in each of the three stages")
    parser.add_argument("--cores", type=int, default=1)
    parser.add_argument("--one", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--sloped", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(one_horizon(options.one, options.count, options.repetitions, options.sloped)))
        return
    rows, costs = horizon_table(options)
    trained, comparison = training_table(options)
    about = (
        f"{options.count} grains, {' x '.join(map(str, COARSE['fluid.cells']))} cells, float32, {options.cores} core(s)"
    )
    text = f"Medians of {options.repetitions} repetitions; {about}.\n\n{costs}\n\n{comparison}"
    harness.write("finetune", {"settings": about, "horizons": rows, "training": trained}, text)


if __name__ == "__main__":
    main()
