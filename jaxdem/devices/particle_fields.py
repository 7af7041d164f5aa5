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
}
"""Fields of `ParticleState` that every particle has an entry of, and along which axis of their arrays."""

KEPT = ("position", "position_low")
"""Fields of which a row without a particle has the values of another one, not zero."""

REFUSED = ("orientation", "orientation_low")
"""Fields of scenes that `refused` turns away."""


def of_each(particles: ParticleState, of: Callable[[Any, int, str], Any]) -> dict[str, Any]:
    """Fields that every particle has an entry of, each array changed by `of(array, axis of the particles, field)`."""

    def changed(name: str, axis: int) -> Any:
        return jax.tree.map(lambda rows: of(rows, axis, name), getattr(particles, name))

    return {name: changed(name, axis) for name, axis in AXIS_OF_PARTICLES.items()}
