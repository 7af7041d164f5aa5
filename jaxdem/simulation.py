"""A scene ready to be run: its structure and what can be done with it; made by `jaxdem.build`."""

from __future__ import annotations

import dataclasses

import jax
from jax import Array

from jaxdem.errors import InputError, require_kinds, required
from jaxdem.numerics import vectors
from jaxdem.numerics.compensated import Low
from jaxdem.numerics.placement import Placement
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.clump_forces import as_members, members_at
from jaxdem.particles.clump_shape import Placed
from jaxdem.particles.integrate import Motion, ParticleProperties, ParticleState, split_low
from jaxdem.particles.jax_md_list import JaxMdList, listed_by_jax_md
from jaxdem.particles.list_room import list_room, with_room_for_meshes
from jaxdem.particles.neighbors import Neighbors, Room, carry_history, carry_memory
from jaxdem.state import Diagnostics, Parameters, State
from jaxdem.step import step
from jaxdem.structure import Structure


@static
class Simulation(Structure):
    """A scene ready to be run; see `Structure` for its parts."""

    def step(
        self, parameters: Parameters, state: State, neighbors: Neighbors | None
    ) -> tuple[State, Neighbors | None, Diagnostics]:
        """State and neighbour list after one coupling interval; see `jaxdem.step`.

        Raises:
            InputError: an argument is of another kind.
        """
        remedy = "give parameters, state and neighbors, as jaxdem.build and jaxdem.initial_state make them"
        require_kinds(remedy, parameters=(parameters, Parameters), state=(state, State))
        if self.contact is not None:
            require_kinds(remedy, neighbors=(neighbors, Neighbors))
        return step(self, parameters, state, neighbors)

    def reversible(self) -> Simulation:
        """The same simulation with loops that reverse-mode differentiation can run backwards."""
        contact = None if self.contact is None else dataclasses.replace(self.contact, reversible=True)
        fluid, coupling = self.fluid, self.coupling
        if fluid is not None:
            fluid = dataclasses.replace(fluid, reversible=True)
            coupling = None if coupling is None else dataclasses.replace(coupling, interval=fluid)
        return dataclasses.replace(self, contact=contact, fluid=fluid, coupling=coupling)

    def without_levels(self) -> Simulation:
        """The same simulation with a search that has one table for grains of all sizes."""
        contact = self.contact
        if contact is None or contact.search is None or contact.search.levels is None:
            return self
        return dataclasses.replace(self, contact=dataclasses.replace(contact, search=contact.search.without_levels))

    def allocate(
        self,
        parameters: Parameters,
        particles: ParticleState,
        room: Room | None = None,
        placed: tuple[Placement | None, ...] = (),
    ) -> Neighbors:
        """A neighbour list with room for these positions, or with exactly so much room; not jittable. Meshes are where
        `placed` has them, see `Structure.placed`; empty for their places without motion.

        Raises:
            InputError: an argument is of another kind.
        """
        _require_particles(parameters, particles)
        bodies = required(parameters.bodies, "parameters.bodies")
        if room is None:
            room = self.room(parameters, particles)
        stood, spheres, radius = _spheres(particles, bodies)
        position, low = _on_host(spheres)
        meshes = placed[len(placed) - len(parameters.meshes) :]
        made = self.search.allocate(position, low, radius, room, spheres.active, parameters.meshes, meshes)
        return made if stood is None else dataclasses.replace(made, bodies=stood)

    def room(self, parameters: Parameters, particles: ParticleState) -> Room:
        """What a list needs room for at these positions; nothing is compiled. Refuses what `allocate` does."""
        _require_particles(parameters, particles)
        bodies = required(parameters.bodies, "parameters.bodies")
        _, particles, radius = _spheres(particles, bodies)
        position = _on_host(particles)[0]
        found = list_room(self.search, position, particles.active, radius)
        if not parameters.meshes:
            return found
        usual = tuple(mesh.usual for mesh in required(self.contact, "particles").model.meshes)
        given = parameters.meshes, usual, position, radius, particles.active
        return with_room_for_meshes(self.search, found, *given)

    def list_shapes(self, parameters: Parameters, particles: ParticleState, room: Room) -> Neighbors:
        """What `allocate` gives, shapes and types alone; nothing is compiled."""
        placed, spheres, radius = _spheres(particles, required(parameters.bodies, "parameters.bodies"))
        made = self.search.shapes(*_on_host(spheres), radius, room, parameters.meshes)
        if placed is None:
            return made
        shapes = jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype), placed)
        return dataclasses.replace(made, bodies=shapes)

    def with_room(self, state: State, neighbors: Neighbors, room: Room) -> tuple[State, Neighbors]:
        """State and list with more room, the pairs and what they keep as before; not jittable.

        Raises:
            InputError: an argument is of another kind.
        """
        remedy = "give state and neighbors, and the room as Simulation.room gives it"
        require_kinds(remedy, state=(state, State), neighbors=(neighbors, Neighbors), room=(room, Room))
        particles = required(state.particles, "state.particles")
        placed = tuple(mesh.placement for mesh in neighbors.meshes)  # where the list was made
        active = particles.active
        if neighbors.bodies is not None:
            active = neighbors.bodies.active_rows(active)
        given = (neighbors.reference, neighbors.reference_low, neighbors.radius, room, active)
        wider = self.search.allocate(*given, neighbors.surfaces, placed)
        springs = jax.jit(carry_history)(particles.contact_spring, neighbors, wider)
        memory = particles.mesh_memory
        if memory:
            memory = jax.jit(carry_memory)(memory, neighbors, wider)
        wider = dataclasses.replace(wider, builds=neighbors.builds, bodies=neighbors.bodies)
        return state._replace(particles=particles._replace(contact_spring=springs, mesh_memory=memory)), wider


