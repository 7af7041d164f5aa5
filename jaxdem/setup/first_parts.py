"""What parts of a scene keep beside position and motion of the particles, at its start: new, or of the run before."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from jaxdem.particles.bond_state import BondState
from jaxdem.particles.integrate import ParticleState
from jaxdem.particles.wear import WornMesh
from jaxdem.scene import Scene
from jaxdem.setup.bonds import bond_state
from jaxdem.setup.particles import ParticleSetup
from jaxdem.setup.pistons import first_pistons
from jaxdem.setup.start_point import StartPoint
from jaxdem.setup.started_meshes import wear_of_meshes
from jaxdem.setup.wear import not_worn


class Begun(NamedTuple):
    """What the first state of a part is made from.

    Attributes:
        scene: that begins.
        particles: of it.
        total: number of particles that there ever are.
        dtype: of the arrays.
        start: the run that the scene begins from; None where it begins at t = 0.
    """

    scene: Scene
    particles: ParticleSetup
    total: int
    dtype: np.dtype[np.floating]
    start: StartPoint | None = None


def _bonds(begun: Begun) -> BondState | None:
    bonds = begun.particles.bonds
    return None if bonds is None else bond_state(bonds, begun.total, begun.dtype)


def _wear(begun: Begun) -> tuple[WornMesh | None, ...]:
    new = not_worn(begun.particles.meshes, begun.dtype)
    return new if begun.start is None else wear_of_meshes(begun.start, begun.scene, begun.particles.meshes, new)


FIRST: dict[str, Callable[[Begun], Any]] = {
    "pistons": lambda begun: first_pistons(begun.scene, begun.particles.meshes, begun.dtype, begun.start),
    "bonds": _bonds,
    "mesh_wear": _wear,
}
"""By the field of `ParticleState`."""


def with_parts(state: ParticleState, begun: Begun) -> ParticleState:
    """The particles with what every part keeps of them at the start."""
    return state._replace(**{name: first(begun) for name, first in FIRST.items()})
