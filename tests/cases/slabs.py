"""Random scenes on several devices against one, and what they differ by.

An interval of a scene is run from the same state on one device and in slabs, again and again, while one device goes on:
so that errors do not grow with the chaos of collisions. `python -m tests.cases.slabs 20 2` runs 20 scenes on 2 devices,
`python -m tests.cases.slabs 20 2 wide` those with few large grains among small ones.
"""

from __future__ import annotations

import sys
from typing import Any, NamedTuple

import jax
import numpy as np

import jaxdem
from jaxdem import devices
from jaxdem.failures import failures


def random_scene(seed: int) -> dict[str, Any]:
    """Tables of a scene: 2-D or 3-D, walls or periodic sides, one size or several, perhaps with an exit or a fluid."""
    draw = np.random.default_rng(seed)
    dimension = int(draw.integers(2, 4))
    fluid, comes = bool(draw.random() < 0.3), bool(draw.random() < 0.3)
    length, width = 0.4, 0.1
    size = [length, width] if dimension == 2 else [length, width, width]
    axis = int(draw.integers(0, dimension))
    size[0], size[axis] = size[axis], size[0]
    wraps = [bool(draw.random() < 0.5) for _ in size]
    names = {2: ("left", "right", "bottom", "top"), 3: ("left", "right", "front", "back", "bottom", "top")}[dimension]
    boundary = {name: {"kind": "periodic"} for k, name in enumerate(names) if wraps[k // 2]}
    contact = {"young_modulus": 4e6, "friction": 0.4, "restitution": float(draw.uniform(0.4, 0.9)), "speed": 3.0}
    if draw.random() < 0.5:
        contact |= {"rolling_friction": 0.1, "rolling_model": "epsd"}
    grains: dict[str, Any] = {"radius": 0.01, "density": 2500.0}
    low, high = np.full(dimension, 0.012), np.asarray(size) - 0.012
    counts = np.floor((high - low) / 0.0215).astype(int) + 1
    places = np.stack(np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"), axis=-1).reshape(-1, dimension)
    places = low + 0.0215 * places + draw.uniform(0, 0.0007, places.shape)
    places = places[draw.random(len(places)) < 0.7]
    grains["position"] = places.tolist()
    if draw.random() < 0.5:
        grains["radius"] = draw.uniform(0.006, 0.01, len(places)).tolist()
    grains["velocity"] = draw.normal(0.0, 0.4, places.shape).tolist()
    tables = {
        "precision": "float64",
        "domain": {"size": size, "gravity": [0.0] * (dimension - 1) + [-9.81]},
        "particles": grains,
        "contact": contact,
        "boundary": boundary,
        "time": {"end": 0.4, "output_interval": 0.01},
    }
    if fluid:
        cells = [max(8, int(round(x / 0.025))) for x in size]
        tables["fluid"] = {"cells": cells, "density": 1.2, "viscosity": 1.5e-5, "time_step": 2e-3}
        if dimension == 2:
            tables["domain"]["depth"] = 0.02
        if wraps[-1]:
            tables["domain"]["gravity"] = [0.0] * dimension
    if comes and not wraps[0]:
        boundary["right"] = {"particles": "remove"} | ({"kind": "outlet"} if fluid else {})
    return tables


def wide_scene(seed: int) -> dict[str, Any]:
    """The same with a fifth of the grains, and 300 that are five to twenty times as small between them."""
    tables, draw = random_scene(seed), np.random.default_rng(seed)
    size, grains = np.asarray(tables["domain"]["size"]), tables["particles"]
    chosen = draw.random(len(grains["position"])) < 0.2
    places, velocity = np.asarray(grains["position"])[chosen], np.asarray(grains["velocity"])[chosen]
    radius = np.full(len(places), 0.01)
    while len(places) < chosen.sum() + 300:
        small = draw.uniform(0.0005, 0.002)
        place = draw.uniform(small, size - small)
        if np.all(np.sum((places - place) ** 2, axis=1) > (radius + small) ** 2):
            places, radius = np.vstack([places, place]), np.append(radius, small)
    velocity = np.vstack([velocity, draw.normal(0.0, 0.4, (300, len(size)))])
    moved = {"position": places.tolist(), "radius": radius.tolist(), "velocity": velocity.tolist()}
    return tables | {"particles": grains | moved}


class Difference(NamedTuple):
    """Of an interval in slabs to that on one device, over the largest of each kind on one device.

    Attributes:
        force, velocity, position, spin: of the particles.
        contacts: number of pairs that touch in the one and not in the other.
        momentum: over the sum of m |v|.
    """

    force: float
    velocity: float
    position: float
    spin: float
    contacts: int
    momentum: float


def apart(one: Any, other: Any) -> float:
    """Largest difference over the largest value."""
    one, other = np.asarray(one), np.asarray(other)
    return float(np.abs(one - other).max(initial=0.0) / max(np.abs(one).max(initial=0.0), 1e-300))


class Pair:
    """A scene on one device and in slabs."""

    def __init__(self, scene: jaxdem.Scene, number: int):
        self.simulation, self.parameters = jaxdem.build(scene)
        self.divided, _ = jaxdem.build(scene, devices=number)
        self.state, self.neighbors = jaxdem.initial_state(scene, self.simulation, self.parameters)
        self.room = None
        self.step = jax.jit(lambda s, n: self.simulation.step(self.parameters, s, n))
        self.step_of_slabs = jax.jit(lambda s, n: self.divided.step(self.parameters, s, n))

    def distributed(self) -> tuple:
        """The present state in slabs."""
        state, lists = devices.distributed(self.divided, self.parameters, self.state, self.neighbors, self.room)
        if lists is not None:
            self.room = devices.SlabRoom.of(lists)
        return state, lists

    def stepped(self, state: Any, lists: Any) -> tuple:
        """A distributed state after one interval, with more room if it is needed."""
        new = self.step_of_slabs(state, lists)
        while int(failures(self.divided, new[2])) & 1:
            state, lists = devices.enlarged(self.divided, self.parameters, state, lists, new[1])
            self.room = devices.SlabRoom.of(lists)
            new = self.step_of_slabs(state, lists)
        return new

    def go_on(self, intervals: int) -> None:
        """So many intervals on one device."""
        for _ in range(intervals):
            new = self.step(self.state, self.neighbors)
            while int(failures(self.simulation, new[2])) & 1:
                room = self.neighbors.room.enlarged()
                self.state, self.neighbors = self.simulation.with_room(self.state, self.neighbors, room)
                new = self.step(self.state, self.neighbors)
            self.state, self.neighbors, report = new
            assert int(failures(self.simulation, report)) == 0, int(failures(self.simulation, report))

    def difference(self, intervals: int = 1) -> Difference:
        """After so many intervals from the present state, with which one device goes on."""
        state, lists = self.distributed()
        for _ in range(intervals):
            state, lists, _ = self.stepped(state, lists)
        self.go_on(intervals)
        whole, contacts = devices.gathered(self.divided, state, lists)
        one, other = self.state.particles, whole.particles
        there = slice(None) if one.active is None else np.asarray(one.active)
        if one.active is not None:
            np.testing.assert_array_equal(one.active, other.active)
        mass = np.broadcast_to(np.asarray(self.parameters.bodies.mass), len(one.velocity))[there, None]
        momenta = [np.sum(mass * np.asarray(p.velocity)[there], axis=0) for p in (one, other)]
        total = np.sum(mass * np.abs(np.asarray(one.velocity)[there]))
        own = devices.contacts.contacts_of_list(one.contact_spring, jax.device_get(self.neighbors))
        pairs = [
            set(zip(np.minimum(c.first, c.second), np.maximum(c.first, c.second), strict=True)) for c in (own, contacts)
        ]
        parts = ("contact_force", "velocity", "position", "angular_velocity")
        found = [apart(np.asarray(getattr(one, p))[there], np.asarray(getattr(other, p))[there]) for p in parts]
        return Difference(*found, len(pairs[0] ^ pairs[1]), float(np.abs(momenta[0] - momenta[1]).max() / total))


def main(scenes: int, number: int, wide: bool) -> None:
    """Prints the largest differences of every scene."""
    for seed in range(scenes):
        tables = (wide_scene if wide else random_scene)(seed)
        pair = Pair(jaxdem.load_scene(tables), number)
        kinds = [len(tables["domain"]["size"]), "fluid" if "fluid" in tables else "dry", pair.divided.blocks]
        found = []
        for _ in range(6):
            found.append(pair.difference())
            pair.go_on(4)
        print(seed, *kinds, len(tables["particles"]["position"]), np.max(found, axis=0), flush=True)


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main(int(sys.argv[1]), int(sys.argv[2]), "wide" in sys.argv)
