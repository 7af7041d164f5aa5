"""Numbers of a scene that look as if they were in another unit. All are possible; a warning says what is likely."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from jaxdem.numerics.axes import AXES
from jaxdem.scene import Scene
from jaxdem.scene.contact import Contact
from jaxdem.scene.particles import radius_key, radius_range
from jaxdem.scene.sizes import column

LARGE_GRAIN = 0.25
"""Radius from which grains are more likely given in mm [m]."""

LONG_BOX = 100.0
"""Side from which a box is more likely given in mm, where it is `MANY_DIAMETERS` long too [m]."""

MANY_DIAMETERS = 5000.0

LIGHT, HEAVY = 23.0, 23_000.0
"""Densities between which all solid grains lie: from foam to osmium (22,590) [kg/m3]."""

SOFT, STIFF = 1e5, 1.3e12
"""Young's moduli between which solids lie, softened ones included: a soft gel, diamond [Pa]."""

THIN = 3e-6
"""Dynamic viscosity below which there is no fluid at room temperature; that of gases is 8e-6 and more [Pa s]."""

ANGLES = (5.0, 80.0)
"""Coefficients of friction that are more likely an angle in degrees [-]."""

EARTH = 9.81
"""Gravity [m/s2]."""

THIN_GAS = 0.02
"""Density below which no gas is at the pressure of the atmosphere; that of hydrogen is 0.084 [kg/m3]."""

LEAST_CAPACITY = 60.0
"""Heat capacity below that of all matter at room temperature; that of uranium is 116 [J/(kg K)]."""

LARGEST_TENSION = 2.0
"""Surface tension above that of all liquids; that of molten iron is 1.8 [N/m]."""

FAST_FLUID, FAST_GRAIN = 100.0, 300.0
"""Speeds from which mm/s are more likely; at 100 m/s gases are compressible [m/s]."""

PHASES = ("fluid", "particle")
"""What has a heat capacity in `[heat]`."""


class Fluid(NamedTuple):
    """A fluid at 20 degrees: name, density [kg/m3], dynamic [Pa s] and kinematic viscosity [m2/s]."""

    name: str
    density: float
    dynamic: float
    kinematic: float


WATER, AIR = Fluid("water", 998.0, 1.0e-3, 1.0e-6), Fluid("air", 1.2, 1.8e-5, 1.5e-5)

MISTAKEN = {
    WATER: (("dynamic, in Pa s", 1e-3), ("in St (cm2/s)", 1e-2), ("in cSt (mm2/s) or cP", 1.0)),
    AIR: (
        ("dynamic, in P", 1.8e-4),
        ("dynamic, in cP", 1.8e-2),
        ("in St (cm2/s)", 0.15),
        ("in cSt (mm2/s)", 15.0),
    ),
}
"""What the viscosity of a fluid is in other units."""


def unit_warnings(scene: Scene) -> tuple[str, ...]:
    """Sentences, each with key, value and what was likely meant."""
    return (
        *_lengths(scene), *_gravity(scene), *_densities(scene), *_moduli(scene), *_friction(scene), *_viscosity(scene),
        *_speeds(scene), *_heat(scene), *_tensions(scene),
    )  # fmt: skip


def _warning(key: str, value: float, unit: str, why: str, meant: str) -> str:
    return f"{f'{key} = {value:.6g} {unit}'.rstrip()}: {why}. If it is {meant}."


def _lengths(scene: Scene) -> Iterator[str]:
    if scene.particles is None:
        return
    smallest, largest = radius_range(scene.particles)
    longest = max(scene.domain.size)
    grain = largest / scene.particles.coarse_grain
    if grain >= LARGE_GRAIN:
        meant = f"in mm, write {grain / 1e3:.6g} (in cm, {grain / 100.0:.6g}), and change the other lengths too"
        why = f"this is a grain of {2.0 * grain:.3g} m diameter"
        yield _warning(radius_key(scene.particles), grain, "m", why, meant)
    if longest >= LONG_BOX and longest >= MANY_DIAMETERS * 2.0 * smallest:
        why = f"this box is {longest / (2.0 * smallest):.3g} diameters long"
        yield _warning("domain.size", longest, "m", why, f"in mm, write {longest / 1e3:.6g}")
    gravity = math.hypot(*scene.domain.strongest_gravity)
    for unit, factor in (("mm/s2", 1e3), ("cm/s2", 100.0)):
        if abs(gravity / (EARTH * factor) - 1.0) < 0.05:
            why = f"this is {factor:.0f} times the gravity of the earth"
            yield _warning("domain.gravity", gravity, "m/s2", why, f"in {unit}, write {gravity / factor:.6g}")


