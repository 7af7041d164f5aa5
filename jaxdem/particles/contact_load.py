"""What the contact law does to two bodies: elastic force, dashpot, friction, rolling resistance and cohesion.

The parts of a step for which bodies touch are here too: a contact begins and ends within a step.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics import vectors
from jaxdem.numerics.quotients import quotient
from jaxdem.numerics.stages import stage
from jaxdem.numerics.vectors import Vector
from jaxdem.particles import tangent
from jaxdem.particles.cohesion import TOUCHING, Attraction, BegunByTouch, Gap
from jaxdem.particles.contact import Contact, ContactForce, ContactMaterial, StoringLaw
from jaxdem.particles.contact_pair import ContactLoad, ContactPair, LoadParts, sum_slots
from jaxdem.particles.contact_step import ContactStep
from jaxdem.particles.film_load import FilmLoad, film_load
from jaxdem.particles.lubrication import wet_friction
from jaxdem.particles.rolling import Rotation


def contact_load(step: ContactStep, material: ContactMaterial, pair: ContactPair, spring: Vector) -> ContactLoad:
    """What all contacts do; zero, and nothing computed, where nothing touches."""
    # Within the step an overlap changes by less than this: also a contact that is about to begin has a dashpot.
    change = 0.5 * step.time_step * vectors.length(pair.approach)
    near, cohesion = pair.overlap, step.model.cohesion
    begun: Array | bool = False
    if isinstance(cohesion, BegunByTouch):
        begun = cohesion.begun(spring[len(spring) - cohesion.memory :])
    elif cohesion is not None:
        near = near + cohesion.reach(gap_of(pair, material), required(material.cohesion, "cohesion"))
    if step.model.lubrication is not None:
        near = near + required(material.lubrication, "lubrication").cutoff
    return stage(jnp.any((near + change > 0) | begun), lambda: _law(step, material, pair, spring))


def _law(step: ContactStep, material: ContactMaterial, pair: ContactPair, spring: Vector) -> ContactLoad:
    """The contact law and rolling resistance."""
    approach_speed = -vectors.dot(pair.approach, pair.normal)
    kept = len(spring) - step.model.memory
    memory, spring = spring[kept:], spring[:kept]
    attraction = attraction_of(step, material, pair, memory)
    meeting = _meeting(step, pair, spring, approach_speed, attraction)
    contact, touching, share = meeting.contact, meeting.touching, meeting.share
    if step.model.wet_friction:
        material = _wetted(step, contact, material)
    result = step.model.law(contact, material)
    # A contact that begins or ends within the step, but not in its middle, has its dashpot only.
    along = jnp.where(touching, result.normal, result.normal - result.elastic)
    adhesion = None
    if attraction is not None:
        along, adhesion = _pulled(step, result, attraction, share, approach_speed)
    across = vectors.where(share > 0, result.tangential, 0.0)
    resistance: Vector = ()
    rolled: Vector = ()
    if step.model.rolling is not None:
        rolling_spring = spring[vectors.angular_size(len(pair.normal)) :]
        rotation = Rotation(pair.normal, meeting.relative_spin, rolling_spring)
        resistance, rolled = step.model.rolling(contact, result, material, rotation, step.time_step)
        resistance = vectors.where(touching, resistance, 0.0)
    springs = vectors.where(touching, (*result.spring, *rolled), 0.0)
    if attraction is not None:
        springs = (*springs, *attraction.kept)
    load, parts = ContactLoad(along, across, resistance, springs, adhesion), None
    film = None if step.model.lubrication is None else film_load(step, material, pair)
    if step.model.energy and not (attraction is None and film is None):
        parts = _parts(step, contact, result, material, load, pair, attraction, film)
    return (load if film is None else _with_film(load, film))._replace(parts=parts)


def _with_film(load: ContactLoad, film: FilmLoad) -> ContactLoad:
    """What a contact and the liquid in its gap do."""
    load = load._replace(along=load.along + film.along)
    if not film.across:
        return load
    resistance = vectors.add(load.resistance, film.resistance) if load.resistance else film.resistance
    return load._replace(across=vectors.add(load.across, film.across), resistance=resistance)


class _Meeting(NamedTuple):
    """How two bodies meet.

    Attributes:
        contact: what the law is given.
        touching: bool, whether they touch in the middle of the step.
        share: part of the step for which they touch [-].
        relative_spin: of the one body against the other [rad/s].
    """

    contact: Contact
    touching: Array
    share: Array
    relative_spin: Vector


def _meeting(
    step: ContactStep, pair: ContactPair, spring: Vector, approach_speed: Array, attraction: Attraction | None
) -> _Meeting:
    """Overlap, slip and springs as the law is given them; the sliding spring has grown by the slip of the step."""
    overlap, normal = pair.overlap, pair.normal
    depth = overlap if attraction is None else attraction.depth
    share = _share_of_step(depth, 0.5 * step.time_step * jnp.abs(approach_speed))
    touching = depth > 0
    # The laws take square roots: elsewhere they see an overlap at which these and their slopes are finite,
    # the same from either side, for a dashpot may act already.
    overlap = jnp.where(touching, overlap, TOUCHING * pair.effective_radius)
    spin, relative_spin = vectors.scale(pair.radius - 0.5 * overlap, pair.spin), pair.spin
    sharing: Array | float = 1.0
    if pair.other_spin is None:
        sharing = jnp.maximum(sum_slots(touching.astype(overlap.dtype)), 1.0)[None]
        if pair.wall_spin is not None:
            relative_spin = vectors.subtract(relative_spin, pair.wall_spin)
    else:
        other = vectors.scale(pair.other_radius - 0.5 * overlap, pair.other_spin)
        spin, relative_spin = vectors.add(spin, other), vectors.subtract(relative_spin, pair.other_spin)
    turning = tangent.surface_velocity(spin, normal)
    slip = vectors.subtract(tangent.part_in_plane(pair.velocity, normal), turning)
    expected_slip = vectors.subtract(tangent.part_in_plane(pair.approach, normal), turning)
    begun = overlap
    if attraction is not None and attraction.holds is not None:  # the whole step, whatever the overlap
        begun = jnp.where(attraction.holds, pair.effective_radius, overlap)
    growth = _time_of_growth(begun, -vectors.dot(pair.velocity, normal), step.time_step)
    turned = tangent.turned_into_plane(spring[: vectors.angular_size(len(normal))], normal)
    contact = Contact(
        overlap=overlap if attraction is None else attraction.overlap,
        approach_speed=share * approach_speed,
        slip=vectors.scale(share, expected_slip),
        spring=vectors.add_scaled(turned, growth, slip),
        effective_radius=pair.effective_radius,
        effective_mass=pair.effective_mass,
        rolling_inertia=pair.rolling_inertia,
        sharing=sharing,
        adhesion=None if attraction is None else attraction.friction,
    )
    return _Meeting(contact, touching, share, relative_spin)


def _parts(
    step: ContactStep,
    contact: Contact,
    result: ContactForce,
    material: ContactMaterial,
    load: ContactLoad,
    pair: ContactPair,
    attraction: Attraction | None,
    film: FilmLoad | None,
) -> LoadParts:
    """What of a load, without that of the film, and of the film takes energy out of the motion."""
    law, approach_speed = step.model.law, -vectors.dot(pair.approach, pair.normal)
    if not isinstance(law, StoringLaw):  # refused before
        raise TypeError("the contact law does not say what its springs store")
    liquid = jnp.zeros_like(load.along)
    if attraction is not None and attraction.damping is not None:
        liquid = liquid + attraction.damping * approach_speed
    if film is not None:
        liquid = liquid + film.along
    stiffness = law.tangential_stiffness(contact.overlap, contact.effective_radius, material)
    kept = load.spring[: len(load.across)]
    dashpot = jnp.broadcast_to(result.normal - result.elastic, load.along.shape)
    sheared = None if film is None or not film.across else (film.across, film.resistance)
    return LoadParts(dashpot, liquid, vectors.add_scaled(load.across, stiffness, kept), sheared)


def _wetted(step: ContactStep, contact: Contact, material: ContactMaterial) -> ContactMaterial:
    """The constants with the friction of wet bodies; the normal force does not depend on friction."""
    normal, constants = step.model.law(contact, material).normal, required(material.lubrication, "lubrication")
    given = material.friction, normal, vectors.length(contact.slip), contact.effective_radius, constants
    return material._replace(friction=wet_friction(*given))


def attraction_of(step: ContactStep, material: ContactMaterial, pair: ContactPair, memory: Vector) -> Attraction | None:
    """What cohesion makes of all contacts; None without."""
    cohesion = step.model.cohesion
    if cohesion is None:
        return None
    return cohesion(gap_of(pair, material), required(material.cohesion, "cohesion"), memory)


def _pulled(
    step: ContactStep, result: ContactForce, attraction: Attraction, share: Array, approach_speed: Array
) -> tuple[Array, Array]:
    """Force along the normal with the pull; and what Coulomb's limit counts beside it.

    A pull that begins or ends at once within the step counts for its part of the step, which makes the force a
    continuous function of the position.
    """
    dashpot = result.normal - result.elastic
    if required(step.model.cohesion, "cohesion").sudden:
        along = dashpot + share * (result.elastic - attraction.pull)
    else:
        along = dashpot + jnp.where(attraction.touching, result.elastic, 0.0) - attraction.pull
    if attraction.damping is not None:
        along = along + attraction.damping * approach_speed
    beside = attraction.pull
    return along, beside if attraction.friction is None else beside + attraction.friction


def gap_of(pair: ContactPair, material: ContactMaterial) -> Gap:
    """What cohesion is given of all contacts."""
    other = None if pair.other_spin is None else pair.other_radius
    return Gap(pair.overlap, pair.radius, other, pair.effective_radius, material.effective_young_modulus)


def _share_of_step(overlap: Array, reach: Array) -> Array:
    """Part of the step for which a pair touches [-].

    `overlap` is that in the middle of the step, `reach` how far it changes in half a step. Without this the
    impulse of a dashpot that starts at full strength, as that of the linear law, depends on where in a step
    the contact begins: 0.3 % of the rebound speed at a hundred steps per contact. It also makes the force a
    continuous function of the position.
    """
    changes = jnp.abs(overlap) < reach
    within = 0.5 + quotient(0.5 * overlap, jnp.where(changes, reach, 1.0))
    return jnp.where(changes, within, (overlap > 0).astype(overlap.dtype))


def _time_of_growth(overlap: Array, closing_speed: Array, time_step: Array) -> Array:
    """Time for which a spring has grown since the step before: a step, or less where the bodies did not touch then [s].

    From the middle of the step before to that of this one all velocities are those at this step's start. A spring that
    takes the whole step's slip when the contact begins gives an elastic impact up to 7 % more energy than it had, at
    twenty steps per contact.

    Source: MFIX has the same, `calc_tangential_displacement` in its `calc_force_dem.f`.
    """
    begins = overlap < time_step * closing_speed
    return jnp.where(begins, quotient(overlap, jnp.where(begins, closing_speed, 1.0)), time_step)
