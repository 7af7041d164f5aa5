"""Which particles come in through the inlets of a scene, and when: known before the run. Host, numpy."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from jaxdem.errors import InputError, required
from jaxdem.scene import Particles, Scene
from jaxdem.setup.bodies import Bodies, species_bodies
from jaxdem.setup.distribution import radii
from jaxdem.setup.inlet_flow import ROUNDING, FlowOverTime, SteadyFlow

MOST = 10_000_000
"""Particles that an inlet may bring; more is a slip of the rate's unit."""

SIZES = 1000
"""Radii by which the mean mass of a distribution is estimated."""


class Arrivals(NamedTuple):
    """The particles of one inlet.

    Attributes:
        time: (M,) when each is due, increasing [s].
        bodies: (M,) what they are.
    """

    time: np.ndarray
    bodies: Bodies


class Queue(NamedTuple):
    """The particles of an inlet, in the order in which they come.

    Attributes:
        rows: (M,) of the particles.
        time: (M,) when each is due [s].
        inserted: how many have come in.
    """

    rows: np.ndarray
    time: np.ndarray
    inserted: int = 0


def arrivals(scene: Scene, particles: Particles) -> tuple[Arrivals, ...]:
    """The particles of every inlet of a scene, their species and sizes drawn with its seed.

    Args:
        scene: the scene.
        particles: its table `[particles]`.

    Raises:
        InputError: an inlet brings no particle, or far too many.
    """
    return tuple(_arrivals_of(scene, particles, number) for number in range(len(particles.inlet)))


def _arrivals_of(scene: Scene, particles: Particles, number: int) -> Arrivals:
    """The particles of inlet `number`."""
    inlet, source = particles.inlet[number], _Source(scene, particles, number)
    name, given = inlet.flow
    key, end = f"particles.inlet.{number}.{name}", min(inlet.end or scene.time.end, scene.time.end)
    flow: SteadyFlow | FlowOverTime
    if isinstance(given, tuple):
        flow = FlowOverTime(required(inlet.times, f"particles.inlet.{number}.times"), given, inlet.begin, end)
    else:
        flow = SteadyFlow(given, inlet.begin, end)
    mean, total = source.mean_part(), inlet.total or math.inf
    most = min(flow.total / mean, total)
    if most > MOST:
        limit = f"brings up to {most:.3g} particles, the limit is {MOST}"
        raise InputError(key, given, limit, "lower it, or set total of the inlet")
    groups: list[Bodies] = []
    count, come = 0, 0.0
    while not groups or (come < flow.total * (1.0 + ROUNDING) and count < total):
        groups.append(source.next(max(math.ceil(min((flow.total - come) / mean, total - count)), 1)))
        count, come = count + len(groups[-1].radius), come + float(source.parts(groups[-1]).sum())
    bodies = Bodies(*(np.concatenate(columns) for columns in zip(*groups, strict=True)))
    time, duration = flow.times(np.cumsum(source.parts(bodies))), end - inlet.begin
    in_time = (time <= inlet.begin + duration * (1.0 + ROUNDING)) & (np.arange(count) < total)
    if not in_time.any():
        limit = f"brings no particle between {inlet.begin} and {inlet.begin + max(duration, 0.0)} s"
        raise InputError(key, given, limit, "raise it, or remove the inlet")
    return Arrivals(time[in_time], Bodies(*(column[in_time] for column in bodies)))


class _Source:
    """The particles of an inlet, drawn one group after the other; how they are grouped changes nothing.

    Args:
        scene: with the seed.
        particles: its table `[particles]`.
        number: of the inlet.
    """

    def __init__(self, scene: Scene, particles: Particles, number: int):
        self._particles, self._inlet = particles, particles.inlet[number]
        self._ratio, self._dimension = particles.coarse_grain, scene.dimension
        self._names = tuple(material.name for material in scene.materials)
        self._species = self._inlet.species_of(particles.species)
        shares = np.asarray([one.share for one in self._species])
        self._shares = shares / shares.sum()
        self._distribution, self._key = particles.distribution, "particles.distribution"
        if self._inlet.distribution is not None:
            self._distribution, self._key = self._inlet.distribution, f"particles.inlet.{number}.distribution"
        self._kinds, self._sizes = (np.random.default_rng([scene.seed, stream, number]) for stream in (2, 4))

    def next(self, count: int) -> Bodies:
        """The next `count` particles."""
        kind = self._kinds.choice(len(self._species), count, p=self._shares)
        return self._bodies(kind, self._sizes.uniform(size=count))

    def parts(self, bodies: Bodies) -> np.ndarray:
        """What each particle takes of the inlet's flow: one of a number, its mass of a mass flow [kg]."""
        if self._inlet.mass_flow is None:
            return np.ones(len(bodies.radius))
        grain, grains = bodies.radius / self._ratio, self._ratio**self._dimension
        return grains * (4.0 / 3.0 * math.pi * grain**3) * bodies.density

    def mean_part(self) -> float:
        """Mean of what a particle takes of the flow, by `SIZES` radii of each species."""
        count = len(self._species)
        kind, u = np.repeat(np.arange(count), SIZES), np.tile((np.arange(SIZES) + 0.5) / SIZES, count)
        return float(np.average(self.parts(self._bodies(kind, u)), weights=np.repeat(self._shares, SIZES)))

    def _bodies(self, kind: np.ndarray, u: np.ndarray) -> Bodies:
        """Particles of the species `kind` (N,), whose radii are where the distribution has reached `u` (N,)."""
        drawn = None if self._distribution is None else radii(self._key, self._distribution, u)
        grains = species_bodies(self._species, self._particles, self._names, kind, drawn)
        return grains.scaled(self._particles.coarse_grain)
