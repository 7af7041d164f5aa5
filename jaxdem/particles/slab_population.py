"""Particles that leave a slab through a side of the box and come into it through inlets.

In slabs only particles that are present have rows: one that leaves gives its row free, and one that comes takes a free
one in the slab that holds its place. All slabs draw the same places and agree on which are free, so that the same
particles come at the same places as on one device.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxdem.errors import required
from jaxdem.numerics.batches import cond_in_batch
from jaxdem.particles.contact_interval import ContactInterval
from jaxdem.particles.ghosts import Division
from jaxdem.particles.integrate import ParticleState, centres_in_box
from jaxdem.particles.neighbors import Neighbors
from jaxdem.particles.population import Entry, Insertion, Population, due_after, without_those_outside
from jaxdem.particles.slab_bonds import with_new_grains, without_those_gone


class _Rows(NamedTuple):
    """Own particles of a slab while others come in.

    Attributes:
        position: (R, D) in the box [m].
        active: (R,) bool.
        identity: (R,) int32.
        come: () int32, how many of the inlet have come.
        lacking: () int32, how many had no row.
    """

    position: Array
    active: Array
    identity: Array
    come: Array
    lacking: Array


def renewed_in_slab(
    population: Population,
    contact: ContactInterval,
    entry: Entry,
    particles: ParticleState,
    neighbors: Neighbors,
    step: Array,
) -> tuple[ParticleState, Neighbors]:
    """Particles of a slab after those who leave and those who come, within `shard_map`; the list is still the old one.

    Args:
        population: static description.
        contact: with the division of the box.
        entry, particles, neighbors, step: see `renewed`.
    """
    division, ghosts = required(contact.division, "division"), required(neighbors.ghosts, "ghosts of a list")
    particles = without_those_outside(population, particles)
    stays, bonds = required(particles.active, "active"), particles.bonds
    if bonds is not None:
        particles = particles._replace(bonds=without_those_gone(ghosts, bonds, stays))
    number = jnp.where(stays, required(particles.identity, "identity"), -1)
    particles, lacking = particles._replace(identity=number), jnp.zeros((), jnp.int32)
    for inlet in range(len(population.inlets)):
        insertion = Insertion(population, inlet, contact.model.surfaces, entry)
        coming = _Coming(insertion, division, ghosts.planes)
        particles, more = coming.with_those_due(particles, step)
        lacking = lacking + more
    needed = jnp.where(lacking > 0, ghosts.rows + lacking, 0)
    ghosts = dataclasses.replace(ghosts, needed=ghosts.needed.at[0].max(needed))
    overflow = neighbors.overflow | (lacking > 0)
    return particles, dataclasses.replace(neighbors, ghosts=ghosts, overflow=overflow)


def _lying(particles: ParticleState, new: Array, identity: Array) -> ParticleState:
    """The particles with clumps in new rows (R, 1) as they come in; `identity` (R,) is of the rows from now on."""
    if particles.coming is None:
        return particles
    now, coming = (particles.orientation, particles.orientation_low), particles.coming
    number = jnp.maximum(identity, 0)
    found = jax.tree.map(lambda rows, all_: jnp.where(new, all_[number], rows), now, coming)
    return particles._replace(orientation=found[0], orientation_low=found[1])


@dataclasses.dataclass(frozen=True)
class _Coming:
    """How the particles of one inlet come into a slab.

    Attributes:
        insertion: as on one device, with the radius of all particles.
        division: of the box; static.
        planes: (B - 1,) where it is cut [m].
    """

    insertion: Insertion
    division: Division
    planes: Array

    def with_those_due(self, particles: ParticleState, step: Array) -> tuple[ParticleState, Array]:
        """Those that are due put where there is room; and how many had a place in this slab and no row."""
        insertion, population = self.insertion, self.insertion.population
        before = required(particles.active, "active of the particles")
        inserted = required(particles.inserted, "inserted of the particles")
        due, zero = due_after(insertion.inlet, step), jnp.zeros((), jnp.int32)
        start = lax.stop_gradient(centres_in_box(particles, population.box, population.periodic))
        identity = required(particles.identity, "identity of the particles")
        rows = cond_in_batch(
            due > inserted[insertion.number],
            lambda rows: self._placed(rows, due, step),
            _Rows(start, before, identity, inserted[insertion.number], zero),
        )
        new, low = (rows.active & ~before)[:, None], particles.position_low
        particles = _lying(particles, new, rows.identity)
        if particles.bonds is not None:
            particles = particles._replace(bonds=with_new_grains(particles.bonds, new[:, 0]))
        particles = particles._replace(
            position=jnp.where(new, rows.position, particles.position),
            position_low=None if low is None else jnp.where(new, 0.0, low),
            velocity=jnp.where(new, insertion.entry.velocity[insertion.number][None], particles.velocity),
            active=rows.active,
            identity=rows.identity,
            inserted=inserted.at[insertion.number].set(rows.come),
        )
        return particles, rows.lacking

    def _placed(self, rows: _Rows, due: Array, step: Array) -> _Rows:
        """The rows after up to `batch` more have come, in whichever slab."""
        insertion, blocks, radius = self.insertion, self.division.blocks, self.insertion.entry.radius
        drawn, corners = insertion.drawn(rows.position, step)

        def one(rows: _Rows, u: Array) -> tuple[_Rows, None]:
            coming = insertion.inlet.row(rows.come)
            own = radius if radius.ndim == 0 else radius[coming]
            of_rows = radius if radius.ndim == 0 else radius[jnp.maximum(rows.identity, 0)]
            here = dataclasses.replace(insertion, entry=insertion.entry._replace(radius=of_rows))
            places, free = here.tried(u, corners, own, (rows.position, rows.active))
            free = ~blocks.any(~free) & (rows.come < due)
            place, comes = places[jnp.argmax(free)], jnp.any(free)
            slab = jnp.sum((place[blocks.axis] >= self.planes).astype(jnp.int32))
            mine, row = comes & (slab == blocks.index()), jnp.argmin(rows.active)
            room = mine & ~rows.active[row]
            position = rows.position.at[row].set(jnp.where(room, place, rows.position[row]))
            active = rows.active.at[row].set(rows.active[row] | room)
            identity = rows.identity.at[row].set(jnp.where(room, coming, rows.identity[row]))
            lacking = rows.lacking + (mine & ~room).astype(jnp.int32)
            return _Rows(position, active, identity, rows.come + comes.astype(rows.come.dtype), lacking), None

        return lax.scan(one, rows, drawn)[0]
