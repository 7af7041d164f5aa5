"""What attracts or resists over a gap between two bodies of a scene, and how far it reaches.

Host side, plain numbers. Equations: `jaxdem.particles.adhesion`, `capillary_bridge` and `lubrication`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from jaxdem.errors import InputError
from jaxdem.scene import Contact
from jaxdem.scene.cohesion import STRENGTH, Cohesion
from jaxdem.setup.bodies import Bodies
from jaxdem.setup.materials import MaterialTable


class Grains(Protocol):
    """What is asked of the particles of a scene, see `ParticleSetup`."""

    @property
    def contact(self) -> Contact:
        """Its table `[contact]`."""
        ...

    @property
    def bodies(self) -> Bodies:
        """Size, density and material of all particles."""
        ...

    @property
    def spheres(self) -> Bodies:
        """The same of what touches."""
        ...

    @property
    def materials(self) -> MaterialTable | None:
        """Constants of the materials; None where there is one only."""
        ...


END_OF_NECK = -3.0 / 16.0 ** (2.0 / 3.0)
"""Overlap, in JKR's unit, at which a contact ends."""

LARGEST_REACH = 0.5
"""Longest attraction that is accepted, over the radius of the smallest particle."""


class Pair(NamedTuple):
    """Two bodies that attract each other.

    Attributes:
        table: of the scene.
        strength: of the pair, see `STRENGTH`.
        radius: R* [m].
        modulus: E* of Hertz's law [Pa]; 0 with the linear law.
        stiffness: of the linear law [N/m]; 0 with Hertz's.
        volume: of a bridge between them at the start [m3].
    """

    table: Cohesion
    strength: float
    radius: float
    modulus: float
    stiffness: float = 0.0
    volume: float = 0.0

    @property
    def unit(self) -> float:
        """JKR's unit of the overlap, (2 pi w / E*)^(2/3) R*^(1/3) [m]."""
        return (2.0 * math.pi * self.strength / self.modulus) ** (2.0 / 3.0) * self.radius ** (1.0 / 3.0)

    @property
    def pull_off(self) -> float:
        """Force that parts them after a light touch; 0 with sjkr [N]."""
        return {
            "jkr": 1.5 * math.pi * self.strength * self.radius,
            "dmt": 2.0 * math.pi * self.strength * self.radius,
            "van_der_waals": self.strength * self.radius / (6.0 * (self.table.minimum_gap or math.inf) ** 2),
            "capillary": 4.0 * math.pi * self.strength * self.radius * math.cos(self.table.contact_angle or 0.0),
            "sjkr": 0.0,
        }[self.table.kind]

    @property
    def reach(self) -> float:
        """Largest gap at which they act on each other [m]."""
        kind = self.table.kind
        if kind == "jkr":
            return -END_OF_NECK * self.unit
        if kind == "capillary":
            return (1.0 + 0.5 * (self.table.contact_angle or 0.0)) * self.volume ** (1.0 / 3.0)
        return (self.table.cutoff or 0.0) if kind == "van_der_waals" else 0.0

    @property
    def steepest(self) -> float:
        """Largest slope of the attraction over the gap, before they touch [N/m]."""
        if self.table.kind == "van_der_waals":
            return 2.0 * self.pull_off / (self.table.minimum_gap or math.inf)
        if self.table.kind == "capillary" and self.volume > 0.0:
            return 1.05 * self.pull_off * math.sqrt(2.0 * self.radius / self.volume)
        return 0.0

    def depth(self, energy: float) -> tuple[float, float]:
        """Overlap at which they turn back that meet with an energy, and the one that the law is evaluated at [m].

        Args:
            energy: kinetic, at a distance [J].
        """
        if self.table.kind == "jkr":
            if self.strength == 0.0:
                return (self._hertz_depth(energy),) * 2
            scale = 2.0 * math.pi * self.strength * self.radius * self.unit
            y = _root(lambda y: scale * (y**4 * (8.0 / 15.0 * y**6 - 4.0 / 3.0 * y**3 + 0.5) + 0.3) - energy, 1.2)
            return self.unit * (y**4 - y), self.unit * y**4
        before = self._work_of_approach()
        area = math.pi * self.strength * self.radius if self.table.kind == "sjkr" else 0.0

        def missing(depth: float) -> float:
            pressed = 8.0 / 15.0 * self.modulus * math.sqrt(self.radius) * depth**2.5 + 0.5 * self.stiffness * depth**2
            return pressed - self.pull_off * depth - area * depth**2 - energy - before

        least = self.radius * 1e-9
        found = _root(missing, least)
        return found, found

    def law_depth(self, overlap: float) -> float:
        """Overlap that the contact law is evaluated at [m], of one that the bodies have."""
        if self.table.kind != "jkr" or self.strength == 0.0:
            return overlap
        scaled = overlap / self.unit
        return self.unit * _root(lambda y: y**4 - y - scaled, 0.7) ** 4

    def resting(self) -> float:
        """Overlap at which they rest without another force; 0 with sjkr [m]."""
        if self.table.kind == "jkr":
            return self.unit * (1.5 ** (4.0 / 3.0) - 1.5 ** (1.0 / 3.0))
        if self.stiffness:
            return self.pull_off / self.stiffness
        return (0.75 * self.pull_off / (self.modulus * math.sqrt(self.radius))) ** (2.0 / 3.0)

    def _hertz_depth(self, energy: float) -> float:
        return float((15.0 * energy / (8.0 * self.modulus * math.sqrt(self.radius))) ** 0.4)

    def _work_of_approach(self) -> float:
        """Of the attraction, from its reach to contact [J]."""
        table = self.table
        if table.kind == "van_der_waals" and table.minimum_gap is not None and table.cutoff is not None:
            return self.pull_off * table.minimum_gap * (2.0 - table.minimum_gap / table.cutoff)
        if table.kind == "capillary" and self.volume > 0.0:
            scaled = np.linspace(0.0, self.reach, 201) * math.sqrt(2.0 * self.radius / self.volume)
            return self.pull_off * self.reach * float(np.mean(1.0 / (1.0 + 1.05 * scaled + 2.5 * scaled**2)))
        return 0.0


