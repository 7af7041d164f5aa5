"""The contact step of a scene: the automatic one chosen, a given one checked. Host side, plain numbers."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxdem.errors import InputError, required
from jaxdem.scene import Contact
from jaxdem.scene.cohesion import STRENGTH
from jaxdem.scene.inlets import inlet_speed
from jaxdem.scene.rows import rows_of
from jaxdem.setup import stability
from jaxdem.setup.bond_stability import SAFETY, bond_growth, bond_limit
from jaxdem.setup.cohesion import attraction_time, pair_of
from jaxdem.setup.contact_bodies import ContactBody, contact_bodies, effective
from jaxdem.setup.contact_stability import contact_stability
from jaxdem.setup.lubrication import lubrication_time
from jaxdem.setup.particles import ParticleSetup
from jaxdem.setup.wall_functions import NO_FUNCTIONS, WallFunctions
from jaxdem.setup.wall_motion import fastest_wall

ATTRACTION = 0.2
"""Automatic contact step over the time in which an attraction multiplies a speed, at most [-]."""


class ContactStep(NamedTuple):
    """The longest contact step and what it was chosen from.

    Attributes:
        longest: contact step, before it is cut to divide the interval [s].
        limits: named limits [s].
        speed: expected of particles [m/s].
        overlap: at that speed, over the diameter [-].
        speed_limit: at which an impact reaches `contact.maximum_overlap` [m/s].
    """

    longest: float
    limits: dict[str, float]
    speed: float
    overlap: float
    speed_limit: float


def contact_step(
    particles: ParticleSetup, boundary_speed: float, own_walls: WallFunctions = NO_FUNCTIONS
) -> ContactStep:
    """The contact step for the materials, sizes and speeds of a scene.

    Args:
        particles: of the scene.
        boundary_speed: largest that a boundary or the initial fluid imposes [m/s].
        own_walls: of the user.

    Raises:
        InputError: the given step is unstable, or impacts would overlap too far.
    """
    contact, bodies = particles.contact, contact_bodies(particles)
    speed = expected_speed(particles, boundary_speed)
    overlap = _overlap(particles, bodies, speed)
    limits: dict[str, float] = {}
    if contact.law == "hertz_mindlin":
        limits["rayleigh"] = min(
            stability.rayleigh_time(body.radius, body.density, body.young_modulus, body.poisson_ratio)
            for body in bodies
            if not body.is_wall
        )
    limits["contact_duration"] = _shortest_contact(particles, bodies, speed)
    limits["contact_stability"] = contact_stability(particles, bodies, speed, own_walls=own_walls)
    bonded = bond_limit(bond_growth(particles))
    if math.isfinite(bonded):
        limits["bond_stability"] = bonded
    growing = attraction_time(particles, bodies)
    if math.isfinite(growing):
        limits["contact_attraction"] = growing
    film = lubrication_time(particles, bodies)
    if math.isfinite(film):
        limits["contact_lubrication"] = film
    limits["contact_automatic"] = min(
        0.2 * limits.get("rayleigh", math.inf),
        limits["contact_duration"] / 20.0,
        limits["contact_stability"],
        ATTRACTION * growing,
        SAFETY * bonded,
    )
    # The overlap grows with v^0.8 in Hertz's law and with v in the linear one.
    power = 1.0 if contact.law == "linear_spring_dashpot" else 1.25
    speed_limit = speed * (contact.maximum_overlap / overlap) ** power
    return ContactStep(_longest(particles, limits), limits, speed, overlap, speed_limit)


def expected_speed(particles: ParticleSetup, boundary_speed: float) -> float:
    """Largest speed to expect of particles [m/s]: boundary, initial velocities, a fall through the box; and on top of
    it that of the fastest wall that they may meet."""
    scene, contact, table = particles.scene, particles.contact, particles.table
    if contact.speed != "auto":
        return contact.speed
    gravity = scene.domain.gravity_along
    fall = math.sqrt(2.0 * sum(g * length for g, length in zip(gravity, scene.domain.size, strict=True)))
    velocity = rows_of("particles.velocity", particles.given_velocity, scene.dimension, of_frame=True)
    fastest = 0.0 if velocity is None or len(velocity) == 0 else float(np.linalg.norm(velocity, axis=1).max())
    slow = max(boundary_speed, fall, 2.0 * max(fastest, inlet_speed(table.inlet)), 1e-3)
    return slow + fastest_wall(scene)


def _meetings(bodies: Sequence[ContactBody]) -> list[tuple[ContactBody, ContactBody]]:
    """Pairs that may touch; two walls do not, nor does the only particle of a kind itself.

    Without a wall among the bodies it does: a pair stands for a particle at a wall then.
    """
    with_walls = any(body.is_wall for body in bodies)
    pairs = itertools.combinations_with_replacement(bodies, 2)
    meet = [pair for pair in pairs if not (pair[0].is_wall and pair[1].is_wall)]
    return [(a, b) for a, b in meet if b.is_wall or not with_walls or a.others(b) > 0]


def _shortest_contact(particles: ParticleSetup, bodies: Sequence[ContactBody], speed: float) -> float:
    """Duration of the shortest contact [s]."""
    contact, table, durations = particles.contact, particles.materials, []
    # The pair with the highest restitution has the shortest contacts.
    restitution = contact.restitution if table is None else float(table.restitution.max())
    for one, other in _meetings(bodies):
        mass = effective(one.mass, other.mass)
        if contact.law == "linear_spring_dashpot":
            damping = stability.damping_ratio(restitution)
            durations.append(stability.linear_duration(mass, contact.normal_stiffness or 0.0, damping))
        else:
            radius, modulus = effective(one.radius, other.radius), effective(one.modulus, other.modulus)
            pair, fast = pair_of(particles, one, other), speed
            if pair is not None:  # as long as an impact without cohesion that is as deep
                deepest = pair.depth(0.5 * mass * speed**2)[1]
                fast = max(speed, stability.hertz_speed(mass, radius, modulus, deepest))
            durations.append(stability.hertz_duration(mass, radius, modulus, fast))
    return min(durations)


def _overlap(particles: ParticleSetup, bodies: Sequence[ContactBody], speed: float) -> float:
    """The deepest overlap of an impact at a speed [m/s], over the diameter [-].

    Raises:
        InputError: it is deeper than `contact.maximum_overlap`, by the speed or by the pull of cohesion.
    """
    contact, overlaps = particles.contact, []
    linear, stiffness = contact.law == "linear_spring_dashpot", contact.normal_stiffness or 0.0
    heaviest = max(body.mass for body in bodies if not body.is_wall)
    for one, other in _meetings(bodies):
        if linear:
            plain = stability.linear_overlap(heaviest, stiffness, speed)
        else:
            mass, radius = effective(one.mass, other.mass), effective(one.radius, other.radius)
            plain = stability.hertz_overlap(mass, radius, effective(one.modulus, other.modulus), speed)
        attracted, overlap = pair_of(particles, one, other), plain
        if attracted is not None:
            mass = heaviest if linear else effective(one.mass, other.mass)
            overlap = attracted.depth(0.5 * mass * speed**2)[0]
        size = 2.0 * min(one.radius, other.radius)
        overlaps.append((overlap / size, plain / size, one, other))
    relative, plain, *pair = max(overlaps, key=lambda found: found[0])
    if relative > contact.maximum_overlap:
        deep = f"an impact at {speed:.3g} m/s would overlap by {100 * relative:.3g} % of a diameter"
        limit = f"the limit is {100 * contact.maximum_overlap:.3g} %"
        if plain <= contact.maximum_overlap:
            key, value = _pulling(contact, any(body.is_wall for body in pair))
            limit = f"with this pull {deep}, without cohesion by {100 * plain:.3g} %; {limit}"
            raise InputError(key, value, limit, "lower it, stiffen the contact, or raise contact.maximum_overlap")
        soft = min(pair, key=lambda body: body.young_modulus)
        raise InputError(
            "contact.normal_stiffness" if linear else soft.key,
            stiffness / particles.table.coarse_grain if linear else soft.young_modulus,
            f"{deep}, {limit}",
            "stiffen the contact, lower contact.speed, or raise contact.maximum_overlap",
        )
    return relative


def _pulling(contact: Contact, at_wall: bool) -> tuple[str, float]:
    """Key of what makes a pull strong, and its value."""
    table = required(contact.cohesion, "cohesion")
    if at_wall and table.wall_factor > 1.0:
        return "contact.cohesion.wall_factor", table.wall_factor
    return f"contact.cohesion.{STRENGTH[table.kind]}", table.strength


def _longest(particles: ParticleSetup, limits: dict[str, float]) -> float:
    """The contact step: the automatic one, or the one given if it is stable [s]."""
    given = particles.contact.time_step
    if given == "auto":
        return limits["contact_automatic"]
    rayleigh = limits.get("rayleigh", math.inf)
    stable = min(limits["contact_stability"], rayleigh)
    # The message gives four digits; the step that it names must be accepted.
    if given > stable * (1.0 + 5e-4):
        raise InputError(
            "contact.time_step",
            given,
            f"the stable step is {stable:.4g} s (2/omega_max {limits['contact_stability']:.4g} s, "
            f"Rayleigh {rayleigh:.4g} s)",
            f'set contact.time_step = "auto" ({limits["contact_automatic"]:.4g} s) or soften the contact',
        )
    return given