def _gravity(scene: Scene) -> Iterator[str]:
    upwards = scene.domain.strongest_gravity[-1]
    if upwards > 0.0:
        yield _warning("domain.gravity", upwards, "m/s2", "the last axis points up", f"downwards, write {-upwards:.6g}")
    for axis, part in enumerate(scene.domain.strongest_gravity[:-1]):
        alone = abs(part) == math.hypot(*scene.domain.strongest_gravity)
        if alone and abs(part / -EARTH - 1.0) < 0.01 and not scene.periodic[axis]:
            why = f"it is along {AXES[scene.dimension][axis]}, and the last axis points up"
            downwards = [0.0] * (scene.dimension - 1) + [part]
            yield _warning("domain.gravity", part, "m/s2", why, f"downwards, write {downwards}")


def _friction(scene: Scene) -> Iterator[str]:
    tables = {"contact": scene.contact, **{f"materials.{k}": one for k, one in enumerate(scene.materials)}}
    for table, constants in tables.items():
        for name in ("friction", "wall_friction"):
            value = getattr(constants, name, None)
            if value is not None and ANGLES[0] <= value <= ANGLES[1]:
                meant = f"an angle in degrees, write {math.tan(math.radians(value)):.3g}"
                yield _warning(f"{table}.{name}", value, "", "dry solids have less than 2", meant)


def _densities(scene: Scene) -> Iterator[str]:
    found: list[tuple[str, float]] = []
    if scene.particles is not None:
        given = [(f"particles.species.{k}.density", s.density) for k, s in enumerate(scene.particles.species)]
        for k, pack in enumerate(scene.particles.packs):
            key = scene.particles.pack_key(k)
            given.append((f"{key}.density", pack.density))
            given += [(f"{key}.species.{j}.density", s.density) for j, s in enumerate(pack.species or ())]
        if scene.particles.own("density") is not None:
            densities = column("particles.density", scene.particles.own("density"))
            given += [
                ("particles.density", float(densities.min())),
                ("particles.density", float(densities.max())),
            ]
        found = list(dict.fromkeys((key, value) for key, value in given if value is not None))
    for key, value in found:
        if value < LIGHT:
            yield _warning(key, value, "kg/m3", "this is lighter than foam", f"in g/cm3, write {value * 1e3:.6g}")
        elif value > HEAVY:
            yield _warning(key, value, "kg/m3", "this is denser than any metal", f"in g/m3, write {value / 1e3:.6g}")
    fluid = scene.fluid
    if fluid is None or fluid.viscosity == 0.0:
        return
    unlikely = 0.5 <= fluid.density <= 2.0 or fluid.density <= THIN_GAS
    if fluid.density * fluid.viscosity < THIN and unlikely:
        why = f"its dynamic viscosity would be {fluid.density * fluid.viscosity:.2g} Pa s, less than that of any gas"
        yield _warning("fluid.density", fluid.density, "kg/m3", why, f"in g/cm3, write {fluid.density * 1e3:.6g}")
    elif fluid.density > HEAVY:
        meant = f"in g/m3, write {fluid.density / 1e3:.6g}"
        yield _warning("fluid.density", fluid.density, "kg/m3", "this is denser than any liquid", meant)


def _moduli(scene: Scene) -> Iterator[str]:
    contact = scene.contact
    if contact is None or contact.law != "hertz_mindlin":
        return
    given: list[tuple[str, object]] = [("contact.young_modulus", contact.young_modulus)]
    if contact.wall_young_modulus != contact.young_modulus:
        given.append(("contact.wall_young_modulus", contact.wall_young_modulus))
    if scene.materials:
        given = [(f"materials.{k}.young_modulus", m.young_modulus) for k, m in enumerate(scene.materials)]
    for key, value in given:
        if not isinstance(value, float):
            continue
        # Who lets grains overlap by more than the default has soft contacts on purpose.
        if value < SOFT and contact.maximum_overlap <= Contact.model_fields["maximum_overlap"].default:
            meant = [f"{unit}, write {value * f:.3g}" for unit, f in _multiples(value)]
            yield _warning(key, value, "Pa", "this is softer than any solid grain", "in " + "; in ".join(meant))
        elif value > STIFF:
            yield _warning(key, value, "Pa", "this is stiffer than diamond", f"in mPa, write {value / 1e3:.3g}")


