"""The numbers of clumps that are traced: places of the members, and inertia."""

from __future__ import annotations

import numpy as np
from jax import Array

from jaxdem.numerics.host import on_device
from jaxdem.particles.clump_shape import Clumps
from jaxdem.setup.as_arrays import AsArrays
from jaxdem.setup.particles import ParticleSetup


def clump_numbers(particles: ParticleSetup, number: AsArrays) -> Clumps | None:
    """Members and inertia of bodies that are clumps; None where all are spheres."""
    table, bodies = particles.shapes, particles.bodies
    if table is None:
        return None
    offset, radius, part, there = table.padded(bodies.shape)
    size = np.atleast_1d(bodies.radius)[None]
    radius, offset = radius * size, offset * size[..., None]
    same = np.ndim(bodies.shape) == 0

    def of_shapes(values: list[float]) -> Array:
        return number(values[int(bodies.shape)] if same else np.asarray(values)[bodies.shape])

    templates = table.templates
    moments, axes = len(templates[0].inertia), len(templates[0].shadow)
    return Clumps(
        offset=tuple(number(offset[..., k]) for k in range(offset.shape[-1])),
        radius=number(radius.flat[0] if (radius == radius.flat[0]).all() else radius),
        inertia=tuple(of_shapes([float(one.inertia[k]) for one in templates]) for k in range(moments)),
        share=number(part),
        reach=of_shapes([one.reach for one in templates]),
        sphericity=of_shapes([one.sphericity for one in templates]),
        shadow=tuple(of_shapes([float(one.shadow[k]) for one in templates]) for k in range(axes)),
        there=None if there is None else on_device(there, bool),
    )
