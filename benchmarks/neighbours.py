"""Cost of a closure of neighbours: one evaluation per grain, over one contact pass of the same grains.

    python benchmarks/neighbours.py [--grains 2000] [--solid-fraction 0.3] [--sizes NAME...] [--closures FILE...]

The grains fill a periodic box at random and do not overlap. All programs are of one process, in single precision, with
the times of the processor and the least of some repetitions, so that other load matters little. A contact pass is a
contact step of the solver: forces of all listed pairs and the motion. An evaluation has the search for the neighbours,
the moments of both levels and the networks; it is done once a coupling interval, which has as many contact steps as the
scene asks for (10 to 100 as a rule).
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from jaxdem.closures import NeighborClosure, load_closure
from jaxdem.closures.neighbor_places import axes_along
from jaxdem.step import advance_fluid, advance_particles
from jaxdem.train.neighbor_settings import SIZES

DIAMETER, REPETITIONS = 0.01, 7
SIDES = ("left", "right", "bottom", "top", "front", "back")


def scattered(count: int, side: float, seed: int = 0) -> np.ndarray:
    """(count, 3) centres in diameters, one at least apart: a lattice whose points are moved at random, in turn."""
    generator, per_side = np.random.default_rng(seed), int(np.ceil(count ** (1 / 3)))
    line = (np.arange(per_side) + 0.5) * side / per_side
    places = np.stack(np.meshgrid(line, line, line), axis=-1).reshape(-1, 3)
    places = places[generator.permutation(len(places))[:count]]
    for _ in range(30):
        for k in range(count):
            tried = places[k] + generator.normal(0.0, 0.3, 3)
            apart = places - tried
            apart -= side * np.round(apart / side)
            squared = np.einsum("nd,nd->n", apart, apart)
            squared[k] = np.inf
            if squared.min() > 1.0:
                places[k] = tried % side
    return places


def scene(count: int, solid_fraction: float) -> jaxdem.Scene:
    """Grains in a periodic box of fluid."""
    side = (count * np.pi / 6 / solid_fraction) ** (1 / 3)
    cells = max(4, int(side / 2.5))
    return jaxdem.Scene.model_validate(
        {
            "precision": "float32",
            "domain": {"size": [side * DIAMETER] * 3, "gravity": [0.0, 0.0, 0.0]},
            "particles": {
                "radius": DIAMETER / 2,
                "density": 2500.0,
                "position": (scattered(count, side) * DIAMETER).tolist(),
            },
            "contact": {"young_modulus": 1e6, "friction": 0.3, "speed": 0.05},
            "fluid": {"cells": [cells] * 3, "viscosity": 1e-6, "density": 1000.0, "time_step": 1e-3},
            "boundary": {name: {"kind": "periodic"} for name in SIDES},
            "coupling": {"interval": 1e-3, "kernel_width": {"diameters": 0.5, "cells": 0.5}},
            "time": {"end": 0.1, "output_interval": 0.1},
        }
    )


def seconds(function: Callable[[], Any]) -> float:
    """Least processor time of a call that is waited for [s]."""
    jax.block_until_ready(function())
    found = []
    for _ in range(REPETITIONS):
        begin = time.process_time()
        jax.block_until_ready(function())
        found.append(time.process_time() - begin)
    return min(found)


def contact_pass(described: jaxdem.Scene) -> float:
    """Processor time of one contact step [s]."""
    simulation, parameters = jaxdem.build(described)
    state, neighbors = jaxdem.initial_state(described, simulation, parameters)

    @jax.jit
    def particles(parameters: Any, state: Any, neighbors: Any, forces: Any) -> Any:
        return advance_particles(simulation, parameters, state, neighbors, forces)

    forces = jax.jit(lambda p, s: advance_fluid(simulation, p, s)[1])(parameters, state)
    return seconds(lambda: particles(parameters, state, neighbors, forces)) / simulation.contact.steps


class Parts(NamedTuple):
    """Processor times of an evaluation and of parts of it [s].

    Attributes:
        whole: all of it.
        search: for the neighbours.
        level: search, moments and network of the first level alone.
    """

    whole: float
    search: float
    level: float


def evaluation(described: jaxdem.Scene, closure: NeighborClosure) -> Parts:
    """Processor time of one evaluation, and of parts of it."""
    simulation, parameters = jaxdem.build(described, closure=closure)
    state, _ = jaxdem.initial_state(described, simulation, parameters)
    coupling, mixture = simulation.coupling, parameters.mixture
    sampled = jax.jit(coupling.sample)(mixture, state.fluid, state.particles)
    inputs = sampled.law_inputs._replace(fluid_velocity=sampled.law_inputs.fluid_velocity + 1e-3)

    @jax.jit
    def effect(closure: NeighborClosure, particles: Any, inputs: Any) -> Any:
        start = coupling.start(mixture, state.fluid, particles, sampled)
        return coupling.drag.neighbors(closure, mixture.drag_scale, start, inputs)

    @jax.jit
    def search(particles: Any, inputs: Any) -> Any:
        start, (axis, _, _) = coupling.start(mixture, state.fluid, particles, sampled), axes_along(inputs.slip_velocity)
        return coupling.drag.surroundings.neighbors(start, axis)

    whole = seconds(lambda: effect(closure, state.particles, inputs))
    first = dataclasses.replace(closure, levels=closure.levels[:1], carried=None)
    level = whole if closure.carried is None else seconds(lambda: effect(first, state.particles, inputs))
    return Parts(whole, seconds(lambda: search(state.particles, inputs)), level)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--grains", type=int, default=2000)
    parser.add_argument("--solid-fraction", type=float, default=0.3)
    parser.add_argument("--sizes", nargs="*", default=list(SIZES), choices=list(SIZES))
    parser.add_argument("--closures", nargs="*", default=[], metavar="FILE")
    options = parser.parse_args()
    described = scene(options.grains, options.solid_fraction)
    chosen = {name: SIZES[name] for name in options.sizes}
    closures = {
        name: NeighborClosure.initial(size.basis, size.carried, size.widths, wake=size.wake)
        for name, size in chosen.items()
    }
    closures |= {Path(file).name: load_closure(file)[0] for file in options.closures}
    contact = contact_pass(described) / options.grains
    print(f"{options.grains} grains at a solid fraction of {options.solid_fraction:g}")
    print(f"contact pass: {1e6 * contact:.3g} us a grain")
    print("size: us a grain; of these search, first level, second level; contact passes")
    for name, closure in closures.items():
        whole, search, level = (1e6 * value / options.grains for value in evaluation(described, closure))
        parts = f"{search:.3g}, {level - search:.3g}, {whole - level:.3g}"
        print(f"{name}: {whole:.3g}; {parts}; {1e-6 * whole / contact:.3g}", flush=True)


if __name__ == "__main__":
    main()
