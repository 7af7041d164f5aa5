"""From a state on one device to a distributed one, and back. Host, numpy."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from jaxdem.devices.contacts import Contacts, contacts_of_list, contacts_of_slabs, history_tables
from jaxdem.devices.mesh import SAME, SLABS, on_host, on_slabs, put
from jaxdem.devices.rooms import SlabRoom, equal_planes, needed_room, slab_of
from jaxdem.devices.simulation import DividedSimulation
from jaxdem.errors import InputError, required
from jaxdem.fluid.slabs import fluid_in_slabs, fluid_of_slabs
from jaxdem.numerics import vectors
from jaxdem.particles.ghosts import Ghosts
from jaxdem.particles.integrate import ParticleState, centres_in_box, split_low
from jaxdem.particles.mesh_contact import MeshMemory
from jaxdem.particles.mesh_list import of_grain
from jaxdem.particles.neighbors import Neighbors, Room
from jaxdem.particles.slab_list import History, Meshes, of_pairs, slab_list
from jaxdem.state import Parameters, State

Tree = TypeVar("Tree")

AXIS_OF_PARTICLES = {
    "position": 0,
    "position_low": 0,
    "velocity": 0,
    "angular_velocity": 0,
    "wall_spring": 1,
    "contact_force": 0,
    "fluid_force": 0,
    "fluid_memory": -2,
    "liquid": 0,
}
"""Fields of `ParticleState` that every particle has an entry of, and along which axis of their arrays."""

KEPT = ("position", "position_low")
"""Fields of which a row without a particle has the values of another one, not zero."""

REFUSED = ("bonds", "orientation", "orientation_low")
"""Fields of scenes that `refused` turns away."""


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
        grid = simulation.fluid.solver.grid.whole
        fluid = put(mesh, fluid_in_slabs(grid, simulation.slabs, on_host(state.fluid)))
    if state.particles is not None and neighbors is not None:
        rows = on_host(state.particles)
        if not isinstance(neighbors, Contacts):
            neighbors = contacts_of_list(rows.contact_spring, on_host(neighbors), rows.mesh_memory)
        placed = simulation.meshes_placed(parameters, _on_one(rows), jnp.asarray(on_host(state.step)))
        meshes = Meshes(parameters.meshes, placed)
        particles, lists = _particles(simulation, parameters, rows, neighbors, room, meshes)
    return State(particles, fluid, put(mesh, on_host(state.step), SAME)), lists


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
    listed = _listed_room(simulation, parameters, particles, np.where(_is_present(particles), slab, -1))
    coming = simulation.count - len(present) if particles.inserted is not None else 0
    wider = needed_room(division, search, inside, planes, listed, coming)
    room = _for_contacts(wider if room is None else _covering(room, wider), contacts)
    row, table = np.zeros_like(slab), np.full((number, room.rows), -1, np.int32)
    for k in range(number):
        own = present[slab[present] == k]
        table[k, : len(own)], row[own] = own, np.arange(len(own))
    history = History(*history_tables(contacts, slab, row, (number, room.listed.slots, room.rows)))
    mesh, memory = required(simulation.mesh, "mesh"), _memory_of_rows(contacts, table)
    given = (_rows(particles, table), _no_ghosts(planes.astype(dtype), table, room), history, memory)
    rows, ghosts, history, memory = put(mesh, given)
    listing, everywhere = _first_list(simulation, room.listed), put(mesh, (parameters.bodies, meshes), SAME)
    springs, memory, new = listing(*everywhere, rows, ghosts, history, memory)
    return rows._replace(contact_spring=springs, mesh_memory=memory), new


def _memory_of_rows(contacts: Contacts, table: np.ndarray) -> tuple[MeshMemory, ...]:
    """What contacts with meshes keep, arrays (B, C, R) of the rows of all slabs."""

    def of_rows(values: Any) -> np.ndarray:
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


def _listed_room(
    simulation: DividedSimulation, parameters: Parameters, particles: ParticleState, slab: np.ndarray
) -> Room:
    """Room for the list of the whole box, but of meshes for that of any slab; `slab` is -1 of who is not there."""
    search, position = simulation.search, tuple(particles.position.T)
    found = search.room(position, particles.active)
    if not parameters.meshes:
        return found
    meshes = required(simulation.contact, "particles").model.meshes
    given = parameters.meshes, tuple(mesh.usual for mesh in meshes), position
    radius: Any = np.asarray(required(parameters.bodies, "parameters.bodies").radius)
    there: list[Any] = [slab == k for k in range(simulation.slabs.number)]
    rooms = [search.with_room_for_meshes(found, *given, radius, own) for own in there]
    return functools.reduce(Room.covering, rooms)


def _covering(room: SlabRoom, other: SlabRoom) -> SlabRoom:
    return SlabRoom(
        max(room.rows, other.rows),
        max(room.ghosts, other.ghosts),
        max(room.migrating, other.migrating),
        room.listed.covering(other.listed),
    )


def _for_contacts(room: SlabRoom, contacts: Contacts) -> SlabRoom:
    """Room for what every particle keeps."""
    numbers = np.bincount(np.concatenate((contacts.first, contacts.second)).astype(int))
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
        **_of_each(particles, lambda rows, axis, name: of(rows, axis, keep=name in KEPT)),
        contact_spring=(),
        active=active,
        identity=identity,
        inserted=_in_all(particles.inserted, len(table)),
        pistons=_in_all(particles.pistons, len(table)),
        mesh_wear=_in_all(particles.mesh_wear, len(table)),
    )


def _of_each(particles: ParticleState, of: Callable[[Any, int, str], Any]) -> dict[str, Any]:
    """Fields that every particle has an entry of, each array changed by `of(array, axis of the particles, field)`."""

    def changed(name: str, axis: int) -> Any:
        return jax.tree.map(lambda rows: of(rows, axis, name), getattr(particles, name))

    return {name: changed(name, axis) for name, axis in AXIS_OF_PARTICLES.items()}


def _in_all(tree: Any, number: int) -> Any:
    """What is the same in all slabs."""
    return jax.tree.map(lambda x: np.stack([np.asarray(x)] * number), tree)


def _no_ghosts(planes: Any, table: Any, room: SlabRoom) -> Ghosts:
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
    return Ghosts(**parts, migrating=room.migrating)


@functools.lru_cache(maxsize=8)
def _first_list(simulation: DividedSimulation, room: Room) -> Callable[..., Any]:
    """A program over all slabs, kept for states that are cut later: the lists, the springs of their pairs and what
    contacts with meshes keep; from the bodies, the meshes, the rows of a slab, its ghosts and what its rows keep."""

    def listing(
        bodies: Any, meshes: Meshes, rows: ParticleState, ghosts: Ghosts, history: History, memory: Any
    ) -> tuple[Any, Any, Neighbors]:
        own = bodies.of_rows(rows.identity)
        position = vectors.components(rows.position)
        low = split_low(rows.position_low, len(position))
        new = slab_list(simulation.search, simulation.division, position, low, own.radius, room, ghosts, meshes)
        kept = zip(memory, new.meshes, strict=True)
        of_rows = tuple(MeshMemory(*(of_grain(part, listed) for part in one)) for one, listed in kept)
        return of_pairs(history, required(new.ghosts, "ghosts").identity, new.pairs), of_rows, new

    mesh = required(simulation.mesh, "mesh")
    return jax.jit(on_slabs(mesh, listing, (SAME, SAME, *(SLABS,) * 4), (SLABS, SLABS, SLABS)))


def gathered(simulation: DividedSimulation, state: State, neighbors: Neighbors | None) -> tuple[State, Contacts | None]:
    """A distributed state as one of arrays on the host, row i of particle i; every process must call it.

    Args:
        simulation: from `jaxdem.build(scene, devices=...)`.
        state, neighbors: distributed.

    Returns:
        the state, without contact springs; rows of particles that are not present are zero. And what the contacts keep.
    """
    fluid, particles, contacts = None, None, None
    if state.fluid is not None:
        fluid = fluid_of_slabs(simulation.slabs, on_host(state.fluid))
    if state.particles is not None and neighbors is not None:
        rows: ParticleState = on_host(state.particles)
        contacts = contacts_of_slabs(rows, on_host(neighbors.without_surfaces()), simulation.count)
        particles = _by_identity(simulation, rows)
    return State(particles, fluid, on_host(state.step)), contacts


def gathered_state(simulation: DividedSimulation, state: State) -> State:
    """As `gathered`, without what contacts keep: for outputs."""
    fluid, particles = None, None
    if state.fluid is not None:
        fluid = fluid_of_slabs(simulation.slabs, on_host(state.fluid))
    if state.particles is not None:
        particles = _by_identity(simulation, on_host(state.particles._replace(contact_spring=(), mesh_memory=())))
    return State(particles, fluid, on_host(state.step))


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
    there = required(rows.active, "active of the particles") & (identity >= 0)
    number = np.asarray(identity)[there]

    active: Any = np.zeros(simulation.count, bool)
    active[number] = True
    return ParticleState(
        **_of_each(rows, lambda values, axis, _: rows_by_identity(values, there, number, simulation.count, axis)),
        contact_spring=(),
        active=None if simulation.population is None else active,
        inserted=None if rows.inserted is None else rows.inserted[0],
        pistons=jax.tree.map(lambda x: x[0], rows.pistons),
        mesh_wear=jax.tree.map(lambda x: x[0], rows.mesh_wear),
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
    fluid, step = jax.tree.map(jnp.asarray, state.fluid), jnp.asarray(state.step)
    if contacts is None:
        return State(None, fluid, step), None
    particles = jax.tree.map(jnp.asarray, required(state.particles, "state.particles"))
    placed = simulation.meshes_placed(parameters, particles, step)
    neighbors = simulation.undivided().allocate(parameters, particles, placed=placed)
    first, second = np.asarray(neighbors.pairs.first), np.asarray(neighbors.pairs.second)
    count = max(len(particles.position), 1)
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
    return State(particles, fluid, step), neighbors


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
        limit = "a particle went farther than the neighbouring slab, or slabs that are no neighbours came within reach"
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
