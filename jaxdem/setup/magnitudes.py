"""Refuses scenes whose numbers the machine cannot hold: floats out of range, arrays beyond the memory. Host side."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from jaxdem.errors import InputError
from jaxdem.scene import Scene
from jaxdem.scene.particles import radius_key
from jaxdem.setup.bodies import Bodies

RANGE = {"float32": (1e-35, 1e35), "float64": (1e-280, 1e280)}
"""Sizes that a product of a scene's numbers may have: the range of the floats, with room for a factor of 1000."""

LONGEST_SIDE = 1e9
"""Of the box, in radii of the smallest particle: pairs of float32 then carry overlaps of millionths of the radius."""

LEAST_BYTES_PER_PARTICLE = 500
"""State, forces and neighbours of a particle in float32, measured by `jaxdem check`; a bound from below."""


class _Product(NamedTuple):
    key: str
    what: str
    unit: str
    value: float


def check_magnitudes(scene: Scene, bodies: Bodies) -> None:
    """Refuses what would be zero or infinite in the scene's precision, and then not a number.

    Args:
        scene: to look at.
        bodies: sizes and densities of its particles.

    Raises:
        InputError: naming the quantity.
    """
    _check_side(scene, bodies)
    low, high = RANGE[scene.precision]
    for key, what, unit, value in (*_of_particles(scene, bodies), *_of_fluid(scene)):
        if value != 0.0 and not low <= abs(value) <= high:
            remedy = "correct the value or its unit"
            if scene.precision == "float32":
                remedy += ', or use precision = "float64"'
            limit = f"gives {what} of {value:.3g} {unit}, which {scene.precision} cannot represent"
            raise InputError(key, _given(scene, key), limit, remedy)


def _check_side(scene: Scene, bodies: Bodies) -> None:
    if scene.particles is None or bodies.radius.size == 0:
        return
    radii = max(scene.domain.size) / float(np.min(bodies.radius))
    if radii > LONGEST_SIDE:
        limit = (
            f"a side is {radii:.3g} times the radius of the smallest particle; the limit is {LONGEST_SIDE:.0e} times"
        )
        raise InputError("domain.size", _given(scene, "domain.size"), limit, "correct the value or its unit")


def check_memory(scene: Scene) -> None:
    """Refuses arrays that are certainly larger than the memory of the machine.

    Raises:
        InputError: naming the number of cells or particles.
    """
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    width = 8 if scene.precision == "float64" else 4
    demands: list[tuple[str, object, int]] = []
    if scene.fluid is not None:
        # Velocities, pressure and void fraction; as many again while a step is computed.
        cells = math.prod(scene.fluid.cells)
        demands.append(("fluid.cells", scene.fluid.cells, 2 * cells * (scene.dimension + 2) * width))
    if scene.particles is not None:
        packs = enumerate(scene.particles.packs)
        counts = {f"{scene.particles.pack_key(k)}.count": pack.count for k, pack in packs}
        for key, count in ({"particles.count": scene.particles.count} | counts).items():
            demands.append((key, count, (count or 0) * LEAST_BYTES_PER_PARTICLE * width // 4))
    for key, value, needed in demands:
        if needed > memory:
            limit = f"needs at least {needed / 1e9:.3g} GB; this machine has {memory / 1e9:.3g} GB"
            raise InputError(key, value, limit, "lower it")


def _of_particles(scene: Scene, bodies: Bodies) -> Iterator[_Product]:
    contact = scene.contact
    if scene.particles is None or contact is None or 0 in (bodies.radius.size, bodies.density.size):
        return
    gravity = math.hypot(*scene.domain.strongest_gravity)
    key = radius_key(scene.particles)
    for pick in (np.min, np.max):
        radius, density = float(pick(bodies.radius)), float(pick(bodies.density))
        volume = 4.0 / 3.0 * math.pi * radius**3
        yield _Product(key, "a volume", "m3", volume)
        mass = volume * density
        yield _Product("particles.density", "a mass", "kg", mass)
        yield _Product(key, "a moment of inertia", "kg m2", 0.4 * mass * radius**2)
        yield _Product("domain.gravity", "a weight", "N", mass * gravity)
        if contact.law == "hertz_mindlin":
            moduli = [m.young_modulus or contact.young_modulus for m in scene.materials] or [contact.young_modulus]
            for modulus in (min(moduli), max(moduli)):
                force = modulus * radius**2
                yield _Product("contact.young_modulus", "contact forces", "N", force)
                yield _Product("contact.young_modulus", "accelerations", "m/s2", force / mass)
        else:
            for name in ("normal_stiffness", "tangential_stiffness"):
                force = (getattr(contact, name) or 0.0) * radius
                yield _Product(f"contact.{name}", "contact forces", "N", force)
                yield _Product(f"contact.{name}", "accelerations", "m/s2", force / mass)
        for name in ("friction", "rolling_friction"):
            yield _Product(f"contact.{name}", "a factor", "-", getattr(contact, name) ** 2)
        if scene.fluid is not None:
            drag = 6.0 * math.pi * scene.fluid.density * scene.fluid.viscosity * radius
            yield _Product("fluid.viscosity", "a drag coefficient", "kg/s", drag)
            yield _Product("fluid.viscosity", "a rate of drag", "1/s", drag / mass)


def _of_fluid(scene: Scene) -> Iterator[_Product]:
    fluid = scene.fluid
    if fluid is None:
        return
    spacing = [length / number for length, number in zip(scene.domain.size, fluid.cells, strict=True)]
    depth = (scene.domain.depth or 1.0) if scene.dimension == 2 else 1.0
    volume = math.prod(spacing) * depth
    yield _Product("domain.size", "cells", "m3", volume)
    for length in spacing:
        yield _Product("domain.size", "a curvature", "1/m2", length**-2)
        yield _Product("domain.size", "the square of a flux through a face", "m6", (volume / length) ** 2)
    yield _Product("fluid.density", "a mass of a cell", "kg", volume * fluid.density)
    yield _Product("fluid.viscosity", "a viscous rate", "1/s", fluid.viscosity / min(spacing) ** 2)
    for name in scene.sides:
        side = scene.boundary[name]
        for velocity in (side.velocity, *(side.velocities or ())):
            if isinstance(velocity, tuple):
                pressure = fluid.density * math.hypot(*velocity) ** 2
                yield _Product(f"boundary.{name}.velocity", "a dynamic pressure", "Pa", pressure)
    pressure = fluid.density * math.hypot(*(fluid.velocity or (0.0,))) ** 2
    yield _Product("fluid.velocity", "a dynamic pressure", "Pa", pressure)


def _given(scene: Scene, key: str) -> object:
    value: object = scene
    for part in key.split("."):
        value = value.get(part) if isinstance(value, dict) else getattr(value, part, None)
    return value
