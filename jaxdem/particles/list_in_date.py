"""The neighbour list between contact steps: whether it covers the coming one, and the list that does."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.numerics.batches import cond_in_batch
from jaxdem.particles.clump_forces import displacement_ahead, updated
from jaxdem.particles.integrate import drift
from jaxdem.particles.neighbors import Neighbors, carry_history, carry_memory, out_of_date, way_of_meshes
from jaxdem.particles.slab_steps import rebuilt
from jaxdem.particles.verlet import Carry, Verlet


def stale(verlet: Verlet, carry: Carry, neighbors: Neighbors) -> Array:
    """() bool: the list does not cover the coming step, up to its end."""
    search = verlet.interval.search
    # A list of nothing is never out of date: the loop would wait for it for ever.
    if search is None or neighbors.lists_nothing:
        return jnp.zeros((), bool)
    if carry.slab is not None:
        return carry.step >= carry.slab.due
    way = way_of_meshes(neighbors, verlet.meshes_placed(carry))
    displacement = displacement_ahead(search, carry.motion, neighbors, verlet.time_step, way)
    return out_of_date(displacement, search.geometry, way)


def with_list_in_date(verlet: Verlet, carry: Carry, neighbors: Neighbors) -> tuple[Carry, Neighbors]:
    """The list rebuilt if it is stale, and the springs moved to its slots."""
    search, division = verlet.interval.search, verlet.interval.division
    if search is None or neighbors.lists_nothing:
        return carry, neighbors

    def rebuild(both: tuple[Carry, Neighbors]) -> tuple[Carry, Neighbors]:
        carry, neighbors = both
        # Where `stale` looks: the new list is in date whatever the speed, and the loop goes on.
        motion = drift(carry.motion, verlet.time_step)
        placed, slab = verlet.meshes_placed(carry), carry.slab
        if division is not None and slab is not None:
            new, at_new, slab = rebuilt(division, search, motion, neighbors, slab, placed)
            motion = carry.motion._replace(contact_spring=at_new.contact_spring)
            if at_new.bonds is not None and motion.bonds is not None:
                turned, low = motion.bonds.orientation, motion.bonds.orientation_low
                motion = motion._replace(bonds=at_new.bonds._replace(orientation=turned, orientation_low=low))
        else:
            new = updated(search, motion, neighbors, verlet.active, placed)
            motion = carry.motion._replace(contact_spring=carry_history(carry.motion.contact_spring, neighbors, new))
        if neighbors.meshes:
            motion = motion._replace(mesh_memory=carry_memory(motion.mesh_memory, neighbors, new))
        return carry._replace(motion=motion, slab=slab), new

    return cond_in_batch(stale(verlet, carry, neighbors), rebuild, (carry, neighbors))
