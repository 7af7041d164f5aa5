"""Scene -> Simulation and Parameters: the one module that knows both the description and the implementations.

Somewhat longer than other modules, for every part that a scene can choose is chosen here and nowhere else.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.closures import DRAG_LAWS, load_closure, load_subgrid
from jaxdem.closures.base import DragClosure, as_closure
from jaxdem.coupling.coarse_inputs import CoarseInputs
from jaxdem.coupling.coupled import Coupling
from jaxdem.coupling.deposition import Centre, Deposition, Diffusion, Divided, Kernel
from jaxdem.coupling.drag import DragModel
from jaxdem.coupling.forces import Basset, FluidForce, Magnus, RotationalDrag, SaffmanMei, VirtualMass
from jaxdem.coupling.interpolation import KernelWidth, cells_under
from jaxdem.coupling.presence import present_weights
from jaxdem.coupling.self_disturbance import LARGEST_STOKES_SHARE, SelfDisturbance, kernel_mobility
from jaxdem.coupling.void_fraction import solid_fraction
from jaxdem.errors import InputError
from jaxdem.failures import MINIMUM_VOID_FRACTION
from jaxdem.fluid.advection import Central, CentralFourth, Superbee, Upwind, VanLeer
from jaxdem.fluid.boundary import Boundary
from jaxdem.fluid.grid import Grid
from jaxdem.fluid.inlet import InletProfile
from jaxdem.fluid.interval import FluidInterval
from jaxdem.fluid.momentum import FluidProperties, FluidSolver, FluidState
from jaxdem.fluid.remap import coarsened
from jaxdem.fluid.side_conditions import SideCondition
from jaxdem.fluid.subgrid_stress import SubgridLaw
from jaxdem.numerics import vectors
from jaxdem.particles.contact import ContactLaw, HertzMindlin, LinearSpringDashpot
from jaxdem.particles.forces import ContactModel, MaterialIndex
from jaxdem.particles.integrate import ParticleProperties, ParticleState, split_low
from jaxdem.particles.loop import ContactInterval
from jaxdem.particles.materials import ContactParameters, MaterialNumbers, SeveralMaterials
from jaxdem.particles.neighbors import NeighborGeometry, Neighbors, NeighborSearch
from jaxdem.particles.population import Population
from jaxdem.particles.rolling import ConstantDirectionalTorque, ElasticPlasticSpringDashpot
from jaxdem.particles.surfaces import Cylinder, DistanceFunction, Plane, Surface, surface_contacts, wedge
from jaxdem.particles.walls import BoxSide, box_sides
from jaxdem.scene import Contact, Scene
from jaxdem.scene.rows import rows_of
from jaxdem.scene.walls import Wall
from jaxdem.setup.arrivals import population_of
from jaxdem.setup.bodies import Bodies, material_table, wall_materials
from jaxdem.setup.boundaries import check_flow, scene_boundary
from jaxdem.setup.coincident_walls import check_coincident
from jaxdem.setup.initial import (
    PACK_OVERLAP,
    Overlap,
    allowed_overlap,
    check_initial_positions,
    check_walls,
    initial_positions,
    scene_bodies,
)
from jaxdem.setup.magnitudes import check_magnitudes, check_memory
from jaxdem.setup.stability import deconvolution_limit
from jaxdem.setup.time_steps import time_steps
from jaxdem.simulation import Simulation
from jaxdem.state import Parameters, State

CONTACT_LAWS: dict[str, Any] = {"hertz_mindlin": HertzMindlin, "linear_spring_dashpot": LinearSpringDashpot}
ROLLING_MODELS: dict[str, Any] = {"cdt": ConstantDirectionalTorque, "epsd": ElasticPlasticSpringDashpot}
LIFT_LAWS: dict[str, Any] = {"saffman_mei": SaffmanMei, "magnus": Magnus}
FOLLOWING = ("wall_young_modulus", "wall_poisson_ratio", "wall_friction", "tangential_stiffness")
"""Constants of contacts that follow another one where the scene gives none of their own."""
MOST_KERNEL_CELLS = 8000
"""A cube of 20: each takes some operations of the program, which would not be compiled within minutes."""
ADVECTION: dict[str, Any] = {
    "limited": VanLeer,
    "superbee": Superbee,
    "central": Central,
    "central_4": CentralFourth,
    "upwind": Upwind,
}


def build(
    scene: Scene,
    closure: DragClosure | None = None,
    walls: Sequence[Callable[[Array], Array]] = (),
    contact_law: ContactLaw | None = None,
    inlet_profiles: Mapping[str, Sequence[InletProfile | None]] | None = None,
    subgrid: SubgridLaw | None = None,
    side_conditions: Mapping[str, SideCondition] | None = None,
) -> tuple[Simulation, Parameters]:
    """The simulation of a scene, and its parameters.

    Args:
        scene: from `jaxdem.load_scene`.
        closure: drag law or learned closure to use instead of the scene's `closure.file` or `coupling.drag`. One
            that is a pytree goes into the parameters, and one may differentiate by its weights.
        walls: signed distances x (D,) [m] -> () [m], positive where particles may be, of walls beside those of
            the scene; see `jaxdem.particles.surfaces.DistanceFunction`.
        contact_law: to use instead of the scene's `contact.law`. The limits of the contact step and the overlap
            stay those of the scene's law: name there the one that is most like it, or stiffer.
        inlet_profiles: by the side's name, one for each of its other axes or None where it is even, instead of the
            scene's `boundary.<side>.profile`; see `jaxdem.fluid.inlet.InletProfile`. The automatic fluid step
            takes them for even; a faster flow is met by sub-steps, or by a flag.
        subgrid: closure of the subgrid stress to use instead of the scene's `fluid.subgrid`. It goes into the
            parameters, and one may differentiate by its weights.
        side_conditions: by the side's name, what the fluid does there instead of what the scene's
            `boundary.<side>.kind` says; see `jaxdem.fluid.side_conditions.SideCondition`. Checks of the scene and limits
            of the fluid step are those of the kind: name there the one that is most like it.

    Raises:
        InputError: a step or size that the scene asks for cannot work.
    """
    dtype = _dtype(scene)
    check_memory(scene)
    grid = _grid(scene)
    boundary = scene_boundary(scene, inlet_profiles or {}, side_conditions or {})
    bodies = scene_bodies(scene)
    check_magnitudes(scene, bodies)
    radius = bodies.radius
    steps = time_steps(scene)
    contact = fluid = coupling = population = None
    if scene.particles is not None and scene.contact is not None:
        geometry = neighbor_geometry(scene, float(np.max(radius)))
        search = NeighborSearch(geometry, jnp.asarray(radius, dtype))
        present = len(initial_positions(scene))
        population = population_of(scene, steps.interval, present)
        exits = () if population is None else population.exits
        without = tuple((side.axis, -1 if side.upper else 1) for side in exits)
        sides = box_sides(scene.domain.size, scene.periodic, without)
        surfaces = _surfaces(scene, walls, dtype)
        _check_coincident(scene, sides, surfaces, 2.0 * float(np.min(radius, initial=np.inf)))
        table = material_table(scene)
        resists = scene.contact.rolling_friction if table is None else table.rolling_friction.max()
        rolling = ROLLING_MODELS[scene.contact.rolling_model]() if resists > 0.0 else None
        index = None
        if table is not None:
            of_walls = wall_materials(scene, table, len(sides), len(surfaces))
            index = MaterialIndex(bodies.material, of_walls, table.pair)
        contact_law = CONTACT_LAWS[scene.contact.law]() if contact_law is None else contact_law
        model = ContactModel(contact_law, rolling, sides, surfaces, index)
        contact = ContactInterval(model, search, steps.contacts_per_interval, False)
    if scene.fluid is not None and grid is not None:
        viscous = scene.fluid.viscosity > 0.0 or scene.fluid.smagorinsky > 0.0
        check_flow(scene, grid, boundary)
        solver = FluidSolver(grid, boundary, ADVECTION[scene.fluid.advection](), viscous, scene.fluid.model)
        fluid = FluidInterval(solver, steps.interval, steps.fluid_substeps, scene.fluid.courant_limit)
        if scene.coupling is not None:
            coupling = _coupling(scene, fluid, 2.0 * float(np.max(radius, initial=0.0)))
            closure = _drag(scene, closure)
    simulation = Simulation(
        steps.interval,
        steps,
        scene.domain.size,
        scene.periodic,
        boundary,
        contact,
        fluid,
        coupling,
        population,
    )
    return simulation, _parameters(scene, bodies, closure, subgrid, dtype)


def initial_state(scene: Scene, simulation: Simulation, parameters: Parameters) -> tuple[State, Neighbors | None]:
    """The state that a scene starts from, and its neighbour list.

    Raises:
        InputError: particles overlap each other or a wall, lie outside the box, or do not fit into their pack.
    """
    dtype = parameters.gravity.dtype
    particles, neighbors = None, None
    if scene.particles is not None:
        allowed = PACK_OVERLAP
        if scene.particles.position is not None:  # a pack is laid out, not a state that a run was in
            allowed = allowed_overlap(simulation.steps.expected_speed, simulation.steps.expected_overlap)
        bare = _initial_particles(scene, simulation.population, allowed, dtype)
        surfaces = simulation.contact.model.surfaces
        if surfaces:
            _check_walls(surfaces, _wall_names(scene, len(surfaces)), bare, parameters.bodies.radius, allowed)
        neighbors = simulation.allocate(bare)
        count, walls = bare.position.shape[0], simulation.contact.model.walls
        kept = simulation.contact.model.history_size(scene.dimension)
        particles = bare._replace(
            contact_spring=(jnp.zeros(neighbors.room.pairs, dtype),) * kept,
            wall_spring=(jnp.zeros((walls, count), dtype),) * kept,
            fluid_memory=_initial_memory(scene, simulation.coupling, bare),
        )
    fluid = None
    if scene.fluid is not None and simulation.fluid is not None:
        fluid = _initial_fluid(scene, simulation, parameters, particles, dtype)
    return State(particles, fluid, jnp.zeros((), jnp.int32)), neighbors


def drag_law(scene: Scene) -> DragClosure:
    """The drag correlation that a scene names."""
    name = scene.coupling.drag if scene.coupling else ""
    if name not in DRAG_LAWS:
        raise InputError("coupling.drag", name, "unknown drag law", f"known: {', '.join(sorted(DRAG_LAWS))}")
    return DRAG_LAWS[name]()


def _drag(scene: Scene, closure: DragClosure | None) -> DragClosure:
    """The drag law of a scene, or the one given in its place."""
    if closure is None:
        closure = drag_law(scene) if scene.closure.file is None else load_closure(scene.closure.file)[0]
    trained = getattr(closure, "dimension", scene.dimension)
    if trained != scene.dimension:
        raise InputError(
            "closure.file",
            scene.closure.file,
            f"was trained in {trained}-D, the scene is {scene.dimension}-D",
            f"train a closure on {scene.dimension}-D runs",
        )
    return as_closure(closure)


def _coupling(scene: Scene, fluid: FluidInterval, diameter: float) -> Coupling:
    """How fluid and particles act on each other."""
    solver = fluid.solver
    deposition = _deposition(scene, solver.grid, diameter)
    drag = DragModel(
        solver.model,
        _self_disturbance(scene, solver.grid, deposition, diameter),
        _coarse_inputs(scene, solver.grid, solver.boundary, diameter),
        _deconvolution(scene, solver.grid, deposition),
    )
    return Coupling(fluid, deposition, drag, _further_forces(scene))


def _further_forces(scene: Scene) -> tuple[FluidForce, ...]:
    """The forces beside drag, pressure gradient and viscous force."""
    coupling = scene.coupling
    assert coupling is not None
    forces: list[FluidForce] = [LIFT_LAWS[name]() for name in coupling.lift]
    if coupling.rotational_drag:
        forces.append(RotationalDrag())
    if coupling.virtual_mass > 0.0:
        forces.append(VirtualMass(coupling.virtual_mass))
    if coupling.basset:
        forces.append(Basset(coupling.basset))
    return tuple(forces)


def neighbor_geometry(scene: Scene, largest_radius: float) -> NeighborGeometry:
    """Reach of the neighbour list; the automatic skin is 0.4 diameters.

    That is the widest at which a dense layer still has fewer neighbours than `USUAL_SLOTS`: the list is
    rebuilt half as often as with 0.2, and no wider.
    """
    contact = scene.contact or Contact()
    skin = (0.4 if contact.skin == "auto" else contact.skin) * 2.0 * largest_radius
    cutoff = 2.0 * largest_radius
    for axis, wraps in enumerate(scene.periodic):
        needed = 3.0 * (cutoff + skin)
        if wraps and scene.domain.size[axis] < needed:
            raise InputError(
                "domain.size",
                scene.domain.size,
                f"a periodic side must be at least {needed:.4g} m, three times the reach of the neighbour list",
                "enlarge the box, or make that side a wall",
            )
    return NeighborGeometry(scene.domain.size, scene.periodic, cutoff, skin)


def _dtype(scene: Scene) -> Any:
    if scene.precision == "float64" and not jax.config.read("jax_enable_x64"):
        raise InputError(
            "precision",
            "float64",
            "JAX computes in float32 by default",
            'call jax.config.update("jax_enable_x64", True) first (the command line does)',
        )
    return jnp.float64 if scene.precision == "float64" else jnp.float32


def _grid(scene: Scene) -> Grid | None:
    if scene.fluid is None:
        return None
    depth = scene.domain.depth if scene.dimension == 2 else 1.0
    return Grid(scene.fluid.cells, scene.domain.size, float(depth or 1.0), scene.periodic)


def _deposition(scene: Scene, grid: Grid, diameter: float) -> Deposition:
    assert scene.coupling is not None
    if scene.coupling.void_fraction == "centre":
        return Centre((0.0,) * grid.dimension)
    if scene.coupling.void_fraction == "divided":
        return Divided((0.5 * diameter,) * grid.dimension)
    width = scene.coupling.kernel_width
    half_width = KernelWidth(width.diameters, width.cells).half_widths(grid, diameter)
    for axis, (half, length) in enumerate(zip(half_width, grid.size, strict=True)):
        # Two cells and a half-width on either side must not meet themselves round a periodic box.
        if grid.periodic[axis] and 2.0 * half + 2.0 * grid.spacing[axis] > length:
            raise InputError(
                "coupling.kernel_width",
                {"diameters": width.diameters, "cells": width.cells},
                f"the kernel is {2.0 * half:.4g} m wide, too much for a periodic side of {length:.4g} m",
                "narrow the kernel, or use more cells along that side",
            )
    if scene.coupling.void_fraction != "kernel":
        return Diffusion(half_width)
    reached = math.prod(cells_under(half, h) for half, h in zip(half_width, grid.spacing, strict=True))
    if reached > MOST_KERNEL_CELLS:
        raise InputError(
            "coupling.kernel_width",
            {"diameters": width.diameters, "cells": width.cells},
            f"the kernel of a particle reaches {reached:.3g} cells, and may reach {MOST_KERNEL_CELLS:,}",
            'narrow the kernel, use fewer cells, or set coupling.void_fraction = "diffusion", which allows any width',
        )
    return Kernel(half_width)


def _self_disturbance(
    scene: Scene, grid: Grid, deposition: Deposition | None, diameter: float
) -> SelfDisturbance | None:
    if scene.coupling is None or deposition is None or not scene.coupling.self_disturbance:
        return None
    correction = SelfDisturbance(kernel_mobility(deposition.half_width, grid.spacing))
    hidden = 3.0 * math.pi * diameter * correction.mobility
    if hidden > LARGEST_STOKES_SHARE:
        width = scene.coupling.kernel_width
        needed = hidden / LARGEST_STOKES_SHARE * max(deposition.half_width)
        raise InputError(
            "coupling.kernel_width",
            {"diameters": width.diameters, "cells": width.cells},
            f"the wake of a particle hides {100 * hidden:.3g} % of its slip with Stokes drag, and "
            f"coupling.self_disturbance corrects up to {100 * LARGEST_STOKES_SHARE:.3g} %",
            f"widen the kernel to a half-width of about {needed:.3g} m",
        )
    return correction


def _coarse_inputs(scene: Scene, grid: Grid, boundary: Boundary, diameter: float) -> CoarseInputs | None:
    if scene.coupling is None or scene.coupling.drag_inputs_coarsened == 1:
        return None
    coarse = coarsened(grid, scene.coupling.drag_inputs_coarsened)
    deposition = _deposition(scene, coarse, diameter)
    return CoarseInputs(coarse, boundary, deposition, _deconvolution(scene, coarse, deposition))


def _deconvolution(scene: Scene, grid: Grid, deposition: Deposition | None) -> float:
    if scene.coupling is None or deposition is None or scene.coupling.deconvolution == 0.0:
        return 0.0
    width = deposition.half_width if scene.coupling.void_fraction == "kernel" else (0.0,) * grid.dimension
    limit = deconvolution_limit(width, grid.spacing)
    if scene.coupling.deconvolution > limit:
        raise InputError(
            "coupling.deconvolution",
            scene.coupling.deconvolution,
            f"in a dense pack the flow would grow from step to step; the limit with these cells and kernels is {limit:.3g}",
            "lower it, or widen coupling.kernel_width",
        )
    return scene.coupling.deconvolution


def _surfaces(scene: Scene, functions: Sequence[Callable[[Array], Array]], dtype: Any) -> tuple[Surface, ...]:
    """The walls of the scene, then those given as functions."""
    surfaces = [surface for wall in scene.walls for surface in _of_wall(wall)]
    for function in functions:
        shape = jax.eval_shape(function, jax.ShapeDtypeStruct((scene.dimension,), dtype)).shape
        if shape != ():
            raise InputError(
                "walls",
                function,
                f"a distance is one number for a point ({scene.dimension},), got the shape {shape}",
                "return a scalar",
            )
        surfaces.append(DistanceFunction(function))
    return tuple(surfaces)


def _check_coincident(scene: Scene, sides: tuple[BoxSide, ...], surfaces: tuple[Surface, ...], diameter: float) -> None:
    names = [f"walls.{k}" for k, wall in enumerate(scene.walls) for _ in _of_wall(wall)]
    names += [f"the function {k} of walls" for k in range(len(surfaces) - len(names))]
    of_box = [(f"the {scene.sides[2 * side.axis + (side.inward < 0)]} side of the box", side) for side in sides]
    check_coincident(of_box, list(zip(names, surfaces, strict=True)), scene.domain.size, diameter)


def _of_wall(wall: Wall) -> tuple[Surface, ...]:
    if wall.kind == "plane":
        return (Plane(wall.point, wall.normal),)
    if wall.kind == "cylinder":
        return (Cylinder(wall.center, wall.radius, wall.axis, wall.inside),)
    return wedge(wall.apex, wall.directions)


def _wall_names(scene: Scene, number: int) -> tuple[str, ...]:
    """Names of the surfaces, for messages; those that are not in the scene were given as functions."""
    names = [f"walls.{k} ({wall.kind})" for k, wall in enumerate(scene.walls) for _ in _of_wall(wall)]
    return (*names, *("a wall given as a function",) * (number - len(names)))


def _check_walls(
    surfaces: tuple[Surface, ...],
    names: tuple[str, ...],
    particles: ParticleState,
    radius: Array,
    allowed: Overlap,
) -> None:
    position = vectors.components(particles.position)
    low = split_low(particles.position_low, len(position))
    # As one program: operation by operation it takes seconds to compile.
    overlap, _ = jax.jit(functools.partial(surface_contacts, surfaces))(position, low, radius)
    if particles.active is not None:  # those still to come are looked at when they come
        overlap = jnp.where(particles.active[None], overlap, -1.0)
    check_walls(np.asarray(particles.position), np.asarray(radius), names, np.asarray(overlap), allowed)


def _contact_constants(scene: Scene, number: Callable[[Any], Array]) -> ContactParameters | SeveralMaterials:
    contact, table = scene.contact, material_table(scene)
    assert contact is not None

    def given(name: str) -> Array | None:
        value = getattr(contact, name)
        return None if value is None and name in FOLLOWING else number(value)

    if table is None:
        return ContactParameters(*(given(name) for name in ContactParameters._fields))
    columns = {name: number(values) for name, (values, _) in table.given.items()}
    numbers = MaterialNumbers(**{name: mixing for name, (_, mixing) in table.given.items()})
    rest = {name: given(name) for name in ("rolling_damping", "normal_stiffness", "tangential_stiffness")}
    return SeveralMaterials(**columns, **rest, numbers=numbers)


def _parameters(scene: Scene, sizes: Bodies, closure: Any, subgrid: SubgridLaw | None, dtype: Any) -> Parameters:
    def number(value: Any) -> Array:
        rigid = isinstance(value, str) and value == "rigid"
        return jnp.asarray(math.inf if rigid else (0.0 if value is None else value), dtype)

    contact = scene.contact
    bodies = constants = fluid = drag_scale = None
    if contact is not None and scene.particles is not None:
        bodies = ParticleProperties(jnp.asarray(sizes.radius, dtype), jnp.asarray(sizes.density, dtype))
        constants = _contact_constants(scene, number)
    sides = [scene.boundary[name] for name in scene.sides]
    velocity = tuple(jnp.asarray(side.velocities or side.velocity or (0.0,) * scene.dimension, dtype) for side in sides)
    if scene.fluid is not None:
        coefficient = number(scene.fluid.smagorinsky) if scene.fluid.smagorinsky > 0.0 else None
        if subgrid is None and scene.fluid.subgrid is not None:
            subgrid = load_subgrid(scene.fluid.subgrid)[0]
        fluid = FluidProperties(
            number(scene.fluid.density), number(scene.fluid.viscosity), velocity, coefficient, subgrid
        )
    if scene.fluid is not None and scene.coupling is not None:
        drag_scale = number(1.0)
    inlets = () if scene.particles is None else scene.particles.inlet
    return Parameters(
        jnp.asarray(scene.domain.gravity, dtype), bodies, constants, fluid, drag_scale, closure,
        tuple(jnp.asarray(inlet.velocity, dtype) for inlet in inlets),
        velocity if fluid is None and any(side.kind == "moving_wall" for side in sides) else (),
    )  # fmt: skip


def _initial_particles(scene: Scene, population: Population | None, allowed: Overlap, dtype: Any) -> ParticleState:
    """Particles at their starting positions, without contact history; those still to come wait in their inlets."""
    assert scene.particles is not None
    position = initial_positions(scene)
    check_initial_positions(scene, position, allowed)
    present, dimension = position.shape
    inlets = () if population is None else population.inlets
    places = [np.tile(0.5 * (inlet.lower + inlet.upper), (len(inlet.due), 1)) for inlet in inlets]
    position = np.concatenate([position, *places])
    count = len(position)
    leading = position.astype(dtype)
    low = None if dtype == jnp.float64 else jnp.asarray((position - leading).astype(dtype))
    turning = vectors.angular_size(dimension)
    velocity = rows_of("particles.velocity", scene.particles.velocity, dimension, present, of_frame=True)
    spin = rows_of("particles.angular_velocity", scene.particles.angular_velocity, turning, present, of_frame=True)
    zero = jnp.zeros((count, dimension), dtype)

    def rows(given: np.ndarray | None, width: int) -> Array:
        still = np.zeros((count, width))
        if given is not None:
            still[:present] = given
        return jnp.asarray(still, dtype)

    return ParticleState(
        position=jnp.asarray(leading),
        position_low=low,
        velocity=rows(velocity, dimension),
        angular_velocity=rows(spin, turning),
        contact_spring=(),
        wall_spring=(),
        contact_force=zero,
        fluid_force=None if scene.fluid is None else zero,
        active=None if population is None else jnp.arange(count) < present,
        inserted=jnp.zeros(len(inlets), jnp.int32) if inlets else None,
    )


def _initial_memory(scene: Scene, coupling: Coupling | None, particles: ParticleState) -> dict[str, Any] | None:
    """What the further forces remember at the start, of a slip that has always been as it is; None for nothing."""
    if coupling is None or scene.fluid is None:
        return None
    velocity = jnp.asarray(scene.fluid.velocity, particles.velocity.dtype)
    slip = velocity[None] - particles.velocity
    memory = {force.name: force.start(slip) for force in coupling.forces}
    return {name: kept for name, kept in memory.items() if kept is not None} or None


def _initial_fluid(
    scene: Scene,
    simulation: Simulation,
    parameters: Parameters,
    particles: ParticleState | None,
    dtype: Any,
) -> FluidState:
    assert scene.fluid is not None and simulation.fluid is not None
    grid = simulation.fluid.solver.grid
    velocity = scene.fluid.velocity or (0.0,) * grid.dimension
    faces = tuple(jnp.full(grid.face_shape(axis), velocity[axis], dtype) for axis in range(grid.dimension))
    void_fraction = None
    if particles is not None and parameters.bodies is not None and simulation.coupling is not None:
        deposition = simulation.coupling.deposition

        @jax.jit  # as one program: outside of jit every operation would be compiled by itself
        def deposited(position: Array, active: Array | None, radius: Array, volume: Array) -> Array:
            weights = present_weights(deposition.weights(grid, position, radius), active)
            return 1.0 - solid_fraction(grid, weights, volume)

        bodies = parameters.bodies
        void_fraction = deposited(particles.position, particles.active, bodies.radius, bodies.volume)
        lowest = float(jnp.min(void_fraction))
        if lowest < MINIMUM_VOID_FRACTION:
            raise InputError(
                "particles",
                f"void fraction {lowest:.3g}",
                f"the fluid's equations need a void fraction above {MINIMUM_VOID_FRACTION}",
                "widen coupling.kernel_width, use larger cells, or a larger domain.depth",
            )
    return FluidState(faces, jnp.zeros(grid.cells, dtype), void_fraction)
