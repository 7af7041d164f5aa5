"""When each wall beside the sides of the box is there."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from jax import Array

from jaxdem.errors import InputError
from jaxdem.numerics.tables import Window
from jaxdem.particles.wall_times import WallInTime, WallTimes
from jaxdem.setup.particles import ParticleSetup
from jaxdem.setup.walls import surfaces_of


def wall_times(
    particles: ParticleSetup, functions: Sequence[Callable[[Array], Array]], interval: float
) -> WallTimes | None:
    """When each of the `scene_surfaces`, and then each mesh, is there; None where all always are.

    Args:
        particles: of the scene.
        functions: signed distances; those of `WallInTime` have their times.
        interval: coupling interval [s].

    Raises:
        InputError: a wall is there for less than an interval.
    """
    walls = particles.scene.walls
    given = [(f"walls.{k}", wall.begin or 0.0, wall.end or math.inf) for k, wall in enumerate(walls)]
    meshes = [k for k, wall in enumerate(walls) if wall.kind == "mesh"]
    count = [len(surfaces_of(wall)) for wall in walls] + [1] * len(functions) + [1] * len(meshes)
    for function in functions:
        timed = function if isinstance(function, WallInTime) else WallInTime(function)
        given.append(("walls", timed.begin, timed.end))
    given += [given[k] for k in meshes]
    for key, begin, end in given:
        check_presence(key, Window(begin, end), interval)
    for k in meshes:
        if walls[k].begin and walls[k].touch == "front":
            limit = (
                "a mesh with touch = front is there from the start: what would be behind it as it comes is not known"
            )
            raise InputError(f"walls.{k}.begin", walls[k].begin, limit, 'remove begin, or set touch = "both"')
    windows = [Window(begin, end) for (_, begin, end), n in zip(given, count, strict=True) for _ in range(n)]
    if all(window.is_always for window in windows):
        return None
    return WallTimes(tuple(windows), particles.contact.maximum_overlap)


def check_presence(key: str, window: Window, interval: float) -> None:
    """Refuses a wall that is there for less than a coupling interval [s]; `key` is that of its table."""
    if window.begin < 0.0 or window.end - window.begin < interval * (1.0 - 1e-9):
        limit = f"a wall must be there for at least a coupling interval of {interval:.4g} s, from 0 s on"
        given = f"{window.begin:g} s to {window.end:g} s"
        raise InputError(f"{key}.begin", given, limit, "lower begin, or raise end")
