"""From a distributed state to one on one device. Host, numpy."""

from __future__ import annotations

from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from jaxdem.devices.bonds import bonds_of_slabs
from jaxdem.devices.contacts import Contacts, contacts_of_slabs
from jaxdem.devices.mesh import on_host
from jaxdem.devices.particle_fields import of_each
from jaxdem.devices.scalars import scalars_of_slabs
from jaxdem.devices.simulation import DividedSimulation
from jaxdem.errors import required
from jaxdem.fluid.slabs import fluid_of_slabs
from jaxdem.particles.integrate import ParticleState
from jaxdem.particles.mesh_contact import MeshMemory
from jaxdem.particles.mesh_list import of_grain
from jaxdem.particles.neighbors import Neighbors
from jaxdem.state import Parameters, State

Tree = TypeVar("Tree")


def gathered(simulation: DividedSimulation, state: State, neighbors: Neighbors | None) -> tuple[State, Contacts | None]:
    """A distributed state as one of arrays on the host, row i of particle i; every process must call it.

    Args:
        simulation: from `jaxdem.build(scene, devices=...)`.
        state, neighbors: distributed.

    Returns:
        the state, without contact springs; rows of particles that are not present are zero. And what the contacts keep.
    """
    contacts = None
    if state.particles is not None and neighbors is not None:
        rows: ParticleState = on_host(state.particles)
        contacts = contacts_of_slabs(rows, on_host(neighbors.without_surfaces()), simulation.count)
        state = state._replace(particles=rows)
    return gathered_state(simulation, state), contacts


def gathered_state(simulation: DividedSimulation, state: State) -> State:
    """As `gathered`, without what contacts keep: for outputs."""
    fluid, particles, scalars, identity = None, None, None, None
    if state.fluid is not None:
        fluid = fluid_of_slabs(simulation.slabs, on_host(state.fluid))
    if state.particles is not None:
        rows = on_host(state.particles._replace(contact_spring=(), mesh_memory=()))
        particles, identity = _by_identity(simulation, rows), rows.identity
    if state.scalars is not None:
        scalars = scalars_of_slabs(simulation.slabs, state.scalars, identity, simulation.count)
    return State(particles, fluid, on_host(state.step), scalars)


def gathered_rows(simulation: DividedSimulation, tree: Tree, identity: Any) -> Tree:
    """Arrays (B, R, ...) of the rows of all slabs as arrays (N, ...) on the host, by identity (B, R).

    Of other arrays, which are the same in all slabs, those of the first one.
    """
    number = on_host(identity)
    there = number >= 0

    def of(values: Any) -> np.ndarray:
        rows = on_host(values)
        if rows.shape[:2] != number.shape:
            return rows[0]
        whole = np.zeros((simulation.count, *rows.shape[2:]), rows.dtype)
        whole[number[there]] = rows[there]
        return whole

    return jax.tree.map(of, tree)


def _by_identity(simulation: DividedSimulation, rows: ParticleState) -> ParticleState:
    """(N, ...) of (B, R, ...)."""
    identity = required(rows.identity, "identity of the particles")
    there = np.asarray(required(rows.active, "active of the particles") & (identity >= 0))
    number = np.asarray(identity)[there]

    active: Any = np.zeros(simulation.count, bool)
    active[number] = True
    by_identity = of_each(rows, lambda values, axis, _: rows_by_identity(values, there, number, simulation.count, axis))
    if rows.coming is not None:  # of clumps that are not there how they were to come in
        for name, all_ in zip(("orientation", "orientation_low"), rows.coming, strict=True):
            if all_ is not None:
                by_identity[name] = np.where(active[:, None], by_identity[name], all_[0])
    return ParticleState(
        **by_identity,
        contact_spring=(),
        active=None if simulation.population is None else active,
        inserted=None if rows.inserted is None else rows.inserted[0],
        pistons=jax.tree.map(lambda x: x[0], rows.pistons),
        mesh_wear=jax.tree.map(lambda x: x[0], rows.mesh_wear),
        bonds=None if rows.bonds is None else bonds_of_slabs(rows.bonds, np.asarray(identity), there, simulation.count),
    )


def rows_by_identity(values: Any, there: Any, number: np.ndarray, count: int, axis: int) -> np.ndarray:
    """Values of all slabs as those of N particles, zero for those that are not there.

    Args:
        values: (B, ...) with an axis of length R.
        there: (B, R) bool, rows with a particle.
        number: identities of these.
        count: N.
        axis: that of the R rows, of the values of a slab.
    """
    chosen = np.moveaxis(values, axis + 1 if axis >= 0 else axis, 1)[there]
    whole = np.zeros((count, *chosen.shape[1:]), chosen.dtype)
    whole[number] = chosen
    return np.moveaxis(whole, 0, axis)


def on_one_device(
    simulation: DividedSimulation, parameters: Parameters, state: State, contacts: Contacts | None
) -> tuple[State, Neighbors | None]:
    """State and list for `simulation.undivided()`, from what `gathered` gives; not jittable."""
    fluid, step, scalars = jax.tree.map(jnp.asarray, (state.fluid, state.step, state.scalars))
    if contacts is None:
        return State(None, fluid, step, scalars), None
    particles = jax.tree.map(jnp.asarray, required(state.particles, "state.particles"))
    placed = simulation.meshes_placed(parameters, particles, step)
    neighbors = simulation.undivided().allocate(parameters, particles, placed=placed)
    first, second = np.asarray(neighbors.pairs.first), np.asarray(neighbors.pairs.second)
    count = max(len(neighbors.reference[0]), 1)
    # A pair is one number; the empty ones come after all others.
    pair = np.where(first == second, count * count, first.astype(np.int64) * count + second)
    order = np.argsort(pair)
    low, high = np.minimum(contacts.first, contacts.second), np.maximum(contacts.first, contacts.second)
    place = order[np.searchsorted(pair[order], low.astype(np.int64) * count + high)]
    springs = np.zeros((len(contacts.values), len(pair)), particles.position.dtype)
    springs[:, place] = contacts.values
    kept = zip(jax.tree.map(jnp.asarray, contacts.meshes), neighbors.meshes, strict=True)
    memory = tuple(MeshMemory(*(of_grain(part, listed) for part in one)) for one, listed in kept)
    particles = particles._replace(contact_spring=tuple(jnp.asarray(x) for x in springs), mesh_memory=memory)
    return State(particles, fluid, step, scalars), neighbors
