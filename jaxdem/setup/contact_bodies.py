"""The bodies that decide the contact step: kinds of particles, and walls. Host side, plain numbers."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from jaxdem.setup.materials import MaterialTable
from jaxdem.setup.parcels import pair_restitution
from jaxdem.setup.particles import ParticleSetup

MOST_KINDS = 8
"""Sizes, and densities, of a material up to which each is a body of its own; of more the extremes are."""


class ContactBody(NamedTuple):
    """A kind of particle, or the smallest and lightest, or largest and heaviest, of a material; or a wall.

    Attributes:
        radius: infinite for a wall [m].
        density: infinite for a wall [kg/m3].
        mass: infinite for a wall [kg].
        young_modulus: [Pa].
        poisson_ratio: [-].
        key: of the scene that gives the modulus.
        material: number of it.
        group: number of the set of particles that it stands for; two extremes stand for the same, -1 of a wall.
        number: of particles in this set, at most; 0 of a wall.
    """

    radius: float
    density: float
    mass: float
    young_modulus: float
    poisson_ratio: float
    key: str
    material: int
    group: int
    number: int

    @property
    def modulus(self) -> float:
        """E / (1 - nu^2) [Pa]; two of them make E* as two masses make m*."""
        return self.young_modulus / (1.0 - self.poisson_ratio**2)

    @property
    def is_wall(self) -> bool:
        """Whether it is a wall."""
        return math.isinf(self.mass)

    def others(self, body: ContactBody) -> int:
        """Number of particles such as `body` that a particle such as this may touch."""
        return body.number - (1 if body.group == self.group else 0)


def contact_bodies(particles: ParticleSetup) -> list[ContactBody]:
    """Every kind of particle, and walls: among their pairs are the shortest contact and the deepest overlap."""
    contact, table, shapes = particles.contact, particles.materials, particles.shapes
    radius, density, material, shape = np.broadcast_arrays(*particles.bodies)
    found: list[ContactBody] = []
    for number in np.unique(material):
        young, poisson, key = contact.young_modulus, contact.poisson_ratio, "contact.young_modulus"
        if table is not None:
            young, poisson, key = _elastic(table, int(number))
        here = material == number
        # Numbers of one size are not repeated for every particle.
        times, first = particles.total if material.ndim == 0 else 1, len(found)
        for group, r, rho, count in _kinds(radius[here], density[here]):
            mass = 4.0 / 3.0 * math.pi * r**3 * rho
            rest = young, poisson, key, int(number), first + group, count * times
            if shapes is None:
                found.append(ContactBody(r, rho, mass, *rest))
                continue
            for kind in np.unique(shape[here]):  # the members, and what their contacts feel of the mass of the body
                one = shapes.templates[kind]
                small, large = r * float(one.radii.min()), r * float(one.radii.max())
                found.append(ContactBody(small, rho, one.share_felt * mass, *rest))
                found.append(ContactBody(large, rho, mass, *rest))
    if table is not None:
        return found + [_wall(*_elastic(table, number), number) for number in table.wall_materials]
    # Walls as hard as the particles, or harder, are left to the margins of step and overlap (15 % more than of a pair),
    # unless they attract more.
    soft, ratio = contact.of_walls("young_modulus"), contact.of_walls("poisson_ratio")
    attracts = contact.cohesion is not None and contact.cohesion.wall_factor > 1.0
    wall = _wall(soft if isinstance(soft, float) else math.inf, ratio, "contact.wall_young_modulus", 0)
    if found and (attracts or wall.modulus < found[0].modulus):
        found.append(wall)
    return found


def _kinds(radius: np.ndarray, density: np.ndarray) -> list[tuple[int, float, float, int]]:
    """Group, radius, density and number of each kind of these particles; of more than `MOST_KINDS`, of the extremes."""
    columns = radius, density
    each = [_values(x) for x in columns]
    if max(map(len, each)) > MOST_KINDS:
        extremes = {(float(f(radius)), float(f(density))) for f in (np.min, np.max)}
        return [(0, *one, len(radius)) for one in sorted(extremes)]
    pairs = [(float(r), float(rho), int(np.sum((radius == r) & (density == rho)))) for r in each[0] for rho in each[1]]
    return [(group, *one) for group, one in enumerate(one for one in pairs if one[2] > 0)]


def _values(column: np.ndarray) -> np.ndarray:
    """The values that there are, each once; or more than `MOST_KINDS` of them."""
    if column.min() == column.max():
        return column[:1]
    some = np.unique(column[:1000])  # which tells of a million that are all different, without sorting them
    return some if len(some) > MOST_KINDS else np.unique(column)


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


def _wall(young_modulus: float, poisson_ratio: float, key: str, material: int) -> ContactBody:
    return ContactBody(math.inf, math.inf, math.inf, young_modulus, poisson_ratio, key, material, -1, 0)


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


def pair_constants(particles: ParticleSetup, one: int, other: int | None) -> ContactConstants:
    """Of contacts between particles of two materials; with None, of one and any wall.

    Of several walls these are the largest moduli and friction, and the least restitution.
    """
    contact, table = particles.contact, particles.materials
    if table is None:
        own = _compliances(contact.young_modulus, contact.poisson_ratio)
        second, friction = own, contact.friction
        if other is None:
            young, friction = contact.of_walls("young_modulus"), contact.of_walls("friction")
            ratio = contact.of_walls("poisson_ratio")
            second = _compliances(young, ratio) if isinstance(young, float) else (0.0, 0.0)
        return ContactConstants(
            1.0 / (own[0] + second[0]),
            1.0 / (own[1] + second[1]),
            contact.restitution if other is None else pair_restitution(particles.scene),
            friction > 0.0,
            contact.rolling_friction,
        )
    found = []
    for number in table.wall_materials if other is None else [other]:
        first, second = (_compliances(*_elastic(table, k)[:2]) for k in (one, number))
        k = table.pair[one, number]
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
