"""What the liquid in the gap between two bodies does to them."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics import vectors
from jaxdem.numerics.vectors import Vector
from jaxdem.particles import tangent
from jaxdem.particles.contact import ContactMaterial
from jaxdem.particles.contact_pair import ContactPair
from jaxdem.particles.contact_step import ContactStep
from jaxdem.particles.lubrication import ROLLING_SHARE


class FilmLoad(NamedTuple):
    """What a film does to the one of two bodies.

    Attributes:
        along: force along the normal, positive away from the other [N].
        across: force in the contact plane; empty without shear [N].
        resistance: torque against rolling, the opposite of that on the other; empty without shear [N m].
    """

    along: Array
    across: Vector = ()
    resistance: Vector = ()


def film_load(step: ContactStep, material: ContactMaterial, pair: ContactPair) -> FilmLoad:
    """What the films of all contacts do, see `Lubrication`.

    With the arms A and B from the centres to the middle of the gap, which make the distance of the centres, the normal
    n, the spins w1 and w2 and the relative velocity v in the plane

        s = v - (A w1 + B w2) x n,   d = (A w1 - B w2) x n - (A - B)/(A + B) v = lever (w1 - w2) x n - skew s

    with lever = 2 A B/(A + B) and skew = (A - B)/(A + B). What takes the power k_s s^2 + k_d d^2 is the force
    -k_s s + skew k_d d in the middle of the gap, and the torque -lever n x k_d d against rolling. At a wall, a plane
    that may turn, skew is -1 and the lever 2 A.
    """
    film, constants = required(step.model.lubrication, "lubrication"), required(material.lubrication, "lubrication")
    normal, radius = pair.normal, pair.effective_radius
    approach_speed = -vectors.dot(pair.approach, normal)
    along = film.damping(pair.overlap, approach_speed, radius, step.time_step, constants) * approach_speed
    if not film.shear:
        return FilmLoad(along)
    arm, smaller = pair.radius - 0.5 * pair.overlap, pair.radius
    turning, relative_spin = vectors.scale(arm, pair.spin), pair.spin
    skew, lever = jnp.full_like(arm, -1.0), 2.0 * arm
    if pair.other_spin is None:
        if pair.wall_spin is not None:
            relative_spin = vectors.subtract(relative_spin, pair.wall_spin)
    else:
        other = pair.other_radius - 0.5 * pair.overlap
        turning = vectors.add(turning, vectors.scale(other, pair.other_spin))
        relative_spin = vectors.subtract(relative_spin, pair.other_spin)
        skew, lever = (arm - other) / (arm + other), 2.0 * arm * other / (arm + other)
        smaller = jnp.minimum(smaller, pair.other_radius)
    slip = vectors.subtract(tangent.part_in_plane(pair.approach, normal), tangent.surface_velocity(turning, normal))
    rolling = vectors.scale(lever, tangent.surface_velocity(relative_spin, normal))
    rolling = vectors.add_scaled(rolling, -skew, slip)
    sliding = film.sliding(pair.overlap, approach_speed, radius, smaller, step.time_step, constants)
    rolled = vectors.scale(ROLLING_SHARE * sliding, rolling)
    across = vectors.add_scaled(vectors.scale(skew, rolled), -sliding, slip)
    return FilmLoad(along, across, vectors.scale(-lever, tangent.moment(normal, rolled)))
