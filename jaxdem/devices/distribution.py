"""From a state on one device to a distributed one; the way back is `gathering`. Host, numpy."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxdem.devices.bonds import bonds_in_slabs, require_in_reach
from jaxdem.devices.contacts import Contacts, Keepers, contacts_of_list, history_tables, keepers_of
from jaxdem.devices.gathering import gathered
from jaxdem.devices.meeting import meet
from jaxdem.devices.mesh import SAME, SLABS, on_host, on_slabs, put
from jaxdem.devices.particle_fields import KEPT, of_each
from jaxdem.devices.rooms import SlabRoom, Spheres, equal_planes, listed_spheres, needed_room, slab_of
from jaxdem.devices.scalars import scalars_in_slabs
from jaxdem.devices.simulation import DividedSimulation
from jaxdem.errors import InputError, required
from jaxdem.fluid.slabs import fluid_in_slabs
from jaxdem.particles.ghosts import Ghosts
from jaxdem.particles.integrate import Motion, ParticleState, centres_in_box
from jaxdem.particles.list_room import with_room_for_meshes
from jaxdem.particles.mesh_contact import MeshMemory
from jaxdem.particles.neighbors import Neighbors, Room
from jaxdem.particles.slab_bonds import relisted
from jaxdem.particles.slab_history import History, of_pairs
from jaxdem.particles.slab_list import Meshes, memory_of_slab, slab_list
from jaxdem.particles.slab_rows import Sizes, Standing
from jaxdem.state import Parameters, State


def distributed(
    simulation: DividedSimulation,
    parameters: Parameters,
    state: State,
    neighbors: Neighbors | Contacts | None,
    room: SlabRoom | None = None,
) -> tuple[State, Neighbors | None]:
    """A state on one device, cut into slabs, with new lists; not jittable.

    Without a fluid the slabs have equal numbers of particles, otherwise equal numbers of cells.

    Args:
        simulation: from `jaxdem.build(scene, devices=...)`.
        parameters: from the same.
        state: on one device or on the host; row i is particle i.
        neighbors: the list that its contact springs belong to; or what the contacts keep, by identity.
        room: at least so much.
    """
    mesh, fluid, particles, lists = required(simulation.mesh, "mesh"), None, None, None
    if state.fluid is not None and simulation.fluid is not None:
        fluid = put(mesh, fluid_in_slabs(simulation.slabs, on_host(state.fluid)))
    if state.particles is not None and neighbors is not None:
        rows = on_host(state.particles)
        if not isinstance(neighbors, Contacts):
            neighbors = contacts_of_list(rows.contact_spring, on_host(neighbors), rows.mesh_memory)
        placed = simulation.meshes_placed(parameters, _on_one(rows), jnp.asarray(on_host(state.step)))
        meshes = Meshes(parameters.meshes, placed)
        particles, lists = _particles(simulation, parameters, rows, neighbors, room, meshes)
    scalars = None
    if state.scalars is not None:
        inlets = simulation.population is not None and bool(simulation.population.inlets)
        identity = None if particles is None else particles.identity
        scalars = put(mesh, scalars_in_slabs(simulation.slabs, state.scalars, identity, inlets))
    return State(particles, fluid, put(mesh, on_host(state.step), SAME), scalars), lists


def _particles(
    simulation: DividedSimulation,
    parameters: Parameters,
    particles: ParticleState,
    contacts: Contacts,
    room: SlabRoom | None,
    meshes: Meshes,
) -> tuple[ParticleState, Neighbors]:
    division, search, number = simulation.division, simulation.search, simulation.slabs.number
    present, dtype = _present(particles), particles.position.dtype
    inside = np.asarray(centres_in_box(_on_one(particles), simulation.box, simulation.periodic), float)[present]
    along = inside[:, division.blocks.axis]
    planes = division.length * np.arange(1, number) / number
    if division.balanced:
        planes = equal_planes(division, search, along)
    slab = np.zeros(len(particles.position), int)
    slab[present] = slab_of(planes.astype(dtype), along)
    spheres = listed_spheres(simulation, parameters, particles)
    listed = _listed_room(simulation, parameters, spheres, np.where(_is_present(particles), slab, -1))
    coming = simulation.count - len(present) if particles.inserted is not None else 0
    wider = needed_room(division, spheres, inside, planes, listed, coming)
    kept = keepers_of(contacts, None if search.levels is None else spheres.on_host()[2])
    room = _for_contacts(wider if room is None else _covering(room, wider), kept)
    row, table = np.zeros_like(slab), np.full((number, room.rows), -1, np.int32)
    for k in range(number):
        own = present[slab[present] == k]
        table[k, : len(own)], row[own] = own, np.arange(len(own))
    shape = number, room.listed.slots, room.rows
    history = History(*history_tables(contacts, kept, slab, row, shape, search.members))
    mesh, memory = required(simulation.mesh, "mesh"), _memory_of_rows(contacts, table, len(particles.position))
    rows_of_all = _rows(particles, table)
    if particles.bonds is not None:
        require_in_reach(search, required(parameters.bodies, "parameters.bodies"), particles.bonds)
        changes = simulation.population is not None
        rows_of_all = rows_of_all._replace(bonds=bonds_in_slabs(particles.bonds, table, changes))
    given = (rows_of_all, _no_ghosts(planes.astype(dtype), table, room, search.members), history, memory)
    rows, ghosts, history, memory = put(mesh, given)
    listing: Any = _first_list(simulation, room.listed)
    placed = (*put(mesh, (parameters.bodies, meshes), SAME), rows, ghosts, history, memory)
    if jax.process_count() > 1:  # what was done on the host, and compiling, takes them unequal times
        listing = listing.lower(*placed).compile()
        meet()
    springs, memory, bonds, new = listing(*placed)
    return rows._replace(contact_spring=springs, mesh_memory=memory, bonds=bonds), new


def _memory_of_rows(contacts: Contacts, table: np.ndarray, count: int) -> tuple[MeshMemory, ...]:
    """What contacts with meshes keep, arrays (B, C m, R) of the rows of all slabs, of `count` particles in all."""

    def of_rows(values: Any) -> np.ndarray:
        values = values.reshape(-1, count)
        chosen = np.where(table[None] >= 0, values[:, np.maximum(table, 0)], 0.0)
        return np.moveaxis(chosen, 1, 0).astype(values.dtype)

    found: tuple[MeshMemory, ...] = jax.tree.map(of_rows, contacts.meshes)
    return found


def _on_one(particles: ParticleState) -> ParticleState:
    return particles._replace(position=jnp.asarray(particles.position)) if particles.position.size else particles


def _present(particles: ParticleState) -> np.ndarray:
    """Identities of the particles that are there."""
    return np.flatnonzero(_is_present(particles))


def _is_present(particles: ParticleState) -> np.ndarray:
    return np.ones(len(particles.position), bool) if particles.active is None else np.asarray(particles.active)


def _listed_room(simulation: DividedSimulation, parameters: Parameters, spheres: Spheres, slab: np.ndarray) -> Room:
    """Room for the list of the whole box, but of meshes for that of any slab; `slab` is -1 of who is not there."""
    search = simulation.search
    found = spheres.whole_room()
    if not parameters.meshes:
        return found
    meshes = required(simulation.contact, "particles").model.meshes
    given = parameters.meshes, tuple(mesh.usual for mesh in meshes), spheres.position
    there = np.ones(len(slab) * search.members, bool) if spheres.active is None else spheres.active
    slab = np.tile(slab, search.members)
    rooms = [
        with_room_for_meshes(search, found, *given, spheres.radius, there & (slab == k))  # type: ignore[arg-type]
        for k in range(simulation.slabs.number)
    ]
    return functools.reduce(Room.covering, rooms)


def _covering(room: SlabRoom, other: SlabRoom) -> SlabRoom:
    return SlabRoom(
        max(room.rows, other.rows),
        max(room.ghosts, other.ghosts),
        max(room.migrating, other.migrating),
        room.listed.covering(other.listed),
    )


def _for_contacts(room: SlabRoom, kept: Keepers) -> SlabRoom:
    """Room for what every particle keeps."""
    numbers = np.bincount(kept.owner.astype(int))
    listed = dataclasses.replace(room.listed, slots=max(room.listed.slots, int(numbers.max(initial=1))))
    return SlabRoom(room.rows, room.ghosts, room.migrating, listed)


def _rows(particles: ParticleState, table: np.ndarray) -> ParticleState:
    """The rows (B, R, ...) of all slabs; those without a particle rest where another one is."""
    number, there = np.maximum(table, 0), table >= 0
    # NumPy's arrays stand for JAX's until they are put on the devices.
    identity: Any = table
    active: Any = there

    def of(rows: Any, axis: int = 0, keep: bool = False) -> Any:
        chosen = np.moveaxis(np.asarray(rows), axis, 0)[number]
        if not keep:
            chosen = np.where(there.reshape(*there.shape, *(1,) * (chosen.ndim - 2)), chosen, 0)
        return np.moveaxis(chosen, 1, axis + 1 if axis >= 0 else axis)

    return ParticleState(
        **of_each(particles, lambda rows, axis, name: of(rows, axis, keep=name in KEPT)),
        contact_spring=(),
        active=active,
        identity=identity,
        inserted=_in_all(particles.inserted, len(table)),
        coming=_in_all(_coming(particles), len(table)),
        pistons=_in_all(particles.pistons, len(table)),
        mesh_wear=_in_all(particles.mesh_wear, len(table)),
    )


def _coming(particles: ParticleState) -> Any:
    """How clumps lie as they come in; None where none does."""
    inlets = particles.inserted is not None and particles.orientation is not None
    return (particles.orientation, particles.orientation_low) if inlets else None


def _in_all(tree: Any, number: int) -> Any:
    """What is the same in all slabs."""
    return jax.tree.map(lambda x: np.stack([np.asarray(x)] * number), tree)


def _no_ghosts(planes: Any, table: Any, room: SlabRoom, members: int) -> Ghosts:
    """Ghosts (B, ...) before any has been chosen."""
    number = len(table)
    nobody = np.full((number, 2 * room.ghosts), -1, np.int32)
    sent = np.full((number, room.ghosts), room.rows, np.int32)
    count = np.sum(table >= 0, axis=1)
    needed = np.stack([count, np.zeros_like(count), np.zeros_like(count)], axis=1).astype(np.int32)
    none = np.zeros(number, np.int32)
    identity = np.concatenate((table, nobody), axis=1)
    parts: dict[str, Any] = {
        "planes": np.tile(planes, (number, 1)),
        "identity": identity,
        "lower": sent,
        "upper": sent,
        "needed": needed,
        "narrow": none > 0,
        "migrations": none,
        "cuts": none,
    }
    return Ghosts(**parts, migrating=room.migrating, members=members)


@functools.lru_cache(maxsize=8)
def _first_list(simulation: DividedSimulation, room: Room) -> Callable[..., Any]:
    """A program over all slabs, kept for states that are cut later: the springs of the pairs, what contacts with meshes
    keep, the bonds and the lists; from the bodies, the meshes, the rows of a slab, its ghosts and what rows keep."""

    def listing(
        bodies: Any, meshes: Meshes, rows: ParticleState, ghosts: Ghosts, history: History, memory: Any
    ) -> tuple[Any, Any, Any, Neighbors]:
        own = Sizes.of(bodies.of_rows(rows.identity))
        standing = Standing.of(Motion.of(rows), own, len(rows.position))
        new = slab_list(simulation.search, simulation.division, standing, room, ghosts, meshes)
        of_rows = memory_of_slab(memory, new)
        new, bonds = relisted(simulation.division.blocks, new, rows.bonds)
        springs = of_pairs(simulation.slabs, history, required(new.ghosts, "ghosts"), new.pairs)
        return springs, of_rows, bonds, new

    mesh = required(simulation.mesh, "mesh")
    return jax.jit(on_slabs(mesh, listing, (SAME, SAME, *(SLABS,) * 4), (SLABS,) * 4))


def enlarged(
    simulation: DividedSimulation, parameters: Parameters, state: State, neighbors: Neighbors, failed: Neighbors
) -> tuple[State, Neighbors | None]:
    """The state before a step that had too little room, with more; not jittable.

    Args:
        simulation, parameters: from `jaxdem.build(scene, devices=...)`.
        state, neighbors: distributed, before the step.
        failed: the list after the step, which says what was lacking.

    Raises:
        InputError: the slabs are too narrow, which no room helps.
    """
    ghosts = required(failed.ghosts, "ghosts of a list")
    if np.any(on_host(ghosts.narrow)):
        limit = (
            "a particle went farther than the neighbouring slab, slabs that are no neighbours came within reach, or a "
            "bond got longer than the neighbour list reaches"
        )
        raise InputError("devices", simulation.slabs.number, limit, "use fewer devices, or a shorter interval")
    needed = np.asarray(on_host(ghosts.needed)).max(axis=0)
    room = SlabRoom.of(neighbors).enlarged(needed)
    whole, contacts = gathered(simulation, state, neighbors)
    state, wider = distributed(simulation, parameters, whole, contacts, room)
    mesh, wider = required(simulation.mesh, "mesh"), required(wider, "neighbors")
    before = on_host((required(neighbors.ghosts, "ghosts of a list"), neighbors.builds))
    migrations, cuts, builds = put(mesh, (before[0].migrations, before[0].cuts, before[1]))
    ghosts = dataclasses.replace(required(wider.ghosts, "ghosts"), migrations=migrations, cuts=cuts)
    return state, dataclasses.replace(wider, ghosts=ghosts, builds=builds)
