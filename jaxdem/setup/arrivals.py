"""Which particles come in through the inlets of a scene, and when: known before the run. Host, numpy."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from jaxdem.errors import InputError
from jaxdem.particles.population import Exit, Inlet, Population
from jaxdem.scene import Scene
from jaxdem.scene.population import comes_and_goes
from jaxdem.setup.bodies import Bodies, species_bodies

MOST = 10_000_000
"""Particles that an inlet may bring; more is a slip of the rate's unit."""

ROUNDING = 1e-9
"""Of a number of particles or intervals that should be whole."""


class Arrivals(NamedTuple):
    """The particles of one inlet.

    Attributes:
        time: (M,) when each is due, increasing [s].
        bodies: (M,) what they are.
    """

    time: np.ndarray
    bodies: Bodies


def arrivals(scene: Scene) -> tuple[Arrivals, ...]:
    """The particles of every inlet of a scene, their species drawn with its seed.

    Raises:
        InputError: an inlet brings no particle, or far too many.
    """
    particles = scene.particles
    if particles is None:
        return ()
    names = tuple(material.name for material in scene.materials)
    found = []
    for k, inlet in enumerate(particles.inlet):
        species = inlet.species_of(particles)
        duration = min(inlet.end or scene.time.end, scene.time.end) - inlet.begin
        shares = np.asarray([one.share for one in species])
        one_each = species_bodies(species, particles, names, np.arange(len(species)))
        masses = 4.0 / 3.0 * math.pi * one_each.radius**3 * one_each.density
        if inlet.rate is not None:
            expected = inlet.rate * duration
        else:
            assert inlet.mass_flow is not None
            expected = inlet.mass_flow * duration / masses.min()
        number = min(expected, inlet.total or math.inf)
        key = f"particles.inlet.{k}." + ("rate" if inlet.rate is not None else "mass_flow")
        if number > MOST:
            raise InputError(
                key, inlet.rate or inlet.mass_flow, f"brings up to {number:.3g} particles, the limit is {MOST}",
                "lower it, or set total of the inlet",
            )  # fmt: skip
        count = max(math.floor(number * (1.0 + ROUNDING) + ROUNDING), 0)
        generator = np.random.default_rng([scene.seed, 2, k])
        kind = generator.choice(len(species), count, p=shares / shares.sum())
        if inlet.rate is not None:
            time = inlet.begin + np.arange(1, count + 1) / inlet.rate
        else:
            time = inlet.begin + np.cumsum(masses[kind]) / inlet.mass_flow  # type: ignore[operator]
        in_time = time <= inlet.begin + duration * (1.0 + ROUNDING)
        kind, time = kind[in_time], time[in_time]
        if len(kind) == 0:
            raise InputError(
                key, inlet.rate or inlet.mass_flow,
                f"brings no particle between {inlet.begin} and {inlet.begin + max(duration, 0.0)} s",
                "raise it, or remove the inlet",
            )  # fmt: skip
        found.append(Arrivals(time, species_bodies(species, particles, names, kind)))
    return tuple(found)


def population_of(scene: Scene, interval: float, present: int) -> Population | None:
    """How the number of particles of a scene changes; None where it does not.

    Args:
        scene: the scene.
        interval: coupling interval [s].
        present: number of particles at the start.
    """
    if not comes_and_goes(scene):
        return None
    assert scene.particles is not None
    exits = tuple(
        Exit(number // 2, bool(number % 2), scene.domain.size[number // 2] if number % 2 else 0.0)
        for number, name in enumerate(scene.sides)
        if scene.boundary[name].particles == "remove"
    )
    inlets, first = [], present
    for inlet, coming in zip(scene.particles.inlet, arrivals(scene), strict=True):
        due = np.maximum(np.ceil(coming.time / interval * (1.0 - ROUNDING) - ROUNDING), 1.0).astype(np.int32)
        most = int(np.bincount(due).max())
        start, stop = np.asarray(inlet.start, float), np.asarray(inlet.stop, float)
        # Twice as many as come at once, so that those who had to wait can catch up.
        inlets.append(Inlet(first, due, start, stop, min(2 * most + 2, len(due))))
        first += len(due)
    return Population(exits, tuple(inlets), scene.domain.size, scene.periodic, scene.seed)
