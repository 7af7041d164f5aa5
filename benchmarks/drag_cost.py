"""Cost of one drag evaluation per particle: every correlation and the learned closures, in both precisions.

    python benchmarks/drag_cost.py [--sizes 100 1000 10000 100000 1000000] [--sizes-double 10000 1000000]
                                   [--closures FILE...]

The networks go from the paper's down to four neurons, as `jaxdem prune` and `jaxdem distill` make them; random weights
cost what trained ones do. `--closures` adds closure files, with the R2 on held-out rows that they were written with.

Every closure is compiled by itself with its inputs and weights as arguments, and every call is waited for, so the
smallest batches cost mostly the call. Inside a time step that part is absent. Each precision runs in a process of its
own. The fluid is air; velocities, solid fractions and gradients are random, the same for every closure.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

from benchmarks import harness
from jaxdem.closures import DragInputs, EnsembleClosure, InvariantClosure, PaperNetwork, load_closure
from jaxdem.closures.base import Drag, DragClosure
from jaxdem.closures.correlation import Correlation
from jaxdem.closures.invariant import FEATURES, TERMS
from jaxdem.closures.network import initial_weights
from jaxdem.closures.registry import DRAG_LAWS

DIMENSION, DIAMETER, CELL = 2, 0.02, 0.08
AIR_DENSITY, AIR_VISCOSITY = 1.2, 1.8e-5
REPETITIONS, SHORTEST = 5, 0.05
"""Repetitions, and the seconds that a repetition lasts at least by calling several times."""
PAPER_NETWORK = "paper's network, 170-70-30"
PAPER_CLASSICAL_S, PAPER_NETWORK_S = 4e-7, 1.75e-5
"""Seconds per particle of Davydzenka & Tahmasebi (2022), J. Fluid Mech. 938, A20."""
NETWORK_SIZES = ((4,), (8,), (16, 8), (32, 16), (85, 35, 15))
"""Hidden layers of networks on raw velocities, beside the paper's; the last is half of it."""
INVARIANT_SIZES = ((4,), (8,), (8, 8), (16, 16))
MEMBERS = 4
MATRICES = (20_000, 170, 70)
"""Rows, inner and outer width of the product that says what the hardware does: the network's largest layer."""


def random_inputs(count: int, dtype: Any, seed: int = 0) -> DragInputs:
    """Inputs as in a gas-solid flow: velocities of about 3 m/s, solid fractions of 0.05 to 0.55."""
    generator = np.random.default_rng(seed)

    def vectors(scale: float) -> jax.Array:
        return jnp.asarray(generator.normal(0.0, scale, (count, DIMENSION)), dtype)

    return DragInputs(
        particle_velocity=vectors(3.0),
        fluid_velocity=vectors(3.0),
        solid_fraction=jnp.asarray(generator.uniform(0.05, 0.55, count), dtype),
        void_fraction_gradient=vectors(2.0),
        pressure_gradient=vectors(1000.0),
        diameter=jnp.asarray(DIAMETER, dtype),
        filter_size=jnp.asarray(CELL, dtype),
        fluid_density=jnp.asarray(AIR_DENSITY, dtype),
        dynamic_viscosity=jnp.asarray(AIR_VISCOSITY, dtype),
    )


def invariant_closure(
    hidden: tuple[int, ...] = (16, 16), terms: tuple[str, ...] = (), seed: int = 0
) -> InvariantClosure:
    """A closure with random weights; as it starts, its last layer is zero."""
    closure = InvariantClosure.initial(hidden=hidden, terms=terms)
    weights = initial_weights(len(FEATURES), closure.hidden, 1 + len(terms), closure.activation, seed)
    return dataclasses.replace(closure, weights=weights)


def widths(hidden: tuple[int, ...]) -> str:
    """Hidden layers as the command line has them."""
    return "-".join(map(str, hidden))


