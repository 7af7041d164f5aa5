"""Which particles come in through the inlets of a scene, and when: known before the run. Host, numpy."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from jaxdem.errors import InputError
from jaxdem.scene import Particles, Scene
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


def arrivals(scene: Scene, particles: Particles) -> tuple[Arrivals, ...]:
    """The particles of every inlet of a scene, their species drawn with its seed.

    Args:
        scene: the scene.
        particles: its table `[particles]`.

    Raises:
        InputError: an inlet brings no particle, or far too many.
    """
    return tuple(_arrivals_of(scene, particles, number) for number in range(len(particles.inlet)))


def _arrivals_of(scene: Scene, particles: Particles, number: int) -> Arrivals:
    """The particles of inlet `number`."""
    inlet, names = particles.inlet[number], tuple(material.name for material in scene.materials)
    species = inlet.species_of(particles.species)
    one_each = species_bodies(species, particles, names, np.arange(len(species)))
    # What a particle of each species takes of the flow: one of a number, its mass of a mass flow.
    name, flow, part = "rate", inlet.rate or 0.0, np.ones(len(species))
    if inlet.mass_flow is not None:
        name, flow, part = "mass_flow", inlet.mass_flow, 4.0 / 3.0 * math.pi * one_each.radius**3 * one_each.density
    key, duration = f"particles.inlet.{number}.{name}", min(inlet.end or scene.time.end, scene.time.end) - inlet.begin
    most = min(flow * duration / part.min(), inlet.total or math.inf)
    if most > MOST:
        limit = f"brings up to {most:.3g} particles, the limit is {MOST}"
        raise InputError(key, flow, limit, "lower it, or set total of the inlet")
    count = max(math.floor(most * (1.0 + ROUNDING) + ROUNDING), 0)
    shares = np.asarray([one.share for one in species])
    kind = np.random.default_rng([scene.seed, 2, number]).choice(len(species), count, p=shares / shares.sum())
    time = inlet.begin + np.cumsum(part[kind]) / flow
    in_time = time <= inlet.begin + duration * (1.0 + ROUNDING)
    kind, time = kind[in_time], time[in_time]
    if len(kind) == 0:
        limit = f"brings no particle between {inlet.begin} and {inlet.begin + max(duration, 0.0)} s"
        raise InputError(key, flow, limit, "raise it, or remove the inlet")
    return Arrivals(time, species_bodies(species, particles, names, kind))
