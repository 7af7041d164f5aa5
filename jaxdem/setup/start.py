"""The state that a scene starts from."""

from __future__ import annotations

import jax
import numpy as np
from jax import Array
from jax.typing import DTypeLike

from jaxdem.coupling.coupled import Coupling, Mixture
from jaxdem.coupling.member_weights import body_weights
from jaxdem.coupling.open_cells import weights_beside
from jaxdem.coupling.presence import present_weights
from jaxdem.coupling.void_fraction import solid_fraction
from jaxdem.errors import InputError, required
from jaxdem.failures import MINIMUM_VOID_FRACTION
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.fluid.momentum import FluidSolver
from jaxdem.fluid.two_fluids import TwoFluidSolver
from jaxdem.numerics import vectors
from jaxdem.numerics.host import on_device
from jaxdem.numerics.placement import Placement
from jaxdem.particles.contact_interval import ContactInterval
from jaxdem.particles.integrate import ParticleState
from jaxdem.particles.mesh_contact import MeshMemory
from jaxdem.particles.mesh_room import MeshRoom
from jaxdem.particles.neighbors import Room
from jaxdem.particles.population import Population
from jaxdem.scene import Scene
from jaxdem.scene.rows import Numbers, rows_of
from jaxdem.setup.cut_liquid import liquid_beside_walls
from jaxdem.setup.first_parts import Begun, with_parts
from jaxdem.setup.first_scalars import first_scalars
from jaxdem.setup.fluid import fluid_velocity
from jaxdem.setup.fluid_walls import with_start_of_solver
from jaxdem.setup.inlet_regions import inlet_space
from jaxdem.setup.overlaps import allowed_overlap, check_initial_positions
from jaxdem.setup.particles import ParticleSetup
from jaxdem.setup.surface import first_fraction, with_liquid
from jaxdem.setup.wall_overlaps import check_inlets_beside_meshes, check_meshes, check_surfaces
from jaxdem.simulation import Simulation, contact_spheres
from jaxdem.state import Parameters, State


def first_state(
    scene: Scene, particles: ParticleSetup | None, simulation: Simulation, parameters: Parameters
) -> tuple[State, Room | None]:
    """The state that a scene starts from, and what its neighbour list needs room for; made on the host.

    Args:
        scene: the scene.
        particles: of it.
        simulation, parameters: built from it.

    Raises:
        InputError: particles overlap each other or a wall, lie outside the box, or do not fit into their pack.
    """
    dtype, state, room = parameters.gravity.dtype, None, None
    if particles is not None and simulation.contact is not None and parameters.bodies is not None:
        allowed = allowed_overlap(particles)
        check_initial_positions(particles)
        state = _particles(particles, simulation.population, dtype)
        model = simulation.contact.model
        times = model.wall_times
        middle = 0.5 * simulation.interval
        present = None if times is None else np.asarray([bool(window.holds(middle)) for window in times.windows])
        placed = surfaces_placed(simulation, parameters, state, _full((), 0, np.int32))
        spheres, radius = contact_spheres(state, parameters.bodies)
        check_surfaces(scene, model.surfaces, present, spheres, radius, allowed, placed)
        check_inlets_beside_meshes(particles, placed)
        check_meshes(particles.meshes, present, spheres, radius, allowed, placed)
        room = simulation.room(parameters, state)
        state = _with_memory(scene, simulation, parameters.bodies.radius, state, room)
        state = with_mesh_memory(state, simulation.contact, room)
    fluid = None
    if simulation.fluid is not None:
        void_fraction = None
        if simulation.coupling is not None and state is not None:
            void_fraction = initial_void_fraction(simulation.coupling, parameters.mixture, state)
        now = simulation.during(parameters, _full((), 0, np.int32))
        fluid = resting_fluid(scene, simulation.fluid.solver, now, void_fraction)
    scalars = first_scalars(scene, particles, simulation, parameters, state, fluid=fluid)
    return State(state, fluid, _full((), 0, np.int32), scalars), room


def surfaces_placed(
    simulation: Simulation, parameters: Parameters, particles: ParticleState, step: Array
) -> tuple[Placement | None, ...]:
    """`Simulation.placed` as one program, which equal simulations share; by itself every operation would be one."""
    moves = simulation.contact is not None and simulation.contact.model.motions
    return _placed(simulation, parameters, particles, step) if moves else ()


