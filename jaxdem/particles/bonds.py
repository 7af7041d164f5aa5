"""What bonds do to their grains: elastic forces, dashpots and the end of a bond whose strength is reached."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics import vectors
from jaxdem.numerics.quotients import harmonic
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.bond_geometry import (
    BondGeometry,
    BondParameters,
    bond_geometry,
    in_space,
    of_grains,
    spin_in_space,
)
from jaxdem.particles.bond_state import INTACT, SHEAR, TENSION, Bonding, BondState
from jaxdem.particles.contact_step import ContactStep
from jaxdem.particles.contact_sums import FoundBonds, Sums
from jaxdem.particles.integrate import Motion, ParticleProperties, ParticleState
from jaxdem.particles.pairs import Pairs, at, sum_over_pairs


class BondLoads(NamedTuple):
    """What bonds carry, (B,) each; zero in those that do not hold.

    Attributes:
        normal_force: positive in tension [N].
        shear_force: [N].
        bending_moment: [N m].
        twisting_moment: [N m].
        tensile_stress: at the rim, that counts against the tensile strength [Pa].
        shear_stress: the same against the shear strength [Pa].
        energy: [J].
    """

    normal_force: Array
    shear_force: Array
    bending_moment: Array
    twisting_moment: Array
    tensile_stress: Array
    shear_stress: Array
    energy: Array


def bond_loads(
    bonding: Bonding, parameters: BondParameters, properties: ParticleProperties, state: ParticleState
) -> BondLoads:
    """What every bond of a state carries; one may differentiate by all of it, up to the first break.

    Args:
        bonding: `simulation.contact.model.bonds`.
        parameters: `parameters.bonds`.
        properties: `parameters.bodies`.
        state: of the particles.
    """
    motion, bonds = Motion.of(state), required(state.bonds, "bonds of the particles")
    geometry = bond_geometry(bonding, parameters, properties, motion, bonds)
    normal, shear, bending, twisting = geometry.stiffness
    loads = BondLoads(
        normal * geometry.stretch,
        shear * vectors.length(geometry.slide),
        bending * vectors.length(geometry.bending),
        twisting * jnp.abs(geometry.twist),
        *geometry.stresses(),
        geometry.energy(),
    )
    return BondLoads(*(jnp.where(bonds.intact, load, 0.0) for load in loads))


def add_bonds(step: ContactStep, bonding: Bonding, sums: Sums, motion: Motion) -> tuple[Sums, Motion]:
    """Adds the bonds between particles; returns the motion with those that hold."""
    parameters = required(step.surroundings.bonds, "parameters.bonds")
    found, bonds = _bonds_of_step(bonding, parameters, step.properties, motion, step.mid_velocity)
    force, torque = _on_grains(found, len(motion.position))
    both = vectors.add(sums.force, force), vectors.add(sums.torque, torque)
    sums = sums._replace(force=both[0], torque=both[1])
    if step.model.energy:
        sums = sums._replace(bonded=found)
    return sums, motion._replace(bonds=bonds)


def bond_forces(
    bonding: Bonding,
    parameters: BondParameters,
    properties: ParticleProperties,
    motion: Motion,
    mid_velocity: Vector,
) -> tuple[Vector, Vector, BondState]:
    """Force, D arrays (N,) [N], and torque, A arrays (N,) [N m], of all bonds on every grain, and the bonds after those
    broke whose strength was reached.

    Args:
        bonding: static.
        parameters, properties: numbers.
        motion: of the grains at this moment.
        mid_velocity: D arrays (N,), that the dashpots act on [m/s].
    """
    found, bonds = _bonds_of_step(bonding, parameters, properties, motion, mid_velocity)
    return *_on_grains(found, len(motion.position)), bonds


def _bonds_of_step(
    bonding: Bonding,
    parameters: BondParameters,
    properties: ParticleProperties,
    motion: Motion,
    mid_velocity: Vector,
) -> tuple[FoundBonds, BondState]:
    """What all bonds do, and the bonds after those broke whose strength was reached; see `bond_forces`."""
    before = required(motion.bonds, "bonds of the particles")
    geometry = bond_geometry(bonding, parameters, properties, motion, before)
    tension, shear = geometry.stresses()
    broken = jnp.where(shear >= geometry.numbers.shear_strength, SHEAR, INTACT)
    broken = jnp.where(tension >= geometry.numbers.tensile_strength, TENSION, broken)
    bonds = before._replace(status=jnp.where(before.intact, broken.astype(before.status.dtype), before.status))
    dashpots = None
    if geometry.numbers.damping is not None:
        dashpots = _damping(geometry, properties, motion, mid_velocity, bonds.pairs)
    breaks = before.intact & ~bonds.intact
    loads = geometry.energy(), geometry.elastic(), dashpots
    found = FoundBonds(bonds.pairs, bonds.intact, breaks, *loads, bonds.counted)
    return found, bonds


def _on_grains(found: FoundBonds, dimension: int) -> tuple[Vector, Vector]:
    """Force and torque of the bonds that hold on every grain."""
    loads = found.elastic
    if found.dashpots is not None:
        one, first, second = (vectors.add(*both) for both in zip(loads, found.dashpots, strict=True))
        loads = one, first, second
    force, on_first, on_second = (vectors.where(found.holds, load, 0.0) for load in loads)
    back = vectors.scale(-1.0, force)
    torques = zip(on_first, on_second, strict=True)
    total = tuple(sum_over_pairs(a, b, found.pairs) for a, b in zip(force[:dimension], back[:dimension], strict=True))
    turning = tuple(sum_over_pairs(a, b, found.pairs) for a, b in torques)
    return total, turning if dimension == 3 else turning[2:]


def _damping(
    geometry: BondGeometry, properties: ParticleProperties, motion: Motion, mid_velocity: Vector, pairs: Pairs
) -> tuple[Vector, Vector, Vector]:
    """What the dashpots give, 2 z sqrt(m* k) on each of the four springs, with the arms on the line of centres."""
    ratio = required(geometry.numbers.damping, "damping of the bonds")
    masses, inertias = (
        tuple(of_grains(quantity, index) for index in (pairs.first, pairs.second))
        for quantity in (properties.mass, properties.inertia)
    )
    mass, inertia = harmonic(*masses), harmonic(*inertias)
    normal, shear, bending, twisting = geometry.stiffness
    dashpots = [2.0 * ratio * jnp.sqrt(mass * k) for k in (normal, shear)]
    dashpots += [2.0 * ratio * jnp.sqrt(inertia) * jnp.sqrt(k) for k in (bending, twisting)]
    one, other = (spin_in_space(at(motion.angular_velocity, index)) for index in (pairs.first, pairs.second))
    length = geometry.arms[0] + geometry.arms[1]
    to_first, to_second = (vectors.scale(arm / length, geometry.separation) for arm in geometry.arms)
    apart = in_space(vectors.subtract(at(mid_velocity, pairs.first), at(mid_velocity, pairs.second)))
    carried = vectors.add(vectors.cross(one, to_first), vectors.cross(other, to_second))
    rate, turn = vectors.subtract(apart, carried), vectors.subtract(one, other)
    along, about = vectors.dot(rate, geometry.normal), vectors.dot(turn, geometry.normal)
    force = vectors.scale(-dashpots[1], vectors.add_scaled(rate, -along, geometry.normal))
    force = vectors.add_scaled(force, -dashpots[0] * along, geometry.normal)
    moment = vectors.scale(-dashpots[2], vectors.add_scaled(turn, -about, geometry.normal))
    moment = vectors.add_scaled(moment, -dashpots[3] * about, geometry.normal)
    on_first = vectors.subtract(moment, vectors.cross(to_first, force))
    on_second = vectors.scale(-1.0, vectors.add(moment, vectors.cross(to_second, force)))
    return force, on_first, on_second
