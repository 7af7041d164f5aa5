"""The bodies that decide the contact step: extremes of size, mass and stiffness. Host side, plain numbers."""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np

from jaxdem.setup.materials import MaterialTable
from jaxdem.setup.parcels import pair_restitution
from jaxdem.setup.particles import ParticleSetup


class ContactBody(NamedTuple):
    """The smallest and lightest, or largest and heaviest, particle that there may be of a material; or a wall.

    Attributes:
        radius: infinite for a wall [m].
        density: infinite for a wall [kg/m3].
        mass: infinite for a wall [kg].
        young_modulus: [Pa].
        poisson_ratio: [-].
        key: of the scene that gives the modulus.
    """

    radius: float
    density: float
    mass: float
    young_modulus: float
    poisson_ratio: float
    key: str

    @property
    def modulus(self) -> float:
        """E / (1 - nu^2) [Pa]; two of them make E* as two masses make m*."""
        return self.young_modulus / (1.0 - self.poisson_ratio**2)

    @property
    def is_wall(self) -> bool:
        """Whether it is a wall."""
        return math.isinf(self.mass)


def contact_bodies(particles: ParticleSetup) -> list[ContactBody]:
    """The extremes of every material: among their pairs are the shortest contact and the deepest overlap."""
    contact, table, shapes = particles.contact, particles.materials, particles.shapes
    radius, density, material, shape = np.broadcast_arrays(*particles.bodies)
    found = []
    for number in np.unique(material):
        young, poisson, key = contact.young_modulus, contact.poisson_ratio, "contact.young_modulus"
        if table is not None:
            young, poisson, key = _elastic(table, int(number))
        here = material == number
        extremes = {(float(f(radius[here])), float(f(density[here]))) for f in (np.min, np.max)}
        for r, rho in sorted(extremes):
            mass = 4.0 / 3.0 * math.pi * r**3 * rho
            if shapes is None:
                found.append(ContactBody(r, rho, mass, young, poisson, key))
                continue
            for kind in np.unique(shape[here]):  # the members, and what their contacts feel of the mass of the body
                one = shapes.templates[kind]
                small, large = r * float(one.radii.min()), r * float(one.radii.max())
                found.append(ContactBody(small, rho, one.share_felt * mass, young, poisson, key))
                found.append(ContactBody(large, rho, mass, young, poisson, key))
    if table is not None:
        return found + [_wall(*_elastic(table, number)) for number in table.wall_materials]
    # Walls as hard as the particles, or harder, are left to the margins of step and overlap (15 % more than of a pair).
    soft, ratio = contact.of_walls("young_modulus"), contact.of_walls("poisson_ratio")
    if found and isinstance(soft, float):
        wall = _wall(soft, ratio, "contact.wall_young_modulus")
        if wall.modulus < found[0].modulus:
            found.append(wall)
    return found


def crowding(particles: ParticleSetup) -> float:
    """Most contacts that a particle has room for, or that it may have with one other, over those of a sphere: 1 of
    spheres [-].

    Those with one other act along one line on the whole body, so they feel its mass and not the share that those of a
    single member feel.
    """
    if particles.shapes is None:
        return 1.0
    kinds = [particles.shapes.templates[kind] for kind in np.unique(particles.bodies.shape)]
    return max(max(one.crowding, one.facing * one.share_felt) for one in kinds)


def effective(a: float, b: float) -> float:
    """1 / (1/a + 1/b); half of two equal numbers, exactly."""
    return 0.5 * a if a == b else 1.0 / (1.0 / a + 1.0 / b)


def _wall(young_modulus: float, poisson_ratio: float, key: str) -> ContactBody:
    return ContactBody(math.inf, math.inf, math.inf, young_modulus, poisson_ratio, key)


def _elastic(table: MaterialTable, number: int) -> tuple[float, float, str]:
    """Young's modulus and Poisson's ratio of a material, and the key that gives the modulus."""
    wall = number == len(table.names) - 1
    key = "contact.wall_young_modulus" if wall else f"materials.{number}.young_modulus"
    return float(table.young_modulus[number]), float(table.poisson_ratio[number]), key


class ContactConstants(NamedTuple):
    """Constants of a contact: E*, G* [Pa], restitution, whether there is friction, rolling friction."""

    modulus: float
    shear_modulus: float
    restitution: float
    rough: bool
    rolling_friction: float


def worst_constants(particles: ParticleSetup, wall: bool) -> ContactConstants:
    """Of contacts between particles, or with walls: the largest moduli and friction, and the least restitution."""
    contact, table = particles.contact, particles.materials
    if table is None:
        own = _compliances(contact.young_modulus, contact.poisson_ratio)
        other, friction = own, contact.friction
        if wall:
            young, friction = contact.of_walls("young_modulus"), contact.of_walls("friction")
            ratio = contact.of_walls("poisson_ratio")
            other = _compliances(young, ratio) if isinstance(young, float) else (0.0, 0.0)
        return ContactConstants(
            1.0 / (own[0] + other[0]),
            1.0 / (own[1] + other[1]),
            contact.restitution if wall else pair_restitution(particles.scene),
            friction > 0.0,
            contact.rolling_friction,
        )
    materials = np.unique(particles.bodies.material).tolist()
    found = []
    for one, other_ in itertools.product(materials, table.wall_materials if wall else materials):
        first, second = (_compliances(*_elastic(table, k)[:2]) for k in (one, other_))
        k = table.pair[one, other_]
        found.append(
            ContactConstants(
                1.0 / (first[0] + second[0]),
                1.0 / (first[1] + second[1]),
                float(table.restitution[k]),
                bool(table.friction[k] > 0.0),
                float(table.rolling_friction[k]),
            )
        )
    moduli, shears, restitutions, rough, rolling = zip(*found, strict=True)
    return ContactConstants(max(moduli), max(shears), min(restitutions), any(rough), max(rolling))


def _compliances(young: float, poisson: float) -> tuple[float, float]:
    """What a body adds to 1/E* and to 1/G* [1/Pa]."""
    return (1.0 - poisson**2) / young, 2.0 * (1.0 + poisson) * (2.0 - poisson) / young
