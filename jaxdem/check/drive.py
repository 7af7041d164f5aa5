"""Whether the drive of a box that is periodic on all sides carries what is in it."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from jaxdem.scene.base import at_all_times
from jaxdem.setup.builder import Case
from jaxdem.setup.parcels import share_of_sphere

UNCARRIED = 0.01
"""Part of the weight that may be left over without a word."""


def drive_cautions(case: Case) -> Iterator[str]:
    """A sentence where a constant pressure gradient does not carry grains and fluid, and no wall takes the rest.

    The sum of all forces on a volume is -grad p + g (s rho_p + (1 - s) rho), s the solid fraction; it has to be zero.
    """
    scene, fluid, setup = case.scene, case.scene.fluid, case.particles
    if fluid is None or setup is None or scene.walls or scene.surface is not None or not all(scene.periodic):
        return
    rows, gravity = at_all_times(fluid.pressure_gradient), np.asarray(scene.domain.gravity, float)
    if len(rows) != 1 or gravity.ndim != 1 or fluid.bulk_velocity is not None or scene.comes_and_goes:
        return
    box = math.prod(scene.domain.size) * (scene.domain.depth or 1.0)
    share = share_of_sphere(setup.table.coarse_grain, scene.dimension)
    each = share * 4.0 / 3.0 * np.pi * np.broadcast_to(setup.bodies.radius, setup.count) ** 3
    mass = float(np.sum(each * setup.bodies.density)) + fluid.density * (box - float(np.sum(each)))
    carries = gravity * mass / box
    rest = np.abs(carries - np.asarray(rows[0])).max()
    if rest > UNCARRIED * np.abs(carries).max() > 0.0:
        wanted, gain = ", ".join(f"{value:.6g}" for value in carries), rest * box / mass
        yield (
            "fluid.pressure_gradient: no wall takes what it leaves of the weight of grains and fluid, which gain "
            f"{gain:.3g} m/s every second. It carries them with [{wanted}] Pa/m."
        )
