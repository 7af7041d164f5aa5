"""Temperatures and other scalars of the first state, new or of the run that a scene begins from."""

from __future__ import annotations

import numpy as np
from jax import Array

from jaxdem.errors import InputError, required
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.numerics.host import on_device
from jaxdem.particles.integrate import ParticleState
from jaxdem.scalars.scalar_state import ScalarState, Supplied
from jaxdem.scalars.scalars import TEMPERATURE
from jaxdem.scene import Scene
from jaxdem.setup.particles import ParticleSetup
from jaxdem.setup.phases import first_temperature
from jaxdem.setup.start_point import StartPoint
from jaxdem.simulation import Simulation
from jaxdem.state import Parameters


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
