"""Scene -> Simulation, Parameters and State: the front door, a list of the parts with one builder each.

Only this room knows both the description of a scene and what implements it. The parts of the user are keyword
arguments and not an object, since `jaxdem.build(scene, walls=[...])` is how they have always been given.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from fractions import Fraction
from typing import Unpack

import jax
import numpy as np

from jaxdem.closures.base import DragClosure, sees_wide
from jaxdem.coupling.coupled import Coupling
from jaxdem.coupling.forces import FluidForce
from jaxdem.devices import DividedSimulation, distributed, divided
from jaxdem.errors import InputError
from jaxdem.fluid.interval import FluidInterval
from jaxdem.particles.neighbors import Neighbors, Room
from jaxdem.probes.base import ScheduledProbe
from jaxdem.scene import Scene
from jaxdem.scene.coupling import Coupling as CouplingTable
from jaxdem.scene.unread import unread_keys
from jaxdem.setup.bodies import NO_BODIES, Bodies
from jaxdem.setup.boundaries import scene_boundary
from jaxdem.setup.closures import drag_closure
from jaxdem.setup.contact import contact_interval
from jaxdem.setup.coupling import check_own_forces, fluid_coupling
from jaxdem.setup.extensions import Extensions, has_models
from jaxdem.setup.fluid import fluid_interval, fluid_setup
from jaxdem.setup.fluid_walls import FluidWalls, fluid_walls
from jaxdem.setup.given import parts_given, require_built, require_one_stage, require_read
from jaxdem.setup.magnitudes import check_magnitudes, check_memory
from jaxdem.setup.merge import merged
from jaxdem.setup.parameters import scene_parameters
from jaxdem.setup.particles import ParticleSetup, particle_setup
from jaxdem.setup.population import population_of
from jaxdem.setup.probes import scene_probes, with_measured_walls
from jaxdem.setup.scalar_walls import surfaces_of_scalars
from jaxdem.setup.scalars import scene_scalars
from jaxdem.setup.settling import Progress, check_settling_time, settled
from jaxdem.setup.start import first_state, initial_void_fraction
from jaxdem.setup.start_point import StartPoint, read_start
from jaxdem.setup.started import Beginning, require_particles
from jaxdem.setup.started_fluid import kept_liquid
from jaxdem.setup.started_particles import StartedParticles
from jaxdem.setup.surroundings import surroundings_of
from jaxdem.setup.time_steps import time_steps
from jaxdem.setup.wall_functions import wall_functions
from jaxdem.simulation import Simulation
from jaxdem.state import Parameters, State


@dataclasses.dataclass(frozen=True)
class Case:
    """A scene that is ready to run.

    Attributes:
        scene: the scene.
        particles: of it, with their positions and sizes; None without.
        simulation: what is compiled.
        parameters: its numbers.
        probes: what is measured while it runs.
        start: state of the run that it begins from; None where it begins at t = 0.
        fluid_walls: what the fluid sees of the walls.
        unread: a sentence for every key of the scene that nothing reads; none with models of the user's, which may read
            any.
    """

    scene: Scene
    particles: ParticleSetup | None
    simulation: Simulation
    parameters: Parameters
    probes: tuple[ScheduledProbe, ...] = ()
    start: StartPoint | None = None
    fluid_walls: FluidWalls = FluidWalls()
    unread: tuple[str, ...] = ()

    def _beginning(self, start: StartPoint) -> Beginning:
        own = self.particles.start if isinstance(self.particles, StartedParticles) else start
        return Beginning(self.scene, self.particles, self.simulation, self.parameters, own)

    @property
    def begin(self) -> Fraction:
        """Time at which it begins [s]."""
        return Fraction(0) if self.start is None else self.start.time

    @property
    def start_figures(self) -> dict[str, object]:
        """What it begins from, for reports; {} where it begins at t = 0."""
        if self.start is None:
            return {}
        found: dict[str, object] = {
            "from": self.start.source,
            "time": float(self.start.time),
            "sha256": self.start.sha256,
        }
        if isinstance(self.particles, StartedParticles):
            found |= self.particles.start_figures
        return found

    @property
    def bodies(self) -> Bodies:
        """Size, density and material of all particles that there ever are; no entries in a scene without."""
        return NO_BODIES if self.particles is None else self.particles.bodies

    @property
    def grains(self) -> Bodies:
        """The same of the grains that particles stand for; the particles themselves where they are no parcels."""
        return self.bodies if self.particles is None else self.bodies.scaled(1.0 / self.particles.table.coarse_grain)

    def first_state(self) -> tuple[State, Room | None]:
        """See `jaxdem.setup.start.first_state`; particles of a settled pack have not fallen yet, and with a start the
        springs of the contacts are still at rest."""
        if self.start is not None:
            return self._beginning(self.start).state()
        return first_state(self.scene, self.particles, self.simulation, self.parameters)

    def initial_state(self, settling: Progress | None = None) -> tuple[State, Neighbors | None]:
        """See `jaxdem.initial_state`; `settling` is called now and then while particles come to rest."""
        state, neighbors = self.unsettled_state()
        if neighbors is None or self.particles is None or not self.particles.settles:
            return state, neighbors
        settle = settled(self.particles, self.simulation, self.parameters, settling)
        state, neighbors = settle(state, neighbors)
        coupling, fluid = self.simulation.coupling, state.fluid
        if coupling is not None and fluid is not None and state.particles is not None:
            void_fraction = initial_void_fraction(coupling, self.parameters.mixture, state.particles)
            state = state._replace(fluid=fluid._replace(void_fraction=void_fraction))
        return state, neighbors

    def unsettled_state(self) -> tuple[State, Neighbors | None]:
        """The same before particles of a settled pack have fallen: all shapes are those of a state."""
        state, room = self.first_state()
        if room is None or state.particles is None:
            return state, None
        if self.start is not None:
            return self._beginning(self.start).with_list(state, room)
        return state, self.simulation.allocate(self.parameters, state.particles, room)


def build(
    scene: Scene,
    closure: DragClosure | None = None,
    devices: int | Sequence[jax.Device] | None = None,
    **extensions: Unpack[Extensions],
) -> tuple[Simulation, Parameters]:
    """The simulation of a scene, and its parameters.

    Args:
        scene: from `jaxdem.load_scene`.
        closure: drag law or learned closure to use instead of the scene's `closure.file` or `coupling.drag`. One
            that is a pytree goes into the parameters, and one may differentiate by its weights.
        devices: how many, or which, the box is cut for; see `jaxdem.devices`. None for one device and the plain
            program.
        extensions: further parts in place of the scene's, or beside them: `walls`, `contact_law`, `cohesion`, `forces`,
            `inlet_profiles`, `subgrid`, `side_conditions`, `nusselt`; see `jaxdem.setup.extensions.Extensions`.

    Raises:
        InputError: a step or size that the scene asks for cannot work, or a part is of another kind.
        TypeError: an extension of another name.
    """
    case = build_case(scene, closure, **extensions)
    if devices is None:
        return case.simulation, case.parameters
    particles = case.particles
    given = (None, 0) if particles is None else (particles.position, particles.total)
    simulation = divided(case.simulation, devices, *given)
    return simulation, simulation.with_parts(case.parameters)


def initial_state(scene: Scene, simulation: Simulation, parameters: Parameters) -> tuple[State, Neighbors | None]:
    """The state that a scene starts from, and its neighbour list. Particles of a settled pack come to rest in it.

    Args:
        scene: from `jaxdem.load_scene`.
        simulation, parameters: from `jaxdem.build`.

    Raises:
        InputError: particles overlap each other or a wall, lie outside the box, do not fit into their pack, or do not
            come to rest; or an argument is of another kind.
    """
    require_one_stage(scene)
    require_built(simulation, parameters)
    start = read_start(scene)
    if isinstance(simulation, DividedSimulation):
        whole = initial_state(scene, simulation.undivided(), simulation.of_whole(parameters))
        return distributed(simulation, parameters, *whole)
    return Case(scene, _particles(scene, start), simulation, parameters, start=start).initial_state()


def build_case(
    scene: Scene,
    closure: DragClosure | None = None,
    start: StartPoint | None = None,
    **extensions: Unpack[Extensions],
) -> Case:
    """`build`, with what it found out about the particles.

    Args:
        scene, closure, extensions: see `build`.
        start: state that it begins from, of a scene with `[start]`; read from the run that it names if not given.
    """
    extensions = _parts_that_work(scene, closure, extensions)
    start = read_start(scene) if start is None else start
    dtype = _dtype(scene)
    boundary = scene_boundary(scene, extensions.get("inlet_profiles"), extensions.get("side_conditions"))
    particles, fluid = _particles(scene, start), fluid_setup(scene, kept_liquid(scene, start))
    check_magnitudes(scene, NO_BODIES if particles is None else particles.bodies)
    own_walls = wall_functions(extensions.get("walls") or (), scene, dtype)
    steps = time_steps(scene, fluid, particles, Fraction(0) if start is None else start.time, own_walls)
    clock = None if start is None else start.clock(steps.interval)
    population = contact = interval = coupling = None
    seen = FluidWalls()
    if particles is not None:
        check_settling_time(particles, steps.interval)
        population = population_of(particles, steps.interval, clock)
        contact = contact_interval(particles, steps, population, extensions, dtype)
    if fluid is not None:
        begin = 0.0 if start is None else float(start.time)
        seen = fluid_walls(scene, fluid.grid, boundary, extensions, begin, steps.interval)
        interval = fluid_interval(fluid, boundary, steps, len(seen.walls), tuple(one.compiled for one in seen.openings))
    if interval is not None and particles is not None and scene.coupling is not None:
        closure = drag_closure(scene, scene.coupling, closure)
        coupling = _coupling(scene, scene.coupling, particles, interval, closure, extensions.get("forces") or ())
        seen = seen.with_particles(interval.solver.grid, coupling.deposition, particles.bodies.largest_diameter)
    scalar_surfaces = None if interval is None else surfaces_of_scalars(scene, interval.solver.grid, seen)
    scalars = scene_scalars(scene, particles, interval, steps, extensions.get("nusselt"), scalar_surfaces)
    simulation = Simulation(
        interval=steps.interval,
        steps=steps,
        box=scene.domain.size,
        periodic=scene.periodic,
        boundary=boundary,
        contact=contact,
        fluid=interval,
        coupling=coupling,
        population=population,
        gravity_times=scene.domain.gravity_times,
        drag_times=None if coupling is None or scene.coupling is None else scene.coupling.drag_times,
        clock=clock,
        scalars=scalars,
        walls_in_fluid=seen.moving,
    )
    parameters = seen.put_into(scene_parameters(scene, particles, closure, extensions.get("subgrid"), dtype))
    if scalar_surfaces is not None and scalars is not None:
        parameters = scalar_surfaces.put_into(parameters, [field.name for field in scalars.fields])
    probes = scene_probes(scene, steps, clock, 0 if particles is None else particles.total)
    unread = () if has_models(extensions) else unread_keys(scene)
    return Case(scene, particles, with_measured_walls(simulation, probes), parameters, probes, start, seen, unread)


def _parts_that_work(scene: Scene, closure: DragClosure | None, extensions: Extensions) -> Extensions:
    """The parts of the user that are given; refuses what cannot work before anything is made."""
    require_one_stage(scene)
    extensions = parts_given(closure, extensions)
    check_memory(scene)
    require_read(scene, closure, extensions)
    check_own_forces(extensions.get("forces") or (), scene.dimension, scene.surface is not None)
    return extensions


def _coupling(
    scene: Scene,
    table: CouplingTable,
    particles: ParticleSetup,
    interval: FluidInterval,
    closure: DragClosure,
    own: Sequence[FluidForce],
) -> Coupling:
    """The exchange between fluid and particles, with what the drag law asks for."""
    surroundings, diameter = surroundings_of(scene, particles, closure), particles.bodies.largest_diameter
    return fluid_coupling(table, interval, diameter, surroundings, own, sees_wide(closure))


def _particles(scene: Scene, start: StartPoint | None) -> ParticleSetup | None:
    """The particles of a scene, those of the run that it begins from with it; None in a scene without."""
    if start is not None:
        require_particles(scene.particles is not None, start)
    own = particle_setup(scene)
    if own is None or start is None or scene.start is None or not start.has_particles:
        return own
    point, merge = merged(scene, start)
    return StartedParticles(scene, own.table, own.contact, point, scene.start, merge)


def _dtype(scene: Scene) -> np.dtype[np.floating]:
    if scene.precision == "float64" and not jax.config.read("jax_enable_x64"):
        raise InputError(
            "precision",
            "float64",
            "JAX computes in float32 by default",
            'call jax.config.update("jax_enable_x64", True) first (the command line does)',
        )
    return np.dtype(scene.precision)
