"""Refuses walls that stand on one another: a particle would feel each of them. Host side."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from jaxdem.errors import InputError
from jaxdem.numerics.host import on_device
from jaxdem.numerics.tables import Window
from jaxdem.particles.surfaces import Surface
from jaxdem.particles.wall_times import WallTimes
from jaxdem.particles.walls import BoxSide
from jaxdem.scene import Scene
from jaxdem.setup.walls import wall_keys

SAMPLES = 32
"""Points of the box at which surfaces are compared; a plane is known by D + 1 of them, a cylinder by a few more."""

NEAR = 0.01
"""Two walls count as one where they are nearer to each other than this part of a diameter, in all of the box [-]."""


def check_coincident(
    scene: Scene, sides: Sequence[BoxSide], surfaces: Sequence[Surface], times: WallTimes | None, diameter: float
) -> None:
    """Refuses a surface with the distance of a side of the box, or of another surface, everywhere in the box.

    A particle that touches both has two contacts where one is meant: twice the stiffness and twice the dashpot (a
    rebound of 0.157 for a restitution of 0.3, linear law). Surfaces that face opposite ways have opposite distances.

    Args:
        scene: that the walls belong to.
        sides: walls of the box.
        surfaces: walls beside it, those given as functions last.
        times: when each of these is there; None where all always are. Walls that are not there together may coincide.
        diameter: of the smallest particle [m].

    Raises:
        InputError: naming both walls.
    """
    if not surfaces:
        return
    box = scene.domain.size
    names = [key for key, _ in wall_keys(scene)]
    names += [f"the function {k} of walls" for k in range(len(surfaces) - len(names))]
    points = np.random.default_rng(0).uniform(0.0, 1.0, (SAMPLES, len(box))) * np.asarray(box)
    places, radius = (on_device(values, jnp.result_type(float)) for values in (points, 0.0))

    @jax.jit  # as one program: outside of jit every operation would be compiled by itself
    def distances() -> list[jax.Array]:
        return [-jax.vmap(surface.overlap, in_axes=(0, None))(places, radius) for surface in surfaces]

    earlier = []
    windows = [Window()] * len(surfaces) if times is None else times.windows[: len(surfaces)]
    for side in sides:
        name = f"the {scene.sides[2 * side.axis + (side.inward < 0)]} side of the box"
        earlier.append((name, side.inward * (points[:, side.axis] - side.coordinate), Window()))
    found = np.asarray(distances(), float)
    for name, surface, distance, window in zip(names, surfaces, found, windows, strict=True):
        for other, known, present in earlier:
            apart = float(np.max(np.abs(distance - known)))
            if apart < NEAR * diameter and window.meets(present):
                raise InputError(
                    name,
                    surface,
                    f"lies on {other} (at most {apart:.2g} m apart): a particle would touch both walls and rebound as "
                    f"from one wall of twice the stiffness and damping",
                    "remove one of them, or move them apart",
                )
        earlier.append((name, distance, window))
