"""The contacts of a state as a table, a row each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.numerics import vectors
from jaxdem.numerics.axes import AXES
from jaxdem.numerics.vectors import Vector
from jaxdem.observables.contacts import contacts_of, particles_seen
from jaxdem.particles.contact_sums import Touching
from jaxdem.particles.integrate import centres_in_box
from jaxdem.particles.neighbors import Neighbors
from jaxdem.state import Parameters, State
from jaxdem.structure import Structure


class ContactTable(NamedTuple):
    """Contacts of pairs, then of walls with particles.

    Attributes:
        first: (R,) number of the particle that the force acts on.
        second: (R,) number of the other; -1 where it is a wall.
        wall: (R,) number of the wall, the sides of the box first; -1 between particles.
        position: (R, D) of the contact, inside the box [m].
        overlap: (R,) positive where they touch [m].
        normal: (R, D) unit vector towards the first particle.
        force: (R, D) on the first particle [N].
        normal_force: (R,) its part along the normal, positive where it repels [N].
        tangential_force: (R,) length of the rest [N].
        mobilised: (R,) tangential force over Coulomb's limit, friction times normal force (and adhesion): 1 where the
            contact slides, a little less while it is being pressed together; 0 without friction [-].
    """

    first: Array
    second: Array
    wall: Array
    position: Array
    overlap: Array
    normal: Array
    force: Array
    normal_force: Array
    tangential_force: Array
    mobilised: Array


def contact_rows(structure: Structure, parameters: Parameters, state: State, neighbors: Neighbors) -> ContactTable:
    """All pairs of the list and all walls with all particles; those with a positive overlap touch. Pure.

    Forces are those of `contacts`: the law at the positions and velocities of the state, with springs as they are. The
    sum over the contacts of a particle is its `contact_force` of a frame where that does not change, for this is the
    mean over the last coupling interval. On several devices the rows are those of a slab, with particles by identity.

    Args:
        structure: or a `Simulation`.
        parameters: that go with it.
        state: with particles.
        neighbors: its list.
    """
    particles, bodies = particles_seen(structure, parameters, state, neighbors)
    centres = centres_in_box(particles, structure.box, structure.periodic)
    radius = jnp.broadcast_to(bodies.radius, centres.shape[:1])
    found, parts = contacts_of(structure, parameters, state, neighbors, particles, bodies), []
    if found.between is not None:
        none = jnp.full_like(found.first, -1)
        between = found.between
        if found.counted is not None:
            between = between._replace(overlap=jnp.where(found.counted, between.overlap, -1.0))
        parts.append(_rows(between, (found.first, found.second, none), centres, radius))
    if found.walls is not None:
        shape = found.walls.overlap.shape
        own, wall = (
            jnp.broadcast_to(jnp.arange(shape[1]), shape),
            jnp.broadcast_to(jnp.arange(shape[0])[:, None], shape),
        )
        parts.append(_rows(found.walls, (own, jnp.full_like(own, -1), wall), centres, radius))
    if not parts:
        dimension, blank = centres.shape[1], jnp.zeros(0, centres.dtype)
        index, vector = jnp.zeros(0, jnp.int32), jnp.zeros((0, dimension), centres.dtype)
        return ContactTable(index, index, index, vector, blank, vector, vector, blank, blank, blank)
    table: ContactTable = jax.tree.map(lambda *columns: jnp.concatenate(columns), *parts)
    if particles.identity is not None:
        first, second = (jnp.where(row < 0, row, particles.identity[row]) for row in (table.first, table.second))
        table = table._replace(first=first, second=second)
    size, wraps = jnp.asarray(structure.box, centres.dtype)[None], jnp.asarray(structure.periodic)[None]
    inside = jnp.where(wraps, table.position % size, table.position)
    return table._replace(position=inside)


def _rows(touching: Touching, bodies: tuple[Array, Array, Array], centres: Array, radius: Array) -> ContactTable:
    first, second, wall = (number.reshape(-1) for number in bodies)
    shape = touching.overlap.shape

    def flat(vector: Vector) -> Vector:
        return tuple(jnp.broadcast_to(x, shape).reshape(-1) for x in vector)

    overlap, normal, force = touching.overlap.reshape(-1), flat(touching.normal), flat(touching.force)
    along = vectors.dot(force, normal)
    across = vectors.length(vectors.add_scaled(force, -along, normal))
    pressing = along if touching.adhesion is None else along + flat((touching.adhesion,))[0]
    limit = flat((touching.friction,))[0] * jnp.maximum(pressing, 0.0)
    slides = limit > 0.0
    mobilised = jnp.where(slides, across / jnp.where(slides, limit, 1.0), 0.0)
    normals = vectors.stack(normal)
    position = centres[first] - (radius[first] - 0.5 * overlap)[:, None] * normals
    return ContactTable(
        first, second, wall, position, overlap, normals, vectors.stack(force), along, across, mobilised
    )  # fmt: skip


def contact_table(
    structure: Structure, parameters: Parameters, state: State, neighbors: Neighbors
) -> dict[str, np.ndarray]:
    """What touches in a state, as columns of a table: `pandas.DataFrame(contact_table(...))`. Not for `jit`.

    Columns are those of `ContactTable`, a vector one for each axis; rows are sorted by `first`, `second` and `wall`.
    Arguments are those of `contact_rows`.
    """
    found = jax.device_get(jax.jit(contact_rows, static_argnums=0)(structure, parameters, state, neighbors))
    columns = {name: np.asarray(column) for name, column in columns_of(found, AXES[len(structure.box)]).items()}
    rows = touching_in_order(columns)
    return {name: column[rows] for name, column in columns.items()}


def touching_in_order(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Numbers of the rows that touch, sorted by `first`, `second` and `wall`: the order of a list depends on its
    room."""
    touching = np.flatnonzero(columns["overlap"] > 0)
    return np.asarray(touching[np.lexsort([columns[name][touching] for name in ("wall", "second", "first")])])


def columns_of(table: ContactTable, axes: str) -> dict[str, Array]:
    """The columns (R,) of a table by name, a vector one for each axis."""
    columns: dict[str, Array] = {}
    for name, array in table._asdict().items():
        if array.ndim == 1:
            columns[name] = array
        else:
            columns |= {f"{name}_{axis}": array[:, k] for k, axis in enumerate(axes)}
    return columns
