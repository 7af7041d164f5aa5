"""What grains of different sizes cost: a contact step of a collapsing column, over that of grains of one size.

    python benchmarks/sizes.py [--count 20000] [--warm-up 0.2] [--steps 200] [--rounds 7] [--dimension 2 3]

Columns of as many grains and of the same volume of solids collapse in a box: of one size; of two, 1 : 1.67; and of a
distribution by number that falls as r^-3, 1 : 10 and 1 : 50. Spheres of 1 : 50 fall as r^-3.5: of 20,000 eight are then
larger than half of the largest, which find room in a column that is 1.4 of its diameter high; of r^-3 it would be 24,
which jam between its walls. After `warm-up` seconds of the column all take the
same number of steps in turns, forwards and backwards, each of its own stable length. A contact is a pair that overlaps.
The figure is the least processor time of a step over the number of contacts at that time, and its ratio to that of one
size. Lists are kept in date as in a run. "one table" is a list without levels of size, from the same state. "list" is
the share of the time that builds of the list take, from the time of one build and their number. The columns are grown
packs; where one is not quite as dense as asked for, its radii are lowered to what was reached.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks import harness
from jaxdem.observables.contacts import contacts
from jaxdem.particles.growth import grown_pack
from jaxdem.particles.regions import box
from jaxdem.step import step

RADIUS, CHUNK = 0.01, 50
RATIOS = (1.0, 1.67, 10.0, 50.0)
ONE_TABLE, ONE = (10.0,), ", one table"
FRACTION = {
    2: {1.0: 0.83, 1.67: 0.82, 10.0: 0.855, 50.0: 0.89},
    3: {1.0: 0.60, 1.67: 0.60, 10.0: 0.67, 50.0: 0.70},
}
"""Solid fraction of the column by dimension and ratio, of areas in 2-D, a little below the densest of the pack [-]."""

EXPONENT = {2: {10.0: 3.0, 50.0: 3.0}, 3: {10.0: 3.0, 50.0: 3.5}}
"""With which the number of grains falls with their radius, by dimension and ratio."""


def radii(dimension: int, ratio: float, count: int) -> np.ndarray:
    """(N,) radii whose mean volume, in 2-D area, is that of `RADIUS` [m]."""
    if ratio < 2.0:
        found = np.where(np.arange(count) % 2, 1.0, ratio)
    else:  # evenly by number, so that the largest are there whatever the seed
        part = (np.random.default_rng(1).permutation(count) + 0.5) / count
        power = EXPONENT[dimension][ratio] - 1.0
        found = (1.0 - part * (1.0 - ratio**-power)) ** (-1.0 / power)
    return RADIUS * found / np.mean(found**dimension) ** (1.0 / dimension)


def scene_of(dimension: int, ratio: float, count: int) -> tuple[jaxdem.Scene, float]:
    """The column in its box, and the solid fraction that it begins with."""
    size, fraction = radii(dimension, ratio, count), FRACTION[dimension][ratio]
    solids = float(np.sum(np.pi * size**2 if dimension == 2 else 4.0 / 3.0 * np.pi * size**3)) / fraction
    height = (solids / 2.0) ** (1.0 / dimension)
    corner = (2.0 * height, *(height,) * (dimension - 1))
    position, part = grown_pack(box((0.0,) * dimension, corner), size, 1.0, 0)
    size = part * size  # where the pack was not quite reached
    sides = [2.0 * corner[0], *corner[1:-1], 1.2 * height]
    domain = {"size": sides} | ({"depth": 4.0 * RADIUS} if dimension == 2 else {})
    tables: dict[str, Any] = {
        "domain": domain,
        "particles": {"position": position.tolist(), "radius": size.tolist(), "density": 2500.0},
        "contact": {"young_modulus": 1e7, "restitution": 0.7, "friction": 0.3, "rolling_friction": 0.1},
        "time": {"end": 1.0, "output_interval": 0.1},
    }
    interval = CHUNK * jaxdem.build(jaxdem.load_scene(tables))[0].steps.contact
    scene = jaxdem.load_scene(tables | {"time": {"end": 10 * interval, "output_interval": interval}})
    return scene, fraction * part**dimension


class Contender:
    """A column and its program.

    Attributes:
        name: of its row.
        simulation: of it.
        now: state and list.
        step: length of a contact step [s].
        chunk: contact steps of a call.
    """

    def __init__(self, name: str, simulation: Any, parameters: Any, now: tuple[Any, Any]) -> None:
        self.name, self.simulation, self.parameters, self.now = name, simulation, parameters, now
        self.step, self.chunk = simulation.steps.contact, simulation.steps.contacts_per_interval
        self.compile()

    @classmethod
    def of_scene(cls, name: str, scene: jaxdem.Scene) -> Contender:
        """At the start of a scene."""
        simulation, parameters = jaxdem.build(scene)
        return cls(name, simulation, parameters, jaxdem.initial_state(scene, simulation, parameters))

    def compile(self) -> None:
        """The program for lists of the present room."""

        def advance(state: Any, neighbors: Any) -> Any:
            return step(self.simulation, self.parameters, state, neighbors)[:2]

        self.advance: Callable[..., Any] = jax.jit(advance).lower(*self.now).compile()
        search = self.simulation.search

        def build(state: Any, neighbors: Any) -> Any:
            position = tuple(state.particles.position.T)
            return search.update(position, tuple(state.particles.position_low.T), neighbors)

        self.build: Callable[..., Any] = jax.jit(build).lower(*self.now).compile()

    def run(self, steps: int, enlarge: bool = False) -> tuple[Any, Any]:
        """State and list so many steps later; a list without room is enlarged and its steps are repeated."""
        now = self.now
        for _ in range(max(round(steps / self.chunk), 1)):
            after = jax.block_until_ready(self.advance(*now))
            while bool(after[1].overflow):
                assert enlarge
                self.now = now = self.simulation.with_room(*now, now[1].room.enlarged())
                self.compile()
                after = jax.block_until_ready(self.advance(*now))
            now = after
        return now

    def contacts(self) -> int:
        """Number of pairs that overlap now."""
        found = contacts(self.simulation, self.parameters, *self.now)
        return int(jnp.sum((found.between.overlap > 0) & (found.first != found.second)))

    def with_one_table(self) -> Contender:
        """The same state with a list without levels."""
        plain, state = self.simulation.without_levels(), self.now[0]
        neighbors = plain.allocate(self.parameters, state.particles)
        blank = (jnp.zeros(neighbors.room.pairs, jnp.float32),) * len(state.particles.contact_spring)
        state = state._replace(particles=state.particles._replace(contact_spring=blank))
        return Contender(f"{self.name}{ONE}", plain, self.parameters, (state, neighbors))


def seconds(function: Callable[[], Any]) -> float:
    """Processor time of a call [s]."""
    begin = time.process_time()
    jax.block_until_ready(function())
    return time.process_time() - begin


def measured(dimension: int, arguments: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """Rows of a dimension."""
    contenders, filled = [], {}
    for ratio in arguments.ratios:
        scene, fraction = scene_of(dimension, ratio, arguments.count)
        one = Contender.of_scene(f"{dimension}-D, 1 : {ratio:g}", scene)
        filled[one.name] = fraction
        one.now = one.run(round(arguments.warm_up / one.step), enlarge=True)
        contenders.append(one)
        if ratio in ONE_TABLE and not arguments.levels_only:
            contenders.append(one.with_one_table())
        print(one.name, one.now[1].room, file=sys.stderr, flush=True)
    for one in contenders:
        one.run(arguments.steps, enlarge=True)  # the steps that are timed have room
    times: dict[str, list[float]] = {one.name: [] for one in contenders}
    builds: dict[str, list[float]] = {one.name: [] for one in contenders}
    for number in range(arguments.rounds):
        for one in contenders if number % 2 == 0 else contenders[::-1]:
            steps = max(round(arguments.steps / one.chunk), 1) * one.chunk
            times[one.name].append(seconds(lambda one=one: one.run(arguments.steps)) / steps)
            builds[one.name].append(seconds(lambda one=one: one.build(*one.now)))
    rows = {}
    for one in contenders:
        after, steps = one.run(arguments.steps), max(round(arguments.steps / one.chunk), 1) * one.chunk
        rows[one.name] = {
            "seconds_per_step": times[one.name],
            "seconds_per_build": builds[one.name],
            "builds_per_step": int(after[1].builds - one.now[1].builds) / steps,
            "contacts": one.contacts(),
            "solid_fraction": filled[one.name.removesuffix(ONE)],
            "step": one.step,
            "levels": 0 if one.simulation.search.levels is None else len(one.simulation.search.levels.radii),
            "room": dataclasses.asdict(one.now[1].room),
        }
    return rows


def table(rows: dict[str, dict[str, Any]]) -> str:
    """As Markdown."""
    lines = [
        "| column | solid fraction | levels | contact step [ms] | contacts | a contact over one size | "
        "range over rounds | pairs listed a grain | a build [ms] | steps a build | list |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for name, row in rows.items():
        base = rows[f"{name[:3]}, 1 : 1"]
        each = [1.0 / base["contacts"], 1.0 / row["contacts"]]
        pairs = zip(row["seconds_per_step"], base["seconds_per_step"], strict=True)
        over = [a * each[1] / (b * each[0]) for a, b in pairs]
        least, build = min(row["seconds_per_step"]), min(row["seconds_per_build"])
        ratio = least * each[1] / (min(base["seconds_per_step"]) * each[0])
        share = build * row["builds_per_step"] / least
        often = f"{1.0 / row['builds_per_step']:.0f}" if row["builds_per_step"] else "more than measured"
        lines.append(
            f"| {name} | {row['solid_fraction']:.3f} | {row['levels']} | {1e3 * least:.2f} | {row['contacts']} | "
            f"{ratio:.2f} | {min(over):.2f} to {max(over):.2f} | {row['pairs']:.1f} | {1e3 * build:.0f} | {often} | "
            f"{100 * share:.0f} % |"
        )
    return "\n".join(lines)


def main() -> None:
    """Measures and writes results/sizes_{2,3}d.{json,md}."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    for name, value in (("--count", 20_000), ("--steps", 200), ("--rounds", 7)):
        parser.add_argument(name, type=int, default=value)
    parser.add_argument("--warm-up", type=float, default=0.2)
    parser.add_argument("--dimension", type=int, nargs="*", default=[2, 3])
    parser.add_argument("--levels-only", action="store_true", help="leave the lists with one table out")
    parser.add_argument("--ratios", type=float, nargs="*", default=list(RATIOS), help="the first must be 1")
    arguments = parser.parse_args()
    rows: dict[str, dict[str, Any]] = {}
    for dimension in arguments.dimension:
        rows |= measured(dimension, arguments)
        for row in rows.values():
            row["pairs"] = (row["room"]["pairs"] - 1) / arguments.count
        own = {name: row for name, row in rows.items() if name.startswith(f"{dimension}-D")}
        harness.save(f"sizes_{dimension}d", {"arguments": vars(arguments), "rows": own}, table(own))
        print(table(own))


if __name__ == "__main__":
    main()