def _root(function: Callable[[float], float], start: float) -> float:
    """Where an ultimately increasing function becomes positive for good, above `start`."""
    high = start
    for _ in range(400):
        if function(high) > 0.0 and function(2.0 * high) > function(high):
            break
        high *= 2.0
    low = 0.5 * high
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if function(middle) > 0.0 else (middle, high)
    return high


def strongest(particles: Grains, wall: bool) -> float:
    """The largest strength of contacts between particles, or with walls."""
    table, materials = particles.contact.cohesion, particles.materials
    if table is None:
        return 0.0
    if materials is None or materials.cohesion is None:
        return table.strength * (table.wall_factor if wall else 1.0)
    used = np.unique(particles.bodies.material).tolist()
    pairs = itertools.product(used, materials.wall_materials if wall else used)
    return max(float(materials.cohesion[materials.pair[one, other]]) for one, other in pairs)


def bridge_volume(particles: Grains, radius: float) -> float:
    """Of the first bridge between two particles of a radius [m3]; 0 without liquid."""
    table = particles.contact.cohesion
    if table is None or table.liquid_content is None or table.bridge_share is None:
        return 0.0
    return 2.0 * table.bridge_share * table.liquid_content * 4.0 / 3.0 * math.pi * radius**3


def cohesion_reach(particles: Grains) -> float:
    """Longest gap at which two bodies of a scene attract each other [m].

    Raises:
        InputError: it is longer than half of the smallest radius.
    """
    table, contact = particles.contact.cohesion, particles.contact
    if table is None or particles.bodies.radius.size == 0:
        return 0.0
    radius = 0.5 * particles.spheres.largest_diameter
    softest = contact.young_modulus / (1.0 - contact.poisson_ratio**2)
    if particles.materials is not None:
        softest = float(np.min(particles.materials.young_modulus / (1.0 - particles.materials.poisson_ratio**2)))
    if contact.wall_young_modulus not in (None, "rigid"):
        softest = min(softest, float(contact.of_walls("young_modulus")))
    strength = max(strongest(particles, wall) for wall in (False, True))
    # The largest sphere at a plane of the softest material: no pair has a longer neck.
    pair = Pair(table, strength, radius, 0.5 * softest, 0.0, bridge_volume(particles, radius))
    if pair.reach > LARGEST_REACH * particles.spheres.smallest_radius:
        key = {"van_der_waals": "cutoff", "capillary": "liquid_content"}.get(table.kind, STRENGTH[table.kind])
        raise InputError(
            f"contact.cohesion.{key}",
            getattr(table, key),
            f"bodies attract each other up to a gap of {pair.reach:.3g} m; the limit is half of the smallest radius, "
            f"{LARGEST_REACH * particles.spheres.smallest_radius:.3g} m",
            "lower it, or stiffen the contact" if table.kind == "jkr" else "lower it",
        )
    return pair.reach


def lubrication_reach(particles: Grains) -> float:
    """Longest gap at which the liquid acts [m].

    Raises:
        InputError: it is longer than half of the smallest radius, of clumps of that of a member.
    """
    table = particles.contact.lubrication
    if table is None or particles.bodies.radius.size == 0:
        return 0.0
    longest = LARGEST_REACH * particles.spheres.smallest_radius
    if table.cutoff > longest:
        limit = f"is at most half of the smallest radius, {longest:.3g} m: the force is that of a narrow gap"
        raise InputError("contact.lubrication.cutoff", table.cutoff, limit, "lower it")
    return table.cutoff


def longest_gap(particles: Grains) -> float:
    """Longest gap at which two bodies of a scene act on each other [m].

    Raises:
        InputError: it is longer than half of the smallest radius.
    """
    return max(cohesion_reach(particles), lubrication_reach(particles))
