"""The walls beside the sides of the box: surfaces of the scene, and functions of the user."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from jax import Array

from jaxdem.errors import InputError
from jaxdem.numerics.tables import Window
from jaxdem.particles.surfaces import Cylinder, DistanceFunction, Plane, Surface, wedge
from jaxdem.particles.wall_times import WallInTime, WallTimes
from jaxdem.scene import Scene
from jaxdem.scene.walls import Wall
from jaxdem.setup.particles import ParticleSetup


def surfaces_of(wall: Wall) -> tuple[Surface, ...]:
    """The surfaces of a wall of the scene: two of a wedge, none of a mesh, else one."""
    if wall.kind == "mesh":
        return ()
    if wall.point is not None and wall.normal is not None:
        return (Plane(wall.point, wall.normal),)
    if wall.center is not None and wall.radius is not None:
        return (Cylinder(wall.center, wall.radius, wall.axis, wall.inside is not False),)
    return wedge(wall.apex or (), wall.directions or ())


def scene_surfaces(scene: Scene, functions: Sequence[Callable[[Array], Array]]) -> tuple[Surface, ...]:
    """The walls of the scene, then those given as functions.

    Args:
        scene: the scene.
        functions: signed distances, looked at by `wall_functions`.
    """
    surfaces = [surface for wall in scene.walls for surface in surfaces_of(wall)]
    return (*surfaces, *map(DistanceFunction, functions))


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


def wall_keys(scene: Scene) -> list[tuple[str, str]]:
    """Key and kind of the wall of the scene that each of its surfaces belongs to."""
    return [(f"walls.{k}", wall.kind) for k, wall in enumerate(scene.walls) for _ in surfaces_of(wall)]
