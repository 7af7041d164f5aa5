"""Branches of contacts, along which their moments lie: the stress by Love and Weber."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics import vectors
from jaxdem.numerics.vectors import Vector
from jaxdem.observables.contacts import Contacts
from jaxdem.particles.pairs import at
from jaxdem.structure import Structure


class Line(NamedTuple):
    """Branches of P contacts.

    Attributes:
        start: D arrays (P,), one end of each, in the domain [m].
        branch: D arrays (P,), from there to the other end [m].
        moment: (D D, P), force on the particle times branch [J].
        touches: () bool, whether any has a force; the others have no moment.
    """

    start: Vector
    branch: Vector
    moment: Array
    touches: Array


def contact_lines(
    structure: Structure, found: Contacts, cut: tuple[int, ...], centres: Array, radius: Array
) -> list[Line]:
    """The branches of all contacts.

    Those to sides of the box that no axis of a cut meets lie with the centre in one box, whatever their length: for all
    these sides the moments of a particle are one sum.

    Args:
        structure: or a `Simulation`.
        found: of a state.
        cut: axes along which boxes are cut.
        centres: (N, D) in the domain [m].
        radius: () or (N,) [m].
    """
    lines = []
    centre, radii = vectors.components(centres), jnp.broadcast_to(radius, centres.shape[:1])
    if found.between is not None:
        touching, second = found.between, found.second
        branch = vectors.scale(radii[found.first] + radii[second] - touching.overlap, touching.normal)
        start, touches = at(centre, second), jnp.any(_acts(touching.force))
        moment = _moment(touching.force, branch)
        if found.counted is not None:
            moment = jnp.where(found.counted, moment, 0.0)
        lines.append(Line(start, branch, moment, touches))
    if found.walls is not None:
        walls, sides = found.walls, required(structure.contact, "particles").model.sides
        branches, touches = (
            vectors.scale(radii[None] - walls.overlap, walls.normal),
            jnp.any(_acts(walls.force), axis=1),
        )
        level = np.array([k < len(sides) and sides[k].axis not in cut for k in range(len(touches))])
        moments = _moment(walls.force, branches)
        if level.any():
            still = (jnp.zeros_like(centre[0]),) * len(centre)
            lines.append(Line(centre, still, jnp.sum(moments[:, level], axis=1), jnp.any(touches[level])))
        for k in np.flatnonzero(~level):
            branch = tuple(x[k] for x in branches)
            lines.append(Line(vectors.subtract(centre, branch), branch, moments[:, k], touches[k]))
    return lines


def _acts(force: Vector) -> Array:
    """Which contacts have a force; bridges of liquid and other attractions also act over a gap."""
    return jnp.any(jnp.stack(force) != 0.0, axis=0)


def _moment(force: Vector, branch: Vector) -> Array:
    """(D D, ...) f l."""
    return jnp.stack([f * x for f in force for x in branch])
