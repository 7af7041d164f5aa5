"""Temperatures and other scalars of a scene: what is compiled, the numbers, and the first state."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from jax import Array

from jaxdem.errors import InputError, required
from jaxdem.fluid.dissolved import MOST_BY_VOLUME, Phase
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.fluid.interval import FluidInterval
from jaxdem.fluid.scalar_transport import ScalarField, ScalarNumbers, SideKind
from jaxdem.numerics.host import on_device
from jaxdem.particles.integrate import ParticleState
from jaxdem.scalars.conduction import Conduction, ConductionNumbers
from jaxdem.scalars.nusselt import NUSSELT_LAWS, NusseltLaw
from jaxdem.scalars.scalar_state import FluidHeat, GrainHeat, ScalarParameters, ScalarState, Supplied
from jaxdem.scalars.scalars import TEMPERATURE, Heat, Scalars
from jaxdem.scene import Scene
from jaxdem.scene.boundary import BoundarySide
from jaxdem.scene.heat import Heat as HeatTable
from jaxdem.scene.heat import thermal_diffusivity
from jaxdem.setup.particles import ParticleSetup
from jaxdem.setup.phases import first_temperature, largest_diffusivity, second_heat
from jaxdem.setup.scalar_walls import SurfacesOfScalars
from jaxdem.setup.start_point import StartPoint
from jaxdem.simulation import Simulation
from jaxdem.state import Parameters
from jaxdem.structure import TimeSteps

FOURIER, FOURIER_AMONG_GRAINS = 0.4, 0.2
"""Largest D t sum(1/h^2) of a step of a scalar [-]: Heun's method is stable up to 0.5 where the void fraction of a face
is that of its cells; at a front of grains it may be more than twice that of a cell."""

MOST_STEPS = 100_000
"""Of a scalar in a coupling interval: far more than a sensible scene takes."""

NO_SURFACES: tuple[SideKind, ...] = ()

CONDUCTED = 0.25
"""Largest part of the difference to its neighbours that a grain may lose in a step of conduction [-]."""

COORDINATION = {2: 6, 3: 12}
"""Most contacts of a grain among equal ones, by the dimension."""


def scene_scalars(
    scene: Scene,
    particles: ParticleSetup | None,
    fluid: FluidInterval | None,
    steps: TimeSteps,
    nusselt: NusseltLaw | None,
    surfaces: SurfacesOfScalars | None = None,
) -> Scalars | None:
    """What is compiled of the scalars of a scene; None where it has none.

    Args:
        scene: the scene.
        particles: of it.
        fluid: its fluid and steps.
        steps: of the run.
        nusselt: law of heat transfer in place of the scene's.
        surfaces: within the mesh of the fluid; None without.

    Raises:
        InputError: a law of heat transfer is given in Python, and no heat is exchanged; or a scalar diffuses so fast
            that a coupling interval takes more than `MOST_STEPS` steps of it.
    """
    exchanges = scene.heat is not None and scene.heat.exchange != "none" and fluid is not None and particles is not None
    if nusselt is not None and not exchanges:
        limit = "a law of heat transfer needs [heat] with an exchange, [fluid] and [particles]"
        raise InputError("nusselt", "given", limit, "leave it out, or add what is missing")
    if scene.heat is None and not scene.scalars:
        return None
    fields = []
    if fluid is not None:
        spacing = fluid.solver.grid.spacing
        for name, diffusivity in _diffusivities(scene):
            if name == TEMPERATURE:
                diffusivity = max(diffusivity, largest_diffusivity(scene))
            number = diffusivity * steps.interval * sum(1.0 / h**2 for h in spacing)
            sides = tuple(_kind(scene.boundary[side], name) for side in scene.sides)
            phase, longest = _phase(scene, name), FOURIER if particles is None else FOURIER_AMONG_GRAINS
            if phase is not None:
                longest = FOURIER / MOST_BY_VOLUME
            finer, kinds = 1, NO_SURFACES
            if surfaces is not None:
                kinds, longest = surfaces.kinds(name), longest * min(1.0, surfaces.smallest)
                finer = max(1, math.ceil(fluid.courant_limit / surfaces.smallest - 1e-9))
            count = max(1, math.ceil(number / longest))
            if count > MOST_STEPS:
                raise _too_many(scene, name, diffusivity, count)
            fields.append(ScalarField(name, sides, diffusivity > 0.0, count, kinds, finer, phase or "both"))
    heat = None
    if scene.heat is not None:
        table = scene.heat
        law = nusselt or NUSSELT_LAWS.get(table.exchange)
        heat = Heat(
            exchange=law if exchanges else None,
            conduction=_conduction(scene, particles, steps),
            expands=table.expansion != 0.0 or (scene.surface is not None and scene.surface.expansion != 0.0),
            bed=table.bed_conductivity,
        )
    return Scalars(tuple(fields), heat)


def _too_many(scene: Scene, name: str, diffusivity: float, count: int) -> InputError:
    """The refusal of a scalar that diffuses too fast."""
    if name == TEMPERATURE:
        key, value = "heat.fluid_conductivity", required(scene.heat, "heat").fluid_conductivity
        if scene.surface is not None and diffusivity > dict(_diffusivities(scene))[name]:
            key, value = "surface.conductivity", scene.surface.conductivity
    else:
        number = [scalar.name for scalar in scene.scalars].index(name)
        key, value = f"scalars.{number}.diffusivity", diffusivity
    limit = f"takes {count:.3g} steps of {name} in a coupling interval, at most {MOST_STEPS:,} are sensible"
    return InputError(key, value, limit, "correct it, or the heat capacity; or use a shorter coupling interval")


def scalar_parameters(
    scene: Scene, particles: ParticleSetup | None, dtype: np.dtype[np.floating]
) -> ScalarParameters | None:
    """The numbers of the scalars; None in a scene without."""
    if scene.heat is None and not scene.scalars:
        return None

    def number(value: float | list[float]) -> Array:
        return on_device(value, dtype)

    table, fields = scene.heat, []
    sides = [scene.boundary[name] for name in scene.sides]
    if scene.fluid is not None:
        for name, _ in _diffusivities(scene):
            values = [_value(side, name) or 0.0 for side in sides]
            if name == TEMPERATURE and table is not None:
                flux = [side.heat_flux or 0.0 for side in sides]
                conductivity = required(table.fluid_conductivity, "fluid_conductivity")
                fields.append(ScalarNumbers(number(conductivity), number(values), number(flux)))
                continue
            diffusivity = next(scalar.diffusivity for scalar in scene.scalars if scalar.name == name)
            fields.append(ScalarNumbers(number(diffusivity), number(values), number([0.0] * len(sides))))
    fluid = grains = None
    if table is not None and table.fluid_heat_capacity is not None and table.fluid_temperature is not None:
        reference = table.fluid_temperature if table.reference_temperature is None else table.reference_temperature
        fluid = FluidHeat(number(table.fluid_heat_capacity), number(table.expansion), number(reference))
    if table is not None and particles is not None and table.particle_heat_capacity is not None:
        grains = GrainHeat(number(table.particle_heat_capacity), _conduction_numbers(scene, table, particles, number))
    return ScalarParameters(tuple(fields), fluid, grains, second=second_heat(scene, number))


def _conduction_numbers(
    scene: Scene, table: HeatTable, particles: ParticleSetup, number: Callable[[float | list[float]], Array]
) -> ConductionNumbers | None:
    if table.particle_conductivity is None or table.true_young_modulus is None:
        return None
    walls = [0.0 if value is None else value for value in _wall_temperatures(scene, particles)]
    meshes = [0.0 if value is None else value for value in _mesh_temperatures(scene)]
    return ConductionNumbers(
        number(table.particle_conductivity),
        number(table.wall_conductivity or table.particle_conductivity),
        number(table.true_young_modulus),
        number(walls),
        number(meshes),
    )


def first_scalars(
    scene: Scene,
    particles: ParticleSetup | None,
    simulation: Simulation,
    parameters: Parameters,
    state: ParticleState | None,
    start: StartPoint | None = None,
    fluid: FluidState | None = None,
    capacity: np.ndarray | None = None,
) -> ScalarState | None:
    """The scalars of the first state; those of a run that the scene begins from go on, in its fluid if that does.

    Args:
        scene, particles, simulation, parameters: of the case.
        state: of the particles.
        start: of the run that it begins from.
        fluid: of the first state.
        capacity: of the cells, that goes on; None for what they have room for.

    Raises:
        InputError: that run has scalars on another mesh.
    """
    scalars, dtype = simulation.scalars, np.dtype(parameters.gravity.dtype)
    if scalars is None:
        return None
    liquid = None if fluid is None or fluid.liquid_fraction is None else np.asarray(fluid.liquid_fraction, float)
    fields = [_first_field(scene, field.name, start, liquid, dtype) for field in scalars.fields]
    grains = None
    if state is not None and particles is not None and scene.heat is not None:
        grains = _first_temperatures(scene, particles, len(state.position), start)
    zero = on_device(np.zeros(()), dtype)
    places = 2 * scene.dimension + (len(scalars.fields[0].surfaces) if fields else 0)
    friction = zero if scene.heat is not None and scene.heat.friction else None
    supplied = Supplied(on_device(np.zeros((len(fields), places)), dtype), zero, zero, friction)
    warm = None if grains is None else on_device(grains, dtype)
    held = _first_capacity(simulation, parameters, fluid, capacity)
    return ScalarState(tuple(fields), warm, supplied, capacity=held)


def _first_capacity(
    simulation: Simulation, parameters: Parameters, fluid: FluidState | None, kept: np.ndarray | None
) -> Array | None:
    """Of the cells of the fluid, where surfaces within its mesh change their place; None elsewhere [-]."""
    moving, own = simulation.walls_in_fluid, required(parameters.scalars, "scalars")
    if fluid is None or own.walls is None or moving is None or not moving.change_place:
        return None
    cut = required(parameters.flow.cut, "cut cells")
    if kept is not None and kept.shape == cut.open_cells.shape:
        return on_device(kept, cut.open_cells.dtype)
    open_cells, lent = np.asarray(cut.open_cells), np.asarray(own.walls.lent)
    void_fraction = 1.0 if fluid.void_fraction is None else np.asarray(fluid.void_fraction)
    return on_device(np.where(open_cells > 0.0, open_cells * void_fraction + lent, 0.0), open_cells.dtype)


def _diffusivities(scene: Scene) -> list[tuple[str, float]]:
    """Name and diffusivity of every scalar of the fluid, the temperature first."""
    found = [(scalar.name, scalar.diffusivity) for scalar in scene.scalars]
    if scene.heat is None or scene.fluid is None:
        return found
    return [(TEMPERATURE, thermal_diffusivity(scene.heat, scene.fluid.density)), *found]


def _phase(scene: Scene, name: str) -> Phase | None:
    """Of two fluids that a scalar is dissolved in; None of one fluid, and of the temperature."""
    if scene.surface is None or name == TEMPERATURE:
        return None
    return next(scalar.dissolved_in for scalar in scene.scalars if scalar.name == name)


def _value(side: BoundarySide, name: str) -> float | None:
    return side.temperature if name == TEMPERATURE else (side.scalars or {}).get(name)


def _kind(side: BoundarySide, name: str) -> SideKind:
    if _value(side, name) is not None:
        return "value"
    return "flux" if name == TEMPERATURE and side.heat_flux is not None else "closed"


def _wall_temperatures(scene: Scene, particles: ParticleSetup) -> list[float | None]:
    """Of all walls that grains have with a formula: sides of the box, then surfaces, a wedge being two; None for one
    without a temperature."""
    sides = []
    for number, name in enumerate(scene.sides):
        table = scene.boundary[name]
        if not scene.periodic[number // 2] and table.particles != "remove":
            sides.append(table.temperature)
    surfaces: list[float | None] = []
    for wall in scene.walls:
        if wall.kind != "mesh":
            surfaces += [wall.temperature] * (2 if wall.kind == "wedge" else 1)
    return sides + surfaces


def _mesh_temperatures(scene: Scene) -> list[float | None]:
    """Of all walls that are meshes; None for one without a temperature."""
    return [wall.temperature for wall in scene.walls if wall.kind == "mesh"]


def _conduction(scene: Scene, particles: ParticleSetup | None, steps: TimeSteps) -> Conduction | None:
    table = required(scene.heat, "heat")
    if particles is None or table.particle_conductivity is None:
        return None
    bodies, contact = particles.bodies, particles.contact
    linear = contact.law == "linear_spring_dashpot"
    # The contact of the largest overlap that is expected, of the smallest grain.
    radius, density = bodies.smallest_radius, float(np.min(bodies.density))
    overlap = 2.0 * radius * max(steps.expected_overlap or 0.0, 1e-4)
    share = 1.0 if linear else (contact.young_modulus / required(table.true_young_modulus, "modulus")) ** (1.0 / 3.0)
    touched = share * math.sqrt(0.5 * radius * overlap)
    capacity = required(table.particle_heat_capacity, "capacity") * density * 4.0 / 3.0 * math.pi * radius**3
    rate = particles.members * COORDINATION[scene.dimension] * 2.0 * table.particle_conductivity * touched / capacity
    walls = tuple(value is not None for value in _wall_temperatures(scene, particles))
    meshes = tuple(value is not None for value in _mesh_temperatures(scene))
    return Conduction(walls, linear, max(1, math.ceil(rate * steps.interval / CONDUCTED)), meshes)


def _first_field(
    scene: Scene, name: str, start: StartPoint | None, liquid: np.ndarray | None, dtype: np.dtype[np.floating]
) -> Array:
    fluid = required(scene.fluid, "fluid")
    if name == TEMPERATURE and scene.heat is not None:
        value = required(scene.heat.fluid_temperature, "fluid_temperature")
    else:
        value = next(scalar.value for scalar in scene.scalars if scalar.name == name)
    found = np.full(fluid.cells, value)
    if name == TEMPERATURE and liquid is not None:
        found = first_temperature(scene, liquid)
    anew = scene.start is not None and scene.start.fluid == "new"
    stored = None if start is None or anew else _stored_field(start, name)
    if stored is not None:
        if stored.shape != found.shape:
            limit = f"the run before has {name} on {list(stored.shape)} cells, and scalars stay on their mesh"
            remedy = 'take the mesh of that run, or start the fluid anew: start.fluid = "new"'
            raise InputError("fluid.cells", list(found.shape), limit, remedy)
        found = stored
    return on_device(found, dtype)


def _stored_field(start: StartPoint, name: str) -> np.ndarray | None:
    """A scalar of the run before by its name; None where it had none of that name."""
    tables = start.tables
    names = [TEMPERATURE] if "heat" in tables and "fluid" in tables else []
    names += [table["name"] for table in tables.get("scalars", [])]
    if name not in names:
        return None
    return start.arrays.get(f"state.scalars.fields[{names.index(name)}]", start.arrays.get(f"cells/{name}"))


def _first_temperatures(scene: Scene, particles: ParticleSetup, count: int, start: StartPoint | None) -> np.ndarray:
    """(N,) of all grains that there ever are, those to come at the temperature of their inlet [K]."""
    usual = required(required(scene.heat, "heat").particle_temperature, "particle_temperature")
    found = np.full(count, usual)
    stored = None if start is None else start.arrays.get("state.scalars.grains")
    if stored is not None:
        found[: len(stored)] = stored
    for inlet, queue in zip(particles.table.inlet, particles.queues, strict=True):
        found[queue.rows[queue.inserted :]] = usual if inlet.temperature is None else inlet.temperature
    return found
