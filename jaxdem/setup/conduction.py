"""Conduction of heat between grains of a scene, and into their walls: what is compiled, and the numbers."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from jax import Array

from jaxdem.errors import required
from jaxdem.scalars.conduction import Conduction, ConductionNumbers
from jaxdem.scene import Scene
from jaxdem.scene.heat import Heat as HeatTable
from jaxdem.setup.particles import ParticleSetup
from jaxdem.setup.walls import surfaces_of
from jaxdem.structure import TimeSteps

CONDUCTED = 0.25
"""Largest part of the difference to its neighbours that a grain may lose in a step of conduction [-]."""

COORDINATION = {2: 6, 3: 12}
"""Most contacts of a grain among equal ones, by the dimension."""


def scene_conduction(scene: Scene, particles: ParticleSetup | None, steps: TimeSteps) -> Conduction | None:
    """What is compiled of it; None without."""
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


def conduction_numbers(
    scene: Scene, table: HeatTable, particles: ParticleSetup, number: Callable[[float | list[float]], Array]
) -> ConductionNumbers | None:
    """Its numbers, each made by `number`; None without."""
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
        surfaces += [wall.temperature] * len(surfaces_of(wall))
    return sides + surfaces


def _mesh_temperatures(scene: Scene) -> list[float | None]:
    """Of all walls that are meshes; None for one without a temperature."""
    return [wall.temperature for wall in scene.walls if wall.kind == "mesh"]