def closures(files: Sequence[str] = ()) -> dict[str, DragClosure]:
    """What is measured, by the name of its row."""
    members = [invariant_closure(seed=seed) for seed in range(MEMBERS)]
    return {
        **{name: law() for name, law in DRAG_LAWS.items()},
        **{f"invariant closure, {widths(hidden)}": invariant_closure(hidden) for hidden in INVARIANT_SIZES},
        "invariant closure, 16-16, two terms": invariant_closure(terms=TERMS),
        f"ensemble of {MEMBERS} invariant closures, 16-16": EnsembleClosure.of(members),
        **{f"network, {widths(h)}": PaperNetwork.initial(DIMENSION, hidden=h) for h in NETWORK_SIZES},
        PAPER_NETWORK: PaperNetwork.initial(DIMENSION),
        **{Path(file).name: load_closure(file)[0] for file in files},
    }


def r_squared_of(files: Sequence[str]) -> dict[str, dict[str, float]]:
    """R2 on held-out rows by coarsening, from the metadata of closure files, by the name of the row."""
    return {
        Path(file).name: {n: row["closure"] for n, row in load_closure(file)[1].get("r2", {}).items()} for file in files
    }


def drag(closure: DragClosure, inputs: DragInputs) -> Drag:
    """One evaluation, as the coupled step does it."""
    return closure(inputs)


def compiled_drag(closure: DragClosure) -> Callable[[DragInputs], Drag]:
    """`drag` compiled; a learned closure is an argument, so that its weights are not folded as constants."""
    if isinstance(closure, Correlation):
        return jax.jit(closure.__call__)
    evaluate = jax.jit(drag)
    return lambda inputs: evaluate(closure, inputs)


def seconds_per_call(call: Callable[..., Any], *arguments: Any) -> list[float]:
    """Repetitions [s] of a compiled call, each the mean over enough calls to last `SHORTEST`."""

    def mean_of(calls: int) -> float:
        start = time.perf_counter()
        for _ in range(calls):
            jax.block_until_ready(call(*arguments))
        return (time.perf_counter() - start) / calls

    mean_of(1)  # compiles
    calls = max(1, math.ceil(SHORTEST / mean_of(1)))
    return [mean_of(calls) for _ in range(REPETITIONS)]


def matrix_gflops(dtype: Any) -> dict[str, float]:
    """Speed of a plain matrix product of the size of `MATRICES` [1e9 flop/s]."""
    rows, inner, outer = MATRICES
    generator = np.random.default_rng(0)
    left = jnp.asarray(generator.normal(size=(rows, inner)), dtype)
    right = jnp.asarray(generator.normal(size=(inner, outer)), dtype)
    seconds = seconds_per_call(jax.jit(jnp.matmul), left, right)
    return harness.spread([2e-9 * rows * inner * outer / value for value in seconds])


def kernel_flops(network: PaperNetwork) -> int:
    """Operations per particle: a product and a sum for every weight of the network's matrices."""
    return sum(2 * layer["kernel"].size for layer in network.weights.values())


def measure(sizes: list[int], files: Sequence[str]) -> dict[str, Any]:
    """Seconds per particle by closure and batch size, in the precision of this process."""
    dtype = jnp.float64 if jax.config.read("jax_enable_x64") else jnp.float32
    seconds: dict[str, dict[int, Any]] = {name: {} for name in closures(files)}
    for size in sizes:
        inputs = jax.block_until_ready(random_inputs(size, dtype))
        for name, closure in closures(files).items():
            repetitions = seconds_per_call(compiled_drag(closure), inputs)
            seconds[name][size] = harness.spread([value / size for value in repetitions])
            print(f"{dtype.__name__} {size} {name}: {seconds[name][size]['median']:.3g} s", file=sys.stderr)
    flops = kernel_flops(PaperNetwork.initial(DIMENSION))
    return {
        "device": jax.devices()[0].device_kind,
        "seconds_per_particle": seconds,
        "network_gflops": {size: 1e-9 * flops / s["median"] for size, s in seconds[PAPER_NETWORK].items()},
        "matrix_gflops": matrix_gflops(dtype),
    }


