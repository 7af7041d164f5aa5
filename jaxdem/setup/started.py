"""The first state of a scene that begins from another run: what that run had, brought into the shapes of this one."""

from __future__ import annotations

import dataclasses
from typing import Any, Literal

import jax
import numpy as np
from jax import Array

from jaxdem.coupling.coupled import Coupling
from jaxdem.coupling.interpolation import interpolate_faces
from jaxdem.errors import InputError, required
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.numerics import vectors
from jaxdem.numerics.host import on_device
from jaxdem.numerics.placement import Placement
from jaxdem.particles.integrate import ParticleState
from jaxdem.particles.neighbors import Neighbors, Room
from jaxdem.scene import Scene
from jaxdem.scene.rows import rows_of
from jaxdem.setup.contact import COHESIONS
from jaxdem.setup.first_parts import Begun, with_parts
from jaxdem.setup.first_scalars import first_scalars
from jaxdem.setup.overlaps import allowed_overlap, check_initial_positions
from jaxdem.setup.particles import ParticleSetup
from jaxdem.setup.start import initial_void_fraction, inlet_places, resting_fluid, surfaces_placed, with_mesh_memory
from jaxdem.setup.start_point import StartPoint, of_deposit, walls_of
from jaxdem.setup.started_fluid import StartedFluid
from jaxdem.setup.started_list import carried_springs, widened_list
from jaxdem.setup.started_meshes import kept_of_meshes
from jaxdem.setup.started_particles import StartedParticles
from jaxdem.setup.stored import stored_room
from jaxdem.setup.wall_overlaps import check_meshes, check_surfaces
from jaxdem.simulation import Simulation
from jaxdem.state import Parameters, State


