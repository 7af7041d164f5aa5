"""The drive of a scene's fluid along periodic axes."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from jax import Array

from jaxdem.fluid.drive import Drive, DriveParameters
from jaxdem.scene import Scene
from jaxdem.scene.base import at_all_times
from jaxdem.scene.drive import is_driven
from jaxdem.scene.fluid import Fluid


def drive_of(scene: Scene, table: Fluid) -> Drive | None:
    """Which axes are driven; None where none is."""
    if not is_driven(table, scene.domain, scene.periodic):
        return None
    bulk = at_all_times(table.bulk_velocity)
    held = tuple(bool(bulk) and wraps and bulk[0][axis] != "free" for axis, wraps in enumerate(scene.periodic))
    return Drive(scene.periodic, held, table.drive_times)


def drive_parameters(scene: Scene, table: Fluid, number: Callable[[np.ndarray], Array]) -> DriveParameters | None:
    """Its numbers; 0 along an axis that is not held."""
    drive = drive_of(scene, table)
    if drive is None:
        return None
    shape = (scene.dimension,) if drive.times is None else (len(drive.times), scene.dimension)
    gradient = np.reshape(at_all_times(table.pressure_gradient) or np.zeros(shape), shape)
    if not any(drive.held):
        return DriveParameters(number(gradient))
    bulk = [[0.0 if value == "free" else value for value in row] for row in at_all_times(table.bulk_velocity)]
    return DriveParameters(number(gradient), number(np.reshape(bulk, shape)))


def bulk_speed(table: Fluid) -> float:
    """Largest bulk velocity that is held [m/s]."""
    rows = [[value for value in row if isinstance(value, float)] for row in at_all_times(table.bulk_velocity)]
    return max((math.hypot(*row) for row in rows), default=0.0)
