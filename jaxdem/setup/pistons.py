"""Where walls that a force holds are at the start of a scene. Host side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxdem.errors import InputError, number_of_tables
from jaxdem.numerics.host import on_device
from jaxdem.particles.moving_walls import PistonState
from jaxdem.scene import Scene
from jaxdem.setup.meshes import WallMesh
from jaxdem.setup.start_point import StartPoint, piston_texts, wall_texts


def first_pistons(
    scene: Scene, meshes: Sequence[WallMesh], dtype: np.dtype[np.floating], start: StartPoint | None
) -> PistonState | None:
    """Those of the run before go on, others begin at rest where the scene has them; None without.

    Args:
        scene: that begins.
        meshes: its walls that are meshes.
        dtype: of the arrays.
        start: the run before; None where the scene begins at t = 0.

    Raises:
        InputError: a wall was a piston, has moved, and is none any more.
    """
    now = piston_texts(scene, meshes)
    arrays, before = ({}, []) if start is None else (start.arrays, start.pistons)
    for number, text in enumerate(before):
        moved = float(arrays["state.particles.pistons.displacement"][number])
        if moved != 0.0 and text not in now:
            there, remedy = wall_texts(scene, meshes), "give the wall its piston again, or begin without [start]"
            if text in there:
                limit = f"was a piston in the run before and has moved by {moved:.6g} m: the wall would jump back"
                raise InputError(f"walls.{there.index(text)}.piston", None, limit, remedy)
            limit = f"has no wall at the place of the piston {text} of the run before, which has moved by {moved:.6g} m"
            raise InputError("walls", number_of_tables(there), limit, remedy)
    if not now:
        return None
    values: dict[str, Any] = {}
    for name in PistonState._fields:
        column, given = np.zeros(len(now)), arrays.get(f"state.particles.pistons.{name}")
        for number, text in enumerate(now):
            if given is not None and text in before:
                column[number] = given[before.index(text)]
        values[name] = on_device(column, dtype)
    if dtype == np.float64:
        values["displacement_low"] = None
    if not any(wall.piston is not None and wall.seen_by_fluid for wall in scene.walls):
        values["seen_velocity"] = None
    return PistonState(**values)