def _multiples(modulus: float) -> list[tuple[str, float]]:
    """Units that make a modulus one of a solid."""
    units = [("GPa", 1e9), ("MPa", 1e6), ("kPa", 1e3)]
    return [(unit, f) for unit, f in units if 1e6 <= modulus * f <= STIFF] or [units[0]]


def _viscosity(scene: Scene) -> Iterator[str]:
    fluid = scene.fluid
    if fluid is None:
        return
    for known, mistaken in MISTAKEN.items():
        if not 0.8 <= fluid.density / known.density <= 1.25:
            continue
        for unit, value in mistaken:
            if 0.7 <= fluid.viscosity / value <= 1.4:
                why = f"this is {fluid.viscosity / known.kinematic:,.0f} times the kinematic viscosity of {known.name}"
                meant = f"that of {known.name} {unit}, write {known.kinematic:.2g}"
                yield _warning("fluid.viscosity", fluid.viscosity, "m2/s", why, meant)


def _heat(scene: Scene) -> Iterator[str]:
    given = {} if scene.heat is None else {name: getattr(scene.heat, f"{name}_heat_capacity") for name in PHASES}
    found = {f"heat.{name}_heat_capacity": value for name, value in given.items()}
    if scene.surface is not None:
        found["surface.heat_capacity"] = scene.surface.heat_capacity
    for key, value in found.items():
        if value is not None and value < LEAST_CAPACITY:
            why = "this is less than that of any matter"
            yield _warning(key, value, "J/(kg K)", why, f"in kJ/(kg K), write {value * 1e3:.6g}")


def _tensions(scene: Scene) -> Iterator[str]:
    cohesion = None if scene.contact is None else scene.contact.cohesion
    found = {
        "contact.cohesion.surface_tension": None if cohesion is None else cohesion.surface_tension,
        "surface.tension": None if scene.surface is None else scene.surface.tension,
    }
    for key, value in found.items():
        if value is not None and value > LARGEST_TENSION:
            why = "this is more than that of any liquid"
            yield _warning(key, value, "N/m", why, f"in mN/m, write {value / 1e3:.6g}")


def _speeds(scene: Scene) -> Iterator[str]:
    found: list[tuple[str, float, float]] = []
    for name in scene.sides:
        side = scene.boundary[name]
        for velocity in (side.velocity, *(side.velocities or ())):
            if isinstance(velocity, tuple):
                found.append((f"boundary.{name}.velocity", math.hypot(*velocity), FAST_FLUID))
    if scene.fluid is not None and scene.fluid.velocity is not None:
        found.append(("fluid.velocity", math.hypot(*scene.fluid.velocity), FAST_FLUID))
    if scene.particles is not None:
        for row in scene.particles.velocity if isinstance(scene.particles.velocity, tuple) else ():
            found.append(("particles.velocity", math.hypot(*row), FAST_GRAIN))
        for k, inlet in enumerate(scene.particles.inlet):
            if isinstance(inlet.velocity, tuple):
                found.append((f"particles.inlet.{k}.velocity", math.hypot(*inlet.velocity), FAST_GRAIN))
    if scene.contact is not None and isinstance(scene.contact.speed, float):
        found.append(("contact.speed", scene.contact.speed, FAST_GRAIN))
    largest: dict[str, tuple[float, float]] = {}
    for key, speed, limit in found:
        largest[key] = max(largest.get(key, (0.0, limit)), (speed, limit))
    for key, (speed, limit) in largest.items():
        if speed >= limit:
            why = "this is about the speed of sound in air" if speed < 400.0 else "this is faster than sound in air"
            if speed < 300.0:
                why = "at this speed a gas is compressible, but the fluid here is not"
            yield _warning(key, speed, "m/s", why, f"in mm/s, write {speed / 1e3:.6g}")