@dataclasses.dataclass(frozen=True)
class Beginning:
    """The start of a scene that begins from another run.

    Attributes:
        scene: that begins.
        particles: of it; None without.
        simulation, parameters: built from it.
        start: state of that run.
    """

    scene: Scene
    particles: ParticleSetup | None
    simulation: Simulation
    parameters: Parameters
    start: StartPoint

    def state(self) -> tuple[State, Room | None]:
        """The first state, its contact springs at rest, and what its list needs room for; see `first_state`."""
        simulation = self.simulation
        particles, room = self._particles, None
        state = fluid = None
        if particles is not None:
            state = self._particle_state(particles)
            if not self.start.foreseen:
                self._check_places(particles, state)
            room = self._room(particles, state)
            state = state._replace(contact_spring=(self._zeros(room.pairs),) * self._kept)
            state = with_mesh_memory(state, required(simulation.contact, "contact"), room)
        if simulation.fluid is not None:
            fluid = self._fluid(state)
        if state is not None and simulation.coupling is not None and simulation.coupling.remembers:
            state = state._replace(fluid_memory=self._memory(simulation.coupling, state, required(fluid, "fluid")))
        given = self.scene, self.particles, simulation, self.parameters
        scalars = first_scalars(*given, state, self.start, fluid, self._kept_capacity)
        return State(state, fluid, on_device(self.start.step, np.int32), scalars), room

    def with_list(self, state: State, room: Room) -> tuple[State, Neighbors]:
        """State and list: the list of the run where it still holds, and the springs of the contacts that go on."""
        particles, own = required(state.particles, "particles"), required(self._particles, "particles")
        simulation, parameters, arrays = self.simulation, self.parameters, self.start.arrays
        if self._keeps_list(own):
            shapes = simulation.list_shapes(parameters, particles, room)
            reference = tuple(np.asarray(particles.position).T)
            radius = required(parameters.bodies, "bodies").radius
            neighbors = widened_list(arrays, shapes, radius, reference)
            springs = [np.pad(s, (0, room.pairs - len(s))) for s in self._springs("contact_spring")]
        else:
            neighbors = simulation.allocate(parameters, particles, room, self._placed(particles))
            springs = []
            if not own.settings.relax and len(arrays.get("neighbors.pairs.first", ())):
                springs = carried_springs(arrays, self._springs("contact_spring"), neighbors)
        kept = tuple(on_device(s, particles.position.dtype) for s in springs)
        kept += (self._zeros(room.pairs),) * (self._kept - len(kept))
        particles = particles._replace(contact_spring=kept[: self._kept])
        particles = with_mesh_memory(particles, required(simulation.contact, "contact"), neighbors.room)
        if neighbors.meshes and not own.settings.relax:
            given = self.start, self.scene, own.meshes, neighbors.meshes, particles.mesh_memory, own.placed
            particles = particles._replace(mesh_memory=kept_of_meshes(*given, self._springs))
        return state._replace(particles=particles), neighbors

    def _placed(self, particles: ParticleState) -> tuple[Placement | None, ...]:
        """Where the walls beside the sides of the box are; empty where all are at rest."""
        return surfaces_placed(self.simulation, self.parameters, particles, on_device(self.start.step, np.int32))

    def _check_places(self, own: StartedParticles, state: ParticleState) -> None:
        """Refuses particles that overlap each other or a wall by more than a run may have."""
        check_initial_positions(own)
        model = required(self.simulation.contact, "contact").model
        times, middle = model.wall_times, float(self.start.time) + 0.5 * self.simulation.interval
        present = None if times is None else np.asarray([bool(window.holds(middle)) for window in times.windows])
        radius = required(self.parameters.bodies, "bodies").radius
        placed = self._placed(state)
        check_surfaces(self.scene, model.surfaces, present, state, radius, allowed_overlap(own), placed)
        check_meshes(own.meshes, present, state, radius, allowed_overlap(own), placed)

    @property
    def _particles(self) -> StartedParticles | None:
        found = self.particles
        return found if isinstance(found, StartedParticles) else None

    @property
    def _dtype(self) -> np.dtype[np.floating]:
        return np.dtype(self.parameters.gravity.dtype)

    @property
    def _kept(self) -> int:
        """Number of components that a contact keeps."""
        return required(self.simulation.contact, "contact").model.history_size(self.scene.dimension)

    def _zeros(self, *shape: int) -> Array:
        return on_device(np.zeros(shape), self._dtype)

    def _springs(self, name: str) -> list[np.ndarray]:
        """Stored components of contact or wall springs that this scene's contacts keep too.

        The sliding spring is a displacement in every law. The rolling spring follows it where there is one, and last
        what cohesion remembers, which only the same kind of cohesion can go on with.

        Raises:
            InputError: a kind of cohesion given in Python keeps other values than the kind of the table.
        """
        found: list[np.ndarray] = []
        while f"state.particles.{name}[{len(found)}]" in self.start.arrays:
            found.append(self.start.arrays[f"state.particles.{name}[{len(found)}]"])
        before = self.start.tables.get("contact", {}).get("cohesion", {}).get("kind")
        model = required(self.simulation.contact, "contact").model
        springs = self._kept - model.memory
        memory: list[np.ndarray] = []
        if before is not None and COHESIONS[before]().memory:
            memory, found = found[-1:], found[:-1]
        if not model.memory or before != required(self.scene.contact, "contact").cohesion_kind:
            return found[:springs]
        if len(memory) != model.memory:
            own, kept = model.memory, len(memory)
            limit = f"the cohesion given in Python keeps {own} of a contact, and this kind {kept} (numbers of values)"
            remedy = "begin without [start], or give a kind in the table that keeps as many"
            raise InputError("contact.cohesion.kind", before, limit, remedy)
        blank = [np.zeros_like(memory[0])] * (springs - len(found))
        return found[:springs] + blank + memory

    def _particle_state(self, own: StartedParticles) -> ParticleState:
        """The particles, without contact springs; those that are not present are at rest."""
        scene, population = self.scene, self.simulation.population
        present, dimension = own.count, scene.dimension
        count, turning = own.total, vectors.angular_size(dimension)
        active = np.arange(count) < present
        active[:present] = own.active
        position = np.concatenate([own.position, *inlet_places(scene, own)])
        leading = position.astype(self._dtype)
        low: np.ndarray | None = None if self._dtype == np.float64 else (position - leading).astype(self._dtype)
        stored = self.start.arrays["state.particles.position"]
        if stored.dtype == self._dtype and not own.settings.relax and not any(own.rewrapped):
            # As they are: a sum of leading and trailing part may be cut into two in another way.
            leading[: own.placed] = stored
            if low is not None:
                low[: own.placed] = self.start.arrays["state.particles.position_low"]

        def rows(name: Literal["velocity", "angular_velocity", "contact_force", "fluid_force"], width: int) -> Array:
            values = np.zeros((count, width), self._dtype)
            values[: own.placed] = self.start.arrays.get(f"state.particles.{name}", 0.0)
            if own.added is not None and (name == "velocity" or name == "angular_velocity"):
                spin = own.added.table.rows("angular_velocity", dimension)
                source = own.added.given_velocity if name == "velocity" else spin
                given = rows_of(f"start.add.{name}", source, width, own.added.count, of_frame=True)
                values[own.placed : present] = 0.0 if given is None else given
            values[own.removed] = 0.0
            return on_device(values, self._dtype)

        found = ParticleState(
            position=on_device(leading, self._dtype),
            position_low=None if low is None else on_device(low, self._dtype),
            velocity=rows("velocity", dimension),
            angular_velocity=rows("angular_velocity", turning),
            contact_spring=(),
            wall_spring=self._wall_springs(own, count),
            contact_force=rows("contact_force", dimension),
            fluid_force=None if scene.fluid is None else rows("fluid_force", dimension),
            active=None if population is None else on_device(active, bool),
            inserted=on_device([queue.inserted for queue in own.queues], np.int32) if own.queues else None,
        )
        return with_parts(found, Begun(scene, own, count, self._dtype, self.start))

    def _wall_springs(self, own: StartedParticles, count: int) -> tuple[Array, ...]:
        """Springs at the walls: those of a wall that was there already go on."""
        names, before = walls_of(self.scene, self.simulation), self.start.walls
        found: list[Array] = []
        for spring in [] if own.settings.relax else self._springs("wall_spring"):
            values = np.zeros((len(names), count), self._dtype)
            for number, name in enumerate(names):
                if name in before:
                    values[number, : own.placed] = spring[before.index(name)]
            values[:, own.removed] = 0.0
            found.append(on_device(values, self._dtype))
        blank = self._zeros(len(names), count)
        return (*found, *(blank,) * (self._kept - len(found)))

    def _keeps_list(self, own: StartedParticles) -> bool:
        """Whether the stored list holds: the same particles in the same places, and as many within its reach."""
        if not len(self.start.arrays.get("neighbors.overlap", ())):  # of several devices there is no list
            return False
        if self.parameters.meshes:
            return False
        search = self.simulation.search
        same = self.start.reach == search.limits and own.same_box
        same = same and (search.levels is None or own.total == own.placed)
        same = same and self.start.arrays["state.particles.position"].dtype == self._dtype
        return same and own.added is None and not own.settings.relax and len(own.removed) == 0

    def _room(self, own: StartedParticles, state: ParticleState) -> Room:
        """Room for the list; that of the stored one where it goes on with as many rows."""
        if not self._keeps_list(own):
            return self.simulation.room(self.parameters, state)
        before = stored_room(self.start.arrays)
        if own.total == own.placed:
            return before
        return self.simulation.room(self.parameters, state).covering(before)

    def _fluid(self, state: ParticleState | None) -> FluidState:
        own = self._particles
        solver = required(self.simulation.fluid, "fluid").solver
        had_fluid = "state.fluid.pressure" in self.start.arrays or "cells/pressure" in self.start.arrays
        void_fraction = None
        if self.simulation.coupling is not None and state is not None and own is not None:
            stored = self.start.arrays.get("state.fluid.void_fraction")
            if stored is not None and self._same_deposit(own):
                void_fraction = on_device(stored, self._dtype)
            else:
                void_fraction = initial_void_fraction(self.simulation.coupling, self.parameters.mixture, state)
        settings = self.scene.start
        now = self.simulation.during(self.parameters, on_device(self.start.step, np.int32))
        if not had_fluid or (settings is not None and settings.fluid == "new"):
            return resting_fluid(self.scene, solver, now, void_fraction)
        return StartedFluid(self.start, solver, now.flow, void_fraction, self._dtype).state()

    def _same_deposit(self, own: StartedParticles | None) -> bool:
        """Whether the particles fill the cells as they did: the same particles, mesh, walls in it and distribution of
        volume."""
        if of_deposit(self.start.tables) != of_deposit(self.scene.tables()):
            return False
        if own is None:
            return True
        unmoved = not self.start.merged and not own.settings.relax
        return unmoved and own.added is None and len(own.removed) == 0

    @property
    def _kept_capacity(self) -> np.ndarray | None:
        """Capacity of the cells for scalars, between walls that change their place, where the fluid of the run goes on
        in its cells; else None."""
        settings = self.scene.start
        stored = self.start.arrays.get("state.scalars.capacity")
        if stored is None or settings is None or settings.fluid == "new":
            return None
        return stored if self._same_deposit(self._particles) else None

    def _memory(self, coupling: Coupling, state: ParticleState, fluid: FluidState) -> Any:
        """What further forces remember: of the particles of the run if it had the force and the interval, else of a
        slip that has always been as it is."""
        if not coupling.remembers:
            return None
        grid = coupling.interval.solver.grid

        @jax.jit
        def first(state: ParticleState, fluid: FluidState) -> dict[str, Any]:
            weights = coupling.deposition.weights(grid, state.position, self.parameters.mixture.bodies.radius)
            slip = interpolate_faces(weights, fluid.face_velocity) - state.velocity
            return coupling.first_memory(slip)

        fresh = first(state, fluid)
        if float(self.start.attributes["interval"]) != self.simulation.interval:
            return fresh or None
        former = len(self.start.arrays["state.particles.position"])
        leaves, structure = jax.tree_util.tree_flatten_with_path(fresh)
        found = []
        for path, leaf in leaves:
            stored = self.start.arrays.get("state.particles.fluid_memory" + jax.tree_util.keystr(path))
            found.append(leaf if stored is None else _over(np.array(leaf), stored, former))
        return jax.tree_util.tree_unflatten(structure, found) or None


def _over(fresh: np.ndarray, stored: np.ndarray, rows: int) -> Array:
    """The stored values of the first `rows` particles in an array of more particles; the fresh ones if they differ in
    another axis too."""
    axis = next((k for k, length in enumerate(stored.shape) if length == rows), 0)
    place = (slice(None),) * axis + (slice(0, rows),)
    if fresh[place].shape == stored.shape:
        fresh[place] = stored
    return on_device(fresh, fresh.dtype)


def require_particles(case_has: bool, start: StartPoint) -> None:
    """Refuses a scene without particles that begins from a run with some.

    Raises:
        InputError: it would lose them.
    """
    if start.has_particles and not case_has:
        limit = f"is missing, and the run {start.source} has particles"
        raise InputError("particles", None, limit, "add [particles], or start from a run without particles")