def measure_apart(precision: str, sizes: list[int], files: Sequence[str]) -> dict[str, Any]:
    """`measure` in a process of its own, for the precision is settled when JAX starts."""
    command = [sys.executable, __file__, "--inside", "--sizes", *map(str, sizes), "--closures", *files]
    environment = os.environ | {"JAX_ENABLE_X64": str(int(precision == "float64"))}
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, env=environment)
    return json.loads(done.stdout.splitlines()[-1])


def table_of(measured: dict[str, dict[str, Any]]) -> str:
    """Nanoseconds per particle with the paper's beside them; below, how near the network is to the hardware."""
    columns = [(p, size) for p in measured for size in measured[p]["seconds_per_particle"][PAPER_NETWORK]]
    titles = [f"{precision}, {int(size):,}" for precision, size in columns]
    head = [" | ".join(["", *titles]), "| --- " * (1 + len(columns)) + "|"]
    cost = [f"| drag law, ns per particle{head[0]} |", head[1]]
    for name in measured["float32"]["seconds_per_particle"]:
        medians = [1e9 * measured[p]["seconds_per_particle"][name][size]["median"] for p, size in columns]
        written = [f"{value:,.0f}" if value >= 100 else f"{value:.3g}" for value in medians]
        cost.append(f"| {name} | {' | '.join(written)} |")
    speed = [f"| GFLOP/s{head[0]} |", head[1]]
    network = [measured[p]["network_gflops"][size] for p, size in columns]
    product = [measured[p]["matrix_gflops"]["median"] for p, _ in columns]
    for name, values in ((PAPER_NETWORK, network), ("a matrix product", product)):
        speed.append(f"| {name} | " + " | ".join(f"{value:.3g}" for value in values) + " |")
    rows, inner, outer = MATRICES
    caption = (
        f"Median of {REPETITIONS} repetitions on {', '.join({m['device'] for m in measured.values()})}, "
        f"by precision and batch size. Davydzenka & Tahmasebi (2022) report {1e9 * PAPER_CLASSICAL_S:.0f} ns "
        f"per particle for their classical law and {1e9 * PAPER_NETWORK_S:,.0f} ns for their network."
    )
    below = (
        "Speed of the paper's network, two operations for a weight and nothing for activations or the base "
        f"law, and of one product ({rows}, {inner}) ({inner}, {outer}) in the same run."
    )
    return "\n\n".join((caption, "\n".join(cost), below, "\n".join(speed)))


def scores_table(scores: dict[str, dict[str, float]]) -> str:
    """R2 of the closure files by coarsening."""
    if not scores:
        return ""
    coarsenings = sorted({n for row in scores.values() for n in row}, key=int)
    lines = [["R2 on held-out rows", *(f"{n}x" for n in coarsenings)], ["---"] * (1 + len(coarsenings))]
    lines += [[name, *(f"{row[n]:.4f}" if n in row else "" for n in coarsenings)] for name, row in scores.items()]
    return "\n\n" + "\n".join("| " + " | ".join(line) + " |" for line in lines)


def main() -> None:
    """Both precisions one after the other, then the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="+", default=[100, 1000, 10_000, 100_000, 1_000_000])
    parser.add_argument("--sizes-double", type=int, nargs="+", default=[10_000, 1_000_000])
    parser.add_argument("--closures", metavar="FILE", nargs="*", default=[], help="closure files of 2-D runs")
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.inside:
        print(json.dumps(measure(arguments.sizes, arguments.closures)))
        return
    measured = {
        "float32": measure_apart("float32", arguments.sizes, arguments.closures),
        "float64": measure_apart("float64", arguments.sizes_double, arguments.closures),
    }
    paper = {"classical": PAPER_CLASSICAL_S, "network": PAPER_NETWORK_S}
    scores = r_squared_of(arguments.closures)
    result = {"paper_seconds_per_particle": paper, "r2": scores, **measured}
    harness.write("drag_cost", result, table_of(measured) + scores_table(scores))


if __name__ == "__main__":
    main()