def _require_particles(parameters: object, particles: object) -> None:
    remedy = "give parameters, and the particles of a state: state.particles"
    require_kinds(remedy, parameters=(parameters, Parameters), particles=(particles, ParticleState))


def _spheres(particles: ParticleState, bodies: ParticleProperties) -> tuple[Placed | None, ParticleState, Array]:
    """What a list is made of: the particles and their radii; of clumps the bodies as it remembers them, and members."""
    if bodies.clumps is None:
        return None, particles, bodies.radius
    placed, spheres, radius = _members(particles, bodies)
    return placed, spheres, radius


@jax.jit  # Outside of `jit` every operation would be compiled by itself.
def _members(particles: ParticleState, bodies: ParticleProperties) -> tuple[Placed, ParticleState, Array]:
    placed = members_at(Motion.of(particles), bodies.rigid.offset, bodies.rigid.there)[0]
    return placed, as_members(particles, bodies.rigid), bodies.spheres(len(particles.position)).radius


def contact_spheres(particles: ParticleState, bodies: ParticleProperties) -> tuple[ParticleState, Array]:
    """What touches, and its radii [m]: the particles, or the members of clumps; not jittable."""
    return _spheres(particles, bodies)[1:]


def _on_host(particles: ParticleState) -> tuple[Vector, tuple[Low, ...]]:
    """Positions by component; outside of `jit` each would be a program of its own on the device."""
    position, low = jax.device_get((particles.position, particles.position_low))
    return vectors.components(position), split_low(low, position.shape[1])


def neighbors_from_jax_md(
    simulation: Simulation, state: State, neighbors: Neighbors, neighbor_list: JaxMdList
) -> tuple[State, Neighbors]:
    """State and neighbour list with the pairs of a list that you made with jax-md; pure, for jit, scan and vmap.

    The contact forces then run over the pairs of that list which are nearer than cutoff + skin at its reference
    positions, as the scene's own list has them. It is good until a particle has moved half the skin from there; if one
    does within a step, the scene's own search takes over, so that no contact is missed. The springs of the contacts
    move along by identity. Shapes are those of `neighbors`: with too little room, in your list or in this one, the flag
    `overflow` is set, which a step reports in its `Diagnostics` and `rollout` in its failures. Then go back to the
    state before, allocate your list anew, and enlarge this one by `Simulation.with_room`.

    Args:
        simulation: from `build`. `search.geometry` has `cutoff` (the largest diameter) and `skin` [m].
        state: now; centres may be whole periods outside of the box, where jax-md needs them inside.
        neighbors: list that the contact springs of the state belong to.
        neighbor_list: a `jax_md.partition.NeighborList`, Dense, Sparse or OrderedSparse, that reaches cutoff + skin.

    Raises:
        InputError: an argument is of another kind, the scene has no particles, or is on several devices; the list has
            another number of particles, dimension, precision or too short a reach. Where the arrays have values (not
            under jit, grad or vmap) also: its reference positions are not those of the state, or a pair in reach is not
            in it, as with another box.
    """
    remedy = "give simulation, state, neighbors and the list of jax-md, in this order"
    require_kinds(remedy, simulation=(simulation, Simulation), state=(state, State))
    if simulation.contact is None or state.particles is None:
        raise InputError("simulation", "no particles", "a neighbour list needs some", "add [particles] to the scene")
    if simulation.cut is not None:
        limit = "a list of jax-md is of all particles, and each device has those of its slab"
        raise InputError("simulation", "on several devices", limit, "build the scene without `devices`")
    particles, neighbors = listed_by_jax_md(simulation.search, state.particles, neighbors, neighbor_list)
    return state._replace(particles=particles), neighbors
