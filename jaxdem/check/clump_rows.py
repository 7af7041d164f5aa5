"""What `jaxdem check` tells of clumps."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from jaxdem.setup.particles import ParticleSetup


def clump_rows(particles: ParticleSetup | None) -> tuple[tuple[str, str], ...]:
    """A row for every shape that particles have; none of spheres."""
    return () if particles is None or particles.shapes is None else tuple(_rows(particles))


def _rows(particles: ParticleSetup) -> Iterator[tuple[str, str]]:
    table = particles.shapes
    assert table is not None
    shape = np.broadcast_to(particles.bodies.shape, particles.total)
    for number, count in zip(*np.unique(shape, return_counts=True), strict=True):
        one = table.templates[number]
        if len(one.radii) == 1 and not one.within:
            continue
        text = f"{count}; {len(one.radii)} spheres, sphericity {one.sphericity:.3f}, "
        text += f"outer radius {one.reach:.3g} times particles.radius"
        if one.within:
            text += f"; {one.within} more lie within others and are left out"
        yield f"clumps, {table.names[number]}", text
