"""The tables `[heat]` and `[[scalars]]`, and the temperatures that other tables give."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

from pydantic import Field

from jaxdem.errors import InputError, number_of_tables
from jaxdem.scene.base import Finite, NonNegative, Positive, Section
from jaxdem.scene.boundary import BoundarySide
from jaxdem.scene.inlets import ParticleInlet
from jaxdem.scene.openings import Opening
from jaxdem.scene.particles import Particles
from jaxdem.scene.unread import ReadWith
from jaxdem.scene.walls import Wall

IN_FLUID, AMONG_PARTICLES = ReadWith("fluid"), ReadWith("particles")
"""What reads keys of heat between both."""

TAKEN = ("temperature", "velocity", "pressure", "void_fraction", "liquid_fraction", "time", "id", "active", "radius")
"""Names of arrays of a frame that no scalar may have."""

OF_FLUID = {
    "fluid_heat_capacity": "the heat capacity of the fluid [J/(kg K)]",
    "fluid_conductivity": "the thermal conductivity of the fluid [W/(m K)]",
    "fluid_temperature": "the temperature of the fluid at the start",
}
OF_PARTICLES = {
    "particle_heat_capacity": "the heat capacity of the particles [J/(kg K)]",
    "particle_temperature": "the temperature of the particles at the start",
}


class Heat(Section):
    """Temperatures of fluid and particles. Any scale of temperature will do whose degrees are kelvins.

    Attributes:
        fluid_heat_capacity: heat capacity of the fluid at constant pressure [J/(kg K)].
        fluid_conductivity: thermal conductivity of the fluid [W/(m K)].
        fluid_temperature: temperature of the fluid at the start [K].
        expansion: thermal expansion coefficient of the fluid: where it is warmer than `reference_temperature`, it is
            lighter and rises (Boussinesq's approximation). Default: 0, no buoyancy [1/K].
        reference_temperature: temperature at which the fluid has its density. Default: `fluid_temperature` [K].
        exchange: law of the heat transfer between particles and fluid: "gunn" (beds and single spheres),
            "ranz_marshall" (single spheres) or "none".
        bed_conductivity: conductivity of the fluid between particles: "kuipers" (the part of a bed through which heat
            goes by the fluid alone) or "open" (in proportion to its volume).
        particle_heat_capacity: heat capacity of the particles [J/(kg K)].
        particle_temperature: temperature of the particles at the start [K].
        particle_conductivity: thermal conductivity of the particles. With it heat is conducted through contacts.
            Default: no conduction through contacts [W/(m K)].
        wall_conductivity: thermal conductivity of walls that have a temperature. Default: `particle_conductivity`
            [W/(m K)].
        true_young_modulus: Young's modulus of the real particles, which softened ones have less of: contact areas are
            those of the real ones. Needed with `particle_conductivity` [Pa].
        friction: whether what contacts and bonds take from the motion warms the particles: dashpots, sliding, rolling,
            liquid and cohesion. Half of it goes to either of two particles, all of it to one that touches a wall.
            Default: false.
    """

    fluid_heat_capacity: Positive | None = None
    fluid_conductivity: Positive | None = None
    fluid_temperature: Finite | None = None
    expansion: Finite = 0.0
    reference_temperature: Finite | None = None
    exchange: Annotated[Literal["gunn", "ranz_marshall", "none"], IN_FLUID, AMONG_PARTICLES] = "gunn"
    bed_conductivity: Annotated[Literal["kuipers", "open"], IN_FLUID, AMONG_PARTICLES] = "kuipers"
    particle_heat_capacity: Positive | None = None
    particle_temperature: Finite | None = None
    particle_conductivity: Positive | None = None
    wall_conductivity: Positive | None = None
    true_young_modulus: Positive | None = None
    friction: Annotated[bool, Field(strict=True)] = False


class Scalar(Section):
    """A scalar that the fluid carries and that does not act on it: a dye, a species.

    Attributes:
        name: of its array in frames, and of its value at a side in `boundary.<side>.scalars`.
        diffusivity: of it in the fluid [m2/s].
        value: everywhere at the start.
        dissolved_in: with `[surface]`, the fluid that it stays in: "liquid", "second", or "both", between which it
            passes freely.
    """

    name: Annotated[str, Field(strict=True, pattern=r"^[a-z][a-z0-9_]{0,39}$")]
    diffusivity: NonNegative = 0.0
    value: Finite = 0.0
    dissolved_in: Annotated[Literal["liquid", "second", "both"], ReadWith("surface")] = "liquid"


def check_heat(
    heat: Heat | None,
    scalars: Sequence[Scalar],
    boundary: Mapping[str, BoundarySide],
    walls: Sequence[Wall],
    particles: Particles | None,
    has_fluid: bool,
    several_materials: bool,
) -> None:
    """Refuses temperatures and scalars that do not fit the rest of a scene.

    Raises:
        InputError: naming the key.
    """
    inlets = () if particles is None else particles.inlet
    _check_given(heat, boundary, walls, inlets)
    if heat is not None:
        _check_numbers(heat, has_fluid, particles is not None)
        _check_conduction(heat, several_materials)
        if particles is not None and particles.coarse_grain != 1.0:
            limit = "means parcels, and [heat] has no rule for them"
            raise InputError("particles.coarse_grain", particles.coarse_grain, limit, "set it to 1, or remove [heat]")
    _check_scalars(scalars, has_fluid)
    names = [scalar.name for scalar in scalars]
    for side, table in boundary.items():
        _check_side(f"boundary.{side}", table, heat is not None and has_fluid, names)
        if table.temperature is not None and not has_fluid and not _conducts(heat):
            limit = "without a fluid a side heats grains by contact alone, and contacts conduct nothing"
            remedy = "set heat.particle_conductivity, or remove it"
            raise InputError(f"boundary.{side}.temperature", table.temperature, limit, remedy)
    for k, wall in enumerate(walls):
        _check_wall(f"walls.{k}", wall, heat, has_fluid and (heat is not None or bool(scalars)))
        for n, opening in enumerate(wall.opening or ()):
            _check_opening(f"walls.{k}.opening.{n}", opening, heat is not None, names)


def check_reference(heat: Heat | None, of_second: float) -> None:
    """Refuses a reference temperature where nothing expands; `of_second` is the expansion of a second fluid.

    Raises:
        InputError: naming the key.
    """
    if heat is not None and heat.reference_temperature is not None and heat.expansion == of_second == 0.0:
        limit = "is not used with heat.expansion = 0"
        raise InputError("heat.reference_temperature", heat.reference_temperature, limit, "set heat.expansion")


def _check_wall(key: str, wall: Wall, heat: Heat | None, carries: bool) -> None:
    """Refuses what a wall cannot be to heat and scalars; `carries` where the fluid has any."""
    if wall.heat_flux is not None:
        if wall.temperature is not None:
            limit = "a wall has a temperature or a heat flux"
            raise InputError(f"{key}.heat_flux", wall.heat_flux, limit, "remove one of them")
        if not wall.seen_by_fluid:
            limit = "a heat flux goes into the fluid, which does not see this wall; grains take its temperature"
            raise InputError(f"{key}.heat_flux", wall.heat_flux, limit, 'set fluid = "no_slip", or give a temperature')
    if wall.temperature is not None and not wall.seen_by_fluid and not _conducts(heat):
        limit = "walls that the fluid does not see heat grains by contact alone, and contacts conduct nothing"
        raise InputError(f"{key}.temperature", wall.temperature, limit, "set heat.particle_conductivity, or remove it")
    given = {name: getattr(wall, name) for name in ("begin", "end") if getattr(wall, name) is not None}
    for name, value in given.items():
        if carries and wall.seen_by_fluid:
            limit = "the fluid that comes and goes with a wall has no temperature and no scalars of its own"
            remedy = 'move the wall by walls.motion, set fluid = "none", or remove [heat] and [[scalars]]'
            raise InputError(f"{key}.{name}", value, limit, remedy)


def _conducts(heat: Heat | None) -> bool:
    """Whether contacts do."""
    return heat is not None and heat.particle_conductivity is not None


def _check_given(
    heat: Heat | None, boundary: Mapping[str, BoundarySide], walls: Sequence[Wall], inlets: Sequence[ParticleInlet]
) -> None:
    """Temperatures need a table `[heat]`."""
    given: dict[str, float | None] = {}
    for side, table in boundary.items():
        given |= {f"boundary.{side}.temperature": table.temperature, f"boundary.{side}.heat_flux": table.heat_flux}
    for k, wall in enumerate(walls):
        given |= {f"walls.{k}.temperature": wall.temperature, f"walls.{k}.heat_flux": wall.heat_flux}
        openings = enumerate(wall.opening or ())
        given |= {f"walls.{k}.opening.{n}.temperature": opening.temperature for n, opening in openings}
    given |= {f"particles.inlet.{k}.temperature": inlet.temperature for k, inlet in enumerate(inlets)}
    for key, value in given.items():
        if value is not None and heat is None:
            raise InputError(key, value, "the scene has no temperatures", "add [heat], or remove this key")


def _check_numbers(heat: Heat, has_fluid: bool, has_particles: bool) -> None:
    for there, keys, part in ((has_fluid, OF_FLUID, "fluid"), (has_particles, OF_PARTICLES, "particles")):
        for name, meaning in keys.items():
            value = getattr(heat, name)
            if there and value is None:
                raise InputError(f"heat.{name}", None, f"is needed in a scene with [{part}]: {meaning}", "set it")
            if not there and value is not None:
                raise InputError(f"heat.{name}", value, f"the scene has no [{part}]", "remove this key")
    if not has_fluid:
        for name in ("expansion", "reference_temperature"):
            if getattr(heat, name):
                raise InputError(f"heat.{name}", getattr(heat, name), "the scene has no [fluid]", "remove this key")
    for name in () if has_particles else ("particle_conductivity", "friction"):
        if getattr(heat, name):
            raise InputError(f"heat.{name}", getattr(heat, name), "the scene has no [particles]", "remove this key")


def _check_conduction(heat: Heat, several_materials: bool) -> None:
    if heat.particle_conductivity is None:
        for name in ("wall_conductivity", "true_young_modulus"):
            if getattr(heat, name) is not None:
                limit = "is not used without heat.particle_conductivity"
                raise InputError(f"heat.{name}", getattr(heat, name), limit, "remove this key")
        return
    if heat.true_young_modulus is None:
        limit = "is needed with heat.particle_conductivity: softened particles overlap, and conduct, too much"
        raise InputError("heat.true_young_modulus", None, limit, "set Young's modulus of the real particles [Pa]")
    if several_materials:
        limit = "conduction through contacts is for particles of one material"
        raise InputError("heat.particle_conductivity", heat.particle_conductivity, limit, "remove [[materials]]")


def _check_scalars(scalars: Sequence[Scalar], has_fluid: bool) -> None:
    if scalars and not has_fluid:
        raise InputError("scalars", number_of_tables(scalars), "need [fluid], which carries them", "add [fluid]")
    names = [scalar.name for scalar in scalars]
    for k, name in enumerate(names):
        if name in TAKEN or name.endswith("_force") or name in names[:k]:
            limit = "is the name of another array of a frame"
            raise InputError(f"scalars.{k}.name", name, limit, "take another name")


def _check_side(key: str, side: BoundarySide, has_heat: bool, names: Sequence[str]) -> None:
    given = _known_scalars(key, side.scalars, names)
    if side.kind == "periodic" and (given or side.temperature is not None or side.heat_flux is not None):
        raise InputError(key, "periodic", "has no temperature and no scalars of its own", "remove these keys")
    if side.temperature is not None and side.heat_flux is not None:
        raise InputError(f"{key}.heat_flux", side.heat_flux, "a side has a temperature or a heat flux", "remove one")
    if side.heat_flux is not None and side.kind in ("inlet", "outlet"):
        limit = f"a side of kind {side.kind} has a temperature and no heat flux"
        raise InputError(f"{key}.heat_flux", side.heat_flux, limit, "remove this key")
    if side.heat_flux is not None and not has_heat:
        limit = "a heat flux goes into the fluid, and the scene has none"
        raise InputError(f"{key}.heat_flux", side.heat_flux, limit, "add [fluid], or give a temperature")
    if side.kind == "inlet":
        _check_brought(key, has_heat and side.temperature is None, given, names)


def _known_scalars(key: str, scalars: Mapping[str, float] | None, names: Sequence[str]) -> dict[str, float]:
    """Values of scalars by name; refuses those of others."""
    given = dict(scalars or {})
    for name in given:
        if name not in names:
            limit = "there is no such scalar in [[scalars]]"
            raise InputError(f"{key}.scalars", name, limit, f"known: {', '.join(names) or 'none'}")
    return given


def _check_brought(key: str, lacks_temperature: bool, given: Mapping[str, float], names: Sequence[str]) -> None:
    """Refuses an inlet without what its fluid brings."""
    if lacks_temperature:
        limit = "is needed by an inlet: the temperature with which the fluid comes in"
        raise InputError(f"{key}.temperature", None, limit, "set it")
    for name in names:
        if name not in given:
            limit = f"an inlet needs the value with which {name} comes in"
            raise InputError(f"{key}.scalars", None, limit, f"set {key}.scalars = {{{name} = ...}}")


def _check_opening(key: str, opening: Opening, has_heat: bool, names: Sequence[str]) -> None:
    """Refuses an opening that does not fit what the fluid carries."""
    given = _known_scalars(key, opening.scalars, names)
    if opening.brings:
        _check_brought(key, has_heat and opening.temperature is None, given, names)
    elif given or opening.temperature is not None:
        name = "scalars" if given else "temperature"
        limit = "is that of what comes in, and nothing comes in through this opening"
        raise InputError(f"{key}.{name}", getattr(opening, name), limit, "remove this key")


def thermal_diffusivity(heat: Heat, density: float) -> float:
    """Thermal diffusivity of the fluid of a scene that has one, k / (rho c) [m2/s]."""
    if heat.fluid_conductivity is None or heat.fluid_heat_capacity is None:
        return math.nan
    return heat.fluid_conductivity / (density * heat.fluid_heat_capacity)