@jax.jit
def _placed(
    simulation: Simulation, parameters: Parameters, particles: ParticleState, step: Array
) -> tuple[Placement | None, ...]:
    return simulation.placed(parameters, particles, step)


def resting_fluid(scene: Scene, solver: FluidSolver, parameters: Parameters, void_fraction: Array | None) -> FluidState:
    """The fluid with the velocity that the scene gives everywhere, zero by default, and the pressure of rest."""
    dtype, velocity = parameters.gravity.dtype, fluid_velocity(scene)
    faces = tuple(_full(solver.grid.face_shape(axis), speed, dtype) for axis, speed in enumerate(velocity))
    if parameters.fluid is not None and parameters.fluid.cut is not None:
        faces = _beside_walls(parameters.fluid.cut, velocity, dtype)
    gradient = None if solver.drive is None else jax.jit(solver.first_gradient)(parameters.flow)
    fluid = FluidState(faces, _full(solver.grid.cells, 0.0, dtype), void_fraction, gradient)
    if parameters.fluid is not None:
        fluid = with_start_of_solver(fluid, parameters.fluid)
    if isinstance(solver, TwoFluidSolver):
        fraction, cut = first_fraction(scene, solver.grid), parameters.flow.cut
        if cut is not None:
            fraction = liquid_beside_walls(cut, fraction)
            _check_liquid(scene, float(np.sum(fraction)))
        fluid = with_liquid(fluid, solver.grid, fraction, dtype, cut)
        fluid = fluid._replace(pressure=jax.jit(solver.resting_pressure)(parameters.flow, fluid))
    return fluid


def _check_liquid(scene: Scene, liquid: float) -> None:
    """Refuses two fluids whose liquid walls leave out as a whole, where none comes in."""
    if liquid > 0.0 or any(side.level for side in scene.boundary.values()):
        return
    regions = bool(required(scene.surface, "surface").regions)
    key, value = ("surface.regions", "...") if regions else ("surface.level", required(scene.surface, "surface").level)
    limit = "puts liquid nowhere but within walls, or into a space that is left out because no outlet reaches it"
    raise InputError(key, value, limit, "put liquid into the largest space, or open its own space by an outlet")


def _beside_walls(cut: CutCells, velocity: tuple[float, ...], dtype: DTypeLike) -> tuple[Array, ...]:
    """The velocity on open faces, on closed ones that of the wall."""
    parts = zip(cut.open_faces, velocity, cut.velocity, strict=True)
    return tuple(on_device(np.where(np.asarray(a) > 0.0, speed, np.asarray(w)), dtype) for a, speed, w in parts)


def inlet_places(scene: Scene, particles: ParticleSetup) -> list[np.ndarray]:
    """(M, D) for each inlet, where its particles wait: in the middle of it [m]."""
    if not scene.comes_and_goes:
        return []
    found = []
    for k, (inlet, coming) in enumerate(zip(particles.table.inlet, particles.arrivals, strict=True)):
        ends = (inlet.start or (), inlet.stop or ())
        if inlet.region is not None:
            ends = inlet_space(f"particles.inlet.{k}", inlet.region, scene.box).bounds
        found.append(np.tile(0.5 * np.add(*ends), (len(coming.time), 1)))
    return found


def _full(shape: tuple[int, ...], value: float, dtype: DTypeLike) -> Array:
    return on_device(np.full(shape, value), dtype)


def _particles(particles: ParticleSetup, population: Population | None, dtype: np.dtype[np.floating]) -> ParticleState:
    """Particles at their starting positions, without contact history; those still to come wait in their inlets."""
    table, position = particles.table, particles.position
    present, dimension = position.shape
    inlets = () if population is None else population.inlets
    position = np.concatenate([position, *inlet_places(particles.scene, particles)])
    count, turning = len(position), vectors.angular_size(dimension)
    leading = position.astype(dtype)
    single = dtype != np.float64

    turned = particles.orientation
    low = None if turned is None else turned - turned.astype(dtype)

    def rows(name: str, source: str | Numbers | None, width: int) -> Array:
        given = rows_of(f"particles.{name}", source, width, present, of_frame=True)
        values = np.zeros((count, width))
        if given is not None:
            values[:present] = given
        return on_device(values, dtype)

    state = ParticleState(
        position=on_device(leading, dtype),
        position_low=on_device(position - leading, dtype) if single else None,
        velocity=rows("velocity", particles.given_velocity, dimension),
        angular_velocity=rows("angular_velocity", table.rows("angular_velocity", dimension), turning),
        contact_spring=(),
        wall_spring=(),
        contact_force=_full((count, dimension), 0.0, dtype),
        fluid_force=None if particles.scene.fluid is None else _full((count, dimension), 0.0, dtype),
        active=None if population is None else on_device(np.arange(count) < present, bool),
        inserted=_full((len(inlets),), 0, np.int32) if inlets else None,
        orientation=None if turned is None else on_device(turned, dtype),
        orientation_low=None if low is None or not single else on_device(low, dtype),
    )
    return with_parts(state, Begun(particles.scene, particles, count, dtype))


