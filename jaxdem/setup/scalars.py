"""Temperatures and other scalars of a scene: what is compiled, and the numbers."""

from __future__ import annotations

import math

import numpy as np
from jax import Array

from jaxdem.errors import InputError, required
from jaxdem.fluid.dissolved import MOST_BY_VOLUME, Phase
from jaxdem.fluid.interval import FluidInterval
from jaxdem.fluid.scalar_transport import ScalarField, ScalarNumbers, SideKind
from jaxdem.numerics.host import on_device
from jaxdem.scalars.nusselt import NUSSELT_LAWS, NusseltLaw
from jaxdem.scalars.scalar_state import FluidHeat, GrainHeat, ScalarParameters
from jaxdem.scalars.scalars import TEMPERATURE, Heat, Scalars
from jaxdem.scene import Scene
from jaxdem.scene.boundary import BoundarySide
from jaxdem.scene.heat import thermal_diffusivity
from jaxdem.setup.conduction import conduction_numbers, scene_conduction
from jaxdem.setup.particles import ParticleSetup
from jaxdem.setup.phases import largest_diffusivity, second_heat
from jaxdem.setup.scalar_walls import SurfacesOfScalars
from jaxdem.structure import TimeSteps

FOURIER, FOURIER_AMONG_GRAINS = 0.4, 0.2
"""Largest D t sum(1/h^2) of a step of a scalar [-]: Heun's method is stable up to 0.5 where the void fraction of a face
is that of its cells; at a front of grains it may be more than twice that of a cell."""

MOST_STEPS = 100_000
"""Of a scalar in a coupling interval: far more than a sensible scene takes."""

NO_SURFACES: tuple[SideKind, ...] = ()


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
        longest = FOURIER if particles is None else FOURIER_AMONG_GRAINS
        for name, diffusivity in _diffusivities(scene):
            fields.append(_scalar_field(scene, name, diffusivity, fluid, (steps.interval, longest), surfaces))
    heat = None
    if scene.heat is not None:
        table = scene.heat
        law = nusselt or NUSSELT_LAWS.get(table.exchange)
        heat = Heat(
            exchange=law if exchanges else None,
            conduction=scene_conduction(scene, particles, steps),
            expands=table.expansion != 0.0 or (scene.surface is not None and scene.surface.expansion != 0.0),
            bed=table.bed_conductivity,
        )
    return Scalars(tuple(fields), heat)


def _scalar_field(
    scene: Scene,
    name: str,
    diffusivity: float,
    fluid: FluidInterval,
    times: tuple[float, float],
    surfaces: SurfacesOfScalars | None,
) -> ScalarField:
    """A scalar of the fluid: its sides, and its steps in an interval.

    Args:
        scene: the scene.
        name: of the scalar.
        diffusivity: of it [m2/s].
        fluid: the fluid and its steps.
        times: the coupling interval [s], and the largest D t sum(1/h^2) of a step [-].
        surfaces: see `scene_scalars`.
    """
    interval, longest = times
    if name == TEMPERATURE:
        diffusivity = max(diffusivity, largest_diffusivity(scene))
    phase, finer, kinds = _phase(scene, name), 1, NO_SURFACES
    if phase is not None:
        longest = FOURIER / MOST_BY_VOLUME
    if surfaces is not None:
        kinds, longest = surfaces.kinds(name), longest * min(1.0, surfaces.smallest)
        finer = max(1, math.ceil(fluid.courant_limit / surfaces.smallest - 1e-9))
    number = diffusivity * interval * sum(1.0 / h**2 for h in fluid.solver.grid.spacing)
    count = max(1, math.ceil(number / longest))
    if count > MOST_STEPS:
        raise _too_many(scene, name, diffusivity, count)
    sides = tuple(_kind(scene.boundary[side], name) for side in scene.sides)
    return ScalarField(name, sides, diffusivity > 0.0, count, kinds, finer, phase or "both")


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
        grains = GrainHeat(number(table.particle_heat_capacity), conduction_numbers(scene, table, particles, number))
    return ScalarParameters(tuple(fields), fluid, grains, second=second_heat(scene, number))


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
