"""The fields of `ParticleState`, as slabs have them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax

from jaxdem.particles.integrate import ParticleState

AXIS_OF_PARTICLES = {
    "position": 0,
    "position_low": 0,
    "velocity": 0,
    "angular_velocity": 0,
    "wall_spring": 1,
    "contact_force": 0,
    "fluid_force": 0,
    "fluid_memory": -2,
    "liquid": 0,
    "orientation": 0,
    "orientation_low": 0,
}
"""Fields of `ParticleState` that every particle has an entry of, and along which axis of their arrays."""

OF_MEMBERS = ("wall_spring",)
"""Fields of which every member of a clump has an entry."""

KEPT = ("position", "position_low")
"""Fields of which a row without a particle has the values of another one, not zero."""


def of_each(particles: ParticleState, of: Callable[[Any, int, str], Any]) -> dict[str, Any]:
    """Fields that every particle has an entry of, each array changed by `of(array, axis of the particles, field)`.

    Springs at walls, (..., S, m N) of the members of clumps, are given to it as (..., S m, N).
    """
    count = particles.position.shape[-2]

    def changed(name: str, axis: int) -> Any:
        def one(rows: Any) -> Any:
            if name not in OF_MEMBERS or rows.shape[-1] == count:
                return of(rows, axis, name)
            *slabs, walls, own = rows.shape
            found = of(rows.reshape(*slabs, walls * own // count, count), axis, name)
            return found.reshape(*found.shape[:-2], walls, own // count * found.shape[-1])

        return jax.tree.map(one, getattr(particles, name))

    return {name: changed(name, axis) for name, axis in AXIS_OF_PARTICLES.items()}
