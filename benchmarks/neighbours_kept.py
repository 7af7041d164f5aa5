"""What a list of neighbours, or a fluctuation, that is kept over several coupling intervals would save and cost.

    python benchmarks/neighbours_kept.py [--closure scenes/neighbours_short.closure.h5] [--intervals 40]

- list: time of an evaluation with a list that reaches farther by a skin, without the search, of the grains of
  `benchmarks/neighbours.py`.
- motion: intervals of `scenes/suspension.toml` after which some grain has moved by half a skin, against the mean of all
  grains; and how often the list of contacts is made anew.
- held: the part of the variance of the fluctuation that is kept if it is evaluated in every k-th interval only.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from pathlib import Path
from typing import Any

import jax
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks.neighbours import DIAMETER, contact_pass, scene, seconds
from jaxdem.closures import NeighborClosure, load_closure
from jaxdem.closures.neighbor_places import Places, axes_along, fluctuation
from jaxdem.coupling.surroundings import AT_ONCE
from jaxdem.particles.integrate import centres_in_box
from jaxdem.particles.wide_search import Region

GRAINS, SOLID_FRACTION = 1500, 0.3
SKINS = (0.0, 0.2, 0.4, 0.8)
"""Of a list, in diameters."""
FIRST = 4
"""Intervals at the start of the suspension that do not count: the grains get their speed."""
HELD = (1, 2, 3, 4)
"""Intervals for which a fluctuation is held."""


def with_skins(closure: NeighborClosure) -> None:
    """Print times of evaluations with lists of several skins."""
    described = scene(GRAINS, SOLID_FRACTION)
    one_pass = contact_pass(described) / GRAINS
    simulation, parameters = jaxdem.build(described, closure=closure)
    state, _ = jaxdem.initial_state(described, simulation, parameters)
    coupling, mixture = simulation.coupling, parameters.mixture
    sampled = jax.jit(coupling.sample)(mixture, state.fluid, state.particles)
    inputs = sampled.law_inputs._replace(fluid_velocity=sampled.law_inputs.fluid_velocity + 1e-3)
    start = coupling.start(mixture, state.fluid, state.particles, sampled)
    finds = coupling.drag.surroundings
    centres = centres_in_box(state.particles, finds.box, finds.periodic)
    period, axis = np.asarray(finds.box, centres.dtype), axes_along(inputs.slip_velocity)[0]

    @jax.jit
    def evaluated(closure: NeighborClosure, others: Any, inputs: Any) -> Any:
        places = Places(centres, others, 2.0 * start.bodies.radius, period)
        frame = axes_along(inputs.slip_velocity)
        return fluctuation(closure, places, frame, inputs.reynolds, inputs.solid_fraction, AT_ONCE)

    for skin in SKINS:
        regions = tuple(Region(*(length + skin * DIAMETER for length in region)) for region in finds.regions)
        more = max(
            (wide.along / own.along) * (wide.across / own.across) ** 2
            for wide, own in zip(regions, finds.regions, strict=True)
        )
        wide = dataclasses.replace(
            finds, regions=regions, slots=int(more * finds.slots) + 2, cell_slots=int(2.0 * more * finds.cell_slots)
        )
        search = jax.jit(lambda own, wide=wide: wide.neighbors(dataclasses.replace(start, particles=own), axis))
        others, _ = search(state.particles)
        took = seconds(lambda others=others: evaluated(closure, others, inputs)) / GRAINS
        passes = f"{took / one_pass:.3g} contact passes"
        print(f"skin {skin:g} d: evaluation {1e6 * took:.3g} us a grain, {passes}", flush=True)


def suspension(closure: NeighborClosure, intervals: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Multiple of the drag (T, N) and force across over the mean drag (T, N, 3) [-] and ways of the grains (T, N, 3)
    [m], by interval; and how often the list of contacts was made."""
    described = jaxdem.load_scene(Path(__file__).parents[1] / "scenes" / "suspension.toml")
    simulation, parameters = jaxdem.build(described, closure=closure)
    state, neighbors = jaxdem.initial_state(described, simulation, parameters)
    coupling = simulation.coupling

    @jax.jit
    def step(parameters: Any, state: Any, neighbors: Any) -> Any:
        mixture = parameters.mixture
        sampled = coupling.sample(mixture, state.fluid, state.particles)
        start, inputs = coupling.start(mixture, state.fluid, state.particles, sampled), sampled.law_inputs
        effect = coupling.drag.neighbors(mixture.closure, mixture.drag_scale, start, inputs)
        mean = mixture.closure.base(inputs).coefficient * inputs.slip_speed
        state, neighbors, _ = simulation.step(parameters, state, neighbors)
        return state, neighbors, (effect.multiple, effect.across / mean[:, None], state.particles.position)

    rows = []
    for _ in range(intervals):
        state, neighbors, row = step(parameters, state, neighbors)
        rows.append([np.asarray(part, np.float64) for part in row])
    multiple, across, places = (np.array(part)[FIRST:] for part in zip(*rows, strict=True))
    steps = np.diff(places, axis=0)
    steps -= np.asarray(described.domain.size) * np.round(steps / np.asarray(described.domain.size))
    ways = np.concatenate([np.zeros_like(places[:1]), np.cumsum(steps, axis=0)])
    return multiple, across, ways, int(neighbors.builds)


def lists_needed(ways: np.ndarray, skin: float) -> int:
    """How many lists of a skin [m] cover the ways (T, N, 3) [m], of which the mean over the grains does not count."""
    own, last, count = ways - ways.mean(axis=1, keepdims=True), 0, 1
    for now in range(len(own)):
        if np.linalg.norm(own[now] - own[last], axis=1).max() > 0.5 * skin:
            last, count = now, count + 1
    return count


def kept_variance(values: np.ndarray, held: int) -> float:
    """1 - (mean square change over 0 to held - 1 intervals) / variance [-]."""
    apart = [np.mean((values[age:] - values[: len(values) - age]) ** 2) for age in range(held)]
    return float(1.0 - np.mean(apart) / np.var(values))


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--closure", default=str(Path(__file__).parents[1] / "scenes/neighbours_short.closure.h5"))
    parser.add_argument("--intervals", type=int, default=40)
    options = parser.parse_args()
    closure = load_closure(options.closure)[0]
    with_skins(closure)
    multiple, across, ways, builds = suspension(closure, options.intervals)
    diameter = 1e-3  # of the scene
    print(f"list of contacts made {builds} times in {options.intervals} intervals")
    for skin in SKINS[1:]:
        print(f"skin {skin:g} d: {len(ways) / lists_needed(ways, skin * diameter):.2g} intervals a list")
    for held in HELD:
        along, side = kept_variance(multiple, held), kept_variance(across, held)
        print(f"evaluated every {held} intervals: along {along:.3f}, across {side:.3f} of the variance kept")


if __name__ == "__main__":
    main()