def _with_memory(
    scene: Scene, simulation: Simulation, radius: Array, particles: ParticleState, room: Room
) -> ParticleState:
    """The particles with springs at rest, and what further forces remember of a slip that has always been as it is."""
    count, dimension = particles.position.shape
    contact, coupling = required(simulation.contact, "contact"), simulation.coupling
    dtype, kept = particles.position.dtype, contact.model.history_size(dimension)
    memory = {}
    if coupling is not None and coupling.remembers:
        slip = np.asarray(fluid_velocity(scene), dtype) - np.asarray(particles.velocity)
        memory = jax.jit(coupling.first_memory)(slip)
    rows = count * required(contact.search, "search").members
    return particles._replace(
        contact_spring=(_full((room.pairs,), 0.0, dtype),) * kept,
        wall_spring=(_full((contact.model.analytic_walls, rows), 0.0, dtype),) * kept,
        fluid_memory=memory or None,
        liquid=first_films(scene, radius, count, dtype) if contact.model.wet else None,
    )


def first_films(scene: Scene, radius: Array, count: int, dtype: DTypeLike) -> Array:
    """(N,) liquid on every particle at the start [m3]."""
    table = required(required(scene.contact, "contact").cohesion, "cohesion")
    volume = 4.0 / 3.0 * np.pi * np.broadcast_to(np.asarray(radius, float), count) ** 3
    return on_device((table.liquid_content or 0.0) * volume, dtype)


def with_mesh_memory(particles: ParticleState, contact: ContactInterval, room: Room) -> ParticleState:
    """The particles with contacts with meshes that have just begun, for lists with so much room."""
    dimension, dtype = particles.position.shape[1], particles.position.dtype
    kept = contact.model.history_size(dimension)

    def blank(of_mesh: MeshRoom, size: int) -> tuple[Array, ...]:
        return (_full((of_mesh.contacts, of_mesh.rows), 0.0, dtype),) * size

    sizes = dimension, kept, 1 if contact.model.tracks_meshes else 0
    memory = tuple(MeshMemory(*(blank(of_mesh, size) for size in sizes)) for of_mesh in room.meshes)
    return particles._replace(mesh_memory=memory)


def initial_void_fraction(coupling: Coupling, mixture: Mixture, particles: ParticleState) -> Array:
    """Void fraction of the cells, on the host.

    Raises:
        InputError: it is too low for the fluid's equations.
    """
    grid, deposition = coupling.interval.solver.grid, coupling.deposition
    given = particles.position, particles.active, mixture.bodies, mixture.properties.cut
    position, active, bodies, cut = jax.tree.map(np.asarray, given)
    own = deposition.weights(grid, position, bodies.radius)
    if bodies.clumps is not None:
        made = jax.jit(lambda state, bodies: body_weights(deposition, grid, state, state.position, bodies))
        own = jax.tree.map(np.asarray, made(particles, mixture.bodies))
    weights = weights_beside(deposition, grid, own, cut)
    solids = solid_fraction(grid, present_weights(weights, active), bodies.volume, cut)
    void_fraction = on_device(1.0 - solids, position.dtype)
    lowest = float(np.min(np.asarray(void_fraction)))
    if lowest < MINIMUM_VOID_FRACTION:
        raise InputError(
            "particles",
            f"void fraction {lowest:.3g}",
            f"the fluid's equations need a void fraction above {MINIMUM_VOID_FRACTION}",
            "widen coupling.kernel_width, use larger cells, or a larger domain.depth",
        )
    return void_fraction
